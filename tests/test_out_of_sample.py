"""Errors on later data and on held-out blocks, against fits that are made anew, and what `refine` makes of them."""

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from thermocorr import DynamicBiasRegressor, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.model.out_of_sample import BLOCKS, PIECES, RIDGE, OutOfSample, later_pieces

N = 1600


@pytest.fixture(scope="module")
def given():
    rng = np.random.default_rng(8)
    base = np.column_stack((np.ones(N), rng.standard_normal((N, 3)).cumsum(axis=0)))
    more = rng.standard_normal((N, 2)).cumsum(axis=0)
    return base, more, base @ [1.0, 0.3, -0.2, 0.1] + more @ [0.4, 0.2] + rng.standard_normal(N)


def squares(base, y, learn, test):
    """Squared errors of a ridge that is fitted to some pieces, on others: of rows, and of the means of pieces."""
    piece = np.arange(N) * PIECES // N
    learned, tested = np.isin(piece, list(learn)), np.isin(piece, list(test))
    mean, scale = base[learned, 1:].mean(axis=0), base[learned, 1:].std(axis=0)
    columns = (base[:, 1:] - mean) / scale
    ridge = Ridge(RIDGE * learned.sum()).fit(columns[learned], y[learned])
    missed = y - ridge.predict(columns)
    return np.mean(missed[tested] ** 2), np.mean([missed[piece == k].mean() ** 2 for k in test])


@pytest.mark.parametrize("moment", [None, 0.5, 0.93])
def test_it_is_the_error_of_fits_made_anew(given, moment):
    base, more, y = given
    ahead = OutOfSample(y, base)
    stretches = later_pieces(moment)
    before = np.array([squares(base, y, *pieces) for pieces in stretches])
    after = np.array([squares(np.column_stack((base, more)), y, *pieces) for pieces in stretches])
    blocks = [[squares(part, y, *pieces) for pieces in BLOCKS] for part in (base, np.column_stack((base, more)))]
    np.testing.assert_allclose(ahead.errors(moment), before, rtol=1e-4)
    assert ahead.later_rms(moment) == pytest.approx(np.sqrt(np.exp(np.log(before[:, 0]).mean())), rel=1e-4)
    one, other = ahead.worth([more], moment)[0], ahead.against(ahead.with_columns(more), moment)
    for scale, (own, anew) in enumerate(zip(one, other, strict=True)):
        np.testing.assert_allclose(own.each, 10 * np.log10(before / after)[:, scale], atol=2e-3)
        assert own.blocks == pytest.approx(10 * np.log10(np.divide(*blocks))[:, scale].mean(), abs=2e-3)
        np.testing.assert_allclose(anew.each, own.each, atol=2e-3)
        assert own.later == pytest.approx(np.mean(own.each))
    assert one.adds()


def test_a_jump_is_asked_behind_itself(given):
    """Behind it a quarter of the rows tells its level, and three stretches are predicted at least, or nothing."""
    base, _, y = given
    step = (np.arange(N) >= 1200)[:, None].astype(float)
    ahead = OutOfSample(y + 40 * step[:, 0], base)
    behind = ahead.worth([step], 0.75)[0]
    assert behind.adds(twice=True) and min(behind.short.each) > 5
    assert all(min(test) > 60 for _, test in later_pieces(0.75)) and len(later_pieces(0.9)) >= 3
    late = ahead.worth([step], 0.98)[0]
    assert len(later_pieces(0.98)) < 3 and not late.adds() and not late.adds(twice=True)
    assert later_pieces(0.999) == [] and np.isnan(ahead.worth([step], 0.999)[0].short.later)


def test_a_fifth_of_the_noise_is_confirmed_by_means():
    """What single readings hide is the largest error of a mean of a hundred."""
    rng = np.random.default_rng(3)
    column = rng.standard_normal((80, 1)).repeat(20, axis=0)
    y = 0.2 * column[:, 0] + rng.standard_normal(N)
    found = OutOfSample(y, np.ones((N, 1))).worth([column])[0]
    assert not found.short.adds(False) and found.long.adds(False) and found.adds()


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


@pytest.mark.parametrize(("kind", "confirmed"), [("hinge", True), ("disturbance", False)])
def test_what_later_data_cannot_show_is_proven_and_not_confirmed(kind, confirmed):
    """A quarter of the noise of a reading; a disturbance is over, and costs later data nothing."""
    record = make_record(20_000, effects={kind: 0.2}, seed=61000)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert [one.effect.kind for one in found.causes] == [kind] * confirmed
    assert found.verdict == ("missing" if confirmed else "unexplained")
    said = " ".join(str(found).split())
    assert ("Proven, but not confirmed on unseen data: disturbance (" in said) is not confirmed
    (named,) = (*found.causes, *found.small)
    assert named.size == pytest.approx(0.04, rel=0.2) and named.standing == ("confirmed" if confirmed else "proven")
    assert named.matters_from == int(np.ceil((found.noise_floor / named.size) ** 2))
    assert f"matters if you average {named.matters_from} readings or more" in said
