"""Averages of readings and columns over short stretches.

Averages commute with linear least squares: a model of the readings is a model of their averages, with the same
coefficients and fewer, quieter rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..equations import noise
from ..records import Block, History, Record
from ..records.history import HISTORY_ROWS

COARSE = 2_500
"""Stretches on which data not learned from are predicted: the user gains in slow structure, which noise would hide."""
ROWS = 1 << 15
"""Rows of a block: each of some hundred effects is asked for its columns, block by block."""
AHEAD_ROWS = 1 << 17
"""Rows of a block for effects that look ahead, each time over many rows beyond it."""


@dataclass(frozen=True, kw_only=True)
class Averages:
    """Averages over stretches within segments."""

    reading: np.ndarray
    """Shape (n,)."""
    columns: list[np.ndarray]
    """One array of shape (n, width) for each effect."""
    counts: np.ndarray
    """Readings in each stretch."""
    segment: np.ndarray
    """Number of the segment of each stretch."""
    seconds: np.ndarray
    """Middle of each stretch [s]."""

    @property
    def steps(self) -> np.ndarray:
        """Times from each stretch to the next of its segment [s]."""
        return np.asarray(np.diff(self.seconds)[np.diff(self.segment) == 0])


def averaged(record: Record, effects: Sequence[Effect], n_stretches: int = COARSE) -> Averages:
    """Average readings and columns over equal numbers of rows.

    Rows without a reading are left out of the averages, columns and all. Effects must have learned the record.
    """
    assert record.reading is not None
    width = stretch_of(record, n_stretches)
    readings, counts, segments, seconds = [], [], [], []
    for block in record.blocks(_rows(width, ROWS), starts=own_starts(record)):
        reading, share = np.asarray(record.reading[block.rows], float), _shares(record, block)
        starts = np.arange(0, len(block), width)
        count = np.add.reduceat(share, starts)
        kept, least = count > 0, np.maximum(count, 1)
        readings.append((np.add.reduceat(np.where(share > 0, reading, 0.0) * share, starts) / least)[kept])
        seconds.append((np.add.reduceat(block.seconds * share, starts) / least)[kept])
        counts.append(count[kept])
        segments.append(np.full(int(kept.sum()), block.segment))
    return Averages(
        reading=np.concatenate(readings),
        columns=averaged_columns(record, effects, n_stretches),
        counts=np.concatenate(counts),
        segment=np.concatenate(segments),
        seconds=np.concatenate(seconds),
    )


def averaged_columns(record: Record, effects: Sequence[Effect], n_stretches: int) -> list[np.ndarray]:
    """The columns of `averaged`, shape (n, width) per effect."""
    width = stretch_of(record, n_stretches)
    near = iter(_columns([(record, e) for e in effects if not e.foresees], width, ROWS))
    far = iter(_columns([(record, e) for e in effects if e.foresees], width, AHEAD_ROWS))
    return [next(far if effect.foresees else near) for effect in effects]


def averaged_copies(copies: Sequence[tuple[Record, Effect]], n_stretches: int) -> list[np.ndarray]:
    """Averaged columns of an effect in many similar records."""
    rows = AHEAD_ROWS if copies[0][1].foresees else ROWS
    return _columns(copies, stretch_of(copies[0][0], n_stretches), rows)


def _columns(pairs: Sequence[tuple[Record, Effect]], width: int, rows: int) -> list[np.ndarray]:
    """Averaged columns of effects, from blocks of `rows` rows."""
    if not pairs:
        return []
    record = pairs[0][0]
    edges = np.cumsum([0, *(effect.n_columns() for _, effect in pairs)]).tolist()
    most = sum(-(-segment.n_rows // width) for segment in record.segments)
    means, n = np.empty((most, edges[-1]), order="F"), 0  # at once: memory in small pieces costs more than its use
    places = [range(low, high) for low, high in pairwise(edges)]
    walked = [(*pair, place) for pair, place in zip(pairs, places, strict=True)]
    whole = bool(np.isfinite(np.asarray(record.reading, float).sum()))
    states: list[Any] = []
    for block in record.blocks(_rows(width, rows), starts=own_starts(record)):
        if block.start == record.segments[block.segment].start:
            states = [None] * len(walked)
        share = None if whole else _shares(record, block)
        if share is not None and (share == 1.0).all():
            share = None  # as many rows as readings
        starts = np.arange(0, len(block), width)
        count = np.diff(starts, append=len(block)) if share is None else np.add.reduceat(share, starts)
        share_of_one, kept = 1 / np.maximum(count, 1), slice(None) if count.all() else count > 0
        as_it_is = width == 1 and share is None
        first, n = n, n + int(np.count_nonzero(count))
        for i, (own_record, effect, own) in enumerate(walked):
            seen = block if own_record is record else block.of(own_record)
            columns, states[i] = effect.each_column(seen, states[i])
            for column, place in zip(columns, own, strict=True):
                averaged = not as_it_is and np.ndim(column) > 0
                means[first:n, place] = (_summed(column, share, width) * share_of_one)[kept] if averaged else column
    return [means[:n, low:high] for low, high in pairwise(edges)]


def _summed(column: np.ndarray, share: np.ndarray | None, width: int) -> np.ndarray:
    """Sums of a column over stretches, each row times its share."""
    if share is not None:
        column = column * share
    return sums_of(column[:, None], width)[:, 0] if width > 1 else np.asarray(column, float)


def stretch_of(record: Record, n_stretches: int) -> int:
    """Rows of a stretch."""
    return max(1, -(-record.n_used // n_stretches))


def _rows(width: int, rows: int) -> int:
    """Rows of a block of whole stretches."""
    return max(width, rows // width * width)


def _shares(record: Record, block: Block) -> np.ndarray:
    """1 for rows with a reading, else 0, shape (n,)."""
    assert record.reading is not None
    return np.asarray(np.isfinite(np.asarray(record.reading[block.rows], float)), float)


def sums_of(columns: np.ndarray, width: int) -> np.ndarray:
    """Sums over stretches of `width` rows, shape (stretches, k)."""
    if len(columns) % width or not columns.size:
        return np.asarray(np.add.reduceat(columns, np.arange(0, len(columns), width), axis=0))
    return np.asarray((columns.T.reshape(columns.shape[1], -1, width) @ np.ones(width)).T)


def key_of(effect: Effect) -> str:
    """An effect with all its parameters, as text."""
    return f"{type(effect).__name__}{sorted(effect.get_params(deep=False).items())}"


def spans(data: Averages, record: Record) -> np.ndarray:
    """Number of the span of each stretch, see `thermocorr.equations.noise.spans`."""
    return noise.spans(data.segment, data.seconds, [segment.run for segment in record.segments])


def rms(values: np.ndarray) -> float:
    """Root mean square of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(known @ known / len(known))) if len(known) else np.nan


@dataclass(frozen=True, kw_only=True)
class Binned:
    """Averages over equal numbers of rows, within segments."""

    segment: np.ndarray
    """Number of the segment, shape (n,)."""
    begins: np.ndarray
    """Time of the first row since the record began [s], shape (n,)."""
    count: np.ndarray
    """Rows with a reading, shape (n,)."""
    reading: np.ndarray
    """Mean of the readings; 0 where there are none."""
    width: int
    """Rows of a bin."""
    known: np.ndarray | None = None
    """Which rows of the history have a reading, as packed bits; None where all have one."""
    columns: np.ndarray | None = None
    """Means of the model's columns, shape (n, p); None where the history holds every row to make them from."""


class Binning:
    """Gathers `Binned`, block by block."""

    def __init__(self, record: Record, width: int):
        self.whole = record.n_used <= HISTORY_ROWS
        # A longer record has fewer bins, whose columns must be averaged while it is at hand; noise that forgets within
        # a bin is taken for white there.
        self.width = max(1, -(-record.n_used // ((1 << 13) if self.whole else (1 << 12))))
        sizes = [-(-(segment.stop - segment.start) // self.width) for segment in record.segments]
        self.first = np.cumsum([0, *sizes])
        self.starts = np.array([segment.start for segment in record.segments])
        self.sums, self.count = np.zeros(self.first[-1]), np.zeros(self.first[-1])
        self.begins = np.full(self.first[-1], np.inf)
        self.columns = None if self.whole else np.zeros((len(self.sums), 1 + width))  # of [1 | Q]
        lengths = [segment.stop - segment.start for segment in record.segments]
        self.before = np.cumsum([0, *lengths])
        self.known = np.ones(self.before[-1] if self.whole else 0, bool)

    def take(self, block: Block, columns: np.ndarray, places: Sequence[int], reading: np.ndarray) -> None:
        """Rows ``[.. | columns | U]`` of a block, and its readings."""
        bins, at = self.bins(block)
        known = np.isfinite(reading)
        all_known = bool(known.all())
        self.sums[bins] += np.add.reduceat(reading if all_known else np.where(known, reading, 0.0), at)
        self.count[bins] += np.diff(at, append=len(block)) if all_known else np.add.reduceat(known.astype(float), at)
        self.begins[bins] = np.minimum(self.begins[bins], block.seconds_at(at))
        if self.columns is None:
            self.known[self.before[block.segment] + block.places - self.starts[block.segment]] = known
        else:
            rows = np.arange(len(self.sums))[bins]
            means = np.add.reduceat(columns if all_known else columns * known[:, None], at, axis=0)
            self.columns[rows[:, None], places] += means[:, -1 - len(places) : -1]

    def bins(self, block: Block) -> tuple[slice | np.ndarray, np.ndarray]:
        """Bin numbers of a block's rows, and first rows."""
        first, low = int(self.first[block.segment]), block.start - int(self.starts[block.segment])
        if block.is_whole:
            begin, end = low // self.width, (low + len(block) - 1) // self.width + 1
            at = np.arange(begin * self.width - low, end * self.width - low, self.width)
            at[0] = 0
            return slice(first + begin, first + end), at
        bins = first + (block.places - self.starts[block.segment]) // self.width
        at = np.flatnonzero(np.diff(bins, prepend=-1))
        return bins[at], at

    def binned(self) -> Binned:
        """All that was gathered, without empty bins."""
        seen = np.isfinite(self.begins)
        segment = np.repeat(np.arange(len(self.starts), dtype=np.int32), np.diff(self.first))
        count = np.maximum(self.count[seen], 1.0)
        return Binned(
            segment=segment[seen],
            begins=self.begins[seen],
            count=self.count[seen].astype(np.float32),  # a model is kept with these: half the size is enough
            reading=self.sums[seen] / count,
            width=self.width,
            known=None if self.known.all() else np.packbits(self.known),
            columns=None if self.columns is None else self.columns[seen, 1:] / count[:, None],
        )


def binned_columns(effects: Sequence[Effect], history: History, bins: Binned) -> tuple[np.ndarray, list[list[object]]]:
    """Binned columns of effects, and their final states.

    Rows without a reading do not count.
    """
    record = history.record
    known = None if bins.known is None else np.unpackbits(bins.known, count=record.n_rows).astype(bool)
    means = np.zeros((len(bins.begins), sum(effect.n_columns() for effect in effects)))
    count = np.zeros(len(bins.begins))
    edges = np.searchsorted(bins.segment, np.arange(len(record.segments) + 1))
    ends: list[list[object]] = []
    for block, columns, states in walk(effects, record, starts=own_starts(record)):
        low, high = edges[block.segment], edges[block.segment + 1]
        at = low + np.maximum(np.searchsorted(bins.begins[low:high], block.seconds, side="right") - 1, 0)
        first = np.flatnonzero(np.diff(at, prepend=-1))
        counts = np.ones(len(at)) if known is None else known[block.places].astype(float)
        means[at[first]] += np.add.reduceat(columns if known is None else columns * counts[:, None], first, axis=0)
        count[at[first]] += np.add.reduceat(counts, first)
        if block.stop == record.segments[block.segment].stop:
            ends.append(list(states))
    return means / np.maximum(count, 1.0)[:, None], ends
