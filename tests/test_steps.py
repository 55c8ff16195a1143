"""Steps between rows: those that are all alike, and gaps among others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from effect_records import temperatures

from thermocorr.records import Layout, gaps, read, read_record, times

N = 60


def record_of(X, **layout):
    return read_record(X, Layout(**layout), quiet=True)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
@pytest.mark.parametrize("late", [9.0, 11.0, 3.0])
def test_a_gap_far_behind_is_told_by_the_usual_step_of_the_first_rows(late, jitter, monkeypatch):
    """In steps as they are at first: of rows that come later, three times as far apart, a step of four is no gap."""
    monkeypatch.setattr(read, "_CHUNK", N // 5)
    steps = 10.0 * (1 + jitter * np.sin(np.arange(N)))
    steps[N // 2 :] *= 3.0
    steps[-3] = 10.0 * late
    notes = record_of(pd.DataFrame({"temperature": temperatures(), "t": np.cumsum(steps)}), time="t").notes
    assert any(f"Sampling has 1 gap, the first after row {N - 4}" in note for note in notes) == (late > 10)


@pytest.mark.parametrize("n", [2, 3, N])
@pytest.mark.parametrize("form", ["spans", "seconds", "dates"])
def test_a_step_that_all_rows_share_is_known_and_changes_nothing(n, form, monkeypatch):
    monkeypatch.setattr(times, "_CHUNK", 7)
    seconds = 1.5 * np.arange(n)
    index = pd.to_timedelta(seconds, unit="s") + (pd.Timestamp(2026, 1, 1) if form == "dates" else pd.Timedelta(0))
    even = record_of(pd.DataFrame({"temperature": temperatures()[:n]}, index=seconds if form == "seconds" else index))
    assert even.times.even_step == (None if even.times.ticks is None else 1.5)
    rows = [slice(0, n), slice(1, n), slice(n - 1, n), slice(0, 0), np.arange(n)]
    for where, before in [(each, b) for each in rows for b in (None, 0)]:
        if len(np.arange(n)[where]):
            known, plain = even.times, replace(even.times)
            assert np.array_equal(known.steps(where, before), plain.steps(where, before))
    if n == N and even.times.ticks is not None:
        uneven = replace(even.times, ticks=np.delete(even.times.ticks, 12), n=n - 1)
        assert uneven.even_step is None


@pytest.mark.parametrize("max_gap", [None, 50.0])
def test_a_gap_is_told_behind_many_runs_of_a_row_each(max_gap, monkeypatch):
    """No step of the first rows lies within a run, so none of them tells what is usual."""
    monkeypatch.setattr(read, "_CHUNK", 10)
    run = np.r_[np.arange(30), np.full(N - 30, 99)]
    seconds = np.where(run < 99, 60.0 * np.arange(N), 1800.0 + np.arange(N))
    seconds[45:] += 100.0
    X = pd.DataFrame({"temperature": temperatures(), "t": seconds, "run": run})
    record = record_of(X, time="t", run="run", max_gap=max_gap)
    assert len(record.segments) == 31 + (max_gap is not None)
    assert any("1 gap, the first after row 44" in note for note in record.notes) == (max_gap is None)


@pytest.mark.parametrize("form", ["spans", "seconds", "dates", "rows"])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_the_longest_step_tells_that_there_is_no_gap_and_where_there_is_one(form, jitter, monkeypatch):
    monkeypatch.setattr(times, "_CHUNK", 7)
    seconds = np.cumsum(10.0 * (1 + jitter * np.sin(np.arange(N))))
    for at, late in ((None, 0.0), (13, 500.0), (N - 1, 500.0), (1, 500.0)):
        moved = seconds + (0.0 if at is None else late * (np.arange(N) >= at))
        index = pd.to_timedelta(moved, unit="s") + (pd.Timestamp(2026, 1, 1) if form == "dates" else pd.Timedelta(0))
        frame = pd.DataFrame(
            {"temperature": temperatures(), "t": moved}, index=None if form in ("rows", "seconds") else index
        )
        layout = {"time": "t"} if form == "seconds" else {}
        record = record_of(frame, **layout)
        steps = record.times.steps(slice(0, N))[1:]
        assert record.times.longest_between_rows == steps.max()
        assert gaps.longest_gap(record, 60.0) == (steps.max() if steps.max() > 60.0 else 0.0)
        if form != "rows":  # rows that are passed over make longer steps than there are between rows
            holed = record_of(frame.assign(temperature=frame["temperature"].where(np.arange(N) % 11 != 5)), **layout)
            kept = np.delete(moved, holed.skipped)
            assert len(kept) < N and gaps.longest_gap(holed, 15.0) == pytest.approx(np.diff(kept).max(), abs=1e-6)
