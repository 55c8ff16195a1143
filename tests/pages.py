"""Pages whose Python blocks run: what a block prints stands in the text block right below it.

    python tests/pages.py docs/guide/missing.md

writes what the code prints now into the page (look at the difference before you keep it).
"""

import contextlib
import io
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_CODE = re.compile(r"^```python\n(?P<code>.*?)^```\n(?:\n```text\n(?P<expected>.*?)^```\n)?", re.DOTALL | re.MULTILINE)


class Ran(NamedTuple):
    """A block of code, what the page says that it prints ("" where it says nothing), and what it printed."""

    code: str
    expected: str
    printed: str


def run(text: str) -> Iterator[Ran]:
    """Run the blocks of a page one after the other, in one namespace."""
    names: dict = {"__name__": "page"}
    for block in _CODE.finditer(text):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block["code"], "page", "exec"), names)
        lines = [line.rstrip() for line in printed.getvalue().strip("\n").splitlines()]
        yield Ran(block["code"], (block["expected"] or "").strip("\n"), "\n".join(lines))


def needs(text: str, module: str) -> bool:
    """Whether the code of a page mentions a module (or what stands for it)."""
    return any(module in block["code"] for block in _CODE.finditer(text))


def rewritten(text: str) -> str:
    """Return the page with what its code prints now."""
    printed = iter([ran.printed for ran in run(text)])

    def block(found: re.Match[str]) -> str:
        output = next(printed)
        return f"```python\n{found['code']}```\n" + (f"\n```text\n{output}\n```\n" if output else "")

    return _CODE.sub(block, text)


if __name__ == "__main__":
    for page in [Path(name).resolve() for name in sys.argv[1:]]:
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # blocks write files of their own
            new = rewritten(page.read_text(encoding="utf-8"))
        page.write_text(new, encoding="utf-8")
        print(f"{page}: written")
