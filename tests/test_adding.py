"""Which effects refinement keeps: errors on later data and on held-out blocks together."""

from dataclasses import replace

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, diagnose, refine
from thermocorr.datasets import load_real_record, make_record
from thermocorr.effects import Covariate, Drift, Interaction, LogAgeing, Step
from thermocorr.estimators.holdout import rms
from thermocorr.judgement.adding import Errors, held_out_blocks
from thermocorr.judgement.refinement import worth_trying
from thermocorr.judgement.tuning import effects_of

pytestmark = pytest.mark.newest

BEFORE = Errors(1.0, 1.0)


def of_blocks(*each):
    """Errors that fall where all blocks are taken together."""
    return Errors(0.8, 0.8, np.array(each))


def test_one_error_may_rise_where_the_other_falls_by_more():
    assert Errors(1.04, 0.9).better_than(BEFORE) and Errors(0.9, 1.04).better_than(BEFORE)
    assert not Errors(1.1, 0.95).better_than(BEFORE) and not Errors(0.95, 1.1).better_than(BEFORE)


@pytest.mark.parametrize("later", [1.0, 1.001, np.nan])
def test_held_out_blocks_decide_where_later_ones_cannot(later):
    assert Errors(0.99, later).better_than(BEFORE) and not Errors(1.0, later).better_than(BEFORE)


def test_what_depends_on_time_alone_must_not_raise_either_error():
    for errors in (Errors(1.05, 0.9), Errors(0.8, 1.01)):
        assert errors.worth(Covariate("supply"), BEFORE)
        assert not errors.worth(Drift(), BEFORE) and not errors.worth(Step(100.0), BEFORE)
    assert Errors(0.98, 1.0).worth(Step(100.0), BEFORE)  # in the last block


def test_a_proven_drift_may_raise_the_held_out_error_by_less_than_it_lowers_the_later_one():
    """The first block, held out, is told backwards: of a drift that slow lags stood for, it may be worse."""
    before, after = Errors(1.0, 1.0, np.ones(6)), Errors(1.01, 0.98, np.array([1.2, 1.1, 1.1, 0.9, 0.9, 1.0]))
    assert after.worth(Drift(), before, proven=True) and after.worth(LogAgeing(), before, proven=True)
    assert not after.worth(Drift(), before) and not after.worth(Step(100.0), before, proven=True)
    assert not Errors(1.03, 0.98, np.ones(6)).worth(Drift(), before, proven=True)


@pytest.mark.parametrize("n", [16_127, 16_128])
def test_a_drift_that_slow_lags_stood_for_is_added_and_foretold(n):
    """Learned from the first 70 %, it had 1.32 times the noise on the rest, and 1.02 with a drift."""
    record = make_record(
        23_040, sampling_period=30.0, setting="chamber", device="box", noise=0.2, effects={"drift": 2.0}, seed=207
    )
    X, y = record.drop(columns="reading"), record["reading"]
    found = refine(DynamicBiasRegressor("temperature"), X[:n], y[:n])
    assert [type(effect) for effect in effects_of(found.model_)] == [Drift]
    assert rms(found.model_.residuals(X[n:], y[n:]).to_numpy()) < 1.1 * 0.2


def test_the_error_must_fall_in_most_blocks():
    """One or two blocks decide on the error of all: they are no sign that the next one will be the same."""
    before = Errors(1.0, 1.0, np.ones(6))
    assert of_blocks(0.9, 0.9, 0.9, 0.9, 1.1, 1.1).worth(Covariate("supply"), before)
    assert not of_blocks(0.2, 0.2, 0.9, 1.1, 1.1, 1.1).worth(Covariate("supply"), before)
    assert of_blocks(0.2, 1.0, 1.0, 1.001, 1.0, 1.0).worth(Covariate("rain"), before)  # what acts in one block only
    assert of_blocks(0.2, 1.0, 1.0, 1.0, 1.0, 1.0).worth(Step(100.0), before)  # a step lies in some blocks
    assert not of_blocks(0.2, 1.1, 1.1, 1.1, 1.0, 1.0).worth(Step(100.0), before)  # and spoils no others
    assert of_blocks(0.2, np.nan, 1.0, 1.0, 1.0, 1.0).worth(Covariate("supply"), before)


def test_a_proven_effect_may_be_of_use_in_few_blocks_where_neither_error_rises():
    few = np.array([0.5, 1.01, 1.01, 1.01, 1.01, 1.01])
    before = Errors(1.0, 1.0, np.ones(6))
    assert Errors(0.9, 1.0, few).worth(Covariate("supply"), before, proven=True)
    assert not Errors(0.9, 1.0, few).worth(Covariate("supply"), before)
    assert not Errors(0.9, 1.01, few).worth(Covariate("supply"), before, proven=True)
    assert not Errors(1.0, 1.0, few).worth(Covariate("supply"), before, proven=True)
    assert Errors(1.0, 1.0, few).worth(Covariate("supply"), before, proven=True, absorbed=True)
    assert not Errors(0.9, 1.0, few).worth(Interaction("supply"), before, proven=True)
    assert not Errors(0.9, 1.0, few).worth(Step(100.0), before, proven=True)


def test_errors_of_each_block_stand_behind_those_of_all():
    record = make_record(2000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    found = Errors.of(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.each.shape == (10,) and np.isfinite(found.each).all()
    assert found.held_out == pytest.approx(rms(found.each[:5]), rel=0.05)  # rows at the starts are left out
    assert found.later == pytest.approx(rms(found.each[5:]), rel=0.05)


def test_exact_records_have_no_ratio_of_errors():
    assert not Errors(0.0, 0.0).better_than(Errors(0.0, 0.0))


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


def test_a_drift_that_slow_lags_had_absorbed_is_named_and_forecasts_fall_to_the_noise():
    """The search grants lags as long as the record, which say the same; beside them the drift is told."""
    record = make_record(6000, effects={"drift": 2.0}, seed=72)
    X, y, n = record.drop(columns="reading"), record["reading"], 4200
    result = refine(DynamicBiasRegressor("temperature"), X[:n], y[:n])
    first, before = result.diagnoses[0].causes[0], DynamicBiasRegressor("temperature").fit(X[:n], y[:n])
    assert first.effect.kind == "drift"
    left = [rms(np.asarray(m.residuals(X[n:], y[n:]))) / record.attrs["noise"] for m in (before, result.model_)]
    assert left[0] > 1.5 and left[1] < 1.1


@pytest.mark.parametrize("seed", [62, 63])
def test_a_drift_that_may_as_well_be_a_slow_body_says_so(seed):
    record = make_record(6000, effects={"drift": 2.0}, seed=seed)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.causes[0].effect.kind == "drift" and found.causes[0].in_model
    assert "slow lags of the model" in found.ranking["sentence"][0]


def test_causes_that_spoil_one_another_are_added_together():
    """Alone, the wave raised the held-out error and the disturbance that of many blocks: nothing was added."""
    record = make_record(
        20_160,
        sampling_period=60.0,
        setting="lab",
        device="slab",
        noise=0.2,
        effects={"periodic": 1.0, "disturbance": 1.0},
        seed=700,
    )
    X, y = record.drop(columns="reading"), record["reading"]
    result = refine(DynamicBiasRegressor("temperature"), X, y)
    assert result.model_.residual_std_ < 1.02 * 0.2
    assert {effect.kind for effect in effects_of(result.model_)} == {"periodic", "disturbance"}
    assert " and " in result.steps["effect"].iloc[1]


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
