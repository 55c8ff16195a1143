"""How much of the code the tests hold: small random changes, and whether the suite notices.

Each mutant changes one operator, constant, condition or statement of the named rooms in a copy of the checkout. The
tests that touch its line run first, quickest first. Mutants that these let live have to live through the rest of the
suite, after all others have been tried; examples are drawn alike each time. Each mutant is listed with its line and the
test that killed it. Survivors are to be judged: some change nothing (a tolerance, a speed).

Which tests touch which line is measured by one run of the suite under coverage.py (`pip install 'coverage>=7.14'`), and
kept with `--map` for later calls. A map of older code and tests costs time and nothing else: what it does not know runs
with the rest of the suite, where `--near` calls it a survivor.

    python benchmarks/mutants.py --mutants 200 --seed 0 --jobs 2 --map map.json
    python benchmarks/mutants.py --mutants 200 --seed 0 --near     # quicker; a survivor may not live through them all
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Queue

import pytest
from mutating.changes import Mutant, draw
from mutating.touched import SUITE, Touched, Watch

ROOT = Path(__file__).parents[1]
ROOMS = (
    "thermocorr/records", "thermocorr/files", "thermocorr/live/corrector.py", "thermocorr/live/advance.py",
    "thermocorr/live/state.py", "thermocorr/live/filled.py", "thermocorr/live/filled.py",
    "thermocorr/command/correct.py", "thermocorr/command/log_rows.py", "thermocorr/command/correct.py",
    "thermocorr/command/lines.py", "thermocorr/command/stopping.py",
)  # fmt: skip
NEAR = 75.0
"""Tests that touch the line run as long as this before all others do [s]."""
LONGEST = 60.0
"""A test hangs that takes so much longer than ten times its time without a mutant; so does what loads the tests [s]."""
LATE = "not tried"
"""Said of mutants for which no time was left."""
FORKS = multiprocessing.get_context("forkserver")
PACKAGES = [
    "pytest", "pandas", "pyarrow.parquet", "scipy.signal", "scipy.optimize", "scipy.interpolate", "sklearn.pipeline",
    "sklearn.preprocessing", "sklearn.linear_model", "sklearn.model_selection", "sklearn.compose",
]  # fmt: skip
"""What is loaded once for all mutants; nothing of this package."""


class Chosen:
    """A plugin of pytest that runs some tests in an order of ours, then the rest, and tells which one it runs."""

    def __init__(self, first: list[str], skipped: list[str], rest: bool, tell: Connection):
        self._place = {name: k for k, name in enumerate(first)}
        self._skipped, self._rest, self._tell = set(skipped), rest, tell

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Choose and sort."""
        chosen = [item for item in items if item.nodeid in self._place or self._rest]
        last = len(self._place)
        items[:] = sorted(
            (item for item in chosen if item.nodeid not in self._skipped),
            key=lambda item: self._place.get(item.nodeid, last),
        )

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Tell."""
        self._tell.send(nodeid)


def enter(copy: Path) -> None:
    """Make this process one that runs the copy's tests."""
    os.environ.update(HYPOTHESIS_PROFILE="derandomized", PYTHONDONTWRITEBYTECODE="1", PYTHONPATH=str(copy))
    os.chdir(copy)
    os.setpgid(0, 0)
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(copy))
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)


def run_tests(copy: Path, first: list[str], skipped: list[str], rest: bool, tell: Connection) -> None:
    """What a process does that judges a mutant."""
    enter(copy)
    where = SUITE if rest else list(dict.fromkeys(name.split("::")[0] for name in first))
    options = ["-x", "-q", "-p", "no:cacheprovider", *where]
    sys.exit(int(pytest.main(options, plugins=[Chosen(first, skipped, rest, tell)])))


def run_map(copy: Path, path: Path) -> None:
    """What the process does that makes the map."""
    enter(copy)
    with tempfile.TemporaryDirectory() as folder:
        watch = Watch(copy, Path(folder))
        pytest.main(["-q", "-p", "no:cacheprovider", *SUITE], plugins=[watch])
        watch.touched().save(path)


def killer(copy: Path, touched: Touched, first: list[str], skipped: list[str], rest: bool) -> str | None:
    """The test that fails or hangs first; None if all pass. In a process that has the packages that the tests need."""
    heard, tell = FORKS.Pipe(duplex=False)
    process = FORKS.Process(target=run_tests, args=(copy, first, skipped, rest, tell))
    process.start()
    tell.close()
    last, limit = "loading the tests", LONGEST
    with contextlib.suppress(EOFError):
        while heard.poll(limit):
            last = heard.recv()
            limit = LONGEST + 10 * touched.seconds.get(last, 0.0)
    process.join(5.0)
    status = process.exitcode
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid or 0, signal.SIGKILL)
    process.join()
    return None if status in (0, pytest.ExitCode.NO_TESTS_COLLECTED) else last


def judged(mutant: Mutant, touched: Touched, copies: Queue[Path], near: bool) -> tuple[bool, str]:
    """Whether the mutant lives through the quick tests that touch its line, or through all others; what is said."""
    copy = copies.get()
    target = copy / mutant.path
    before = target.read_text()
    lines = range(len(before.splitlines()) + 1) if mutant.lines is None else mutant.lines
    touching = [name for name in touched.tests(mutant.path, lines) if name not in touched.failed]
    quick = touched.within(touching, NEAR)
    try:
        target.write_text(mutant.source)
        if not near:
            found = killer(copy, touched, touching, quick, True)
            return found is None, found or "survives"
        found = killer(copy, touched, quick, [], False) if quick else None
        return found is None, found or f"lives through {len(quick)} of {len(touching)} tests that touch it"
    finally:
        target.write_text(before)
        copies.put(copy)


def map_of(copy: Path, path: Path) -> Touched:
    """The map that is kept at the path; made if there is none."""
    if not path.exists():
        if find_spec("coverage") is None:
            raise SystemExit("which tests touch which line is measured by coverage.py: pip install 'coverage>=7.14'")
        process = FORKS.Process(target=run_map, args=(copy, path))
        process.start()
        process.join()
    touched = Touched.load(path).there(copy)
    failing = killer(copy, touched, touched.failed, [], False) if touched.failed else None
    if failing is not None:
        raise SystemExit(f"{failing} fails without a mutant")
    print(f"{len(touched.fixtures)} tests, {sum(touched.seconds.values()):.0f} s under coverage.py", flush=True)
    return touched


def main() -> None:
    """Draw, try, list."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mutants", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--rooms", nargs="*", default=list(ROOMS))
    parser.add_argument("--near", action="store_true", help="only tests that touch the line: survivors may be fewer")
    parser.add_argument("--map", type=Path, help="file of which tests touch which line, made if absent")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no mutant after so long")
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    FORKS.set_forkserver_preload(PACKAGES)
    mutants = draw(options.mutants, random.Random(options.seed), ROOT, options.rooms)
    with tempfile.TemporaryDirectory() as folder:
        copies: Queue[Path] = Queue()
        for k in range(options.jobs):
            ignored = shutil.ignore_patterns(".git", "__pycache__", ".venv", ".*_cache", ".hypothesis", "*.ipynb")
            copies.put(copy := Path(shutil.copytree(ROOT, Path(folder) / f"copy{k}" / "main", ignore=ignored)))
        touched = map_of(copy, (options.map or Path(folder) / "map.json").absolute())
        tried, left, end = 0, mutants, time.monotonic() + 60 * options.minutes
        for near in (True, False)[: 1 if options.near else 2]:
            alive = []

            def outcome(mutant: Mutant, near: bool = near) -> tuple[bool, str]:
                return judged(mutant, touched, copies, near) if time.monotonic() < end else (not near, LATE)

            with ThreadPoolExecutor(options.jobs) as pool:
                for mutant, (lives, said) in zip(left, pool.map(outcome, left), strict=True):
                    tried += near and said != LATE
                    alive += [mutant] * lives
                    print(f"{said}: {mutant.path}:{mutant.line}: {mutant.what}", flush=True)
            left = alive
    print(f"{tried} mutants, {len(left)} live, {1 - len(left) / max(tried, 1):.1%} killed")


if __name__ == "__main__":
    main()
