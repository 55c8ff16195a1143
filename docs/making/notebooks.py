"""The committed notebooks as pages."""

from __future__ import annotations

import json
from pathlib import Path

_INDEX = """\
# Notebooks

Longer stories, with their outputs as they were when the notebooks were last executed (`python notebooks/build.py`).

```{toctree}
:maxdepth: 1

%s
```
"""


def copy(source: Path, target: Path) -> None:
    """Copy ``*.ipynb`` besides an index page; Sphinx reads only what lies below its own folder."""
    target.mkdir(exist_ok=True)
    names = []
    for path in sorted(source.glob("*.ipynb")):
        text = path.read_text(encoding="utf-8")
        json.loads(text)
        names.append(path.stem)
        _write(target / path.name, text)
    _write(target / "index.md", _INDEX % "\n".join(names))


def _write(path: Path, text: str) -> None:
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
