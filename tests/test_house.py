"""The house rules of CONTRIBUTING.md that a machine can read: floors, length of files, late imports, docstrings."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

import thermocorr
from thermocorr.effects import CATALOGUE

pytestmark = pytest.mark.newest

PACKAGE = Path(thermocorr.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
ROOT = Path(__file__).parents[1]
BESIDE = sorted(path for folder in ("tests", "benchmarks") for path in (ROOT / folder).rglob("*.py"))
FLOORS = {
    "equations": 0, "records": 1, "foreign": 1, "datasets": 1, "effects": 2, "estimators": 3, "files": 4, "pictures": 4,
    "cluster": 4, "firmware": 5, "pages": 5, "live": 5, "judgement": 6, "interactive": 7,
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


def at_module_level(tree):
    """What runs when the module is imported: bodies of functions are left out, and what only type checkers read."""
    for node in ast.iter_child_nodes(tree):
        for_checkers = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
        if not (for_checkers or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)):
            yield node
            yield from at_module_level(node)


def test_every_room_has_a_floor():
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert rooms == set(FLOORS)
    assert sorted(path.name for path in PACKAGE.glob("*.py")) == ["__init__.py", "__main__.py", "_version.py"]


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


def test_the_reader_of_imports_sees_every_form():
    code = (
        "import thermocorr.command.cli\nfrom ..records import x\nfrom .. import effects\nfrom . import y\n"
        "def f():\n    from thermocorr import judgement\n    from .z import a\nif True:\n    import numpy.linalg\n"
    )
    found = {name for _, name in imports(ast.parse(code), PACKAGE / "equations" / "new.py")}
    assert found == {
        "thermocorr.command.cli",
        "thermocorr.records",
        "thermocorr.effects",
        "thermocorr.equations",
        "thermocorr.judgement",
        "thermocorr.equations.z",
        "numpy.linalg",
    }


EXTRAS = {"thermocorr.interactive.browser.server": "uvicorn", "thermocorr.interactive.browser.guard": "starlette"}
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
def test_no_file_is_longer_than_400_lines(path):
    length = len(path.read_text(encoding="utf-8").splitlines())
    assert length <= 400, f"{path} has {length} lines"


@for_each(FILES)
def test_matplotlib_waits_until_something_is_drawn(path):
    loaded = [node for node in at_module_level(parsed(path)) if isinstance(node, ast.Import | ast.ImportFrom)]
    for node in loaded:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        assert not any(name.split(".")[0] == "matplotlib" for name in names), f"{path}:{node.lineno}"


def test_the_reader_of_module_level_sees_classes_and_branches_but_no_functions():
    code = "class A:\n    import a\ntry:\n    import b\nexcept E:\n    import c\n"
    code += "def f():\n    import d\nif TYPE_CHECKING:\n    import e\nclass B:\n    def g(self):\n        import h\n"
    found = [node.names[0].name for node in at_module_level(ast.parse(code)) if isinstance(node, ast.Import)]
    assert found == ["a", "b", "c"]


@pytest.mark.parametrize("name", thermocorr.__all__)
def test_everything_public_exists_and_says_what_it_is(name):
    thing = getattr(thermocorr, name)
    own = vars(thing).get("__doc__") if isinstance(thing, type) else thing.__doc__
    assert own, f"thermocorr.{name} has no docstring of its own"
    assert len(own.strip()) > 20


@for_each(FILES)
def test_every_module_says_what_it_is(path):
    tree = parsed(path)
    assert not tree.body or ast.get_docstring(tree)


OPEN = {
    "_asdict", "_fields", "_make", "_replace",  # of named tuples
    "_get_param_names", "_parameter_constraints", "_validate_params",  # of scikit-learn's estimators
}  # fmt: skip
"""Names with an underscore that are the documented way."""


def private_access(tree):
    """(line, code) of every use of a private name of another object: ``model._errors``, but not ``self._errors``."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or node.attr in OPEN:
            continue
        if node.attr.startswith("_") and not (node.attr.startswith("__") and node.attr.endswith("__")):
            owner = ast.unparse(node.value)
            if owner not in ("self", "cls", "super()"):
                yield node.lineno, ast.unparse(node)


@for_each(FILES)
def test_no_module_uses_what_another_object_keeps_to_itself(path):
    found = [f"{path}:{line}: {code}" for line, code in private_access(parsed(path))]
    assert not found, "make public what others need, with a docstring: " + ", ".join(found)


def test_the_reader_of_private_names_sees_them():
    code = "self._a; cls._b; super()._c; x._fields; x.__class__; model._errors; model.features_._layout(); self.x._d\n"
    found = [code for _, code in private_access(ast.parse(code))]
    assert sorted(found) == ["model._errors", "model.features_._layout", "self.x._d"]


LEANING = (
    "The same", "Its ", "Of ", "See ", "That ", "Both", "Their ", "It ", "These", "Those of a", "Those of one",
    "Those of several", "Those of some", "Which are", "Which lie", "All of them", "The one there", "The one that",
    "As they are", "As many", "As a ", "From where", "From which", "From a fitted", "From what `", "With these",
)  # fmt: skip
"""Beginnings that lean on the line before, which help() does not show."""


def docstrings(tree):
    """(line, text) of every docstring: of modules, classes, functions, and those that stand under a name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value.strip()


@for_each(FILES)
def test_a_docstring_stands_alone(path):
    for line, text in docstrings(parsed(path)):
        assert not text.startswith(LEANING), f"{path}:{line} begins with what stands elsewhere: {text.splitlines()[0]}"


def test_the_reader_of_docstrings_sees_every_form():
    code = (
        '"""a"""\nX = 1\n"""b"""\nclass C:\n    """c"""\n    x: int\n    """d"""\n    def f(self):\n        """e"""\n'
    )
    assert sorted(text for _, text in docstrings(ast.parse(code))) == ["a", "b", "c", "d", "e"]


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


def test_one_name_one_module():
    """No two modules have the same name; rooms and the modules in them may."""
    seen = {}
    for path in FILES:
        if path.name in ("__init__.py", "__main__.py"):
            continue
        assert path.name not in seen, f"{path} and {seen[path.name]}"
        seen[path.name] = path


def test_type_checkers_of_users_are_told_that_there_are_types():
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.skipif(not (PACKAGE.parent / "CITATION.cff").is_file(), reason="the checkout is not beside the package")
def test_the_version_to_cite_is_this_one():
    assert f"\nversion: {thermocorr.__version__}\n" in (PACKAGE.parent / "CITATION.cff").read_text(encoding="utf-8")


def test_help_is_quick():
    """Neither the command's help nor the package loads what only work needs."""
    code = "import sys, thermocorr, thermocorr.command.cli; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "scipy", "pandas", "sklearn", "matplotlib", "pyarrow", "numba"} & set(loaded)


TOP_LEVEL = {
    "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md", "SECURITY.md", "pyproject.toml",
    "benchmarks", "docs", "notebooks", "tests", "thermocorr",
}  # fmt: skip


def test_nothing_strange_stands_at_the_top_of_the_checkout():
    listed = subprocess.run(["git", "ls-files"], cwd=PACKAGE.parent, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    tops = {name.split("/")[0] for name in listed.stdout.splitlines()}
    assert {name for name in tops if not name.startswith(".")} == TOP_LEVEL


@for_each([p for p in FILES if module_of(p).startswith("thermocorr.firmware")])
def test_an_export_does_not_read_back_what_it_printed(path):
    """What the code needs is known from what asks for it; expressions are for the user's words, in `names`."""
    if module_of(path) != "thermocorr.firmware.target":
        used = [node.attr for node in ast.walk(parsed(path)) if isinstance(node, ast.Attribute)]
        assert not {"findall", "fullmatch", "finditer", "replace", "partition", "find"} & set(used)
        assert "import re\n" not in path.read_text()


def test_one_name_one_class():
    """No two classes have the same name, wherever they stand."""
    seen = {}
    for path in FILES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ClassDef):
                assert node.name not in seen, f"{node.name}: {path}:{node.lineno} and {seen[node.name]}"
                seen[node.name] = f"{path}:{node.lineno}"


def positional(tree, most=5):
    """(line, code) of every construction with more positional arguments than a reader can keep apart."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and len(node.args) > most:
            name = ast.unparse(node.func).split(".")[-1]
            if name[:1].isupper() or name == "cls":
                yield node.lineno, name


@for_each(FILES)
def test_what_is_built_of_many_parts_names_them(path):
    found = [f"{path}:{line}: {name}(...)" for line, name in positional(parsed(path))]
    assert not found, "pass by name: " + ", ".join(found)


def test_the_reader_of_constructions_sees_them():
    code = "a.Line(1, 2, 3, 4, 5, 6); Line(1, 2, 3, 4, 5); f(1, 2, 3, 4, 5, 6); cls(1, 2, 3, 4, 5, 6)"
    assert list(positional(ast.parse(code))) == [(1, "Line"), (1, "cls")]


def thresholds(tree):
    """(line, name) of public numbers at the top of a module."""
    for node in tree.body:
        value = getattr(node, "value", None)
        numbers = value.elts if isinstance(value, ast.Tuple) else [value]
        if isinstance(node, ast.Assign) and all(
            isinstance(one, ast.Constant) and isinstance(one.value, int | float) for one in numbers
        ):
            yield from ((node.lineno, ast.unparse(name)) for name in node.targets)


@for_each(sorted((PACKAGE / "judgement").glob("*.py")))
def test_thresholds_of_the_judgement_stand_in_files_of_their_own(path):
    if not path.stem.endswith("levels"):
        found = [name for _, name in thresholds(parsed(path)) if not name.startswith("_")]
        assert not set(found) - {"WIDTH"}, f"{path}: {found} belong to a file of levels"  # of lines of text


def test_the_reader_of_thresholds_sees_them():
    assert [name for _, name in thresholds(ast.parse("A = 1\nB = 2.0, 3\nC = 'x'\nD = f(1)\n"))] == ["A", "B"]


@for_each(FILES)
def test_nothing_in_a_module_is_named_twice(path):
    """A second constant of a name would change what the first one stood for."""
    tree = parsed(path)
    names = [ast.unparse(name) for node in tree.body if isinstance(node, ast.Assign) for name in node.targets]
    names += [ast.unparse(node.target) for node in tree.body if isinstance(node, ast.AnnAssign)]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names += [node.name] * (not any(ast.unparse(one) == "overload" for one in node.decorator_list))
    assert not [name for name in {*names} if names.count(name) > 1 and name.isidentifier()]


WORDS = {"delay", "drift", "events", "lead", "rate", "step"}
"""Kinds that are words of other things as well: an aspect, a column of a table."""
OWN_WORDS = {"effects", "datasets"}
"""Rooms that may call kinds by name: their own, and that which plants them by formulas of its own."""


def kinds_by_name(tree):
    """(line, kind) of every text that is the kind of an effect."""
    kinds = {*CATALOGUE} - WORDS
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in kinds:
            yield node.lineno, node.value


@for_each([p for p in FILES if room(module_of(p)) not in OWN_WORDS])
def test_kinds_of_effects_are_classes_outside_their_room(path):
    found = {kind for _, kind in kinds_by_name(parsed(path))}
    if path.name == "migrations.py":  # as files of versions 5 and 12 have them
        found -= {"lag_products", "hinge"}
    assert not found, f"{path}: ask the class, or an attribute of it, not for {found}"


def test_the_reader_of_kinds_sees_them():
    assert list(kinds_by_name(ast.parse("a = kind in ('hysteresis', 'step')"))) == [(1, "hysteresis")]
