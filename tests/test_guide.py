"""Every Python block of the guide runs, and prints what the guide says."""

from pathlib import Path

import pytest
from pages import needs, rewritten, run

GUIDE = Path(__file__).parents[1] / "docs" / "guide"
PAGES = sorted(GUIDE.glob("*.md"))
EXTRAS = {"distributed": "distributed", ".plot(": "matplotlib", "workbench(": "anywidget"}
"""What a page mentions -> the module that it needs then."""


@pytest.mark.skipif(not GUIDE.is_dir(), reason="docs/guide is not besides the tests")
def test_there_is_a_guide():
    assert len(PAGES) >= 8


@pytest.mark.newest
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_prints_what_it_says(page, tmp_path, monkeypatch):
    text = page.read_text(encoding="utf-8")
    for mention, module in EXTRAS.items():
        if needs(text, mention):
            pytest.importorskip(module, reason=f"the page needs {module}: pip install '.[all]'")
    monkeypatch.chdir(tmp_path)  # pages that write files write them here
    blocks = list(run(text))
    assert blocks, "a page of the guide shows no code"
    for block in blocks:
        assert block.printed == block.expected, block.code
    assert text.count("```text") == sum(bool(block.expected) for block in blocks), "a text block belongs to no code"


def test_what_code_prints_is_compared_and_can_be_written():
    page = "Text.\n\n```python\nx = 2\n```\n\n```python\nprint(x + 1)\n```\n\n```text\n4\n```\n\nMore.\n"
    assert [(block.expected, block.printed) for block in run(page)] == [("", ""), ("4", "3")]
    assert rewritten(page) == page.replace("\n4\n", "\n3\n")
    assert rewritten("```python\nprint(1)\n```\n") == "```python\nprint(1)\n```\n\n```text\n1\n```\n"
