"""Which tests touch which line, and how long each takes.

The suite runs once under coverage.py, and so do the processes that it starts. What a fixture of a module or of the
session touches counts for every test that asks for it.
"""

from __future__ import annotations

import ast
import json
import os
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

PACKAGE = "thermocorr"
SUITE = ["--ignore=tests/test_notebooks.py"]


@dataclass(frozen=True)
class Touched:
    """The map; a fixture stands in it like a test."""

    seconds: dict[str, float]
    """Test -> how long it takes [s], without its fixtures."""
    fixtures: dict[str, list[str]]
    """Test -> fixtures of its module and of the session."""
    lines: dict[str, dict[str, str]]
    """Path -> test -> its lines, as bits of a hexadecimal number."""
    failed: list[str]
    """Tests that failed under coverage.py."""

    @classmethod
    def load(cls, path: Path) -> Touched:
        """Read what `save` has written."""
        return cls(**json.loads(path.read_text()))

    def save(self, path: Path) -> None:
        """Keep the map."""
        path.write_text(json.dumps(asdict(self)))

    def there(self, root: Path) -> Touched:
        """The map without tests whose files are gone: pytest would end with an error that looks like a mutant's."""
        tests = {name: wide for name, wide in self.fixtures.items() if (root / name.split("::")[0]).exists()}
        return Touched(self.seconds, tests, self.lines, [name for name in self.failed if name in tests])

    def tests(self, path: str, lines: range) -> list[str]:
        """Tests that touch any of the lines, quickest first; a module's expensive fixtures are made once.

        Tests of one function look alike: the second counts as twice as slow, and so on.
        """
        bits = sum(1 << line for line in lines)
        touch = {name for name, mask in self.lines.get(path, {}).items() if int(mask, 16) & bits}
        groups: dict[tuple[str, ...], list[str]] = defaultdict(list)
        alike: Counter[str] = Counter()
        price: dict[str, float] = {}
        for name in sorted(self.fixtures, key=self.seconds.__getitem__):
            if name in touch or not touch.isdisjoint(self.fixtures[name]):
                alike[name.split("[")[0]] += 1
                price[name] = self.seconds[name] * alike[name.split("[")[0]]
                wide = self.fixtures[name]
                groups[(name.split("::")[0], *wide) if wide else (name,)].append(name)
        made = {key: sum(self.seconds.get(fixture, 0.0) for fixture in key[1:]) for key in groups}
        order = sorted(groups, key=lambda key: made[key] + price[groups[key][0]])
        return [name for key in order for name in groups[key]]

    def within(self, tests: list[str], limit: float) -> list[str]:
        """The first of these tests, as many as take no longer than the limit [s]."""
        first, spent, made = [], 0.0, set()
        for name in tests:
            new = set(self.fixtures[name]) - made
            cost = self.seconds[name] + sum(self.seconds.get(fixture, 0.0) for fixture in new)
            if spent + cost <= limit:
                first.append(name)
                spent += cost
                made |= new
        return first


class Watch:
    """A plugin of pytest that notes lines and times, test by test."""

    def __init__(self, copy: Path, folder: Path):
        import coverage

        self._copy, self._folder, self._name = copy, folder, ""
        settings = folder / "settings"
        settings.write_text(
            f"[run]\nsource = {copy / PACKAGE}\nparallel = true\npatch = _exit\ndata_file = {folder / 'child'}\n"
        )
        os.environ["COVERAGE_PROCESS_START"] = str(settings)
        self._coverage = coverage.Coverage(data_file=None, source=[str(copy / PACKAGE)], config_file=False)
        self._coverage.start()
        self._seconds: Counter[str] = Counter()
        self._fixtures: dict[str, list[str]] = {}
        self._masks: dict[str, Counter[str]] = defaultdict(Counter)
        self._failed: list[str] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[Any]:
        """Note a test."""
        self._fixtures[item.nodeid] = list(getattr(item, "fixturenames", ()))
        with self._noted(item.nodeid):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[Any]:
        """Note a fixture that several tests share."""
        if fixturedef.scope == "function":
            return (yield)
        with self._noted(f"{fixturedef.baseid} {fixturedef.argname}"):
            return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a failure."""
        if report.failed:
            self._failed.append(report.nodeid)

    @contextmanager
    def _noted(self, name: str) -> Iterator[None]:
        outer, self._name, began = self._name, name, time.monotonic()
        self._coverage.switch_context(name)
        try:
            yield
        finally:
            self._seconds[name] += time.monotonic() - began
            if outer:
                self._seconds[outer] -= time.monotonic() - began
            self._coverage.switch_context(outer)
            self._name = outer
            self._read_children(name)

    def _read_children(self, name: str) -> None:
        """What processes have left that the test has started."""
        from coverage import CoverageData
        from coverage.exceptions import CoverageException

        for path in self._folder.glob("child.*"):
            data = CoverageData(str(path))
            try:
                data.read()
                for file in data.measured_files():
                    self._note(file, name, data.lines(file) or [])
            except CoverageException:
                continue  # being written, or killed while it was
            finally:
                data.close()
            path.unlink(missing_ok=True)

    def _note(self, file: str, name: str, lines: list[int]) -> None:
        masks = self._masks[str(Path(file).relative_to(self._copy))]
        masks[name] |= sum(1 << line for line in set(lines))

    def touched(self) -> Touched:
        """The map of what has run."""
        self._coverage.stop()
        data = self._coverage.get_data()
        for file in data.measured_files():
            by_name = defaultdict(list)
            for line, names in data.contexts_by_lineno(file).items():
                for name in names:
                    by_name[name].append(line)
            for name, lines in by_name.items():
                self._note(file, name, lines)
        shared = [name for name in self._seconds if name and name not in self._fixtures]
        fixtures = {
            test: [name for name in shared if name.split(" ")[1] in asked and test.startswith(name.split(" ")[0])]
            for test, asked in self._fixtures.items()
        }
        lines = {}
        for path, masks in self._masks.items():
            bodies = in_functions(self._copy / path)
            lines[path] = {name: f"{mask & bodies:x}" for name, mask in masks.items() if name and mask & bodies}
        return Touched(dict(self._seconds), fixtures, lines, sorted(set(self._failed)))


def in_functions(path: Path) -> int:
    """Lines in bodies of functions, as bits: the others are touched by who imports the module first."""
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    bodies = [range(node.body[0].lineno, (node.end_lineno or 0) + 1) for node in functions]
    return sum(1 << line for line in {line for body in bodies for line in body})
