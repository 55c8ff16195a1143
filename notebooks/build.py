"""Make the notebooks from their texts, execute them top to bottom, and keep their outputs.

    python notebooks/build.py                    # writes every notebook
    python notebooks/build.py 03_hidden_effect   # one of them
    python notebooks/build.py --check            # executes them and writes nothing; fails where a cell fails

A text is Markdown; its Python blocks are the cells. Measured records are read from the folder that the environment
variable THERMOCORR_RECORDS names. Needs `pip install '.[notebooks]'`.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import re
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
TEXTS = HERE / "texts"
_BLOCK = re.compile(r"^```python\n(.*?)^```\n?", re.DOTALL | re.MULTILINE)
_MACHINE = re.compile(r"(?:/(?:home|root|tmp|usr|opt|work|Users|private)/|[A-Z]:\\\\)[\w.]")
"""What a path on somebody's machine looks like."""


def cells(text: str) -> list[tuple[str, str]]:
    """(kind, source) of every cell of a text: "markdown" and "code" take turns where there is something to say."""
    parts = _BLOCK.split(text)  # text, code, text, code, ..., text
    kinds = ("markdown", "code")
    return [(kinds[i % 2], part.strip("\n")) for i, part in enumerate(parts) if part.strip()]


def notebook(text: str) -> Any:
    """The notebook of a text, not yet executed; identifiers of cells count, so that differences stay readable."""
    import nbformat

    make = {"markdown": nbformat.v4.new_markdown_cell, "code": nbformat.v4.new_code_cell}
    made = [make[kind](source, id=f"cell-{i}") for i, (kind, source) in enumerate(cells(text), 1)]
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return nbformat.v4.new_notebook(cells=made, metadata={**kernel, "language_info": {"name": "python"}})


def execute(made: Any) -> Any:
    """Execute a notebook in a fresh kernel, in the folder of the notebooks; without the marks of time and machine."""
    from nbclient import NotebookClient

    NotebookClient(made, timeout=300, resources={"metadata": {"path": str(HERE)}}, record_timing=False).execute()
    made.metadata["language_info"] = {"name": "python"}
    for cell in made.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            cell.outputs = _merged(cell.outputs)
            for output in cell.outputs:
                if "image/png" in output.get("data", {}):
                    output["data"]["image/png"] = _smaller(output["data"]["image/png"])
                    output["data"].pop("text/plain", None)
    return made


def _merged(outputs: list[Any]) -> list[Any]:
    """What was printed in pieces, in one piece."""
    merged: list[Any] = []
    for output in outputs:
        last = merged[-1] if merged else {}
        if output.output_type == "stream" and last.get("name") == output.name:
            last["text"] += output.text
        else:
            merged.append(output)
    return merged


def _smaller(png: str) -> str:
    """The picture with a palette of 128 colours: a third of the size, and nobody sees the difference."""
    from PIL import Image

    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    file = io.BytesIO()
    picture.quantize(128, dither=Image.Dither.NONE).save(file, "png", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


def machine_paths(made: Any) -> list[str]:
    """Outputs that tell where they were made."""
    outputs = json.dumps([cell.get("outputs", []) for cell in made["cells"]])
    return [outputs[max(found.start() - 40, 0) : found.end() + 40] for found in _MACHINE.finditer(outputs)]


def main(arguments: list[str]) -> int:
    """Build or check; the exit status is the number of notebooks that fail."""
    import nbformat
    from nbclient.exceptions import CellExecutionError

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="notebooks, by default all")
    parser.add_argument("--check", action="store_true", help="write nothing")
    options = parser.parse_args(arguments)
    failed = 0
    for path in [TEXTS / f"{name}.md" for name in options.names] or sorted(TEXTS.glob("*.md")):
        began = time.perf_counter()
        try:
            made = execute(notebook(path.read_text(encoding="utf-8")))
        except CellExecutionError as error:
            print(f"{path.stem}: {error}", file=sys.stderr)
            failed += 1
            continue
        told = machine_paths(made)
        failed += bool(told)
        for text in told:
            print(f"{path.stem}: an output names a path of this machine: {text}", file=sys.stderr)
        if not options.check and not told:
            nbformat.write(made, HERE / f"{path.stem}.ipynb")
        print(f"{path.stem}: {time.perf_counter() - began:.1f} s", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
