"""Moving average and tracked reference of a live corrector, alone: every cut of a stream gives the same numbers."""

import math
from itertools import cycle, pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from thermocorr import DynamicBiasRegressor, OnlineCorrector
from thermocorr.datasets import make_record
from thermocorr.equations import MovingAverage
from thermocorr.live.clock import Tracker

SIZES = ("1", "N-1", "N", "N+1", "2N+1", "8191", "8192", "8193", "mixed")


def moving_average(values, window):
    """Eq. (26) from sums of extended precision; NaN are passed over and get NaN."""
    values, result = np.asarray(values, float), np.full(len(values), np.nan)
    known = values[~np.isnan(values)]
    sums = np.concatenate(([0], np.cumsum(known, dtype=np.longdouble)))
    stop = np.arange(1, len(known) + 1)
    low = np.maximum(stop - window, 0)
    result[~np.isnan(values)] = (sums[stop] - sums[low]) / (stop - low)
    return result


def blocks(size, window, n):
    """Edges of the blocks; single rows follow on a long block, so that they meet a full window."""
    sizes = {"N-1": [max(window - 1, 1)], "N": [window], "N+1": [window + 1], "2N+1": [2 * window + 1]}
    sizes |= {"1": [n - 300, *[1] * 300], "mixed": [1, window, 3, 8192, 2 * window + 1, 1, 1]}
    edges = [0]
    for step in cycle(sizes.get(size) or [int(size)]):
        edges.append(min(edges[-1] + step, n))
        if edges[-1] == n:
            return edges


NUMBERS = st.one_of(st.floats(-1e6, 1e6), st.integers(-9, 9).map(float), st.just(math.nan))


@settings(max_examples=300, deadline=None)
@given(st.lists(st.lists(NUMBERS, max_size=12), max_size=8), st.integers(1, 12), st.lists(st.booleans(), min_size=1))
@example([[1.0, 2.0, 3.0]], 5, [False])
@example([[1.0], [2.0, 3.0]], 5, [False])
@example([[1.0], [2.0], [3.0]], 5, [False])
@example([[1.0, 2.0], [3.0]], 5, [False, True])
@example([[1.0, math.nan], [], [2.0, 3.0]], 5, [False])
def test_any_cut_is_the_average_of_what_came(parts, window, singly):
    """The windows of 1, 2, 3 with average=5 are pinned: blocks once gave 1.75 for 2."""
    average, got = MovingAverage(window), []
    for part, single in zip(parts, cycle(singly), strict=False):
        got += [average.one(value) for value in part] if single else average.many(np.array(part, float)).tolist()
    values = [value for part in parts for value in part]
    scale = max((abs(value) for value in values if value == value), default=0.0)
    np.testing.assert_allclose(got, moving_average(values, window), rtol=0, atol=1e-14 * scale)


@pytest.mark.parametrize("huge", [1e9, 9.9e37], ids=["spike", "overload"])
def test_a_huge_reading_leaves_with_its_window(huge):
    """Multimeters write 9.9e37 for an overload: once it is out of the window, nothing of it is left."""
    values = np.array([1.0, 2.0, 3.0, huge, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    expected = [1.0, 1.5, 2.0, *[(huge + rest) / 3 for rest in (5.0, 4.0, 3.0)], 2.0, 3.0, 4.0, 5.0]
    np.testing.assert_allclose(MovingAverage(3).many(values), expected, rtol=1e-12)
    average = MovingAverage(3)
    np.testing.assert_allclose([average.one(value) for value in values.tolist()], expected, rtol=1e-15)


def test_batch_and_live_write_the_same_mean():
    """Eqs. (9) (26)."""
    record = make_record(1200, seed=5)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", ["10 min"], degree=1).fit(X, y)
    smoothed = model.correct(X, y, average=25)
    assert smoothed.name == "smoothed" and smoothed.iloc[100] == pytest.approx(model.correct(X, y).iloc[76:101].mean())
    live = OnlineCorrector(model, average=25).update_many(X, y)
    np.testing.assert_allclose(live["smoothed"], smoothed, rtol=1e-9)
    with pytest.raises(ValueError, match="average or return_std"):
        model.correct(X, y, average=25, return_std=True)


def test_a_reset_forgets():
    average = MovingAverage(3)
    average.many(np.array([5.0, 6.0]))
    average.reset()
    assert average.one(1.0) == 1.0


def tracked(seconds, values, trusted, tau, start):
    """The weighted mean in closed form: exp(-(t - s)/tau) weighs what was known at s against what came since."""
    result, u, last = [], start, None
    for t, value, trust in zip(seconds, values, trusted, strict=True):
        if trust:
            kept = 1.0 if last is None else np.exp(-max(t - last, 0.0) / tau)
            u, last = kept * u + (1 - kept) * value, t
        result.append(u)
    return np.array(result)


def samples(n, seed=0):
    """Times that stand still and step back now and then, as where runs overlap; values; what is trusted."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([0.25, 1.0, 15.0, 4000.0, 0.0, -300.0], n, p=[0.3, 0.3, 0.3, 0.06, 0.02, 0.02])
    return np.cumsum(steps), 10 + rng.normal(size=n), rng.random(n) < 0.9


@pytest.mark.parametrize("tau", [0.5, 60.0, 86_400.0])
@pytest.mark.parametrize("size", SIZES)
def test_a_tracker_in_blocks_of_every_size(size, tau):
    n = 17_000 if size.startswith("8") else 900
    seconds, values, trusted = samples(n)
    tracker, edges = Tracker(tau, 3.0), blocks(size, 25, n)
    got = [tracker.many(seconds[low:high], values[low:high], trusted[low:high]) for low, high in pairwise(edges)]
    np.testing.assert_allclose(np.concatenate(got), tracked(seconds, values, trusted, tau, 3.0), rtol=1e-12)
    single = Tracker(tau, 3.0)
    rows = zip(seconds.tolist(), values.tolist(), trusted.tolist(), strict=True)
    np.testing.assert_array_equal(np.concatenate(got), [single.one(*row) for row in rows])


def test_untrusted_values_do_not_enter_a_tracker():
    """Whatever they are: NaN and infinities too; the time they take counts once a trusted one comes."""
    tracker, alone = Tracker("10 s", 5.0), Tracker(10.0, 5.0)
    seconds, values = np.array([0.0, 3.0, 4.0, 7.0]), np.array([1.0, math.nan, math.inf, 2.0])
    got = tracker.many(seconds, values, np.array([True, False, False, True]))
    assert got[:3].tolist() == [5.0, 5.0, 5.0]  # the first value only starts the clock
    assert got[3] == alone.many(seconds[[0, 3]], values[[0, 3]], np.ones(2, bool))[1]
    assert got[3] == pytest.approx(2 + 3 * math.exp(-0.7), rel=1e-15)
    tracker.reset()
    assert (tracker.value, tracker.last) == (5.0, None)


def test_empty_blocks_change_nothing():
    none = np.zeros(0)
    average, tracker = MovingAverage(3), Tracker(60.0, 1.0)
    assert average.many(none).shape == tracker.many(none, none, none.astype(bool)).shape == (0,)
    assert average.one(2.0) == 2.0 and tracker.one(0.0, 9.0, True) == 1.0
