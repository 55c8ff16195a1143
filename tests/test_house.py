"""The house rules of CONTRIBUTING.md that a machine can read: floors, circles, length of files."""

import ast
import importlib
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

import thermocorr

pytestmark = pytest.mark.newest

PACKAGE = Path(thermocorr.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
ROOT = Path(__file__).parents[1]
BESIDE = sorted(path for folder in ("tests", "benchmarks") for path in (ROOT / folder).rglob("*.py"))
FLOORS = {
    "equations": 0, "records": 1, "readers": 1, "datasets": 1, "effects": 2, "model": 3, "output": 4,
    "firmware": 5, "live": 5, "judgement": 6, "workbench": 7,
    "command": 8,
}  # fmt: skip
TOP = "thermocorr"


def for_each(paths):
    """Decorator of a test of one file: all are tested at once, and those named for which it fails."""

    def of_one(test):
        def of_all():
            wrong = []
            for path in paths:
                try:
                    test(path)
                except (AssertionError, ImportError) as error:
                    wrong.append(f"{path}: {error}")
            assert not wrong, "\n".join(wrong)

        of_all.__name__, of_all.__doc__ = test.__name__, test.__doc__
        return of_all

    return of_one


def room(module):
    """The room that a module of the package stands in: thermocorr.effects.thermal -> effects; None for the package."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[1] in FLOORS else None


def module_of(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(tree, path):
    """(line, full name) of every import, at any depth; ``from .. import x`` counts as an import of ..x."""
    package = module_of(path).split(".") if path.name == "__init__.py" else module_of(path).split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            for alias in node.names:  # names of modules, or what is in a module
                inner = ".".join([*base, alias.name])
                yield node.lineno, inner if base == [TOP] or inner in MODULES else ".".join(base)


MODULES = {module_of(path) for path in FILES}


@cache
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def test_every_room_has_a_floor():
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert rooms == set(FLOORS)
    assert sorted(path.name for path in PACKAGE.glob("*.py")) == [
        "__init__.py",
        "__main__.py",
        "_version.py",
        "displays.py",
        "validation.py",
    ]


@for_each(FILES)
def test_no_floor_imports_a_higher_one(path):
    own = room(module_of(path))
    if own is None:
        return  # thermocorr/__init__.py shows every floor
    for line, name in imports(parsed(path), path):
        if name.split(".")[0] != TOP:
            continue
        if name == f"{TOP}._version":
            continue  # below every room
        floor = FLOORS.get(room(name), max(FLOORS.values()))  # the package itself stands over every room
        assert floor <= FLOORS[own], f"{path}:{line}: {own} (floor {FLOORS[own]}) imports {name}"


EXTRAS = {"thermocorr.workbench.screen.server": "uvicorn"}
"""Modules that cannot be imported without an extra; whoever wants them says so."""


@for_each(FILES)
def test_every_module_can_be_imported(path):
    name = module_of(path)
    if name not in EXTRAS or find_spec(EXTRAS[name]) is not None:
        importlib.import_module(name)


@for_each(sorted((PACKAGE / "equations").rglob("*.py")))
def test_equations_need_numpy_and_scipy_alone(path):
    for line, name in imports(parsed(path), path):
        top = name.split(".")[0]
        allowed = {"numpy", "scipy"} | set(sys.stdlib_module_names)
        if path.name == "compiled.py":
            allowed.add("numba")  # an accelerator, looked for when it is first used
        assert top in allowed or name.startswith(f"{TOP}.equations"), f"{path}:{line} imports {name}"


@for_each([*FILES, *BESIDE])
def test_no_file_is_longer_than_800_lines(path):
    length = len(path.read_text(encoding="utf-8").splitlines())
    assert length <= 800, f"{path} has {length} lines"


def test_there_are_no_circular_imports():
    """Imports between modules, those inside functions too, make no circle."""
    names = {module_of(path) for path in FILES}
    arrows = {}
    for path in FILES:
        own = module_of(path)
        if own == TOP:
            continue  # shows every room
        arrows[own] = {name for _, name in imports(parsed(path), path) if name in names} - {own, TOP}
    left = dict(arrows)
    while left:
        free = {own for own, others in left.items() if not others & set(left)}
        assert free, f"these import each other: {sorted(left)}"
        left = {own: others for own, others in left.items() if own not in free}


def test_type_checkers_of_users_are_told_that_there_are_types():
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.skipif(not (PACKAGE.parent / "CITATION.cff").is_file(), reason="the checkout is not besides the package")
def test_the_version_to_cite_is_this_one():
    assert f"\nversion: {thermocorr.__version__}\n" in (PACKAGE.parent / "CITATION.cff").read_text(encoding="utf-8")


def test_help_is_quick():
    """Neither the command's help nor the package loads what only work needs."""
    code = "import sys, thermocorr, thermocorr.command.cli; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "scipy", "pandas", "sklearn", "matplotlib", "pyarrow", "numba"} & set(loaded)
