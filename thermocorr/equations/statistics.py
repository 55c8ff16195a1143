"""Moments, robust scales and usual steps, block by block."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def moving_average(values: Floats, window: int) -> Floats:
    """Centred moving average over `window` samples, eqs. (9) (26).

    NaN values are left out of the mean. Near the ends the window is cut, so the result has the length of `values`;
    it is NaN where a window holds no value.

    Examples
    --------
    >>> import numpy as np
    >>> moving_average(np.array([0.0, 3.0, 6.0, np.nan]), 3).round(2)
    array([1.5, 3. , 4.5, 6. ])
    """
    n = len(values)
    here = np.isfinite(values)
    offset = values[here].mean() if here.any() else 0.0  # a running sum of small numbers keeps its digits
    total = np.concatenate(([0.0], np.cumsum(np.where(here, values - offset, 0.0))))
    count = np.concatenate(([0], np.cumsum(here)))
    low = np.maximum(np.arange(n) - (window - 1) // 2, 0)
    high = np.minimum(np.arange(n) + window // 2 + 1, n)
    number = count[high] - count[low]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(number > 0, (total[high] - total[low]) / number + offset, np.nan)


class MovingAverage:
    """Mean of the last `count` values, eq. (26).

    NaN leave it as it is, and get NaN.
    """

    def __init__(self, count: int):
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(f"The 'average' parameter must be a number of samples, at least 1. Got {count!r} instead.")
        self.count = int(count)
        self.values: deque[float] = deque(maxlen=self.count)

    def reset(self) -> None:
        """Forget all values."""
        self.values.clear()

    def one(self, value: float) -> float:
        """The mean, after one more value."""
        if math.isnan(value):
            return math.nan
        self.values.append(value)
        return math.fsum(self.values) / len(self.values)

    def many(self, values: np.ndarray) -> np.ndarray:
        """The mean after each of many values, shape (n,)."""
        result = np.full(len(values), np.nan)
        known = np.flatnonzero(np.isfinite(values))
        if len(known):
            line = np.concatenate((np.array(self.values), values[known]))
            offset = float(np.median(line))  # small numbers keep their digits
            sums = _window_sums(line - offset, self.count)[len(self.values) :]
            counts = np.minimum(np.arange(len(self.values), len(line)) + 1, self.count)
            result[known] = sums / counts + offset
            self.values.extend(values[known][-self.count :].tolist())
        return result


def _window_sums(values: np.ndarray, count: int) -> np.ndarray:
    """Sums over the last `count` values, shape (n,).

    A window is the end of one stretch of `count` values and the beginning of the next (van Herk 1992, Pattern
    Recognition Letters 13, 517): nothing is subtracted, so an absurd value is gone when it has left the window.
    """
    n, count = len(values), min(count, len(values))
    stretches = np.zeros((-(-n // count) + 1, count))
    stretches.ravel()[count : count + n] = values  # a stretch of zeros before the first
    beginnings = np.cumsum(stretches, axis=1).ravel()[count : count + n]
    ends = np.cumsum(stretches[:, ::-1], axis=1)[:, ::-1].ravel()
    after = np.arange(1, n + 1)  # where the window begins
    return np.where((after + count) % count == 0, beginnings, beginnings + ends[after])


def reduction_db(after: float, before: float) -> float:
    """20 log10(std after / std before) [dB]; negative is good.

    Examples
    --------
    >>> reduction_db(0.1, 1.0)
    -20.0
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(20.0 * np.log10(np.float64(after) / np.float64(before)))


def white_part(series: Sequence[Floats]) -> float:
    """Variance of the white part of evenly spaced series.

    Differences of order m take out what moves smoothly, and leave of white noise its variance times the binomial
    coefficient (2 m over m) (variate differences: Anderson, Nature 120, 1927). What they leave of a wander grows with
    the rows k between the values, ``V(k) = s^2 + c k^p``: so k = 1, 2, 4 tell the part that does not (the nugget;
    Cressie, Statistics for Spatial Data, 1993, sec. 2.3). p lies between 1 (random walk) and 6 (smooth). 0 where
    a tenth of V(1) or less is left.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> wave, noise = 5.0 * np.sin(np.arange(100_000) / 3), 0.1 * rng.standard_normal(100_000)
    >>> round(white_part([wave + noise]), 3), white_part([wave])
    (0.01, 0.0)
    """
    order = 3
    found = []
    # Differences over one, two and four rows show the white part.
    for k in (1, 2, 4):
        total, count = 0.0, 0
        for x in series:
            change = x
            for _ in range(order):
                change = change[k:] - change[:-k]
            total, count = total + float(change @ change), count + len(change)
        if not count:
            return 0.0
        found.append(total / (count * math.comb(2 * order, order)))
    once, twice, four_times = found
    if twice <= once:
        return once  # nothing wanders
    growth = min(max((four_times - twice) / (twice - once), 2.0), 4.0**order)  # 2^p
    white = once - (twice - once) / (growth - 1)
    # A white part of less than a tenth of the differences from row to row is an error of the extrapolation. Exact
    # temperatures of simulated climates have up to 0.04, or as much as 0.3 mK.
    return white if white > 0.1 * once else 0.0


class Moments(NamedTuple):
    """Number, mean, sum of squared deviations and range of some values."""

    n: int = 0
    mean: float = 0.0
    squares: float = 0.0
    low: float = np.inf
    high: float = -np.inf

    @classmethod
    def of(cls, values: Floats) -> Moments:
        """Moments of an array, without its NaN."""
        if not np.isfinite(values.sum()):
            values = values[np.isfinite(values)]
        if not len(values):
            return cls()
        mean = float(values.sum() / len(values))
        centred = values - mean
        return cls(len(values), mean, float(centred @ centred), float(values.min()), float(values.max()))

    def merged(self, other: Moments) -> Moments:
        """Moments of two sets joined, Chan, Golub & LeVeque (1983)."""
        n = self.n + other.n
        if not n:
            return self
        shift = other.mean - self.mean
        return Moments(
            n,
            self.mean + shift * other.n / n,
            self.squares + other.squares + shift**2 * self.n * other.n / n,
            min(self.low, other.low),
            max(self.high, other.high),
        )

    @property
    def std(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(self.squares / max(self.n, 1)))


Booleans = NDArray[np.bool_]
