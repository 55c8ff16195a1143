"""How well the record knows a moment: rows between which a step, another law or a disturbance begins or ends."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..equations.noise import Kernel, inverse_kernel
from .bandwise import solved
from .choice import Cause
from .cuts import products_from
from .dated import DATED
from .levels import MOMENTS
from .likelihood import Comparison
from .pool import Pool

Interval = tuple[float, float]


def intervals(pool: Pool, judged: Comparison, causes: Sequence[Cause]) -> list[tuple[Interval, ...]]:
    """Intervals (95 %) of the moments of each cause [s] since the record began; none for causes without a moment.

    A moment may lie wherever the likelihood falls by no more than `MOMENTS`, the coefficients held. That is the
    quantile of its fall at the true moment, (1 - exp(-fall))^2 <= 95 %, for jumps that are small beside the noise of a
    sample (Siegmund, Int. Stat. Rev. 56, 1988); a large jump is known better, to the sample.
    """
    with_moments = [k for k, cause in enumerate(causes) if cause.tried.key[0] in DATED]
    found: list[tuple[Interval, ...]] = [() for _ in causes]
    seconds = pool.data.seconds
    if not with_moments or np.any(np.diff(seconds) <= 0):  # runs that overlap: a time has several places
        return found
    heights, left = _heights(judged, [causes[k] for k in with_moments])
    kernel = inverse_kernel(judged.base.theta, judged.bands.times)
    for k, height in zip(with_moments, heights, strict=True):
        effect = causes[k].tried.explanation.effect
        shift = pool.rows.weight * (height[0] + (height[1] * pool.temperature if len(height) > 1 else 0.0))
        ends = effect.seconds_ if isinstance(effect.seconds_, list) else [effect.seconds_]
        found[k] = tuple(
            _interval(shift * sign, left, int(np.searchsorted(seconds, end)), kernel, seconds)
            for end, sign in zip(ends, (1.0, -1.0), strict=False)
        )
    return found


def _heights(judged: Comparison, causes: Sequence[Cause]) -> tuple[list[np.ndarray], np.ndarray]:
    """Coefficients of columns that begin at a moment, and what all causes leave, times the noise's inverse covariance.

    The adopted columns are mixtures with the base; here the plain ones stand in their places.
    """
    plain = [judged.bands.forward(cause.tried.explanation.columns) for cause in causes]
    mixed = [np.arange(judged.Q.shape[1])[judged.causes[cause.adopted]] for cause in causes]
    columns = np.column_stack([np.delete(judged.Q, np.concatenate(mixed), axis=1), *plain])
    W = 1 / judged.bands.each_row(judged.S(judged.base.theta))
    coef = solved(columns.T @ (columns * W[:, None]), columns.T @ (W * judged.z))
    left = judged.bands.back(((judged.z - columns @ coef) * W)[:, None])[:, 0]
    edges = np.cumsum([0, *(part.shape[1] for part in plain)]) + columns.shape[1] - sum(p.shape[1] for p in plain)
    return [coef[a:b] for a, b in pairwise(edges)], left


def _interval(shift: np.ndarray, left: np.ndarray, row: int, kernel: Kernel, seconds: np.ndarray) -> Interval:
    """Where a shift that begins at a row may begin: times of the rows before and after."""
    reach, n = len(shift) // 4, len(shift)
    before, after = slice(max(row - reach, 1), row), slice(row, min(row + reach, n - 1))
    earlier = _falls(shift[before][::-1], -left[before][::-1], kernel) <= MOMENTS
    later = _falls(shift[after], left[after], kernel) <= MOMENTS
    low = row - 1 - int(np.flatnonzero(earlier).max(initial=-1))
    high = row + 1 + int(np.flatnonzero(later).max(initial=-1))
    return float(seconds[max(low - 1, 0)]), float(seconds[min(high, n - 1)])


def _falls(shift: np.ndarray, left: np.ndarray, kernel: Kernel) -> np.ndarray:
    """How far the likelihood falls as the first one, two, ... rows lose their shift."""
    own = products_from(shift[::-1, None], kernel, mirrored=False)[::-1, 0, 0]
    return np.asarray(np.cumsum(shift * left) + 0.5 * own)
