"""Values that are no measurements: codes, isolated spikes, repeats.

Three things distinguish a spike from what a device really does. It is alone or one of a pair, and what comes after it
agrees with what came before: a step, a pulse that decays, a warm-up do not return. It is far beyond the record's own
increments, whose tail is predicted from its bulk by a power law: noise with heavy tails has no spikes. And no fewer of
the record's jumps of that size return than stay: a random telegraph has no spikes either.

A logger that asks more often than its instrument measures writes readings down more than once: such a record has fewer
readings than rows, and several rows share the noise of one. What is written down again is equal to the last digit, and
the next value is many digits away, after as many rows; readings that are merely coarse stand still as well, but move on
by a digit or two, and now and then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Rows = NDArray[np.intp]

OVERLOAD = 1e30
"""Size beyond which a number is a code wherever it stands: 9.9E37 is "overload" in SCPI (1999, vol. 1, 7.2.1.5)."""


SPIKE = 8.0
"""Distance from the neighbours, in robust standard deviations of the noise, below which no reading is a spike. White
Gaussian noise reaches it once in 1e11 rows; at 4, the tails of ordinary noise would be cut."""


GAP_FROM = 10
"""Place of the first of the largest peaks that is looked at: chance leaves large gaps between the very largest."""


FEWEST = 30
"""Readings below which no noise is estimated, so that nothing is a spike; and of those that stand in more than one row,
below which nothing is said of them."""
MOST = 0.02
"""Share of the readings at which spikes are the noise itself."""


DEVIATION = 1.4826 / np.sqrt(2)
"""Standard deviation of white Gaussian noise, over the median size of its steps."""


@dataclass(frozen=True, kw_only=True)
class Usual:
    """Usual range and noise of readings."""

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
    """True if they are written down more than once each."""

    @property
    def range(self) -> float:
        """Range of nine tenths of the readings."""
        return self.high - self.low

    def outside(self, values: Floats, ranges: float = 1.0) -> Booleans:
        """True where values lie many ranges beyond the others."""
        return np.asarray((values < self.low - ranges * self.range) | (values > self.high + ranges * self.range))


def usual_of(stretches: Sequence[Floats], n_rows: int | None = None) -> Usual:
    """Estimate the usual range and noise of `n_rows` readings."""
    apart = np.full(1, np.nan)  # between two stretches
    whole = np.concatenate([np.zeros(0), *(part for stretch in stretches for part in (apart, stretch))])
    fits = np.abs(whole) < OVERLOAD  # NaN does not
    values = np.sort(whole[fits])
    if len(values) < FEWEST:
        return Usual(middle=0.0, low=-np.inf, high=np.inf, noise=np.inf, reach=np.inf)
    low, middle, high = (_share(values, share) for share in (0.05, 0.5, 0.95))
    fits[np.cumsum([0, *(1 + len(stretch) for stretch in stretches[:-1])])] = True
    line = whole[fits]
    repeats = is_repeated(line)
    if repeats:
        line = line[~repeated(line)]
    steps = line[1:] - line[:-1]
    noise = _noise(steps)
    if noise == 0.0:
        return Usual(middle=middle, low=low, high=high, noise=0.0, reach=np.inf)  # it stands still: no jump is unusual
    peaks = np.sort(peak_heights(steps))
    fewest = max(1e-3, 10 / len(values))
    # The tail is predicted at these shares of the rows, too: where as many are spikes, they are no part of it.
    shares = [fewest, *(share for share in (3e-3, 1e-2, 3e-2) if share > fewest)]
    n = max(n_rows or 0, len(values))
    predicted = min(_predicted(peaks, share, n, noise) for share in shares)
    reach = max(SPIKE * noise, min(predicted, _below_a_gap(peaks, noise)))
    return Usual(middle=middle, low=low, high=high, noise=noise, reach=float(reach), repeats=repeats)


def _predicted(peaks: Floats, rare: float, n_rows: int, noise: float) -> float:
    """Expected height of the largest of `n_rows` peaks."""
    often = min(10 * rare, 0.3)
    q_rare, q_often = _share(peaks, 1 - rare), _share(peaks, 1 - often)
    growth = max(q_rare / max(q_often, noise), 1.0) ** (1 / np.log10(often / rare))
    # The tail of the peaks is predicted to one decade beyond the largest expected peak of the whole record. Of 40
    # records of Student's t with three degrees, 20 000 rows each, 6 lose a row; at 0 27 do, at 2 one, but of spikes of
    # 12 standard deviations in white noise 15 % are kept then.
    return float(q_rare * growth ** max(np.log10(rare * n_rows) + 1.0, 0.0))


def _below_a_gap(peaks: Floats, noise: float) -> float:
    """Height of the lowest gap that no power law explains.

    Of a tail like 1 / height the k-th largest is twice the next once in 2^k records, of lighter ones still less often.
    """
    top = peaks[int((1 - MOST) * len(peaks)) :][::-1]
    high, low = top[GAP_FROM - 1 : -1], np.maximum(top[GAP_FROM:], noise)
    # What is above a gap of twice the height is no tail.
    gaps = np.flatnonzero((high > SPIKE * noise) & (high > 2.0 * low))
    return float(np.sqrt(high[gaps[-1]] * low[gaps[-1]])) if len(gaps) else np.inf


def _share(ordered: Floats, share: float) -> float:
    """The value below which a share of the sorted ones lies."""
    return float(ordered[int(share * (len(ordered) - 1))])


def _noise(steps: Floats) -> float:
    """Standard deviation of white noise, from the median step."""
    sizes = np.abs(steps)
    moved = np.sort(sizes[sizes > 0])  # a quantised reading stands still most of the time
    return float(DEVIATION * _share(moved, 0.5)) if len(moved) else 0.0


def peak_heights(steps: Floats) -> Floats:
    """Heights of one-row peaks over the nearer neighbour."""
    up, down = steps[:-1], steps[1:]
    heights = np.minimum(np.abs(up), np.abs(down))
    heights[~(up * down < 0)] = 0.0  # nor where one is missing
    return heights


NEARBY = 25
"""Rows to either side on which the noise near a spike is measured: what is usual where noise comes and goes."""
ABSURD = 50.0
"""Distance from the median, in ranges of nine tenths of the readings, of a code that is met for the first time."""
CODES = (85.0, -127.0, -273.15, 327.67, -327.68, 999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 99999.9,
         999999.0, 32767.0, -32768.0, 65535.0)  # fmt: skip
"""Numbers that stand for "no value", those of nines with either sign: DS18B20 at power-on (85) and unplugged (-127),
ends of integers, and what loggers write."""
ALL_CODES = np.unique([sign * code for code in CODES for sign in (1.0, -1.0 if "999" in str(code) else 1.0)])
CHUNK = 1 << 16
"""Rows that are looked at together: they stay near the processor, and their memory is used again."""
HALO = 64
"""Rows to either side that decide on a row, missing ones included."""


class Found(NamedTuple):
    """What is no measurement in some rows, whose numbers increase."""

    codes: Rows
    """Rows that hold codes."""
    spikes: Rows
    """Rows of peaks beyond the reach, alone or in pairs."""
    heights: Floats
    """Heights of these peaks."""
    staying: Floats
    """Sizes of jumps that do not return."""
    repeats: Rows
    """Rows that repeat the one before, where readings are repeated."""

    def true_spikes(self, n_rows: int) -> Rows:
        """Spikes that return; none where most jumps stay."""
        if not len(self.spikes) or len(self.spikes) > MOST * n_rows:
            return self.spikes[:0]
        stay, turn = (_alike(self.heights, others) for others in (self.staying, self.heights))
        return self.spikes[stay <= turn]


def _alike(sizes: Floats, others: Floats) -> NDArray[np.intp]:
    """Number of other sizes within a factor of 2."""
    ordered = np.sort(others)
    return np.searchsorted(ordered, 2 * sizes, "right") - np.searchsorted(ordered, sizes / 2)


def found_in(read: Callable[[int, int], Floats], stretches: Iterable[tuple[int, int]], usual: Usual) -> Found:
    """Look at stretches of consecutive rows, a chunk at a time.

    `read` gives the values between two rows, NaN for a missing one.
    """
    parts = []
    for start, stop in stretches:
        for low in range(start, stop, CHUNK):
            high = min(low + CHUNK, stop)
            first = max(low - HALO, start)
            parts.append(_found(read(first, min(high + HALO, stop)), first, (low, high), usual))
    none = Found(*(np.zeros(0, kind) for kind in (np.intp, np.intp, float, float, np.intp)))
    return Found(*(np.concatenate(each) for each in zip(none, *parts, strict=True)))


def _found(values: Floats, first: int, decided: tuple[int, int], usual: Usual) -> Found:
    """Codes and spikes in some rows, numbered from the first."""

    def inside(rows: Rows) -> Booleans:
        return (rows >= decided[0]) & (rows < decided[1])

    none, sizes = np.zeros(0, np.intp), np.zeros(0)
    repeats = none
    if usual.repeats:
        again = repeated(values)
        values, repeats = np.where(again, np.nan, values), first + np.flatnonzero(again)
        repeats = repeats[inside(repeats)]
    most, steps = min(usual.reach, OVERLOAD / 2), np.diff(values)
    if steps.max(initial=0.0) <= most and steps.min(initial=0.0) >= -most and abs(values[0]) < OVERLOAD:
        return Found(none, none, sizes, sizes, repeats)  # never where one is missing
    left = np.flatnonzero(np.isfinite(values))
    coded = np.abs(values[left]) >= OVERLOAD
    if np.isfinite(usual.reach):
        coded[~coded] = _coded(values[left[~coded]], usual)
    codes, left = first + left[coded], left[~coded]
    spiked, heights, jumped = _peaks(values[left], usual)
    spikes, staying = first + left[spiked], first + left[jumped]
    sizes = np.abs(values[left[jumped]] - values[left[jumped - 1]])
    clear = inside(spikes)
    return Found(codes[inside(codes)], spikes[clear], heights[clear], sizes[inside(staying)], repeats)


def _coded(values: Floats, usual: Usual) -> Booleans:
    """True if readings are codes, entered and left by jumps."""
    found = np.zeros(len(values), bool)
    beyond = usual.outside(values)
    if not beyond.any():
        return found
    repeated = np.zeros(len(values), bool)
    repeated[1:] = values[1:] == values[:-1]
    repeated[:-1] |= repeated[1:]
    # A number that repeats itself exactly, a thousand ranges away, is a code whatever it is.
    beyond &= np.isin(values, ALL_CODES) | (repeated & usual.outside(values, 1000.0))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], beyond, [False])).astype(int)))
    for start, stop in edges.reshape(-1, 2).tolist():
        ends = [abs(values[start] - values[start - 1])] if start else []
        ends += [abs(values[stop - 1] - values[stop])] if stop < len(values) else []
        if ends and min(ends) > max(usual.reach, usual.range):
            found[start:stop] = True
    return found


def _peaks(values: Floats, usual: Usual) -> tuple[Rows, Floats, Rows]:
    """Rows and heights of peaks, and jumps that stay."""
    steps = np.diff(values)
    far = np.flatnonzero(np.abs(steps) > usual.reach)
    lengths, heights = np.zeros(len(far), np.intp), np.zeros(len(far))
    # A spike lasts for two rows at most.
    for length in (1, 2):  # of the longest that returns
        ends = np.flatnonzero(np.isin(far + length, far))
        returned, height = _returned(values, far[ends] + 1, length, usual)
        lengths[ends[returned]], heights[ends[returned]] = length, height[returned]
    stays, free = np.ones(len(far), bool), 0
    rows: list[Rows] = []
    for k in np.flatnonzero(lengths):
        if far[k] >= free:  # not within the one before
            free = far[k] + lengths[k] + 1
            stays[k : np.searchsorted(far, free)] = False
            rows.append(np.arange(far[k] + 1, free))
        else:
            lengths[k] = 0
    return np.concatenate([np.zeros(0, np.intp), *rows]), np.repeat(heights, lengths), far[stays] + 1


def _returned(values: Floats, first: Rows, length: int, usual: Usual) -> tuple[Booleans, Floats]:
    """True where rows leave the level around them.
    nearby; and how far they are.
    """
    returned, heights = np.zeros(len(first), bool), np.zeros(len(first))
    complete = np.flatnonzero((first > 0) & (first + length < len(values)))
    first = first[complete]
    before, after = values[first - 1], values[first + length]
    away = np.abs(values[first[:, None] + np.arange(length)] - ((before + after) / 2)[:, None])
    heights[complete] = height = away.min(axis=1)
    high = height > max(usual.reach, SPIKE * usual.noise)  # else the noise nearby need not be looked at
    noise = np.maximum(usual.noise, _noise_around(values, first[high], length))
    # A spike has returned if the readings before and after it differ by less than a fifth of its height.
    agree = np.abs(after - before)[high] <= np.maximum(3 * noise, 0.2 * height[high])
    returned[complete[high]] = agree & (height[high] > SPIKE * noise)
    return returned, heights


def _noise_around(values: Floats, first: Rows, length: int) -> Floats:
    """Noise of the rows around each of `first`."""
    rows = first[:, None] + np.concatenate((np.arange(-NEARBY, 0), np.arange(length, length + NEARBY)))
    near = values.take(rows, mode="clip")
    near[(rows < 0) | (rows >= len(values))] = np.nan
    sizes = np.abs(np.diff(near, axis=1))
    sizes[~(sizes > 0)] = np.inf  # where it stands still, and beyond the ends
    moved = np.isfinite(sizes).sum(axis=1)
    middle = np.take_along_axis(np.sort(sizes, axis=1), np.maximum(moved[:, None] - 1, 0) // 2, axis=1)[:, 0]
    return np.where(moved > 0, DEVIATION * middle, 0.0)


def spikes(values: Floats, rounding: float = 0.0) -> Booleans:
    """True if consecutive readings are codes or spikes, shape (n,), booleans.

    Noise that is no more than `rounding` has no spikes.

    Examples
    --------
    >>> import numpy as np
    >>> values = np.random.default_rng(0).normal(size=1000)
    >>> values[[100, 500, 501]] = 9.9e37, 80.0, 90.0
    >>> np.flatnonzero(spikes(values))
    array([100, 500, 501])
    """
    values = np.asarray(values, float)
    usual, mask = usual_of([values]), np.zeros(len(values), bool)
    found = found_in(lambda low, high: values[low:high], [(0, len(values))], usual)
    mask[found.codes] = True
    if usual.noise > rounding:
        mask[found.true_spikes(len(values))] = True
    return mask


DIGIT, FEW_DIGITS, COARSE = 0.1, 2.5, 0.5
"""Quantile of the steps to and from what stands still that is a digit where readings are coarse; number of digits that
their steps have at most; share of such steps at which readings are coarse. Of white noise of many digits it is a
quarter."""
UNEVEN, JITTER, JUST, TRIMMED = 1.25, 0.15, 0.02, 0.02
"""How unevenly repeated readings may stand: variance of their numbers of rows over that of a logger that asks at even
times, standard deviation as a share of their mean that is added, variance that is added; share of the readings that
stand longest, and as many that stand shortest, whose rows are not asked."""
DIFFERENT = 30
"""Different numbers among these readings, below which they are states or setpoints."""


def repeated(values: Floats) -> Booleans:
    """Mask of consecutive readings equal to the one before, shape (n,)."""
    found = np.zeros(len(values), bool)
    found[1:] = values[1:] == values[:-1]
    return found


def is_repeated(values: Floats) -> bool:
    """True if readings are written down more than once each.

    `values` (array of shape (n,)): Consecutive readings, NaN where there is none, or rows were not looked at.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> is_repeated(np.repeat(noise, 3)), is_repeated(noise), is_repeated(noise.round())
    (True, False, False)
    """
    again = repeated(values)
    if np.count_nonzero(again) < FEWEST:
        return False
    first = np.flatnonzero(~again)
    shown, rows = values[first], np.diff(first, append=len(values))
    stands = rows > 1
    # Readings may be repeated where 15 % of them stand in more than one row: those of white noise of 1.9 digits do as
    # often, and move on by two digits or less in two of three steps.
    if stands.sum() < max(FEWEST, 0.15 * len(shown)) or len(np.unique(shown[stands])) < DIFFERENT:
        return False
    steps = np.abs(np.diff(shown))
    moves = steps[stands[1:] | stands[:-1]]
    moves = moves[np.isfinite(moves)]
    if np.mean(moves <= FEW_DIGITS * np.quantile(moves, DIGIT)) > COARSE:
        return False
    rows = rows[1:-1][np.isfinite(steps[1:]) & np.isfinite(steps[:-1])]  # not cut by the end of a stretch
    low, high = np.quantile(rows, [TRIMMED, 1 - TRIMMED]) if len(rows) else (0, 0)
    rows = rows[(rows >= low) & (rows <= high)]
    mean = float(rows.mean()) if len(rows) else 0.0
    most = UNEVEN * (mean % 1) * (1 - mean % 1) + (JITTER * mean) ** 2 + JUST
    return len(rows) >= FEWEST and bool(np.var(rows) <= most)
