"""A short stretch of wrong readings, wherever it begins and ends: what each would explain, all at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from ..equations.noise import Kernel, inverse_kernel
from .levels import AROUND, LENGTHS, LEVEL, LONGEST_STRETCH, OUTSTANDING, ROBUST, SHORTEST_STRETCH, STRETCHES
from .likelihood import Comparison


class Stretch(NamedTuple):
    """Rows ``start:stop``, and what a shift of them gains in log likelihood."""

    start: int
    stop: int
    gain: float


def lengths_of(n: int) -> np.ndarray:
    """Lengths in rows that are tried on a record of n rows, evenly in the logarithm."""
    longest = int(LONGEST_STRETCH * n)
    count = int(np.log(max(longest, 1) / SHORTEST_STRETCH) / np.log(LENGTHS)) + 1
    return np.unique((SHORTEST_STRETCH * LENGTHS ** np.arange(count)).astype(int)) if count > 0 else np.zeros(0, int)


def squares_of(longest: int, kernel: Kernel) -> np.ndarray:
    """Sums over all pairs of rows of a stretch of the inverse covariance of the noise, for 0 to `longest` rows."""
    white, sizes, r = kernel
    L = np.arange(longest + 1.0)[:, None]
    pairs = L * (1 + r) / (1 - r) - 2 * r * (1 - r**L) / (1 - r) ** 2  # of r^|i - j|, i and j in the stretch
    return np.asarray(white * (L[:, 0] - pairs @ sizes))


def damped(values: np.ndarray) -> np.ndarray:
    """Values with those that stand out of the median around them brought near to it, shape (n,)."""
    near = pd.Series(values).rolling(AROUND, center=True, min_periods=1).median().to_numpy()
    apart = values - near
    limit = OUTSTANDING * (ROBUST * float(np.median(np.abs(apart))) or float(np.std(apart)))
    return np.asarray(near + np.clip(apart, -limit, limit))


def best_stretch(judged: Comparison, theta: np.ndarray, weight: np.ndarray) -> Stretch | None:
    """The stretch whose shift gains most under a given noise; None where chance may do as much.

    A short stretch lies outside the base but for a share that is left out of account. Single readings that stand out
    count less, or heavy tails of the noise would be short disturbances. `weight` is what rows are weighted with, shape
    (n,).
    """
    lengths = lengths_of(judged.n)
    if not len(lengths):
        return None
    bands = judged.bands
    left = bands.forward(damped(bands.back(judged.left(theta)[:, None])[:, 0])[:, None])
    rows = bands.back(left / bands.each_row(judged.S(theta))[:, None])[:, 0]
    sums = np.concatenate(([0.0], np.cumsum(rows * weight)))
    squares = np.concatenate(([0.0], np.cumsum(weight**2)))
    of_length = squares_of(2 * int(lengths[-1]), inverse_kernel(theta, bands.times))
    segment = judged.bands.segment

    def gains(start: np.ndarray, stop: np.ndarray) -> np.ndarray:
        length = stop - start
        own = of_length[length] * (squares[stop] - squares[start]) / length
        return np.where(segment[start] == segment[stop - 1], 0.5 * (sums[stop] - sums[start]) ** 2 / own, 0.0)

    best = Stretch(0, 0, 0.0)
    for length in lengths.tolist():
        start = np.arange(1, judged.n - length)
        best = max(best, _best(start, start + length, gains), key=lambda stretch: stretch.gain)
    reach = max(1, int((LENGTHS - 1) * (best.stop - best.start)))
    start = np.arange(max(best.start - reach, 1), best.start + reach + 1)
    stop = np.arange(best.stop - reach, min(best.stop + reach, judged.n - 1) + 1)
    pairs = [part.ravel() for part in np.meshgrid(start[:: 1 + reach // 40], stop[:: 1 + reach // 40])]
    long_enough = pairs[1] - pairs[0] >= SHORTEST_STRETCH
    best = max(best, _best(pairs[0][long_enough], pairs[1][long_enough], gains), key=lambda stretch: stretch.gain)
    return best if stats.chi2.sf(2 * best.gain, 1) * STRETCHES * judged.n <= LEVEL else None


def _best(start: np.ndarray, stop: np.ndarray, gains: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Stretch:
    each = gains(start, stop)
    k = int(each.argmax())
    return Stretch(int(start[k]), int(stop[k]), float(each[k]))
