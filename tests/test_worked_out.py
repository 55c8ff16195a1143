"""Working out an effect that was just added: its parameters, further lags, the knee at freezing point."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, refine
from thermocorr.datasets import load_real_record, make_record
from thermocorr.effects import Covariate, Hinge, LaggedCovariate
from thermocorr.judgement.adding import Errors
from thermocorr.judgement.tuning import effects_of, fitted_with, tuned
from thermocorr.judgement.worked_out import worked_out

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


def test_a_column_that_acts_through_two_bodies_gets_both_lags():
    X, y = late_column()
    model = DynamicBiasRegressor("temperature", effects=[LaggedCovariate("flow", [3000.0])]).fit(X, y)
    errors = Errors.of(model, X, y)
    said = []
    longer, better, effect = worked_out(model, X, y, errors, LaggedCovariate("flow", [3000.0]), said.append)
    assert errors.held_out > 3 * NOISE and better.held_out < 1.2 * NOISE
    assert len(effect.time_constants) >= 2 and len(said) >= 1
    assert effect is effects_of(longer)[0] and better == Errors.of(longer, X, y)


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


@pytest.mark.parametrize(("unit", "factor", "zero"), [("degC", 1.0, 0.0), ("degF", 1.8, 32.0), ("K", 1.0, 273.15)])
def test_a_knee_near_freezing_point_is_freezing_point(unit, factor, zero):
    """Where the record cannot tell the two apart; in the unit of the temperature's name."""
    record = make_record(6000, sampling_period=600.0, setting="outdoor", noise=NOISE, seed=8)
    T = record["temperature"] - record["temperature"].mean()
    y = record["reading"] + 0.2 * np.maximum(T, 0.0)
    name = f"air_temp_{unit}"
    X = pd.DataFrame({name: factor * T + zero}, index=record.index)
    near = Hinge(zero + 0.3 * factor)
    model = DynamicBiasRegressor(name, effects=[near]).fit(X, y)
    _, _, effect = worked_out(model, X, y, Errors.of(model, X, y), near, quiet)
    assert effect.knee == zero


def test_a_knee_elsewhere_stays_there():
    record = make_record(6000, sampling_period=600.0, setting="outdoor", noise=NOISE, seed=9)
    T = record["temperature"] - record["temperature"].mean()
    y = record["reading"] + 0.4 * np.maximum(T - 3.0, 0.0)
    X = pd.DataFrame({"air_temp_degC": T}, index=record.index)
    model = DynamicBiasRegressor("air_temp_degC", effects=[Hinge(2.5)]).fit(X, y)
    _, _, effect = worked_out(model, X, y, Errors.of(model, X, y), Hinge(2.5), quiet)
    assert effect.knee == pytest.approx(3.0, abs=0.2)


def test_what_has_no_lags_of_its_own_stays_as_it_is():
    record = make_record(2000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", effects=[Covariate("humidity")]).fit(X, y)
    errors, added = Errors.of(model, X, y), Covariate("humidity")
    assert worked_out(model, X, y, errors, added, quiet) == (model, errors, added)


def test_tuning_moves_what_it_is_told_to_and_keeps_a_model_that_is_at_its_least():
    X, y = late_column(times=(3000.0,), n=4000)
    model = DynamicBiasRegressor("temperature", effects=[LaggedCovariate("flow", [1000.0]), Covariate("humidity")])
    model.fit(X, y)
    best = tuned(model, X, y, (0.5, 0.1, 0.03), [0], moves=8)
    assert best.residual_std_ < model.residual_std_
    assert effects_of(best)[0].time_constants == [pytest.approx(3000.0, rel=0.05)]
    assert tuned(best, X, y, (0.1,), [0]) is best
    assert tuned(model, X, y, (0.5,), []) is model
    assert fitted_with(model, [], X, y).effects == []


def test_the_ground_at_5_cm_freezes_at_0_degc(measured):
    """Soil below freezing air: a hinge at 0 degC with one lag has 0.62 K on the last 30 %, one at 3.2 degC 0.80."""
    soil = load_real_record("oldtown_soil", measured)
    X = soil.drop(columns=[name for name in soil.columns if name.startswith("soil_temp")])
    y, n = soil["soil_temp_5cm_degC"], int(0.7 * len(soil))
    given = Hinge(3.228, "above", [42_365.0])  # what diagnosis names
    model = DynamicBiasRegressor("air_temp_degC", effects=[given]).fit(X[:n], y[:n])
    model, _, effect = worked_out(model, X[:n], y[:n], Errors.of(model, X[:n], y[:n]), given, quiet)
    assert isinstance(effect, Hinge) and effect.knee == 0.0
    assert float(np.sqrt(np.nanmean(np.asarray(model.residuals(X[n:], y[n:])) ** 2))) <= 0.67
