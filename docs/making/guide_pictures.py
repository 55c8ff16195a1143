"""Pictures of the guide: displays of what the code of its pages has made."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

from thermocorr import displays

GUIDE = Path(__file__).parents[1] / "guide"
SHOWN = re.compile(r"`(\w+Display\.from_\w+\([^`]*\))\.plot\(\)`|\]\(\.\./_made/(\w+)\.png\)")
"""What a page calls, and the picture that it shows: as many of each, in the same order."""


def draw_all(folder: Path) -> None:
    """Draw the pictures of every page into `folder`."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    for page in sorted(GUIDE.glob("*.md")):
        shown = pictures(page)
        made = names_of(page) | {name: getattr(displays, name) for name in displays.__all__} if shown else {}
        for code, picture in shown:
            eval(code, made).plot()
            plt.savefig(folder / f"{picture}.png", dpi=90)
            plt.close("all")


def pictures(page: Path) -> list[tuple[str, str]]:
    """Code of each picture of a page, and its name."""
    found = SHOWN.findall(page.read_text(encoding="utf-8"))
    return list(zip([call for call, _ in found if call], [name for _, name in found if name], strict=True))


def names_of(page: Path) -> dict[str, Any]:
    """Names that the code of a page makes."""
    names: dict[str, Any] = {"__name__": "page"}
    with contextlib.redirect_stdout(io.StringIO()):
        for code in re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
            exec(code, names)
    return names
