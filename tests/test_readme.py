"""Every Python block of the README runs, and prints what the README says."""

from pathlib import Path

import pytest
from pages import run

README = Path(__file__).parents[1] / "README.md"


def test_readme_prints_what_it_says(tmp_path, monkeypatch):
    if not README.exists():
        pytest.skip("README.md is not besides the tests")
    monkeypatch.chdir(tmp_path)  # it writes a model file
    blocks = list(run(README.read_text(encoding="utf-8")))
    assert blocks
    for block in blocks:
        assert block.printed == block.expected, block.code
