"""What the documentation promises about itself: every equation, effect and public name is in it."""

import ast
import importlib
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import thermocorr
from thermocorr import displays
from thermocorr.effects import CATALOGUE

DOCS = Path(__file__).parents[1] / "docs"
PACKAGE = Path(thermocorr.__file__).parent
DISPLAYS = [name for name in displays.__all__ if name.endswith("Display")]
"""All pictures."""
pytestmark = [
    pytest.mark.newest,
    pytest.mark.skipif(not (DOCS / "making").is_dir(), reason="docs is not besides the tests"),
]


@pytest.fixture
def making(monkeypatch):
    """Import a module of docs/making."""
    monkeypatch.syspath_prepend(str(DOCS))
    yield lambda name: importlib.import_module(f"making.{name}")
    for name in [name for name in sys.modules if name.split(".")[0] == "making"]:
        del sys.modules[name]


def test_every_equation_has_its_code_and_every_citation_its_equation(making):
    equations = making("equations")
    found = equations.citations(PACKAGE)
    assert set(found) == set(equations.WORDS)
    # what a reader looks for first, by hand
    assert "thermocorr.equations.leastsquares.solve_ridge" in found[13]
    assert "thermocorr.equations.lags.decays" in found[18]
    assert "thermocorr.equations.lags.lag_differences" in found[19]
    assert "thermocorr.model.regressor.DynamicBiasRegressor.correct" in found[24]


def test_the_reader_of_citations_knows_how_they_are_written(making):
    cited = making("equations").cited
    assert cited("x = 1  # eq. (25) times xi") == {25}
    assert cited("by eqs. (11)-(13) and (30)-(32).") == {11, 12, 13, 30, 31, 32}
    assert cited("eqs. (9) (26), and f(17)") == {9, 26}
    assert cited("seq. (3) and row (4)") == set()


def test_names_are_links_where_the_reference_has_them(making):
    equations = making("equations")
    text = equations.table(PACKAGE)
    assert "{py:obj}`solve_ridge <thermocorr.equations.solve_ridge>`" in text
    targets = re.findall(r"<(thermocorr[\w.]+)>`", text)
    written = documented(making)
    assert all(any(target == name or target.startswith(f"{name}.") for name in written) for target in targets)


def documented(making):
    """Names that the reference pages describe."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.md"))
    names = set(re.findall(r"^\.\. auto\w+:: (thermocorr[\w.]+)$", text, re.MULTILINE))
    return names | {f"thermocorr.effects.{effect.__name__}" for effect in CATALOGUE.values()}  # on their own pages


def test_every_public_name_is_in_the_reference(making):
    names = documented(making)
    described = {id(resolved(name)) for name in names}
    for module in making("equations").PUBLIC:
        room = importlib.import_module(module)
        for name in room.__all__:
            thing = getattr(room, name)
            if callable(thing):
                assert id(thing) in described, f"{module}.{name} has no place in docs/api"


def resolved(name):
    module, _, last = name.rpartition(".")
    return getattr(importlib.import_module(module), last)


def test_what_lies_beside_the_package_imports_what_there_is():
    """Nothing but a build of the pages runs docs/making, and nothing but a long run the benchmarks."""
    for path in [*(DOCS / "making").glob("*.py"), *(DOCS.parent / "benchmarks").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "thermocorr":
                room = importlib.import_module(node.module)
                for alias in node.names:
                    there = hasattr(room, alias.name) or find_spec(f"{node.module}.{alias.name}")
                    assert there, f"{path}:{node.lineno}: {node.module} has no {alias.name}"


def test_the_example_of_an_effect_page_runs_and_the_effect_removes_what_was_planted(making):
    effects = making("effects")
    for kind in CATALOGUE:
        printed, names = effects.executed(effects.example(kind, effects.planted(kind)[2]))
        assert printed.count("residual") == 2
        noise = names["record"].attrs["noise"]
        # the residual falls to the noise: 7200 samples know a standard deviation to a percent
        assert names["better"].residual_std_ == pytest.approx(noise, rel=0.05)
        assert names["model"].residual_std_ > 1.1 * noise
        assert type(names["better"].features_.effect_list()[-1]) is CATALOGUE[kind]


def test_the_reference_of_the_command_line_has_every_command_and_option(making, tmp_path):
    making("commands").write_page(tmp_path / "commands.md")
    text = (tmp_path / "commands.md").read_text(encoding="utf-8")
    for name in ("analyze", "correct", "workbench", "propose", "export-c"):
        assert f"## thermocorr {name}" in text
    for option in ("--refine", "--follow", "--effects", "--timezone", "--names"):
        assert option in text


def test_every_picture_is_shown_somewhere_in_the_guide():
    shown = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "guide").glob("*.md"))
    assert [name for name in DISPLAYS if name not in shown] == []


@pytest.mark.parametrize("name", DISPLAYS)
def test_every_picture_is_in_the_reference(name, making):
    assert f"thermocorr.displays.{name}" in documented(making), f"docs/api/judgement.md has no autoclass of {name}"
