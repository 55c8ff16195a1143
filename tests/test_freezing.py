"""A knee at freezing point: tried where what a diagnosis names may only stand for it."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, refine
from thermocorr.datasets import load_real_record, make_record
from thermocorr.effects import Hinge
from thermocorr.judgement.adding import Errors
from thermocorr.judgement.freezing import freezing_point, with_knee_at_freezing
from thermocorr.judgement.tuning import effects_of

pytestmark = pytest.mark.newest

NOISE = 0.05
TAU = 40_000.0


def freezing(*, name="air_temp_degC", factor=1.0, zero=0.0, bend=0.4, at=0.0, seed=8):
    """An outdoor record and a reading that bends at a temperature [degC], late by TAU."""
    record = make_record(6000, sampling_period=600.0, setting="outdoor", noise=NOISE, seed=seed)
    T = record["temperature"] - record["temperature"].mean()
    bent = Hinge(at, time_constants=[TAU])
    plain = pd.DataFrame({"air_temp_degC": T}, index=record.index)
    late = DynamicBiasRegressor("air_temp_degC", time_constants=[], effects=[bent]).fit(plain, record["reading"])
    column = late.features_.transform(plain)[:, -2:].sum(axis=1)  # the bent side, and its lag difference
    return pd.DataFrame({name: factor * T + zero}, index=record.index), record["reading"] + bend * column


def quiet(text):
    """Say nothing."""


def found(X, y, *effects):
    """What is found beside a model with some effects."""
    model = DynamicBiasRegressor(X.columns[0], effects=list(effects)).fit(X, y)
    errors = Errors.of(model, X, y)
    return model, errors, with_knee_at_freezing(model, X, y, errors, errors, quiet)


@pytest.mark.parametrize(("unit", "factor", "zero"), [("degC", 1.0, 0.0), ("degF", 1.8, 32.0), ("K", 1.0, 273.15)])
def test_the_knee_and_its_lag_are_found_in_the_unit_of_the_temperature(unit, factor, zero):
    _, before, kept = found(*freezing(name=f"air_temp_{unit}", factor=factor, zero=zero))
    model, errors, (knee,) = kept
    assert knee.knee == zero and 0.5 * TAU < knee.time_constants[0] < 2 * TAU
    assert errors.ratio(before) < 0.9 and model.residual_std_ < 1.2 * NOISE
    assert freezing_point(model) is None, "one is enough"


def test_nothing_is_found_where_nothing_freezes():
    X, y = freezing(bend=0.0)
    assert found(X, y)[2] is None and freezing_point(found(X, y)[0]) == 0.0
    X, y = freezing(at=6.0)  # a bend elsewhere is no bend at freezing point beside itself
    assert found(X, y, Hinge(6.0, time_constants=[TAU]))[2] is None


def test_the_ground_at_25_cm_freezes_too(measured):
    """A diagnosis names waves of months and products of lags; the record's last 30 % have 0.98 K without a knee.

    Every second row, which takes half the time; `benchmarks/real_diagnosis.py` has all of them.
    """
    soil = load_real_record("oldtown_soil", measured).iloc[::2]
    X = soil.drop(columns=[name for name in soil.columns if name.startswith("soil_temp")])
    y, n = soil["soil_temp_25cm_degC"], int(0.7 * len(soil))
    refined = refine(DynamicBiasRegressor("air_temp_degC"), X[:n], y[:n], max_steps=1)
    (knee,) = effects_of(refined.model_)
    assert isinstance(knee, Hinge) and knee.knee == 0.0
    assert float(np.sqrt(np.nanmean(np.asarray(refined.model_.residuals(X[n:], y[n:])) ** 2))) <= 0.67
