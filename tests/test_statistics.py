"""Moving average, eqs. (9) (26), and reduction in dB, against a naive loop and the founding paper's table."""

from __future__ import annotations

import math

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import chi2

from thermocorr.equations import moving_average, reduction_db
from thermocorr.equations.statistics import whiteness


def naive(values, window):
    """Mean over `window` samples around each, cut at the ends; an even window reaches one further ahead."""
    result = []
    for k in range(len(values)):
        inside = range(max(k - (window - 1) // 2, 0), min(k + window // 2, len(values) - 1) + 1)
        known = [values[i] for i in inside if not math.isnan(values[i])]
        result.append(math.fsum(known) / len(known) if known else math.nan)
    return np.array(result)


numbers = st.one_of(st.floats(-1e3, 1e3), st.just(math.nan))


@examples(100)
@given(values=st.lists(numbers, max_size=40), window=st.integers(1, 60))
def test_moving_average_is_the_mean_of_each_window(values, window):
    values = np.array(values, float)
    # atol: a running sum of 40 values of 1000 is rounded 40 times at 4e4
    np.testing.assert_allclose(moving_average(values, window), naive(values, window), rtol=0, atol=1e-9)


def test_window_of_one_changes_nothing():
    values = np.random.default_rng(0).normal(size=100)
    values[7] = np.nan
    # atol: the running sum reaches about 20, so each difference is rounded at 4e-15
    np.testing.assert_allclose(moving_average(values, 1), values, rtol=0, atol=1e-14)


def test_window_is_centred():
    pulse = np.zeros(21)
    pulse[10] = 1.0
    np.testing.assert_allclose(np.flatnonzero(moving_average(pulse, 5) > 0.1), np.arange(8, 13))


def test_window_longer_than_twice_the_data_gives_the_mean_everywhere():
    values = np.arange(10.0)
    np.testing.assert_allclose(moving_average(values, 1000), 4.5, rtol=1e-15)


def test_window_without_a_value_gives_nan_and_nothing_else_does():
    values = np.r_[np.ones(10), np.full(10, np.nan), 3 * np.ones(10)]
    smooth = moving_average(values, 5)
    assert np.flatnonzero(np.isnan(smooth)).tolist() == list(range(12, 18))
    np.testing.assert_allclose(smooth[:12], 1.0, rtol=1e-14)
    np.testing.assert_allclose(smooth[18:], 3.0, rtol=1e-14)
    assert np.isnan(moving_average(np.full(4, np.nan), 3)).all()


def test_empty_series_stays_empty():
    assert moving_average(np.zeros(0), 5).shape == (0,)


def test_large_offset_costs_no_digits():
    ppm = np.random.default_rng(1).normal(0.0, 0.1, 100_000)
    smooth = moving_average(99_998.0 + ppm, 25)
    inside = np.convolve(ppm, np.ones(25) / 25, "valid")
    # atol: the readings themselves are rounded at 99 998 eps / 2 = 7e-12; a running sum of the raw readings,
    # which reaches 1e10, would be off by 1e-6 / 25
    np.testing.assert_allclose(smooth[12:-12] - 99_998.0, inside, rtol=0, atol=5e-11)


@pytest.mark.parametrize(
    ("after", "before", "said"),
    [
        (4.911e-5, 1.114e-3, -27.3),
        (4.471e-5, 1.114e-3, -27.9),
        (1.331e-5, 1.114e-3, -38.6),
        (1.173e-5, 1.114e-3, -39.5),
        (1.331e-5, 4.911e-5, -11.3),
        (1.173e-5, 4.471e-5, -11.6),
    ],
)
def test_reductions_are_those_of_the_paper(after, before, said):
    # atol: the paper's dB do not follow from its own standard deviations to the last digit (up to 0.2 dB off)
    assert reduction_db(after, before) == pytest.approx(said, abs=0.2)


def test_reduction_is_20_db_per_power_of_ten_and_negative_is_good():
    assert reduction_db(0.1, 1.0) == pytest.approx(-20.0, abs=1e-13)
    assert reduction_db(1.0, 1.0) == 0.0
    assert reduction_db(2.0, 1.0) == pytest.approx(6.0206, abs=1e-4)


def test_reduction_from_or_to_nothing_is_infinite_without_a_warning():
    assert reduction_db(0.0, 1.0) == -math.inf
    assert reduction_db(1.0, 0.0) == math.inf
    assert math.isnan(reduction_db(0.0, 0.0))
    assert isinstance(reduction_db(1, 3), float)


def test_white_noise_is_white_and_what_wanders_is_not():
    """p values of white noise are even; those of a weak memory are small, over breaks too."""
    rng = np.random.default_rng(5)
    found = np.array([whiteness([rng.normal(size=300), rng.normal(size=100)]) for _ in range(400)])
    assert (np.abs(np.quantile(found, [0.1, 0.5, 0.9], axis=0) - [[0.1], [0.5], [0.9]]) < 0.08).all()
    wander = lfilter([1.0], [1.0, -0.5], rng.normal(size=400))
    assert max(whiteness([wander[:200], wander[200:]])) < 1e-6
    gap = np.where(np.arange(400) % 40 == 7, np.nan, wander)
    assert max(whiteness([gap])) < 1e-6
    assert np.isnan(whiteness([wander[:30]])).all() and np.isnan(whiteness([np.ones(100)])).all()


def test_ljung_and_box_by_the_formula():
    values = np.random.default_rng(1).normal(size=100)
    centred = values - values.mean()
    r = np.array([centred[k:] @ centred[:-k] for k in range(1, 6)]) / (centred @ centred)
    expected = chi2.sf(100 * 102 * np.sum(r**2 / (100 - np.arange(1, 6))), 5)
    assert whiteness([values], 5)[0] == pytest.approx(expected, rel=1e-12)
