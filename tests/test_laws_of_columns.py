"""Which law a recorded column acts by: as it is, late, its square, or the square of its distance from its mean."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import QuadraticCovariate


def late(x, time_constant, step=30.0):
    """First-order lag of regular steps, at rest with the first value."""
    kept = np.exp(-step / time_constant)
    return lfilter([1 - kept], [1, -kept], x, zi=[kept * x[0]])[0]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_column_late_is_not_told_as_its_square_late(seed):
    """Five days of a device that takes up moisture, with two gaps: of two laws nearly alike the likelier one."""
    rng, n = np.random.default_rng(seed), 5 * 2880
    t = 30.0 * np.arange(n)
    T = 23 + 1.2 * np.sin(2 * np.pi * t / 86_400) + 4 * late(rng.normal(size=n), 3600)
    humidity = 45 + 200 * late(late(rng.normal(size=n), 14_400), 600) + 4 * np.sin(2 * np.pi * t / 123_000)
    thermal = 0.6 * late(T - 23, 480) + 0.4 * late(T - 23, 10_800)
    y = 10 + 20e-6 * thermal + 0.5e-6 * late(humidity - 45, 21_600) + 1.5e-6 * rng.normal(size=n)
    X = pd.DataFrame({"temperature": T, "humidity": humidity}, index=pd.date_range("2025-06-02", periods=n, freq="30s"))
    kept = ~(((t >= 103_680) & (t < 107_280)) | ((t >= 267_840) & (t < 271_440)))
    X, y = X[kept], pd.Series(y[kept], X.index[kept])
    best = diagnose(DynamicBiasRegressor("temperature", max_gap="30 min").fit(X, y), X, y).best
    assert (best.kind, best.power) == ("lagged_covariate", 1)
    assert best.time_constants[0] == pytest.approx(21_600, rel=0.2)


@pytest.mark.parametrize("column", ["supply", "pressure"])
def test_curvature_about_the_usual_value_is_named(column):
    """Of a column that swings by a hundredth of its mean, whose own square is a straight line of it."""
    record = make_record(6000, effects=[(QuadraticCovariate(column), 1.0)], seed=31)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y)
    assert [(cause.effect.kind, cause.effect.column) for cause in found.causes] == [("quadratic_covariate", column)]
    better = model.with_effect(found.best).fit(X, y)
    assert better.residual_std_ == pytest.approx(record.attrs["noise"], rel=0.05)
