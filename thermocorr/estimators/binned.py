"""A record averaged over short stretches: readings, and the columns of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..records import Block, History, Record
from ..records.history import HISTORY_ROWS


@dataclass(frozen=True, kw_only=True)
class Binned:
    """Averages over stretches of equal numbers of rows, none across a segment's end."""

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
        # Bins of a longer record, whose columns must be averaged while it is at hand
        # Bins of a record that its history keeps whole; noise that forgets within a bin is taken for white there
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
        """Rows ``[.. | columns | U]`` of a block, the columns' numbers, and readings, NaN where there is none."""
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
        """Numbers of the bins that a block's rows fall into, and the first of its rows in each."""
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
        """All that was gathered; bins whose rows were all passed over are left out."""
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
    """Means of effects' columns in the bins of a history that keeps every row, and their states at segments' ends.

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
