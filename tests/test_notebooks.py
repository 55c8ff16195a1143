"""The committed notebooks are those of their texts, executed in order, small, and tell nothing about a machine.

`notebooks/build.py --check` executes them; that takes minutes, and is a step of its own.
"""

import importlib.util
import json
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
TEXTS = sorted((NOTEBOOKS / "texts").glob("*.md"))
pytestmark = pytest.mark.skipif(not TEXTS, reason="notebooks is not besides the tests")


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("notebooks_build", NOTEBOOKS / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_text_has_its_notebook():
    assert [path.stem for path in TEXTS] == [path.stem for path in sorted(NOTEBOOKS.glob("*.ipynb"))]
    assert len(TEXTS) >= 5


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_notebook_is_that_of_its_text_and_was_executed_in_order(path, build):
    committed = NOTEBOOKS / f"{path.stem}.ipynb"
    made = json.loads(committed.read_text(encoding="utf-8"))
    own = [(cell["cell_type"], "".join(cell["source"])) for cell in made["cells"]]
    assert own == build.cells(path.read_text(encoding="utf-8")), "run: python notebooks/build.py"
    code = [cell for cell in made["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert outputs
    assert not [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"]
    assert not build.machine_paths(made)
    assert committed.stat().st_size < 500_000


def test_paths_of_a_machine_are_seen(build):
    def output(text):
        return {"cells": [{"outputs": [{"output_type": "stream", "text": [text]}]}, {"source": "/tmp/free"}]}

    for text in ("/home/ann/log.csv", "in /tmp/x/y.py:3", "C:\\Users\\ann"):
        assert build.machine_paths(output(text))
    for text in ("ppm/K", "1/(K/s)", "and/or", "/"):
        assert not build.machine_paths(output(text))


def test_a_text_becomes_cells(build):
    assert build.cells("# A\n\nb\n\n```python\nx = 1\n```\n\n```python\nx\n```\n\nend\n") == [
        ("markdown", "# A\n\nb"),
        ("code", "x = 1"),
        ("code", "x"),
        ("markdown", "end"),
    ]
