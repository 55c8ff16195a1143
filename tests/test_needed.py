"""Causes weighed together in the end: what an earlier one holds, and what two say that hide one another."""

from __future__ import annotations

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Drift
from thermocorr.judgement.choice import Cause, Tried
from thermocorr.judgement.likelihood import Comparison
from thermocorr.judgement.needed import still_helping, worth_beside
from thermocorr.judgement.pool import Explanation
from thermocorr.judgement.worth import HeldOut, Worth

pytestmark = pytest.mark.newest

N = 3000


def cause_of(columns, effect=None, p_value=0.0, score=1.0):
    """A cause that nobody has weighed."""
    tried = Tried(
        explanation=Explanation(effect or Drift(), columns),
        number=0,
        score=score,
        full=1.0,
        as_law=1.0,
        p_value=p_value,
        worth=Worth(later=0.0, blocks=0.0),
        scatter=0.0,
        uneven=False,
    )
    return Cause(tried=tried, alike=(), others=(), share=0.5, size=1.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_cause_that_was_tried_beside_another_one_does_not_hold_that_one(seed):
    """Tuned after the first was taken in, and very like it: dropping the first is to cost all that it explains."""
    rng = np.random.default_rng(seed)
    first = np.cumsum(rng.standard_normal(N)) / 10
    second = first + 0.2 * rng.standard_normal(N)
    base = np.column_stack([np.ones(N), np.linspace(0, 1, N)])
    reading = 3 * first + second + rng.standard_normal(N)

    together = Comparison(reading, base, np.zeros(N, int))
    together.add([first[:, None]])
    together.adopt(0)
    together.add([second[:, None]])
    together.adopt(1)
    alone = Comparison(reading, base, np.zeros(N, int))
    alone.add([second[:, None]])
    alone.adopt(0)
    assert together.level_with([1]) == pytest.approx(alone.base.level, abs=1.0)
    assert together.base.level - alone.base.level > 50


def slow_record(seed, size, n=8000):
    """An ageing and a drift of opposite sign beside what temperature makes; they add up to a fraction of either."""
    record = make_record(n, seed=seed)
    days = np.arange(n) / 1440
    ageing = np.log1p(3 * days)
    drift = days * (ageing @ days) / (days @ days)
    return record.drop(columns="reading"), record["reading"] + 0.2 * size * (drift - ageing)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_ageing_and_a_drift_that_hide_one_another_are_both_proven(seed):
    X, y = slow_record(seed, 2.0)
    found = diagnose(DynamicBiasRegressor("temperature", [60.0, 3600.0]).fit(X, y), X, y)
    slow = [cause for cause in found.causes if cause.effect.of_time_alone]
    assert len(slow) == 2
    assert all(cause.standing == "proven" for cause in slow)


def test_what_a_cause_is_worth_is_told_beside_all_others():
    """Found first, a cause was worth little beside what it could not explain; a third one is none of the two."""
    rng = np.random.default_rng(3)
    t = np.linspace(0, 1, N)
    loud, quiet = 30 * np.sin(400 * t)[:, None], np.sin(90 * t)[:, None]
    start = HeldOut((loud + quiet)[:, 0][:, None] + 0.3 * rng.standard_normal((N, 1)), np.column_stack([np.ones(N), t]))
    worths = [cause.tried.worth.both for cause in worth_beside([cause_of(quiet), cause_of(loud)], start, [quiet, loud])]
    assert start.worth([quiet])[0].both < 0.1
    assert worths[0] == pytest.approx(10 * np.log10(1 + 0.5 / 0.09), abs=0.5)
    assert worths[1] > 35
    assert worth_beside([cause_of(loud)], start, [loud])[0].tried.worth == start.worth([loud])[0]


def test_what_only_helped_goes_where_it_stood_for_another_cause():
    rng = np.random.default_rng(4)
    there, other, else_ = rng.normal(size=(3, N, 1))
    stood_for, base = there + else_, np.column_stack((np.ones(N), rng.normal(size=N)))
    reading = base @ [2.0, 1.0] + there[:, 0] + other[:, 0] + 0.3 * rng.normal(size=N)
    start, columns = HeldOut(reading[:, None], base), [stood_for, there, other]
    assert start.worth([stood_for])[0].both > 1  # alone it helps
    beside = [cause_of(there, Covariate("b")), cause_of(other, Covariate("c"), 1.0)]
    helps, proven, of_time = Covariate("a"), Covariate("a"), Drift()
    assert still_helping([cause_of(stood_for, helps, 1.0), *beside], start, columns) == [1, 2]
    assert still_helping([cause_of(stood_for, proven, 0.0), *beside], start, columns) == [0, 1, 2]
    assert still_helping([cause_of(stood_for, of_time, 1.0), *beside], start, columns) == [0, 1, 2]


@pytest.mark.parametrize(("score", "kept"), [(10.0, [1]), (20.0, [0, 1])])
def test_a_proven_column_that_harms_beside_all_others_stays_on_strong_evidence_only(score, kept):
    """In two stretches it goes with the reading, and then against it: neither is foretold from the other."""
    rng = np.random.default_rng(5)
    t = np.arange(N) / N
    column = rng.normal(size=N) * ((abs(t - 0.5) < 0.1) | (abs(t - 0.8) < 0.1))
    there, base = rng.normal(size=(N, 1)), np.column_stack((np.ones(N), t))
    reading = there[:, 0] + 2 * column * np.sign(0.65 - t) + 0.3 * rng.normal(size=N)
    start, columns = HeldOut(reading[:, None], base), [column[:, None], there]
    causes = [cause_of(columns[0], Covariate("a"), score=score), cause_of(there, Covariate("b"))]
    assert still_helping(causes, start, columns) == kept


@pytest.mark.parametrize(("others", "score", "stays"), [(1, 20.0, True), (8, 20.0, False), (8, 40.0, True)])
def test_beside_many_causes_a_proven_column_must_not_harm_unless_its_evidence_outweighs_it(others, score, stays):
    """It goes with the reading at first and against it in the end."""
    rng = np.random.default_rng(6)
    t, column, there = np.arange(N) / N, rng.normal(size=N), rng.normal(size=(N, 8))
    reading = there.sum(axis=1) + 2 * column * np.sign(0.6 - t) + 0.3 * rng.normal(size=N)
    start = HeldOut(reading[:, None], np.column_stack((np.ones(N), t, there[:, others:])))
    causes = [cause_of(column[:, None], Covariate("a"), score=score)]
    causes += [cause_of(there[:, [k]], Covariate(f"b{k}")) for k in range(others)]
    kept = still_helping(causes, start, [cause.tried.explanation.columns for cause in causes])
    assert kept == list(range(0 if stays else 1, others + 1))
