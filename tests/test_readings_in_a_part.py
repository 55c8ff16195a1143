"""Readings in a part of a record only: everything is judged where they are."""

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, compare_variants, diagnose, refine
from thermocorr.datasets import make_record

pytestmark = pytest.mark.newest


@pytest.mark.long
@pytest.mark.parametrize("part", [(0, 2500), (3000, 8000), (15_000, 20_000)])
def test_a_week_of_readings_beside_months_of_temperature(part):
    """Time constants, figures on later data and a hidden column are found where the readings are."""
    record = make_record(20_000, seed=5, noise=0.2, effects={"covariate": 1.0})
    X, y = record.drop(columns="reading"), record["reading"]
    own = y.where((np.arange(20_000) >= part[0]) & (np.arange(20_000) < part[1]))
    model = DynamicBiasRegressor("temperature").fit(X, own)
    assert [cause.effect.kind for cause in diagnose(model, X, own).causes] == ["covariate"]
    better = refine(model, X, own).model_
    assert np.std((y - better.predict(X))[300:]) < 1.05 * 0.2
    compared = compare_variants(X, own, temperature="temperature")
    figures = compared.frame()["held_out_rms"]
    assert figures["dynamic linear"] < 0.6 * figures["static linear"]
    assert compared.advice.choice == "dynamic"


def test_readings_at_both_ends_of_a_long_record_are_enough():
    record = make_record(6000, seed=5, noise=0.2)
    y = record["reading"].where((np.arange(6000) < 300) | (np.arange(6000) >= 5700))
    model = DynamicBiasRegressor("temperature").fit(record[["temperature"]], y)
    assert len(model.time_constants_) >= 2 and model.residual_std_ < 1.1 * 0.2
