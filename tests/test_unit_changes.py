"""A fitted record whose temperature changes its unit on the way: the fit says where, and is silent elsewhere."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, RecordWarning
from thermocorr.datasets import make_record
from thermocorr.estimators import unit_changes
from thermocorr.records import Layout, read_record

N = 2000
IN = {
    "kelvin": (lambda T: T + 273.15, lambda T: T - 273.15),
    "degF": (lambda T: 1.8 * T + 32.0, lambda T: (T - 32.0) / 1.8),
}


@pytest.fixture(scope="module")
def log():
    record = make_record(N, seed=4)
    return record[["temperature"]], record["reading"]


def said_of(temperature, **more):
    record = read_record(temperature.to_frame().assign(**more), Layout("temperature", run="run" if more else None))
    return unit_changes.unit_changes(record)


@pytest.mark.parametrize("other", IN)
@pytest.mark.parametrize("rows", [slice(1000, N), slice(1000, 1050), slice(1000, 1005)])
def test_a_change_of_the_unit_is_said_with_its_first_row(log, other, rows):
    X, y = log[0].copy(), log[1]
    X.iloc[rows, 0] = IN[other][0](X.iloc[rows, 0])
    with pytest.warns(RecordWarning, match=f"looks like {other} where degC was recorded before"):
        model = DynamicBiasRegressor("temperature", ["10 min"], screen=False).fit(X, y)
    (note,) = [note for note in model.notes_ if "recorded before" in note]
    assert f"at row 1000 ({X.index[1000]})" in note and "convert the rows" in note


@pytest.mark.parametrize("other", IN)
def test_a_record_that_begins_in_the_other_unit(log, other):
    T = log[0]["temperature"].copy()
    T.iloc[:700] = IN[other][0](T.iloc[:700])
    (said,) = said_of(T)
    assert f"at row 700 ({T.index[700]})" in said and f"degC where {other} was recorded before" in said


@pytest.mark.parametrize("first", [995, 1000, 1001, 1003, 1999 - 5])
def test_chunks_and_missing_rows_hide_nothing(log, first, monkeypatch):
    monkeypatch.setattr(unit_changes, "CHUNK", 100)
    T = log[0]["temperature"].copy()
    T.iloc[first:] += 273.15
    T.iloc[first - 3 : first - 1] = np.nan
    (said,) = said_of(T)
    assert f"at row {first} ({T.index[first]})" in said


def test_a_run_in_kelvin_among_others_is_found(log):
    T = log[0]["temperature"].copy()
    T.iloc[1200:] += 273.15
    (said,) = said_of(T, run=np.repeat(["a", "b", "c"], [600, 600, 800]))
    assert "at row 1200" in said


def test_real_jumps_and_single_rows_are_not_asked():
    """Chambers that go from 10 to 50 degC and back, again and again; an oven; a spike; a mild winter."""
    noise = np.random.default_rng(0).normal(0.0, 0.05, N)
    times = pd.date_range("2024-03-01", periods=N, freq="min", name="time")
    number = np.arange(N)
    quiet = {
        "chamber": np.where(number // 250 % 2, 50.0, 10.0),
        "oven": np.clip(20.0 + 0.3 * number, 20.0, 450.0),
        "spike": np.where(number == 900, 293.15, 20.0),
        "other steps": np.where(number > 900, 90.0, 20.0),
        "winter": -5.0 + 12.0 * np.sin(number / 230.0),
    }
    for name, T in quiet.items():
        assert not said_of(pd.Series(T + noise, times, name="temperature")), name
