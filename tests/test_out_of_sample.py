"""Errors on later data and on held-out blocks, against fits that are made anew, and what `refine` makes of them."""

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from thermocorr import DynamicBiasRegressor, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.estimators.out_of_sample import BLOCKS, PIECES, RIDGE, OutOfSample, later_pieces

N = 1600


@pytest.fixture(scope="module")
def given():
    rng = np.random.default_rng(8)
    base = np.column_stack((np.ones(N), rng.standard_normal((N, 3)).cumsum(axis=0)))
    more = rng.standard_normal((N, 2)).cumsum(axis=0)
    return base, more, base @ [1.0, 0.3, -0.2, 0.1] + more @ [0.4, 0.2] + rng.standard_normal(N)


def squares(base, y, learn, test):
    """Squared error of a ridge that is fitted to some pieces, on others."""
    piece = np.arange(N) * PIECES // N
    learned, tested = np.isin(piece, list(learn)), np.isin(piece, list(test))
    mean, scale = base[learned, 1:].mean(axis=0), base[learned, 1:].std(axis=0)
    columns = (base[:, 1:] - mean) / scale
    ridge = Ridge(RIDGE * learned.sum()).fit(columns[learned], y[learned])
    return float(np.mean((y - ridge.predict(columns))[tested] ** 2))


@pytest.mark.parametrize("moment", [None, 0.5, 0.93])
def test_it_is_the_error_of_fits_made_anew(given, moment):
    base, more, y = given
    ahead = OutOfSample(y, base)
    stretches = later_pieces(moment)
    before = np.array([squares(base, y, *pieces) for pieces in stretches])
    after = np.array([squares(np.column_stack((base, more)), y, *pieces) for pieces in stretches])
    blocks = [[squares(part, y, *pieces) for pieces in BLOCKS] for part in (base, np.column_stack((base, more)))]
    np.testing.assert_allclose(ahead.errors(moment), before, rtol=1e-4)
    assert ahead.later_rms(moment) == pytest.approx(np.sqrt(np.exp(np.log(before).mean())), rel=1e-4)
    one, other = ahead.worth([more], moment)[0], ahead.against(ahead.with_columns(more), moment)
    np.testing.assert_allclose(one.each, 10 * np.log10(before / after), atol=1e-3)
    assert one.blocks == pytest.approx(10 * np.log10(np.divide(*blocks)).mean(), abs=1e-3)
    np.testing.assert_allclose(other.each, one.each, atol=1e-3)
    assert one.later == pytest.approx(np.mean(one.each)) and one.adds()


def test_a_jump_is_asked_behind_itself(given):
    """Before it there is nothing to learn; behind it a quarter tells its level, and nothing is predicted at the end."""
    base, _, y = given
    step = (np.arange(N) >= 1200)[:, None].astype(float)
    ahead = OutOfSample(y + 40 * step[:, 0], base)
    behind = ahead.worth([step], 0.75)[0]
    assert behind.adds() and min(behind.each) > 5
    assert all(min(test) > 60 for _, test in later_pieces(0.75))
    assert later_pieces(0.999) == [] and np.isnan(ahead.worth([step], 0.999)[0].later)


def test_refine_keeps_what_the_fitted_model_confirms():
    record = make_record(8000, effects={"covariate": 2.0, "step": 3.0}, seed=12)
    X, y = record.drop(columns="reading"), record["reading"]
    found = refine(DynamicBiasRegressor("temperature"), X, y)
    steps = found.steps
    assert steps["effect"].tolist() == ["", "step + covariate: pressure"]  # each hides what the other is worth
    assert (steps["later_rms"].diff()[1:] < 0).all() and steps["change"].tolist() == ["given", "added"]
    assert (steps["low"] <= steps["db"]).all() and (steps["db"] <= steps["high"]).all()
    assert found.diagnoses[-1].verdict == "nothing missing" and not found.untried


@pytest.mark.parametrize(("most", "untried"), [(0, True), (1, False)])
def test_what_is_named_last_is_said_to_be_untried(most, untried):
    record = make_record(3000, effects={"covariate": 2.0}, seed=12)
    X, y = record.drop(columns="reading"), record["reading"]
    found = refine(DynamicBiasRegressor("temperature"), X, y, max_steps=most)
    assert found.untried is untried and ("No step was left." in str(found)) is untried


def test_no_more_effects_are_added_than_asked_for():
    record = make_record(8000, effects={"covariate": 2.0, "step": 3.0}, seed=12)
    X, y = record.drop(columns="reading"), record["reading"]
    found = refine(DynamicBiasRegressor("temperature"), X, y, max_steps=1)
    assert len(found.diagnoses[0].causes) == 2 and len(found.model_.effects) <= 1


def test_what_is_too_small_to_matter_is_said_in_one_line():
    record = make_record(20_000, effects={"hinge": 0.25}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert not found.causes and [one.effect.kind for one in found.small] == ["hinge"]
    assert "Another effect is significant, and worth too little to be added: hinge, 0." in " ".join(str(found).split())
