"""Working out an effect that was just added: its parameters, further lags, the knee at freezing point."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, refine
from thermocorr.datasets import make_record
from thermocorr.effects import Hinge, LaggedCovariate
from thermocorr.judgement.adding import Errors
from thermocorr.judgement.worked_out import effects_of, worked_out

pytestmark = pytest.mark.newest

NOISE = 0.05


def late_column(*, times=(400.0, 12_000.0), n=12_000, seed=5):
    """A record that a column moves by two bodies, each by as much as 1 for one unit of it."""
    record = make_record(n, sampling_period=60.0, noise=NOISE, seed=seed)
    X = record.drop(columns="reading")
    flow = np.cumsum(np.random.default_rng(seed).normal(size=n)) / 30
    late = len(times) * flow
    for tau in times:
        a, lag = np.exp(-60.0 / tau), 0.0  # exact where the flow is a straight line between samples, eq. (25)
        for k in range(1, n):
            lag = a * lag - tau / 60.0 * (1 - a) * (flow[k] - flow[k - 1])
            late[k] += lag
    return X.assign(flow=flow), record["reading"] + late


def quiet(text):
    """Say nothing."""


def test_refinement_brings_the_error_to_the_floor():
    X, y = late_column(seed=6)
    result = refine(DynamicBiasRegressor("temperature"), X, y)
    assert result.model_.residual_std_ < 1.1 * NOISE
    assert any(len(getattr(effect, "time_constants", ())) >= 2 for effect in effects_of(result.model_))


def test_one_body_gets_no_second_lag():
    """Of ten records none: a lag is kept only if data that it was not learned from are better for it."""
    for seed in range(10):
        X, y = late_column(times=(3000.0,), n=4000, seed=seed)
        model = DynamicBiasRegressor("temperature", effects=[LaggedCovariate("flow", [2000.0])]).fit(X, y)
        _, better, effect = worked_out(model, X, y, Errors.of(model, X, y), effects_of(model)[0], quiet)
        assert better.held_out < 1.2 * NOISE
        assert effect.time_constants == [pytest.approx(3000.0, rel=0.1)]


def test_a_knee_elsewhere_stays_there():
    record = make_record(6000, sampling_period=600.0, setting="outdoor", noise=NOISE, seed=9)
    T = record["temperature"] - record["temperature"].mean()
    y = record["reading"] + 0.4 * np.maximum(T - 3.0, 0.0)
    X = pd.DataFrame({"air_temp_degC": T}, index=record.index)
    model = DynamicBiasRegressor("air_temp_degC", effects=[Hinge(2.5)]).fit(X, y)
    _, _, effect = worked_out(model, X, y, Errors.of(model, X, y), Hinge(2.5), quiet)
    assert effect.knee == pytest.approx(3.0, abs=0.2)
