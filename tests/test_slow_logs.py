"""What the temperature does between its rows: how much of it a model feels, and what a diagnosis puts down to it."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicHermiteSpline

from thermocorr import DynamicBiasRegressor
from thermocorr.estimators.input_errors import felt_between_rows
from thermocorr.records import read_record

pytestmark = pytest.mark.newest


spec = importlib.util.spec_from_file_location("bench", Path(__file__).parents[1] / "benchmarks" / "slow_logs.py")
bench = importlib.util.module_from_spec(spec)
spec.loader.exec_module(bench)


def fitted(X, y, **options):
    model = DynamicBiasRegressor("temperature", **options).fit(X, y)
    return model, read_record(X, model.features_.layout(), y=y, quiet=True)


@pytest.mark.parametrize("irregular", [0.0, 0.4])
def test_it_is_what_a_finer_record_of_the_curve_would_move(irregular):
    """A room that swings within four rows; the curve in a record of sixteen rows for each."""
    rng = np.random.default_rng(3)
    seconds = np.cumsum(300 * (1 + irregular * rng.uniform(-1, 1, 3000)))
    T = 21 + 0.3 * np.sin(seconds / 250) + 0.2 * np.sin(seconds / 40_000)
    X = pd.DataFrame({"temperature": T, "t": seconds})
    y = 2 * T + 0.01 * rng.standard_normal(3000)
    model, record = fitted(X, y, time_constants=["20 min", "1 h"], degree=1, time="t", initial_state="equilibrium")
    model.coef_[1:3] = 0.5, 0.7  # bodies that the readings do not have
    rows, fine = np.arange(3000.0), np.arange(0, 2999.001, 1 / 16)
    slopes = np.gradient(T, seconds)
    times = np.interp(fine, rows, seconds)
    walk = {"curve": CubicHermiteSpline(seconds, T, slopes)(times), "line": np.interp(times, seconds, T)}
    lags = {
        name: model.features_.transform(pd.DataFrame({"temperature": values, "t": times}))[::16, 1:3]
        for name, values in walk.items()
    }
    moved = (lags["curve"] - lags["line"]) @ [0.5, 0.7]
    assert felt_between_rows(model, record).curve == pytest.approx(moved.std(), rel=0.1)
