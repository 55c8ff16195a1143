"""Looks at values and times, against sums that are exact."""

from math import fsum

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from thermocorr.equations.looks import are_apart, stay_within, steps_between, summed
from thermocorr.equations.statistics import Moments

VALUES = hnp.arrays(float, st.integers(1, 200), elements=st.floats(-1e6, 1e6))
TICKS = hnp.arrays(np.int64, st.integers(2, 100), elements=st.integers(-(2**60), 2**60))


@given(VALUES)
def test_sums_are_those_of_exact_arithmetic(values):
    """To four units in the last digit of the largest value, each."""
    found, mean, most = summed(values), fsum(values) / len(values), np.abs(values).max()
    assert abs(found.mean - mean) <= 4 * np.spacing(most)
    assert found.squares == pytest.approx(
        fsum((values - mean) ** 2), rel=1e-12, abs=len(values) * (4 * np.spacing(most)) ** 2
    )
    assert (found.low, found.high) == (values.min(), values.max())


@given(VALUES, st.floats(0, 1e6), st.booleans())
def test_a_step_is_seen_wherever_it_is(values, most, missing):
    if missing:
        values[len(values) // 2] = np.nan
    expected = bool((np.abs(np.diff(values)) <= most).all())  # false where one is missing
    assert stay_within(values, most) == expected


@given(TICKS, st.sampled_from([1, 1000, 10**9]), st.booleans())
def test_steps_are_those_of_numpy_to_the_bit(ticks, per_second, as_floats):
    ticks = ticks.astype(float) if as_floats else ticks
    found = np.empty(len(ticks) - 1)
    steps_between(ticks, per_second, found)
    assert np.array_equal(found, np.diff(ticks) / per_second)
    even = np.arange(len(ticks), dtype=ticks.dtype) * 7
    assert are_apart(even, 7)
    even[-1] += 1
    assert not are_apart(even, 7)
    assert are_apart(ticks, ticks[1] - ticks[0]) == bool((np.diff(ticks) == ticks[1] - ticks[0]).all())


def test_any_kind_of_array_is_looked_at():
    values = np.random.default_rng(0).normal(23, 1, 1000)
    fixed = values.copy()
    fixed.flags.writeable = False
    expected = Moments.of(values)
    assert Moments.of(fixed) == expected
    assert Moments.of(np.repeat(values, 2)[::2]) == pytest.approx(expected, rel=1e-14)
    assert Moments.of(values.astype(">f8")) == pytest.approx(expected, rel=1e-14)
    assert Moments.of(values.astype("f4")) == pytest.approx(expected, rel=1e-5)
    assert not fixed.flags.writeable and values.flags.writeable
    with_holes = np.insert(values, [0, 500, 1000], [np.nan, np.inf, np.nan])
    assert Moments.of(with_holes) == pytest.approx(expected, rel=1e-14)
    assert Moments.of(np.array([])) == Moments.of(np.array([np.nan])) == Moments()
    assert summed(np.full(1000, 0.1))[2:] == (0.1, 0.1)
