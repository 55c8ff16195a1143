"""A part of `benchmarks/live_cases.py`: random streams say what the whole record says."""

import importlib.util
import sys
from collections import Counter
from pathlib import Path
from unittest import mock

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
spec = importlib.util.spec_from_file_location("bench", BENCHMARKS / "live_cases.py")
bench = importlib.util.module_from_spec(spec)
with mock.patch.object(sys, "path", [str(BENCHMARKS), *sys.path]):
    spec.loader.exec_module(bench)

SEED = 7


@pytest.mark.newest
@pytest.mark.parametrize("number", [*range(20), *(pytest.param(k, marks=pytest.mark.long) for k in range(20, 60))])
def test_a_stream_says_what_the_whole_record_says(number):
    """Fails? `python benchmarks/live_cases.py --seed 7 --only NUMBER` runs the case alone."""
    assert bench.case(SEED, number, Counter()) == []


def test_the_cases_are_of_every_kind():
    """Rows that must be refused, damaged dates, logs in files: nothing is left out by a turn of the generator."""
    counts = Counter()
    for number in (0, 1, 3, 4, 5, 6):
        bench.case(SEED, number, counts)
    assert {"stream cases", "rows cases", "command cases", "lines of files"} <= counts.keys()
    assert min(counts[f"{fate} rows"] for fate in ("damaged", "stale time", "backward time")) > 0


def test_a_wrong_corrector_is_found(monkeypatch):
    """A stream that forgets which row came last after a restart is no longer the whole record."""
    forget = bench.OnlineCorrector.from_state.__func__
    monkeypatch.setattr(
        bench.OnlineCorrector,
        "from_state",
        classmethod(lambda cls, model, state: forget(cls, model, {**state, "state": {**state["state"], "run": "x"}})),
    )
    assert any(bench.case(SEED, number, Counter()) for number in (3, 4, 5, 6))
