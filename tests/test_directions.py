"""Directions of the base: those that are rounding, and those in which no plausible law can be seen."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.effects import Drift, ThermalLag
from thermocorr.judgement.choice import Cause, Tried
from thermocorr.judgement.diagnosis import _not_silently
from thermocorr.judgement.directions import orthonormal, visible
from thermocorr.judgement.levels import VISIBLE
from thermocorr.judgement.pool import Explanation
from thermocorr.judgement.worth import Worth

N = 4000


def smooth(seed):
    """A constant, a slow temperature, and the same with a hundred-thousandth of something else beside it."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, N)
    T = np.sin(7 * t) + 0.3 * np.sin(31 * t)
    return np.column_stack([np.ones(N), T, T + 1e-5 * np.cos(97 * t)]), T, rng.standard_normal(N)


def test_directions_of_rounding_are_dropped():
    columns = smooth(0)[0]
    assert orthonormal(columns).shape[1] == 3
    assert orthonormal(np.column_stack([columns, columns @ [1.0, 2.0, -1.0]])).shape[1] == 3
    assert orthonormal(columns, 1e-3).shape[1] == 2
    Q = orthonormal(columns)
    np.testing.assert_allclose(Q.T @ Q, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_direction_counts_where_a_law_of_the_usual_size_would_show(seed):
    """Ten parts of a law of this size make 1e-5 of it there, beside a noise that is larger or smaller than that."""
    columns, T, noise = smooth(seed)
    law = 10 * T
    sized = 1e-5 * np.linalg.norm(law)
    for factor, kept in ((0.1, 3), (10.0, 2)):
        quiet = factor * sized / VISIBLE
        assert visible(columns, 500 + law + quiet * noise).shape[1] == kept


def test_exact_readings_show_all_directions_and_offsets_are_no_law():
    columns, T, noise = smooth(4)
    assert visible(columns, 10 * T).shape[1] == 3
    loud = [visible(columns, level + 10 * T + noise).shape[1] for level in (0.0, 1e6)]
    assert loud == [2, 2]
    columns[:, 0] = 0.0  # held by the starts of runs
    assert visible(columns, 10 * T + noise).shape[1] == 1


@pytest.mark.parametrize("seed", [0, 3])
def test_a_delay_is_not_in_fast_lags_that_imitate_it(seed):
    """Lags of 5, 20, 27 and 70 s made a delay of 32 s of one of 50 s, beside noise that wanders."""
    rng, n, step, late = np.random.default_rng(seed), 3000, 10.0, 5
    t = np.arange(n) * step
    swing = lfilter([0.02], [1, -0.98], lfilter([0.05], [1, -0.95], rng.standard_normal(n)))
    T = 23 + 3 * np.sin(2 * np.pi * t / 21000) + 1.5 * np.sin(2 * np.pi * t / 3300 + 1) + 2 * swing
    felt = np.concatenate((np.full(late, T[0]), T[:-late]))
    kept = np.exp(-step / 900)
    lag = lfilter([1 - kept], [1, -kept], felt, zi=[kept * felt[0]])[0]
    slow = lfilter([1], [1, -0.995], rng.standard_normal(n))
    y = 10 * felt - 4 * (lag - felt) + 0.1 * slow / slow.std() + 0.02 * rng.standard_normal(n)
    X = pd.DataFrame({"temperature": T}, index=pd.to_timedelta(t, unit="s"))
    model = DynamicBiasRegressor("temperature").fit(X, pd.Series(y, index=X.index))
    assert model.time_constants_.min() < late * step
    (cause,) = diagnose(model, X, y).causes
    assert cause.effect.kind == "delay"
    assert cause.effect.delay == pytest.approx(late * step, rel=0.03)


@pytest.mark.parametrize("proven", [True, False])
def test_a_slow_lag_of_the_model_is_said_to_be_what_is_proven_as_well(proven):
    def tried(effect, in_model, p_value):
        return Tried(
            explanation=Explanation(effect, np.zeros((3, 1)), in_model), number=0, score=10.0, full=10.0,
            as_law=10.0, p_value=p_value, worth=Worth(later=1.0, blocks=1.0), scatter=0.0, uneven=False,
        )  # fmt: skip

    lag, drift = tried(ThermalLag([9000.0]), True, 1e-6), tried(Drift(), False, 1e-6 if proven else 0.1)
    told = _not_silently(Cause(tried=lag, alike=(drift,), others=(), share=0.5, size=1.0))
    assert told.tried is (drift if proven else lag) and told.alike == ((lag,) if proven else (drift,))
