"""How much of the code the tests hold: small random changes, and whether the suite notices.

Each mutant changes one operator, constant, condition or statement of the named rooms in a copy of the checkout. The
nearest tests run first; a mutant that these let live has to live through the whole suite, examples drawn alike each
time. Survivors are listed with their line, to be judged: some change nothing (a tolerance, a speed).

    python benchmarks/mutants.py --mutants 200 --seed 0 --jobs 2
    python benchmarks/mutants.py --mutants 200 --seed 0 --near     # quicker; a survivor may not live through them all
"""

from __future__ import annotations

import argparse
import ast
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

ROOT = Path(__file__).parents[1]
ROOMS = (
    "thermocorr/records", "thermocorr/files", "thermocorr/live/corrector.py", "thermocorr/live/advance.py",
    "thermocorr/live/state.py", "thermocorr/live/smoothing.py", "thermocorr/live/clock.py",
    "thermocorr/command/correct.py", "thermocorr/command/log_rows.py", "thermocorr/command/results.py",
    "thermocorr/command/lines.py", "thermocorr/command/stopping.py",
)  # fmt: skip
NEAR = {
    "records/": ("test_records", "test_bad_input", "test_tables", "test_fuzz_corpus", "test_parquet", "corpus"),
    "records/h": ("test_later_rows", "test_online", "test_model_file", "test_live_cases"),
    "records/re": ("test_records", "test_later_rows", "test_bad_input", "test_online", "test_samples"),
    "records/p": ("test_parquet", "corpus/test_parquet_corpus", "test_tables"),
    "records/l": ("corpus", "test_records", "test_parquet"),
    "files/": ("test_files", "test_interrupts", "test_crash"),
    "files/codec": ("corpus/test_json_corpus", "test_hostile_model_files", "test_model_file"),
    "files/effect_nodes": ("corpus/test_json_corpus", "test_hostile_model_files", "test_model_file"),
    "files/model": ("corpus/test_json_corpus", "test_hostile_model_files", "test_model_file"),
    "live/": ("test_online", "test_online_kinds", "test_averages", "test_live_cases", "corpus/test_json_corpus"),
    "command/": ("test_correct", "test_resuming", "test_interrupts", "test_fuzz_corpus", "test_cli"),
}
"""Beginning of a path -> test files that know the room best; the longest beginning counts."""
NEXT = (
    "test_records", "test_later_rows", "test_bad_input", "test_tables", "test_files", "test_parquet", "test_averages",
    "test_online", "test_online_kinds", "test_interrupts", "test_resuming", "test_model_file",
    "test_hostile_model_files", "corpus", "test_fuzz_corpus", "test_correct", "test_absurd_fits", "test_ecosystem",
    "test_cli", "test_live_cases", "test_small_doors", "test_crash",
)  # fmt: skip
"""Test files that run then."""
ALL = ["--ignore=tests/test_notebooks.py"]
LONGEST = 900.0
"""Tests that take longer hang [s]."""
FORKS = multiprocessing.get_context("forkserver")
PACKAGES = [
    "pytest", "pandas", "pyarrow.parquet", "scipy.signal", "scipy.optimize", "scipy.interpolate", "sklearn.pipeline",
    "sklearn.preprocessing", "sklearn.linear_model", "sklearn.model_selection", "sklearn.compose",
]  # fmt: skip
"""What is loaded once for all mutants; nothing of this package."""
SWAPS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,), ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,), ast.And: (ast.Or,), ast.Or: (ast.And,), ast.BitOr: (ast.BitAnd,),
    ast.BitAnd: (ast.BitOr,),
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change."""

    path: str
    line: int
    what: str
    source: str


def places(tree: ast.Module) -> list[ast.AST]:
    """Nodes that can be changed: no annotations, docstrings, messages of errors."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        hidden: list[ast.AST | None] = []
        if isinstance(node, ast.FunctionDef):
            hidden += [
                node.returns,
                *node.decorator_list,
                *(a.annotation for a in ast.walk(node.args) if isinstance(a, ast.arg)),
            ]
        if isinstance(node, ast.AnnAssign):
            hidden.append(node.annotation)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            hidden.append(node)
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
            hidden.append(node)
        for part in hidden:
            if part is not None:
                skipped.update(
                    id(inner) for inner in ast.walk(part) if inner is not node or isinstance(node, ast.JoinedStr)
                )
    kinds = (
        ast.Compare,
        ast.BinOp,
        ast.BoolOp,
        ast.UnaryOp,
        ast.Constant,
        ast.If,
        ast.Raise,
        ast.Return,
        ast.Expr,
        ast.Assign,
        ast.AugAssign,
    )
    return [node for node in ast.walk(tree) if isinstance(node, kinds) and id(node) not in skipped and changeable(node)]


def changeable(node: ast.AST) -> bool:
    """Whether there is a change that could matter."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, bool | int | float) or node.value is None
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Call)
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.Not | ast.USub)
    if isinstance(node, ast.BinOp | ast.BoolOp):
        return type(node.op) in SWAPS
    return not isinstance(node, ast.Return) or not (node.value is None or ast.unparse(node.value) == "None")


def changed(node: ast.AST, rng: random.Random) -> ast.AST:
    """Another node in its place."""
    if isinstance(node, ast.Compare):
        ops = list(node.ops)
        k = rng.randrange(len(ops))
        ops[k] = rng.choice(SWAPS[type(ops[k])])()
        return ast.Compare(node.left, ops, node.comparators)
    if isinstance(node, ast.BinOp):
        return ast.BinOp(node.left, rng.choice(SWAPS[type(node.op)])(), node.right)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(rng.choice(SWAPS[type(node.op)])(), node.values)
    if isinstance(node, ast.UnaryOp):
        return node.operand
    if isinstance(node, ast.Constant):
        return ast.Constant(other_value(node.value, rng))
    if isinstance(node, ast.If):
        return ast.If(ast.Constant(rng.choice([True, False])), node.body, node.orelse)
    if isinstance(node, ast.Return):
        return ast.Return(ast.Constant(None))
    return ast.Pass()


def other_value(value: object, rng: random.Random) -> object:
    """Another constant of the same kind."""
    if value is None:
        return 0
    if isinstance(value, bool):
        return not value
    if value == 0.0 and isinstance(value, float):
        return 1.0
    return value + rng.choice([-1, 1]) if isinstance(value, int) else value * rng.choice([0.5, 2.0])  # type: ignore[operator]


class Replace(ast.NodeTransformer):
    """Puts one node in another's place."""

    def __init__(self, old: ast.AST, new: ast.AST):
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return ast.copy_location(self.new, node) if node is self.old else self.generic_visit(node)


def draw(count: int, rng: random.Random, rooms: list[str]) -> list[Mutant]:
    """Random mutants, each place with the same chance."""
    files = sorted(
        p for room in rooms for p in ([ROOT / room] if room.endswith(".py") else (ROOT / room).rglob("*.py"))
    )
    everywhere = [(path, k) for path in files for k in range(len(places(ast.parse(path.read_text()))))]
    mutants = []
    for path, k in rng.sample(everywhere, min(count, len(everywhere))):
        tree = ast.parse(path.read_text())
        old = places(tree)[k]
        new = changed(old, rng)
        before, after = (ast.unparse(ast.fix_missing_locations(node)).splitlines()[0][:70] for node in (old, new))
        what = f"{before}  ->  {after}"
        source = ast.unparse(ast.fix_missing_locations(Replace(old, new).visit(tree)))
        mutants.append(Mutant(str(path.relative_to(ROOT)), old.lineno, what, source))
    return mutants


def survives(copy: Path, tests: list[str]) -> bool:
    """Whether the tests pass; ones that hang do not. In a process that has the packages that the tests need."""
    process = FORKS.Process(target=run_tests, args=(copy, tests))
    process.start()
    process.join(LONGEST)
    if process.exitcode is None:
        process.kill()
        process.join()
    return process.exitcode == 0


def run_tests(copy: Path, tests: list[str]) -> None:
    """What that process does."""
    os.environ.update(HYPOTHESIS_PROFILE="derandomized", OMP_NUM_THREADS="1", PYTHONDONTWRITEBYTECODE="1")
    os.chdir(copy)
    os.setpgid(0, 0)
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(copy))
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)
    import pytest

    sys.exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests])))


def near(path: str) -> list[str]:
    """Test files in the order in which a mutant of this file meets them."""
    room = path.removeprefix("thermocorr/")
    first = NEAR[max((begin for begin in NEAR if room.startswith(begin)), key=len)]
    return [f"tests/{name}" if name == "corpus" else f"tests/{name}.py" for name in dict.fromkeys((*first, *NEXT))]


def judged(mutant: Mutant, copies: Queue[Path], whole: bool) -> bool:
    """Whether the mutant lives through the nearest tests, and then through all if the whole suite is asked for."""
    copy = copies.get()
    target = copy / mutant.path
    before = target.read_text()
    try:
        target.write_text(mutant.source)
        return survives(copy, near(mutant.path)) and not (whole and not survives(copy, ALL))
    finally:
        target.write_text(before)
        copies.put(copy)


def main() -> None:
    """Draw, try, list."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mutants", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--rooms", nargs="*", default=list(ROOMS))
    parser.add_argument("--near", action="store_true", help="only the nearest tests: survivors may be fewer")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no mutant after so long")
    options = parser.parse_args()
    FORKS.set_forkserver_preload(PACKAGES)
    mutants, end = draw(options.mutants, random.Random(options.seed), options.rooms), 60 * options.minutes
    began, tried, lives = time.monotonic(), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        copies: Queue[Path] = Queue()
        for k in range(options.jobs):
            ignored = shutil.ignore_patterns(".git", "__pycache__", ".venv", "*.ipynb")
            copies.put(Path(shutil.copytree(ROOT, Path(folder) / f"copy{k}" / "main", ignore=ignored)))

        def outcome(mutant: Mutant) -> bool | None:
            return judged(mutant, copies, not options.near) if time.monotonic() - began < end else None

        with ThreadPoolExecutor(options.jobs) as pool:
            for mutant, alive in zip(mutants, pool.map(outcome, mutants), strict=True):
                tried += alive is not None
                if alive:
                    lives += 1
                    print(f"survivor {lives} of {tried}: {mutant.path}:{mutant.line}: {mutant.what}", flush=True)
                elif alive is not None and tried % 20 == 0:
                    print(f"{tried} tried", flush=True)
    print(f"{tried} mutants, {1 - lives / max(tried, 1):.1%} killed")


if __name__ == "__main__":
    main()
