"""Pictures of the guide: displays of what the code of its pages has made."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

from thermocorr import displays

GUIDE = Path(__file__).parents[1] / "guide"
PARTS = re.compile(
    r"^```python\n(?P<code>.*?)^```|`(?P<call>\w+Display\.from_\w+\([^`]*\))\.plot\(\)`|\]\(\.\./_made/(?P<picture>\w+)\.png\)",
    re.DOTALL | re.MULTILINE,
)
"""Code of a page, the call that draws a picture, and the picture that it shows: as many of each, in the same order."""


def draw_all(folder: Path) -> None:
    """Draw the pictures of every page into `folder`, each from what the code above it has made."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    for page in sorted(GUIDE.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        if "](../_made/" not in text:
            continue
        names: dict[str, Any] = {"__name__": "page"}
        calls, pictures = [], []
        for part in PARTS.finditer(text):
            if part["code"]:
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(part["code"], names)
            elif part["call"]:
                calls.append(
                    eval(part["call"], {**names, **{name: getattr(displays, name) for name in displays.__all__}})
                )
            else:
                pictures.append(part["picture"])
        for display, picture in zip(calls, pictures, strict=True):
            display.plot()
            plt.savefig(folder / f"{picture}.png", dpi=90)
            plt.close("all")
