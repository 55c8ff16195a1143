"""Readings that are none: isolated spikes by robust increments, and codes that stand for "no value".

A spike is told from what a device really does by three things. It is alone or one of a pair, and what comes after it
agrees with what came before: a step, a pulse that decays, a warm-up do not return. It is far beyond the record's own
increments, whose tail is foretold from its bulk by a power law: noise with heavy tails has no spikes. And no fewer of
the record's jumps of that size return than stay: a random telegraph has no spikes either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from .looks import stay_within
from .repeats import at_ends, on_lines, repeated
from .statistics import Moments
from .usual import DEVIATION, MOST, OVERLOAD, SPIKE, Usual, usual_of

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

RETURN = 0.2
"""Difference between the readings after and before a spike, over its height, up to which it has returned."""
LONGEST = 2
"""Rows of a spike at most."""
NEARBY = 25
"""Rows to either side on which the noise near a spike is measured: what is usual where noise comes and goes."""
ABSURD = 50.0
"""Distance from the median, in ranges of nine tenths of the readings, of a code that is met for the first time."""
UNHEARD = 1000.0
"""Distance [ranges] of a number that is none of these codes, from which it is one if it repeats itself exactly."""
CODES = (85.0, -127.0, -273.15, 327.67, -327.68, 999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 99999.9,
         999999.0, 32767.0, -32768.0, 65535.0)  # fmt: skip
"""Numbers that stand for "no value", those of nines with either sign: DS18B20 at power-on (85) and unplugged (-127),
ends of integers, and what loggers write."""
ALL_CODES = np.unique([sign * code for code in CODES for sign in (1.0, -1.0 if "999" in str(code) else 1.0)])
CHUNK = 1 << 16
"""Rows that are looked at together: they stay near the processor, and their memory is used again."""
HALO = 64
"""Rows to either side that decide on a row, missing ones included."""
_BINS, _PER_OCTAVE = 512, 8


class Jumps:
    """How often heights of each size occur, in 8 classes an octave."""

    def __init__(self, counts: NDArray[np.int64] | None = None):
        self.counts = np.zeros(_BINS, np.int64) if counts is None else counts

    def add(self, sizes: Floats, reach: float) -> None:
        """Count heights, measured in `reach`."""
        self.counts += np.bincount(self._classes(sizes, reach), minlength=_BINS)

    def alike(self, sizes: Floats, reach: float) -> NDArray[np.int64]:
        """How many are about as high as each of `sizes`, within a factor of 2."""
        at_least = np.append(np.cumsum(self.counts[::-1])[::-1], 0)
        classes = self._classes(sizes, reach)
        low = np.maximum(classes - _PER_OCTAVE, 0)
        return np.asarray(at_least[low] - at_least[np.minimum(classes + _PER_OCTAVE + 1, _BINS)])

    @staticmethod
    def _classes(sizes: Floats, reach: float) -> NDArray[np.intp]:
        octaves = np.log2(np.maximum(sizes / max(reach, 1e-300), 1.0))
        return np.asarray(np.minimum((_PER_OCTAVE * octaves).astype(int), _BINS - 1))


@dataclass
class Scanned:
    """What was found in some rows."""

    codes: NDArray[np.intp]
    """Rows that hold codes."""
    spikes: NDArray[np.intp]
    """Rows of peaks beyond the reach, alone or in pairs."""
    heights: Floats
    """Heights of the peaks."""
    staying: Jumps
    """Jumps that do not return."""
    left: Moments = field(default_factory=Moments)
    """Moments of what is left."""
    repeats: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    """Rows that repeat the one before, or stand on lines, where readings are repeated or filled in."""
    clipped: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    """Rows at an end of the instrument's range, or so near that noise would go beyond it."""

    @classmethod
    def together(cls, parts: Iterable[Scanned]) -> Scanned:
        """What was found in several stretches of rows, as one."""
        parts = list(parts)
        staying = Jumps(np.sum([part.staying.counts for part in parts], axis=0)) if parts else Jumps()
        none = np.zeros(0, np.intp)
        return cls(
            codes=np.concatenate([none, *(part.codes for part in parts)]),
            spikes=np.concatenate([none, *(part.spikes for part in parts)]),
            heights=np.concatenate([np.zeros(0), *(part.heights for part in parts)]),
            staying=staying,
            left=reduce(Moments.merged, (part.left for part in parts), Moments()),
            repeats=np.concatenate([none, *(part.repeats for part in parts)]),
            clipped=np.concatenate([none, *(part.clipped for part in parts)]),
        )

    @property
    def is_nothing(self) -> bool:
        """Whether nothing was found, so that all values are left."""
        return not (len(self.codes) or len(self.spikes) or len(self.repeats) or len(self.clipped))

    def moved(self, rows: int) -> Scanned:
        """Rows counted from so many rows earlier."""
        found = {name: getattr(self, name) for name in ("codes", "spikes", "repeats", "clipped")}
        return replace(self, **{name: places + rows for name, places in found.items() if len(places)})

    def true_spikes(self, usual: Usual, n_rows: int) -> NDArray[np.intp]:
        """Spikes that are none of the device's own jumps: at least half of the jumps of their size return."""
        if not len(self.spikes) or len(self.spikes) > MOST * n_rows:
            return np.zeros(0, np.intp)
        returning = Jumps()
        returning.add(self.heights, usual.reach)
        own = self.staying.alike(self.heights, usual.reach) > returning.alike(self.heights, usual.reach)
        return np.asarray(self.spikes[~own])


def scan(values: Floats, low: int, high: int, usual: Usual) -> Scanned:
    """Look at rows ``low:high`` of `values`, which holds `HALO` more to either side where there are any.

    Parameters
    ----------
    values : array of shape (n,)
        Consecutive readings, NaN where there is none.
    low, high : int
        Rows that are decided on; the others are their neighbours.
    usual : Usual

    Returns
    -------
    Scanned
        Rows are numbered as in `values`.
    """
    if usual.repeats or usual.ends or np.isfinite(usual.near_lines):
        clipped = at_ends(values, usual.ends, usual.noise)
        again = (repeated(values) if usual.repeats else on_lines(values, usual.near_lines)) & ~clipped
        plain = replace(usual, repeats=False, near_lines=np.nan, ends=())
        rest = scan(np.where(again | clipped, np.nan, values), low, high, plain)
        at_end, at_rest = (low + np.flatnonzero(rows[low:high]) for rows in (clipped, again))
        return replace(rest, clipped=at_end, repeats=at_rest)
    nothing, jumps = np.zeros(0, np.intp), Jumps()
    most = min(usual.reach, OVERLOAD / 2)
    if not len(values) or (stay_within(values, most) and abs(values[0]) < OVERLOAD):  # never where one is missing
        return Scanned(
            codes=nothing,
            spikes=nothing,
            heights=np.zeros(0),
            staying=jumps,
            left=Moments.of(values[low:high]),
        )
    rows = np.flatnonzero(np.isfinite(values))
    over = usual.overloads(values[rows])
    left, found = rows[~over], [rows[over]]
    if np.isfinite(usual.reach):
        coded = _coded(values[left], usual)
        found.append(left[coded])
        left = left[~coded]
    codes = np.sort(np.concatenate(found))
    spiked, heights = _peaks(values[left], usual, jumps, (left >= low) & (left < high))
    inside = (left[spiked] >= low) & (left[spiked] < high)
    codes = codes[(codes >= low) & (codes < high)]
    kept = np.delete(left, spiked)
    moments = Moments.of(values[kept[(kept >= low) & (kept < high)]])
    return Scanned(codes, left[spiked][inside], heights[inside], jumps, moments)


def scan_stretch(
    read: Callable[[int, int], Floats], start: int, stop: int, first: int, last: int, usual: Usual
) -> Iterator[Scanned]:
    """Look at the rows ``start:stop``, a chunk at a time; their neighbours may lie in ``first:last``."""
    for low in range(start, stop, CHUNK):
        high = min(low + CHUNK, stop)
        before, behind = max(low - HALO, first), min(high + HALO, last)
        yield scan(read(before, behind), low - before, high - before, usual).moved(before)


def _coded(values: Floats, usual: Usual) -> Booleans:
    """Whether readings are codes: entered and left by jumps to usual readings, or to the end; shape (n,), booleans."""
    found = np.zeros(len(values), bool)
    beyond = usual.outside(values)
    if not beyond.any():
        return found
    repeated = np.zeros(len(values), bool)
    repeated[1:] = values[1:] == values[:-1]
    repeated[:-1] |= repeated[1:]
    beyond &= np.isin(values, ALL_CODES) | (repeated & usual.outside(values, UNHEARD))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], beyond, [False])).astype(int)))
    for start, stop in edges.reshape(-1, 2).tolist():
        ends = [abs(values[start] - values[start - 1])] if start else []
        ends += [abs(values[stop - 1] - values[stop])] if stop < len(values) else []
        if ends and min(ends) > max(usual.reach, usual.range):
            found[start:stop] = True
    return found


def _peaks(values: Floats, usual: Usual, jumps: Jumps, inside: Booleans) -> tuple[NDArray[np.intp], Floats]:
    """Peaks of one or two rows beyond the reach, and their heights; jumps that stay are counted."""
    steps = np.diff(values)
    far = np.flatnonzero(np.abs(steps) > usual.reach)
    lengths, heights = np.zeros(len(far), np.intp), np.zeros(len(far))
    for length in range(1, LONGEST + 1):  # of the longest that returns
        ends = np.flatnonzero(np.isin(far + length, far))
        returned, height = _returned(values, far[ends] + 1, length, usual)
        lengths[ends[returned]], heights[ends[returned]] = length, height[returned]
    stays, free = np.ones(len(far), bool), 0
    rows: list[NDArray[np.intp]] = []
    for k in np.flatnonzero(lengths):
        if far[k] >= free:  # not within the one before
            free = far[k] + lengths[k] + 1
            stays[k : np.searchsorted(far, free)] = False
            rows.append(np.arange(far[k] + 1, free))
        else:
            lengths[k] = 0
    stays[stays] = inside[far[stays] + 1]
    jumps.add(np.abs(steps[far[stays]]), usual.reach)
    return np.concatenate([np.zeros(0, np.intp), *rows]), np.repeat(heights, lengths)


def _returned(values: Floats, first: NDArray[np.intp], length: int, usual: Usual) -> tuple[Booleans, Floats]:
    """Whether the rows from each of `first` on are far from those before and after, which agree, and from the noise
    nearby; and how far they are.
    """
    returned, heights = np.zeros(len(first), bool), np.zeros(len(first))
    complete = np.flatnonzero((first > 0) & (first + length < len(values)))
    first = first[complete]
    before, after = values[first - 1], values[first + length]
    away = np.abs(values[first[:, None] + np.arange(length)] - ((before + after) / 2)[:, None])
    heights[complete] = height = away.min(axis=1)
    high = height > max(usual.reach, SPIKE * usual.noise)  # else the noise nearby need not be looked at
    noise = np.maximum(usual.noise, _noise_beside(values, first[high], length))
    agree = np.abs(after - before)[high] <= np.maximum(3 * noise, RETURN * height[high])
    returned[complete[high]] = agree & (height[high] > SPIKE * noise)
    return returned, heights


def _noise_beside(values: Floats, first: NDArray[np.intp], length: int) -> Floats:
    """`_noise` of the rows nearby, before and after those from each of `first` on."""
    rows = first[:, None] + np.concatenate((np.arange(-NEARBY, 0), np.arange(length, length + NEARBY)))
    near = values.take(rows, mode="clip")
    near[(rows < 0) | (rows >= len(values))] = np.nan
    sizes = np.abs(np.diff(near, axis=1))
    sizes[~(sizes > 0)] = np.inf  # where it stands still, and beyond the ends
    moved = np.isfinite(sizes).sum(axis=1)
    middle = np.take_along_axis(np.sort(sizes, axis=1), np.maximum(moved[:, None] - 1, 0) // 2, axis=1)[:, 0]
    return np.where(moved > 0, DEVIATION * middle, 0.0)


def spikes(values: Floats, rounding: float = 0.0) -> Booleans:
    """Whether consecutive readings are codes or spikes, shape (n,), booleans.

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
    usual = usual_of([values])
    found = scan(values, 0, len(values), usual)
    mask = np.zeros(len(values), bool)
    mask[found.codes] = True
    if usual.noise > rounding:
        mask[found.true_spikes(usual, len(values))] = True
    return mask
