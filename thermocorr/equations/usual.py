"""What readings usually do: their noise, their range, and the height that a peak among them may have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .repeats import ends_of_range, filled_in, is_repeated, on_lines, repeated

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

OVERLOAD = 1e30
"""Size beyond which a number is a code wherever it stands: 9.9E37 is "overload" in SCPI (1999, vol. 1, 7.2.1.5)."""
SPIKE = 8.0
"""Distance from the neighbours, in robust standard deviations of the noise, below which no reading is a spike. White
Gaussian noise reaches it once in 1e11 rows; at 4, the tails of ordinary noise would be cut."""
DECADES = 1.0
"""Decades beyond the largest peak that is expected of the whole record, out to which the tail of its peaks is foretold.
Of 40 records of Student's t with three degrees, 20 000 rows each, 6 lose a row; at 0 27
do, at 2 one, but of spikes of 12 standard deviations in white noise 15 % are kept then."""
SHARES = (3e-3, 1e-2, 3e-2)
"""Shares of the rows from which, too, the tail is foretold: where as many are spikes, they are no part of it."""
GAP = 2.0
"""Ratio of the heights of one of the largest peaks and the next, from which what is above is no tail."""
GAP_FROM = 10
"""Place of the first of the largest peaks that is looked at: chance leaves large gaps between the very largest."""
FEWEST = 50
"""Readings below which no noise is estimated, so that nothing is a spike."""
MOST = 0.02
"""Share of the readings from which spikes are the noise itself."""
DEVIATION = 1.4826 / np.sqrt(2)
"""Standard deviation of white Gaussian noise, over the median size of its steps."""
_APART = np.full(1, np.nan)  # stands between two stretches


@dataclass(frozen=True, kw_only=True)
class Usual:
    """What readings usually do."""

    middle: float
    low: float
    """5 % of the readings are below."""
    high: float
    """5 % of the readings are above."""
    noise: float
    """Standard deviation of the noise of one reading, robust."""
    reach: float
    """Height that the largest peak of the whole record may have; infinite where nothing tells."""
    repeats: bool = False
    """Whether they are written down more than once each."""
    near_lines: float = np.nan
    """How near to the line between its neighbours a reading stands that was filled in; NaN where none were."""
    ends: tuple[float, ...] = ()
    """Readings at which they are clipped."""

    @property
    def range(self) -> float:
        """Range of nine tenths of the readings."""
        return self.high - self.low

    def overloads(self, values: Floats) -> Booleans:
        """Whether values are too large for a number, shape (n,), booleans."""
        return np.asarray(np.abs(values) >= OVERLOAD)

    def outside(self, values: Floats, ranges: float = 1.0) -> Booleans:
        """Whether values lie so many ranges beyond nine tenths of the readings, shape (n,), booleans."""
        return np.asarray((values < self.low - ranges * self.range) | (values > self.high + ranges * self.range))


def usual_of(stretches: Sequence[Floats], n_rows: int | None = None, temperature: bool = False) -> Usual:
    """What is usual of `n_rows` readings, from stretches (NaN: none); no ends or lines of a `temperature`."""
    whole = np.concatenate([np.zeros(0), *(part for stretch in stretches for part in (_APART, stretch))])
    fits = np.abs(whole) < OVERLOAD  # NaN does not
    values = np.sort(whole[fits])
    if len(values) < FEWEST:
        return Usual(middle=0.0, low=-np.inf, high=np.inf, noise=np.inf, reach=np.inf)
    low, middle, high = (_share(values, share) for share in (0.05, 0.5, 0.95))
    fits[np.cumsum([0, *(1 + len(stretch) for stretch in stretches[:-1])])] = True
    line = whole[fits]
    ends, repeats = () if temperature else ends_of_range(line), is_repeated(line)
    near = np.nan if temperature or repeats else filled_in(np.where(fits, whole, np.nan))
    if repeats or np.isfinite(near):
        line = line[~(repeated(line) if repeats else on_lines(line, near))]
    steps = line[1:] - line[:-1]
    noise = _noise(steps)
    if noise == 0.0:
        return Usual(middle=middle, low=low, high=high, noise=0.0, reach=np.inf)  # it stands still: no jump is unusual
    peaks = np.sort(peak_heights(steps))
    fewest = max(1e-3, 10 / len(values))
    shares = [fewest, *(share for share in SHARES if share > fewest)]
    n = max(n_rows or 0, len(values))
    foretold = min(_foretold(peaks, share, n, noise) for share in shares)
    reach = max(SPIKE * noise, min(foretold, _below_a_gap(peaks, noise)))
    return Usual(
        middle=middle, low=low, high=high, noise=noise, reach=float(reach), repeats=repeats, near_lines=near, ends=ends
    )


def _foretold(peaks: Floats, rare: float, n_rows: int, noise: float) -> float:
    """Height of the largest of `n_rows` peaks, by a power law: what a share exceeds, and ten times it."""
    often = min(10 * rare, 0.3)
    q_rare, q_often = _share(peaks, 1 - rare), _share(peaks, 1 - often)
    growth = max(q_rare / max(q_often, noise), 1.0) ** (1 / np.log10(often / rare))
    return float(q_rare * growth ** max(np.log10(rare * n_rows) + DECADES, 0.0))


def _below_a_gap(peaks: Floats, noise: float) -> float:
    """Height within the lowest gap of the sorted peaks that no power law has; infinite where there is none.

    Of a tail like 1 / height the k-th largest is twice the next once in 2^k records, of lighter ones still less often.
    """
    top = peaks[int((1 - MOST) * len(peaks)) :][::-1]
    high, low = top[GAP_FROM - 1 : -1], np.maximum(top[GAP_FROM:], noise)
    gaps = np.flatnonzero((high > SPIKE * noise) & (high > GAP * low))
    return float(np.sqrt(high[gaps[-1]] * low[gaps[-1]])) if len(gaps) else np.inf


def _share(ordered: Floats, share: float) -> float:
    """The value below which a share of the sorted ones lies."""
    return float(ordered[int(share * (len(ordered) - 1))])


def _noise(steps: Floats) -> float:
    """Standard deviation of white noise with these steps, from their median; 0 where nothing moves."""
    sizes = np.abs(steps)
    moved = np.sort(sizes[sizes > 0])  # a quantised reading stands still most of the time
    return float(DEVIATION * _share(moved, 0.5)) if len(moved) else 0.0


def peak_heights(steps: Floats) -> Floats:
    """Heights of peaks of one row over the nearer neighbour, 0 where there is none; from the steps, shape (n - 1,)."""
    up, down = steps[:-1], steps[1:]
    heights = np.minimum(np.abs(up), np.abs(down))
    heights[~(up * down < 0)] = 0.0  # nor where one is missing
    return heights
