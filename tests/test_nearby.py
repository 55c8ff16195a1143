"""Causes that were found are moved to where they explain most beside those found since."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from effect_records import log, read

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import ThermalLag
from thermocorr.judgement.likelihood import Comparison
from thermocorr.judgement.nearby import moved_for_another

pytestmark = pytest.mark.newest

N = 4000


def test_what_the_parameters_of_a_cause_miss_is_no_further_cause():
    """A second hinge had been named beside the first."""
    effects = {"hinge": 1.0, "lagged_covariate": 1.0}
    record = make_record(84_000, sampling_period=15.0, effects=effects, seed=6, noise=0.2)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert sorted(cause.effect.kind for cause in found.causes) == sorted(effects)


@pytest.fixture
def parts():
    rng = np.random.default_rng(3)
    base = np.column_stack((np.ones(N), rng.normal(size=N)))
    near, there, other = rng.normal(size=(3, N, 1))
    reading = base @ [2.0, 1.0] + there[:, 0] + other[:, 0] + 0.3 * rng.normal(size=N)
    return reading, base, near + 0.5 * there, there, other


def test_a_moved_cause_leaves_what_had_been_left_had_it_been_there_at_once(parts):
    reading, base, near, there, other = parts
    run = np.repeat([0, 1], N // 2)
    moved, fresh = Comparison(reading, base, run), Comparison(reading, base, run)
    moved.add([near, other, near + other])
    fresh.add([there, other, near + other])
    for judged in (moved, fresh):
        judged.adopt(0)
        judged.adopt(1)
    assert moved.moves(0, there, 100.0)
    assert moved.base.level == pytest.approx(fresh.base.level, abs=0.1)  # of noise that was estimated another way
    assert moved.white == pytest.approx(fresh.white, rel=1e-9)
    for judged in (moved, fresh):
        judged.add([near])
    theta = fresh.base.theta
    np.testing.assert_allclose(moved.screen(theta), fresh.screen(theta), rtol=1e-8, atol=1e-8)


def test_no_cause_is_moved_to_where_it_explains_less(parts):
    reading, base, near, there, _ = parts
    judged = Comparison(reading, base, np.zeros(N, int))
    judged.add([there])
    judged.adopt(0)
    level, Q = judged.base.level, judged.Q
    assert not judged.moves(0, near, 0.0)
    assert not judged.moves(0, np.column_stack((near, there)), 0.0)  # nor into more columns
    assert not judged.moves(0, there, 1.0)
    assert judged.base.level == level
    assert judged.Q is Q


def test_a_cause_of_fewer_columns_leaves_what_had_been_left_had_it_been_there_at_once(parts):
    reading, base, near, there, other = parts
    run = np.repeat([0, 1], N // 2)
    moved, fresh = Comparison(reading, base, run), Comparison(reading, base, run)
    wide = np.column_stack((near, there))
    for judged, first in ((moved, wide), (fresh, there)):
        judged.add([first, other, near + other])
        judged.adopt(0)
        judged.adopt(1)
    assert moved.moves(0, there, -10.0)
    assert moved.Q.shape == fresh.Q.shape and moved.causes == fresh.causes
    assert moved.level_with([0]) == pytest.approx(fresh.level_with([0]), abs=0.1)
    assert moved.level_with([1]) == pytest.approx(fresh.level_with([1]), abs=0.1)
    theta = fresh.base.theta
    np.testing.assert_allclose(moved.screen(theta), fresh.screen(theta), rtol=1e-8, atol=1e-8)


def test_a_cause_whose_neighbours_the_base_has_already_hides_nothing(parts):
    """A lag beside slow lags of the model: all that its neighbours say is said, and nobody stands behind it."""
    reading, base, near, there, _ = parts
    judged = Comparison(reading, base, np.repeat([0, 1], N // 2))
    judged.add([near, there])
    judged.adopt(0)
    effect = ThermalLag([900.0])
    within = SimpleNamespace(effect=effect, columns=base @ np.array([[0.3], [2.0]]), in_model=False, n_tuned=1)
    pool = SimpleNamespace(record=read(log(300)), of=lambda effects: [within for _ in effects])
    cause = SimpleNamespace(tried=SimpleNamespace(key="thermal_lag", explanation=within))
    family = SimpleNamespace(judged=judged, alive=lambda: [1])
    assert moved_for_another(pool, family, [cause], (), set()) is None
    assert len(judged.explanations) == 2


@pytest.mark.parametrize(("seed", "strength"), [(2, 3.0), (5, 2.0), (9, 2.0)])
def test_rounding_does_not_choose_the_moment_of_a_step(seed, strength):
    """It may lie anywhere between two rows; what differs by the last digit, as processors do, had other moments."""
    record = make_record(3000, effects={"step": strength}, seed=seed)
    X, moments = record[["temperature"]], set()
    for last_digit in (0.0, 1e-15, -1e-15, 3e-15):
        y = record["reading"] * (1 + last_digit)
        found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
        moments |= {cause.effect.time for cause in found.causes}
    assert len(moments) == 1
