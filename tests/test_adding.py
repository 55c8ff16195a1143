"""Which effects refinement keeps: errors on later data and on held-out blocks together."""

from dataclasses import replace

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, refine
from thermocorr.datasets import load_real_record, make_record
from thermocorr.estimators.holdout import rms
from thermocorr.judgement.adding import Errors, held_out_blocks
from thermocorr.judgement.refinement import worth_trying

pytestmark = pytest.mark.newest


def test_errors_of_each_block_stand_behind_those_of_all():
    record = make_record(2000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    found = Errors.of(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.each.shape == (10,) and np.isfinite(found.each).all()
    assert found.held_out == pytest.approx(rms(found.each[:5]), rel=0.05)  # rows at the starts are left out
    assert found.later == pytest.approx(rms(found.each[5:]), rel=0.05)


def test_later_errors_stand_in_the_table():
    record = make_record(3000, effects={"covariate": 2.0}, seed=21)
    X, y = record.drop(columns="reading"), record["reading"]
    steps = refine(DynamicBiasRegressor("temperature"), X, y, max_steps=1).steps
    assert (steps["later_rms"].iloc[-1] < 0.9 * steps["later_rms"].iloc[0]) and steps["later_rms"].notna().all()


def test_a_step_that_spoils_forecasts_is_not_added_to_the_nanovoltmeter(measured):
    """With held-out blocks alone a lagged room was added, and the last 30 % had 0.28 to 0.30 ppm instead of 0.23."""
    meter = load_real_record("hp34420a_nanovoltmeter", measured, run="100mV")
    X = meter.drop(columns=[name for name in meter.columns if name.endswith("_V")])
    y = (meter["dut_ch1_V"] / 0.1 - 1) * 1e6
    n = int(0.7 * len(X))
    result = refine(DynamicBiasRegressor("bath_temp_degC"), X[:n], y[:n])
    assert worth_trying(result.diagnoses[0])
    assert float(np.sqrt(np.nanmean(np.asarray(result.model_.residuals(X[n:], y[n:])) ** 2))) <= 0.24


def test_held_out_blocks_are_cut_where_readings_are_believed():
    """A code for "no value" far behind the readings makes the record no longer."""
    record = make_record(3000, seed=1)
    X, y = record[["temperature"]], record["reading"].where(np.arange(3000) < 900)
    model = DynamicBiasRegressor("temperature", ["15 min", "2 h"]).fit(X, y)
    blocks = held_out_blocks(model, X, y)
    coded = y.copy()
    coded.iloc[2900] = 9.9e37
    assert np.isfinite(blocks).all()
    np.testing.assert_allclose(held_out_blocks(model, X, coded), blocks, rtol=1e-9)


@pytest.mark.parametrize(("most", "untried"), [(1, True), (5, False)])
def test_what_is_named_last_is_said_to_be_untried_or_spoken_against(most, untried):
    record = make_record(2500, effects={"step": 2.0, "covariate": 2.0}, seed=1)
    X, y = record.drop(columns="reading"), record["reading"]
    found = refine(DynamicBiasRegressor("temperature"), X, y, max_steps=most)
    assert found.untried == untried and ("No step was left." in str(found)) == untried
    named = " ".join(str(replace(found, diagnoses=(found.diagnoses[0],))).split())
    assert ("No step was left." in named) == untried and ("speak against it" in named) == (not untried)
