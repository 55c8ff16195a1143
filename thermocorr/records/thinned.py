"""Long records in fewer rows: averages over short stretches of time, made in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .grammar import LARGEST
from .record import Record
from .record_log import RecordLog
from .segments import Segment
from .times import Floats, Times

CHUNK = 1 << 16
"""Rows that are averaged together."""
_NS = 1_000_000_000


@dataclass(frozen=True, kw_only=True)
class Thinned(Record):
    """A record whose rows are averages of a longer one's. Times count from the longer one's first row."""

    counts: NDArray[np.integer[Any]] = field(repr=False)
    """Readings in each row."""
    began: float
    """Stamp of the longer record's first row."""
    step: float
    """Usual step of the longer record [s]."""
    places: NDArray[np.integer[Any]] = field(repr=False)
    """Where each row begins in the longer record, in time order."""
    sizes: NDArray[np.integer[Any]] = field(repr=False)
    """Rows of the longer record in each row."""
    lengths: tuple[float, ...]
    """Duration of each of its segments [s]."""
    unseen: float = 0.0
    """Variance of the residual inside the rows, which their averages do not show."""
    exact: dict[str, Floats] = field(default_factory=dict, repr=False)
    """Averages of the columns of some effects over stretches of `exact_rows` of these rows, none of which crosses from
    one segment into the next, computed in the longer record: shape (stretches, k) each."""
    exact_rows: int = 0

    def places_of(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Rows of this record that rows of the longer one, in time order, have become a part of; -1 for none."""
        place = np.searchsorted(self.places, rows.astype(self.places.dtype), side="right") - 1
        return np.where(rows < self.places[place] + self.sizes[place], place, -1)

    def first_stamp(self) -> float:
        """Absolute time of the longer record's first row."""
        return self.began

    def duration(self, segment: Segment) -> float:
        """First to last sample of a segment of the longer record [s]."""
        return self.lengths[self.segments.index(segment)]

    def usual_step(self) -> float:
        """Median step of the longer record [s]: what fast effects are measured in."""
        return self.step


def thinned(record: Record, columns: Mapping[Any, Any], most: int) -> tuple[Record, dict[Any, float]]:
    """A record in memory, of at most about `most` rows.

    Parameters
    ----------
    record : Record
    columns : mapping of name to column
        Further columns beside the record's own; missing and absurd numbers are left out of their averages.
    most : int
        Up to so many rows the record stays as it is.

    Returns
    -------
    record : Record
        A `Thinned` one where it is longer.
    sound : dict
        Share of each further column that is neither missing nor absurd; 0 for one that never changes.
    """
    width = max(1, -(-record.n_used // most))
    if width == 1:
        return _in_memory(record, columns)
    n = sum(-(-(high - low) // width) for segment in record.segments for low, high in _chunks(record, segment, width))
    own: dict[Any, Floats] = {name: np.empty(n) for name in (*record.columns, *columns)}
    looked = {name: _Looked() for name in columns}
    reading, seconds = np.empty(n), np.empty(n)
    counts, sizes = (np.empty(n, np.min_scalar_type(width)) for _ in range(2))
    places: NDArray[np.integer[Any]] = np.empty(n, np.int32 if record.n_rows <= np.iinfo(np.int32).max else np.int64)
    segments, began, at = [], record.first_stamp(), 0
    for segment in record.segments:
        first = at
        for low, high in _chunks(record, segment, width):
            rows = record.rows(low, high)
            starts = np.arange(0, high - low, width)
            size = np.diff(np.append(starts, high - low))
            into = slice(at, at + len(starts))
            for name, column in record.columns.items():
                own[name][into] = np.add.reduceat(np.asarray(column[rows], float), starts) / size
            for name, column in columns.items():
                values = looked[name].sound(np.asarray(column[rows], float))
                own[name][into] = _known_means(values, starts)[0]
            values = np.asarray(record.reading[rows], float)  # type: ignore[index]
            reading[into], counts[into] = _known_means(values, starts)
            seconds[into] = np.add.reduceat(record.times.seconds(rows, began), starts) / size
            places[into], sizes[into] = low + starts, size
            at = into.stop
        segments.append(Segment(first, at, segment.run))
    short = Thinned(
        times=_times(record, seconds, began),
        temperature_name=record.temperature_name,
        columns=own,
        segments=tuple(segments),
        reading=reading,
        notes=record.notes,
        refused=record.refused,
        counts=counts,
        began=began,
        step=record.usual_step(),
        lengths=tuple(record.duration(segment) for segment in record.segments),
        places=places,
        sizes=sizes,
    )
    return short, {name: each.share(record.n_used) for name, each in looked.items()}


def _in_memory(record: Record, columns: Mapping[Any, Any]) -> tuple[Record, dict[Any, float]]:
    """The record with all its columns as arrays."""
    own = {name: np.asarray(column[:]) for name, column in record.columns.items()}
    sound = {}
    for name, column in columns.items():
        looked, values = _Looked(), np.array(column[:], float)
        own[name], sound[name] = looked.sound(values), looked.share(len(values))
    times = record.times
    if times.ticks is not None and not isinstance(times.ticks, np.ndarray):
        times = replace(times, ticks=np.asarray(times.ticks[:]))
    reading = None if record.reading is None else np.asarray(record.reading[:], float)
    return replace(record, times=times, columns=own, reading=reading, known_moments={}), sound


class _Looked:
    """What was seen of a column: how many of its numbers are sound, and whether they differ."""

    def __init__(self) -> None:
        self.count, self.low, self.high = 0, np.inf, -np.inf

    def sound(self, values: Floats) -> Floats:
        """The numbers, NaN for those that are none."""
        values = np.where(np.abs(values) <= LARGEST, values, np.nan)
        self.count += int(np.isfinite(values).sum())
        self.low = min(self.low, float(np.fmin.reduce(values, initial=np.inf)))
        self.high = max(self.high, float(np.fmax.reduce(values, initial=-np.inf)))
        return values

    def share(self, n: int) -> float:
        """Share of sound numbers among `n`; 0 where they are all the same."""
        return self.count / n if self.high > self.low else 0.0


def _chunks(record: Record, segment: Segment, width: int) -> Iterator[tuple[int, int]]:
    """Pieces of a segment, of many stretches of `width` rows each."""
    size = max(CHUNK // width, 1) * width
    for low, high in record.stretches(segment):
        for start in range(low, high, size):
            yield start, min(start + size, high)


def _known_means(values: Floats, starts: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
    """Means of what is known in each stretch, NaN where nothing is, and how much that is."""
    known = np.isfinite(values)
    counts = np.add.reduceat(known.astype(np.intp), starts)
    sums = np.add.reduceat(np.where(known, values, 0.0), starts)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan), counts


def _times(record: Record, seconds: Floats, began: float) -> Times:
    """Times of the middle of each stretch, on the record's own clock."""
    times, n = record.times, len(seconds)
    ticks: Any
    if times.kind == "rows":
        ticks, per_second = np.floor(seconds / times.period).astype(np.int64) + int(began), times.per_second
    elif times.kind == "seconds":
        ticks, per_second = began + seconds, 1
    else:
        ticks, per_second = int(began) + np.rint(seconds * _NS).astype(np.int64), _NS
    return Times(n, times.kind, ticks, per_second, times.period)


class ThinnedLog(RecordLog):
    """A thinned record as the X of estimators; its readings are given as ``log.reading``."""

    record: Thinned

    def _check_gaps(self, most: float) -> None:
        """Steps between averages are longer than those of the record that they are of, which has been cut."""
