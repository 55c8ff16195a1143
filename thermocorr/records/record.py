"""The record: segments, blocks, columns and readings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..equations.outliers import CHUNK
from ..equations.statistics import Moments
from .times import Floats, Rows, Times
from .types import Column, Counted, RunLabel


class Segment(NamedTuple):
    """Rows ``start:stop`` without a gap, in time order."""

    start: Counted
    stop: Counted
    run: RunLabel = None

    @property
    def n_rows(self) -> int:
        """Number of rows, those passed over included."""
        return self.stop - self.start


class SegmentStart(NamedTuple):
    """Relation of a new segment to one of the fitted record."""

    key: int | None
    """Number of the fitted segment that it belongs to; None for a stretch that hangs on none."""
    segment_zero: float
    """Stamp of that segment's first sample."""
    step: float | None
    """Time since the sample whose state it continues [s]; None where it starts afresh."""


def holes(places: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Starts and ends of consecutive numbers among sorted ones."""
    return places[np.diff(places, prepend=-2) != 1], places[np.diff(places, append=-2) != 1] + 1


class Flags:
    """One flag for each of many rows.

    `n` (int): Rows. `flag` (str): That of all of them, to begin with.
    """

    def __init__(self, n: int, flag: str = ""):
        self.codes = np.zeros(n, np.int8)
        self.names = [flag]

    def __len__(self) -> int:
        return len(self.codes)

    def __iter__(self) -> Iterator[str]:
        return iter(self.tolist())

    def __setitem__(self, rows: Any, flag: str | Flags | np.ndarray) -> None:
        if isinstance(flag, np.ndarray):
            names, codes = np.unique(flag.astype(str), return_inverse=True)
            self.codes[rows] = self._codes_of(names.tolist())[codes]
        elif isinstance(flag, Flags):
            known = self._codes_of(flag.names)
            self.codes[rows] = known[0] if len(known) == 1 else known[flag.codes]
        else:
            self.codes[rows] = self._codes_of([flag])[0]

    def _codes_of(self, names: list[str]) -> np.ndarray:
        self.names += [name for name in dict.fromkeys(names) if name not in self.names]
        return np.array([self.names.index(name) for name in names], np.int8)

    def are(self, *flags: str) -> np.ndarray:
        """True if each row has one of these flags, shape (n,)."""
        found = np.zeros(len(self), bool)
        for flag in flags:
            if flag in self.names:
                found |= self.codes == self.names.index(flag)
        return found

    def counts(self) -> dict[str, int]:
        """Number of rows with each flag that occurs."""
        counted = np.bincount(self.codes, minlength=len(self.names)).tolist()
        return {name: count for name, count in zip(self.names, counted, strict=True) if count}

    def texts(self) -> np.ndarray:
        """An array of texts, shape (n,)."""
        return np.asarray(np.array(self.names, dtype=object)[self.codes])

    def tolist(self) -> list[str]:
        """A list of texts."""
        found: list[str] = self.texts().tolist()
        return found

    def column(self) -> Any:
        """A column of a DataFrame."""
        return _texts(tuple(self.names)).take(self.codes.astype(np.intp))


@lru_cache(maxsize=64)
def _texts(names: tuple[str, ...]) -> Any:
    """An array of text as pandas keeps it, made quickly."""
    return pd.Series(names).array


def where_read(reading: Any, n: int, rows: Callable[[int, int], Any]) -> tuple[int, int]:
    """Positions of the first reading and behind the last.

    A week of readings may come with a year of temperature: by the year, all of it would be one moment.

    `reading` (array of shape (n,), or None). `n` (int): Rows. `rows` (callable): The user's rows of a stretch in the
    order of time, from its start and stop.
    """
    if reading is None:
        return 0, n
    known = np.isfinite(np.asarray(reading[rows(0, n)], float))
    if not known.any():
        return 0, n
    low, high = int(known.argmax()), n - int(known[::-1].argmax())
    return (low, high) if 2 * (high - low) < n else (0, n)


BLOCK_ROWS = 8192
"""Rows of one block: large enough to keep Python out of the way, small enough to stay in the cache."""


class Itself:
    """A key by identity, for what has no name."""

    def __init__(self, of: object):
        self.of = of

    def __hash__(self) -> int:
        return id(self.of)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Itself) and other.of is self.of


class Refused(NamedTuple):
    """Rows whose reading or input is no measurement."""

    what: str
    """ "reading", "temperature", or a recorded column in quotes."""
    reason: str
    """ "spike", "sentinel", "other unit", "jump", "clipped", "filled in", "repeat" (the row before)."""
    rows: NDArray[np.intp]
    """Rows of the user's record, shape (n,)."""
    values: Floats
    """What stands there, shape (n,)."""
    seconds: Floats
    """Time since the record began [s], shape (n,)."""


def _fixed(values: Floats) -> Floats:
    """Values that several effects share: none may write to them."""
    values.flags.writeable = False
    return values


@dataclass(frozen=True)
class Block:
    """Consecutive rows of one segment, as effects see them."""

    record: Record
    segment: int
    """Number of the segment in its record."""
    start: int
    stop: int
    begins: bool
    """True where the segment begins here, so that there is no earlier sample."""
    steps: Floats
    """``steps[k]`` is the time from the sample before k to sample k [s]; ``steps[0]`` is 1 where the segment begins."""
    zero: float
    """Origin of `seconds`, a stamp: the first row of the fitted record."""
    segment_zero: float
    """Origin of `elapsed`, a stamp: the first row of the (fitted) segment."""
    segment_key: int | None
    """Number of the fitted segment that this block belongs to, None for a new one."""
    values: dict[object, Floats] = field(default_factory=dict, repr=False)
    """Columns read so far."""

    def __len__(self) -> int:
        return len(self.steps)

    @cached_property
    def rows(self) -> Rows:
        """Row numbers in the user's record."""
        return self.record.kept(self.start, self.stop)

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """Places of the rows in time order, shape (n,)."""
        return self.record.kept_places(self.start, self.stop)

    @property
    def even_step(self) -> float | None:
        """The common step of the record's rows [s], or None.

        What comes before the block and behind it may lack rows that are passed over.
        """
        return self.record.times.step_of(self.rows)

    @property
    def is_whole(self) -> bool:
        """True if no row is passed over."""
        return len(self) == self.stop - self.start

    def first_from(self, places: NDArray[np.intp]) -> NDArray[np.intp]:
        """Numbers of the first rows at or behind some places."""
        return np.clip(places - self.start, 0, len(self)) if self.is_whole else np.searchsorted(self.places, places)

    @cached_property
    def seconds(self) -> Floats:
        """Time since the fitted record began [s], shape (n,)."""
        return _fixed(self.record.times.seconds(self.rows, self.zero))

    @cached_property
    def elapsed(self) -> Floats:
        """Time since the start of the segment [s], shape (n,)."""
        return _fixed(self.record.times.seconds(self.rows, self.segment_zero))

    def seconds_at(self, numbers: NDArray[np.intp]) -> Floats:
        """Some of `seconds`, by their numbers within the block [s]."""
        if isinstance(self.rows, slice):
            return self.record.times.seconds(numbers + self.rows.start, self.zero)
        return self.record.times.seconds(self.rows[numbers], self.zero)

    def of(self, record: Record) -> Block:
        """The same rows of another record with these times."""
        other = replace(self, record=record, values={})
        other.__dict__["rows"] = self.rows  # known already
        return other

    def elapsed_at(self, number: int) -> float:
        """One of `elapsed` [s]."""
        row = self.start + number if isinstance(self.rows, slice) else int(self.rows[number])
        return self.record.times.between(self.record.times.stamp(row), self.segment_zero)

    @property
    def temperature(self) -> Floats:
        """Ambient temperature, shape (n,)."""
        return self[self.record.temperature_name]

    def __getitem__(self, column: object) -> Floats:
        """A recorded column, shape (n,), contiguous float64."""
        if column not in self.values:
            self.values[column] = np.ascontiguousarray(self.record.columns[column][self.rows], dtype=np.float64)
        return self.values[column]


@dataclass(frozen=True)
class Record:
    """A validated record; its arrays view the user's data."""

    times: Times
    temperature_name: Column
    columns: Mapping[object, NDArray[Any]]
    segments: tuple[Segment, ...]
    order: NDArray[np.intp] | None = field(default=None, compare=False)
    """``order[k]`` is the user's row that comes k-th in time order; None when rows already stand in order."""
    reading: NDArray[Any] | None = field(default=None, compare=False)
    notes: tuple[str, ...] = field(default=(), compare=False)
    """What the user should know about the record's quality, one sentence each."""
    known_moments: dict[tuple[object, int], Moments] = field(default_factory=dict, repr=False, compare=False)
    """Moments computed so far, by column (`Itself` of the readings) and power."""
    skipped: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp), repr=False, compare=False)
    """Rows in time order, sorted, inside segments, that are passed over as if they had not been recorded; a segment
    neither begins nor ends with one."""
    weight: Floats | None = field(default=None, repr=False, compare=False)
    """How much each reading counts in a fit, shape (n_rows,); None where all do alike."""
    refused: tuple[Refused, ...] = field(default=(), compare=False)
    """What the screen left out of this record."""
    held: NDArray[np.bool_] | None = field(default=None, repr=False, compare=False)
    """Rows in which an input is held back: the last value that was accepted stands there; None for none."""
    twins: Mapping[object, Floats] = field(default_factory=dict, repr=False, compare=False)
    """What might stand in a column for values that are held back or doubted, NaN for others, shape (n_rows,)."""
    accepted: Mapping[object, NDArray[np.bool_]] = field(default_factory=dict, repr=False, compare=False)
    """Rows with which the doubt of a column ends because it has stayed away, shape (n_rows,)."""
    doubt: Floats | None = field(default=None, repr=False, compare=False)
    """What the twins move the bias of a model by in each row, shape (n_rows,); None without twins."""
    gap_variance: Floats | None = field(default=None, repr=False, compare=False)
    """Variance of a model's bias by what its inputs did in gaps between rows, shape (n_rows,); None for none."""

    @property
    def n_rows(self) -> int:
        """Rows of the user's record, those outside any segment included."""
        return self.times.n

    def __len__(self) -> int:
        return self.times.n

    @property
    def n_used(self) -> int:
        """Rows inside segments, without those passed over."""
        return sum(segment.n_rows for segment in self.segments) - len(self.skipped)

    def is_skipped(self, k: int) -> bool:
        """True if the k-th row in time order is skipped."""
        at = int(np.searchsorted(self.skipped, k))
        return at < len(self.skipped) and int(self.skipped[at]) == k

    def input_variance(self, rows: Any) -> Floats | float:
        """Variance of the bias by uncertain inputs, per row."""
        doubt = 0.0 if self.doubt is None else self.doubt[rows] ** 2
        return doubt + (0.0 if self.gap_variance is None else self.gap_variance[rows])

    def rows_at(self, places: NDArray[np.intp]) -> NDArray[np.intp]:
        """The user's rows at some places in time order."""
        return places if self.order is None else self.order[places]

    def kept_places(self, start: int, stop: int) -> NDArray[np.intp]:
        """Places of a stretch in time order, without skipped rows."""
        first, last = np.searchsorted(self.skipped, (start, stop))
        places = np.arange(start, stop)
        return places if first == last else np.delete(places, self.skipped[first:last] - start)

    def kept(self, start: int, stop: int) -> Rows:
        """The user's rows of a stretch, without skipped ones."""
        first, last = np.searchsorted(self.skipped, (start, stop))
        return self.rows(start, stop) if first == last else self.rows_at(self.kept_places(start, stop))

    def rows(self, start: int, stop: int) -> Rows:
        """The user's rows for a stretch in time order."""
        return slice(start, stop) if self.order is None else self.order[start:stop]

    def row(self, k: int) -> int:
        """The user's row that comes k-th in time order."""
        return k if self.order is None else int(self.order[k])

    def stamp(self, k: int) -> float:
        """Absolute time of the row that comes k-th in time order."""
        return self.times.stamp(self.row(k))

    def duration(self, segment: Segment) -> float:
        """First to last sample of a segment [s]."""
        return self.times.between(self.stamp(segment.stop - 1), self.stamp(segment.start))

    @cached_property
    def read_places(self) -> tuple[int, int]:
        """Ends of the readings, where they cover less than half."""
        return where_read(self.reading, self.n_rows, self.rows)

    def read_duration(self, segment: Segment) -> float:
        """First to last sample of a segment [s], within `read_places`."""
        low, high = max(segment.start, self.read_places[0]), min(segment.stop, self.read_places[1])
        if (low, high) == segment[:2]:
            return self.duration(segment)
        return self.times.between(self.stamp(high - 1), self.stamp(low)) if low < high else 0.0

    def longest_read(self) -> float:
        """The longest `read_duration` of a segment [s]."""
        return max((self.read_duration(segment) for segment in self.segments), default=0.0)

    def usual_step(self) -> float:
        """Median step inside segments [s]; long records are sampled."""
        return self._usual_step

    def longest(self) -> Segment:
        """The segment with most rows."""
        return max(self.segments, key=lambda segment: segment.n_rows)

    @cached_property
    def _usual_step(self) -> float:
        parts = []
        longest = sorted(self.segments, key=lambda segment: -segment.n_rows)[:16]
        for start, stop, _ in longest:
            parts.append(self.times.steps(self.kept(start, min(stop, start + 16_384)))[1:])
        steps = np.concatenate(parts) if parts else np.zeros(0)
        if not len(steps):
            return 1.0
        return float(steps[0] if steps.min() == steps.max() else np.median(steps))

    def moments(self, column: object, power: int = 1) -> Moments:
        """Number, mean, variance and range of a column's power."""
        return self._moments(column, self.columns[column], power)

    def reading_moments(self) -> Moments:
        """Moments of the readings, without the missing ones."""
        return self._moments(Itself(self.reading), self.reading)

    def _moments(self, key: object, column: Any, power: int = 1) -> Moments:
        if (key, power) not in self.known_moments:
            self.known_moments[key, power] = self._looked_at(column, power)
        return self.known_moments[key, power]

    def _looked_at(self, column: Any, power: int) -> Moments:
        """Moments of a column's power, in one pass."""
        result = Moments()
        for values in self.chunks(column):
            result = result.merged(Moments.of(values if power == 1 else values**power))
        return result

    def chunks(self, column: Any) -> Iterator[Floats]:
        """Numbers of a column, or the readings, in chunks."""
        ends = {segment.stop for segment in self.segments}
        starts = [segment.start for segment in self.segments if segment.start not in ends]
        stops = sorted(ends - {segment.start for segment in self.segments})
        for first, stop in zip(sorted(starts), stops, strict=True):  # of segments that meet
            for start in range(first, stop, CHUNK):
                yield np.asarray(column[self.kept(start, min(start + CHUNK, stop))], float)

    def passing_over(self, places: NDArray[np.intp], max_gap: float | None) -> Record:
        """The record without some rows; each segment keeps one.

        Parameters
        ----------
        places : array of int, shape (n,)
            Where the rows stand in time order.
        max_gap : float, optional
            A longer step, over such rows too, starts a new segment [s].
        """
        gone, segments = np.union1d(self.skipped, places), []
        for start, stop, run in self.segments:
            low, within = start, gone[slice(*np.searchsorted(gone, (start, stop)))]
            for first, behind in (*self._ends(within, start, stop, max_gap), (stop, stop)):
                if low < first:
                    segments.append(Segment(low, first, run))
                low = behind
        inside = np.zeros(len(gone), bool)
        for start, stop, _ in segments:
            inside[slice(*np.searchsorted(gone, (start, stop)))] = True
        return replace(self, segments=tuple(segments), skipped=gone[inside], known_moments={})

    def _ends(self, gone: NDArray[np.intp], start: int, stop: int, max_gap: float | None) -> Iterable[tuple[int, int]]:
        """Skipped stretches that split a segment."""
        first, behind = holes(gone)
        outer = (first == start) | (behind == stop)
        if max_gap is not None:
            outer[~outer] = self.steps_over(first[~outer], behind[~outer]) > max_gap
        return zip(first[outer].tolist(), behind[outer].tolist(), strict=True)

    def steps_over(self, first: NDArray[np.intp], behind: NDArray[np.intp]) -> Floats:
        """Time from the row before a stretch to the row behind [s]."""
        return self.times.steps(self.rows_at(np.column_stack((first - 1, behind)).ravel()))[1::2]

    def first_stamp(self) -> float:
        """Absolute time of the first row inside a segment."""
        return self.stamp(self.segments[0].start) if self.segments else 0

    def since_1970(self) -> float | None:
        """Date of the first row [s since 1970], or None."""
        return self.times.since_1970(self.first_stamp())

    def blocks(
        self, size: int = BLOCK_ROWS, zero: float | None = None, starts: Mapping[int, SegmentStart] | None = None
    ) -> Iterator[Block]:
        """Blocks of at most `size` rows in time order.

        `zero` is the origin of seconds, a stamp (this record's first by default); `starts` ties segments,
        by number, to those of the fitted record.
        """
        zero = self.first_stamp() if zero is None else zero
        for number, segment in enumerate(self.segments):
            known = (starts or {}).get(number)
            segment_zero = self.stamp(segment.start) if known is None else known.segment_zero
            before = None
            for start in range(segment.start, segment.stop, size):
                stop = min(start + size, segment.stop)
                begins, rows = start == segment.start, self.kept(start, stop)
                steps = self.times.steps(rows, before)
                if not len(steps):
                    continue
                before = stop - 1 if isinstance(rows, slice) else int(rows[-1])
                if known is not None and begins and known.step is not None:
                    steps[0] = known.step
                yield Block(
                    record=self,
                    segment=number,
                    start=start,
                    stop=stop,
                    begins=begins and (known is None or known.step is None),
                    steps=steps,
                    zero=zero,
                    segment_zero=segment_zero,
                    segment_key=None if known is None else known.key,
                )
