"""The fitted record as later rows meet it, and its gaps."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..equations.lags import Structure
from .errors import RecordError, option, warn
from .numbers import span_text
from .record import Block, Record, Segment, SegmentStart
from .screen import Screen
from .times import Floats, Kind, Rows, Times
from .types import LARGEST, Column, Counted, Number, Positive, Sizes, Stamp
from .units import other_units

GAP = 2.5
"""Steps, in usual ones, at which the time between is unknown."""
MOST_ROWS = 200_000
"""Rows of a segment that tell how columns wander, at most."""


@dataclass(frozen=True)
class Gaps:
    """How columns wander in gaps, learned from a record."""

    least: Positive
    """Steps above it are gaps [s]."""
    lags: Sizes = field(default_factory=lambda: np.zeros(1))
    """Times [s], 0 first, increasing, shape (k,)."""
    squares: dict[Column, Sizes] = field(default_factory=dict)
    """Mean square of each column's changes over these times, shape (k,): its structure function."""

    def __post_init__(self) -> None:
        """Refuse times and squares that do not belong together."""
        shapes = {np.shape(each) for each in (self.lags, *self.squares.values())}
        if len(shapes) > 1 or np.ndim(self.lags) != 1 or self.lags[:1] != [0.0] or (np.diff(self.lags) <= 0).any():
            raise ValueError("times of gaps are 0 first and increase, and each column has as many squares")

    @classmethod
    def of(cls, record: Record, columns: Collection[Any], least: float, longest: float | None = None) -> Gaps:
        """Learn how columns wander up to the `longest` time [s]."""
        usual = record.usual_step()
        if longest is None:
            # Where no longest gap is known, changes are looked at over a third of the longest segment.
            longest = (1 / 3) * record.duration(record.longest())
        # Changes are looked at over 25 times, evenly spaced on a logarithmic scale.
        counts = np.unique(np.geomspace(1, max(longest / usual, 2.0), 25).astype(int))
        sums, sizes = np.zeros((len(columns), len(counts))), np.zeros(len(counts))
        for segment in record.segments:
            rows = record.kept(segment.start, min(segment.stop, segment.start + MOST_ROWS))
            values = [np.asarray(record.columns[name][rows], float) for name in columns]
            steps = np.array(record.times.steps(rows))
            steps[:1] = 0.0
            elapsed = np.cumsum(steps)
            for i, k in enumerate(counts.tolist()):
                # Uneven steps are compared with as many usual ones if they last as long to 30 %.
                like = np.abs(elapsed[k:] - elapsed[:-k] - k * usual) <= 0.3 * k * usual
                sums[:, i] += [np.square(column[k:] - column[:-k])[like].sum() for column in values]
                sizes[i] += np.count_nonzero(like)
        seen = sizes > 0
        means = np.column_stack((np.zeros(len(columns)), sums[:, seen] / sizes[seen]))
        return cls(least, np.concatenate(([0.0], counts[seen] * usual)), dict(zip(columns, means, strict=True)))

    def structure(self, column: Any) -> Structure:
        """Mean square of a column's changes over a time [s].

        Between two times of the record a power of time, which is what noise (0), a random walk (1) and a smooth
        temperature (2) have; a straight line to zero below the usual step, the last value beyond.
        """
        known = (self.lags > 0) & (self.squares[column] > 0)
        if not known.any():
            return lambda lag: np.zeros_like(lag, float)
        lags, squares = self.lags[known], self.squares[column][known]
        log_lags, log_squares, first = np.log(lags), np.log(squares), lags[0]

        def structure(lag: Floats) -> Floats:
            power = np.exp(np.interp(np.log(np.maximum(lag, first)), log_lags, log_squares))
            return np.asarray(power * np.minimum(np.asarray(lag) / first, 1.0))

        return structure


def least_gap(record: Record, usual_step: float, stride: int = 1) -> float:
    """Shortest step that counts as a gap [s]."""
    if _is_even(record):
        return GAP * usual_step
    some = next(record.blocks()).steps[1:]
    # A log that is written on changes has long steps all the time, in which the temperature is known to have stood
    # still: one in twenty of its first steps may be longer.
    return max(GAP * usual_step, float(np.quantile(some, 0.95)) / stride if len(some) else 0.0)


def longest_gap(record: Record, least: float) -> float:
    """The longest gap [s]; 0 for none."""
    if _is_even(record):
        return record.usual_step() if record.usual_step() > least else 0.0
    if record.order is None and not len(record.skipped) and record.times.longest_between_rows <= least:
        return 0.0
    return max(float(block.steps[gap_rows(block, least)].max(initial=0.0)) for block in record.blocks())


def gap_rows(block: Block, least: float) -> np.ndarray:
    """Numbers of a block's rows behind a gap."""
    rows = np.flatnonzero(block.steps > least)
    return rows[rows > 0] if block.begins else rows


def _is_even(record: Record) -> bool:
    """True if all steps are known to be equal."""
    usual = record.usual_step()
    # A segment's length differs from as many usual steps by rounding alone.
    return not len(record.skipped) and all(
        record.duration(segment) <= (segment.n_rows - 1) * usual * (1 + 1e-9) for segment in record.segments
    )


def rows_apart(record: Record) -> str:
    """Sentence on rows cut off by a long gap; else "".

    They stretch all that counts by a segment's length: is their time damaged?
    """
    segment = max(record.segments, key=record.duration)
    places = record.kept_places(segment.start, segment.stop)
    steps = np.array(record.times.steps(record.rows_at(places)))
    if len(steps) < 2:
        return ""
    steps[0] = 0.0
    at, usual = int(steps.argmax()), record.usual_step()
    longest, rest = float(steps[at]), record.duration(segment) - float(steps[at])
    if longest <= max(rest, GAP * usual):
        return ""
    behind = len(places) - at <= at
    some = [record.row(int(places[k])) for k in ((at, len(places) - 1) if behind else (0, at - 1))]
    one = some[0] == some[1]
    before, after = (record.row(int(places[k])) for k in (at - 1, at))
    return (
        f"{f'Row {some[0]} stands' if one else f'Rows {some[0]} to {some[1]} stand'} far apart from the others: "
        f"{record.times.label(after)} in row {after} follows {record.times.label(before)} in row {before} after "
        f"{span_text(longest)}, and all the others lie within {span_text(rest)}. "
        f"{'Is its time' if one else 'Are their times'} damaged? Correct {'it' if one else 'them'}, or leave "
        f"{'the row' if one else 'the rows'} out; if not, pass {option('max_gap', f'{3 * usual:.5g}')} to start a new "
        "segment there."
    )


_NS = 1_000_000_000


def in_memory(record: Record, columns: Mapping[Any, Any]) -> tuple[Record, dict[Any, float]]:
    """The record with its columns, and further ones, as arrays.

    Missing and absurd numbers are not sound; none are in a column that never changes.
    """
    own = {name: np.asarray(column[:]) for name, column in record.columns.items()}
    sound = {}
    for name, column in columns.items():
        values = np.array(column[:], float)
        values[~(np.abs(values) <= LARGEST)] = np.nan
        known = values[np.isfinite(values)]
        own[name], sound[name] = values, len(known) / len(values) if len(known) and known.max() > known.min() else 0.0
    times = record.times
    if times.ticks is not None and not isinstance(times.ticks, np.ndarray):
        times = replace(times, ticks=np.asarray(times.ticks[:]))
    reading = None if record.reading is None else np.asarray(record.reading[:], float)
    return replace(record, times=times, columns=own, reading=reading, known_moments={}), sound


def strided(record: Record, stride: int) -> Record:
    """Every so many rows of a record, in memory."""
    kept, segments, at = [], [], 0
    for start, stop, run in record.segments:
        some = np.arange(start, stop, stride)
        if some[-1] != stop - 1:
            some = np.append(some, stop - 1)
        kept.append(some)
        segments.append(Segment(at, at + len(some), run))
        at += len(some)
    order = kept[0] if len(kept) == 1 else np.concatenate(kept)
    whole = record.order is None and order[-1] - order[0] == len(order) - 1
    rows: Rows = slice(int(order[0]), int(order[-1]) + 1) if whole else record.rows_at(order)
    copied = np.array if whole else np.asarray  # rows by number are copied already
    times, ticks = record.times, record.times.ticks
    if ticks is None:
        thin = Times(len(order), "rows", record.rows_at(order) + times.first_row, period=times.period)
    else:
        thin = replace(times, n=len(order), ticks=copied(ticks[rows]))
    columns = {name: copied(values[rows], np.float64) for name, values in record.columns.items()}
    skipped = np.flatnonzero(np.isin(order, record.skipped)) if len(record.skipped) else record.skipped
    reading = None if record.reading is None else copied(record.reading[rows], np.float64)
    return Record(thin, record.temperature_name, columns, tuple(segments), reading=reading, skipped=skipped)


MOST_FOLDED = 400
"""Pieces into which folds may cut a record: more are not blocks in time but shuffled rows."""
HEAD = 8
"""Rows with which a segment begins that are kept in a file: they tell its record from another with such times."""
HISTORY_ROWS = 1 << 17
"""Rows kept of a fitted record. Longer records are thinned; the state at their end is exact all the same."""


State = Any


@dataclass(frozen=True, kw_only=True)
class History:
    """Times, columns and final states of the fitted record."""

    kind: Kind
    zero: Stamp
    """Stamp of the first fitted row."""
    record: Record
    """The kept rows: segments are numbered as in the fitted record."""
    end_states: tuple[State, ...]
    n_fitted: Counted
    """Rows of the fitted record."""
    stride: Counted
    """Of so many rows one is kept, and the last of each segment; 0: no others than those of `ends`."""
    usual_step: Positive
    max_gap: Positive | None
    ranges: dict[Column, tuple[Number, Number]]
    """Least and greatest fitted value of each column."""
    screen: Screen | None = None
    """What is refused of later rows; None for nothing."""
    known_gaps: Gaps | None = None
    """`gaps`, where the kept rows cannot tell any more."""

    @cached_property
    def gaps(self) -> Gaps:
        """Gaps of the fitted record, for later rows."""
        if self.known_gaps is not None:
            return self.known_gaps
        return Gaps.of(self.record, tuple(self.record.columns), least_gap(self.record, self.usual_step, self.stride))

    @cached_property
    def later_screen(self) -> Screen:
        """The screen for later temperatures, unit included; or None."""
        if self.screen is None:
            return Screen()
        name = self.record.temperature_name
        limits = replace(self.screen.inputs[name], elsewhere=other_units(*self.ranges[name]))
        return replace(self.screen, inputs={**self.screen.inputs, name: limits})

    @cached_property
    def _segment_starts(self) -> list[tuple[float, object]]:
        """First stamp and run of each segment."""
        return [(self.record.stamp(segment.start), segment.run) for segment in self.record.segments]

    @classmethod
    def of(
        cls, record: Record, end_states: Sequence[State], max_gap: float | None, screen: Screen | None = None
    ) -> History:
        """Keep what later rows need of a record."""
        stride = max(1, -(-record.n_used // HISTORY_ROWS))
        small = strided(replace(record, reading=None), stride)
        return cls(
            kind=record.times.kind,
            zero=record.first_stamp(),
            record=small,
            end_states=tuple(end_states),
            n_fitted=record.n_rows,
            stride=stride,
            usual_step=record.usual_step(),
            max_gap=max_gap,
            ranges={name: (record.moments(name).low, record.moments(name).high) for name in record.columns},
            screen=screen,
        )

    def ends(self) -> History:
        """The history without inner rows: later rows start afresh."""
        kept, segments, places, at = self.record, [], [], 0
        for start, stop, run in kept.segments:
            some = kept.kept_places(start, stop)
            some = np.unique(np.append(some[:HEAD], some[-1:]))
            segments.append(Segment(at, at + len(some), run))
            places.append(some)
            at += len(some)
        rows = np.concatenate(places)
        columns = {name: values[rows] for name, values in kept.columns.items()}
        times = replace(kept.times, n=at, ticks=np.asarray(kept.times.ticks)[rows])
        record = Record(times, kept.temperature_name, columns, tuple(segments))
        return replace(self, record=record, stride=0, known_gaps=self.gaps)

    def between(self, later: float, earlier: float) -> float:
        """Difference of two stamps [s]."""
        return self.record.times.between(later, earlier)

    def locate(self, record: Record) -> tuple[Record, dict[int, SegmentStart], dict[int, int | None]]:
        """Tie the segments of `record` to the fitted ones.

        Rows that repeat the fitted record get the states they had; rows that follow it continue from its end (or from
        the last fitted row before them); any other segment starts afresh.

        Returns
        -------
        record : Record
            The same without what the screen refuses, with row numbers that follow on the fitted ones where rows have no
            times of their own.
        starts : dict
            Segment number -> `SegmentStart`; segments that start afresh are not in it.
        replay : dict
            Segment number -> kept row up to which the fitted record must be replayed for the state, or None for the
            state at the end of the fitted segment.
        """
        if self.kind != record.times.kind:
            raise RecordError(
                f"The fitted record has times of kind {self.kind!r}, these rows have {record.times.kind!r}. Give both "
                "the same kind of time (dates with or without zone, time spans, seconds, or none at all)."
            )
        if self.kind != "rows" and (holes := self._holes_of(record)) > MOST_FOLDED:
            warn(
                f"These rows lie in {holes} holes between rows that the model was fitted on, as in shuffled folds: "
                "their errors say nothing about later data. Score on whole stretches: TimeSeriesSplit, or KFold "
                "without shuffling."
            )
        if self.screen is not None:
            record = self.later_screen.without_codes(record, self.max_gap)
        if self.kind == "rows":
            record = replace(record, times=replace(record.times, ticks=None, first_row=self.first_row(record)))
        if self.screen is not None:
            record = self.screen.without_spikes(record, self.max_gap)
            if record.held is None:  # not gated before
                record = self.screen.gated(record, self.zero, self.max_gap)
        starts: dict[int, SegmentStart] = {}
        replay: dict[int, int | None] = {}
        seen: set[object] = set()
        for number, segment in enumerate(record.segments):
            values = _values(record, record.row(segment.start))
            held = partial(self._holds, record=record, segment=segment)
            tied = self.tie(record.stamp(segment.start), segment.run, values, segment.run not in seen, held)
            seen.add(segment.run)
            if tied is not None:
                starts[number] = tied[0]
                if tied[0].step is not None:
                    replay[number] = tied[1]
        return record, starts, replay

    def _holes_of(self, record: Record) -> int:
        """Number of holes in the fitted record that rows fill."""
        if self.stride != 1 or record.n_used > HISTORY_ROWS:
            return 0
        ours, theirs = (
            np.sort(each.times.seconds(each.rows(0, each.n_used), self.zero)) for each in (self.record, record)
        )
        place = np.searchsorted(ours, theirs)
        inside = (place > 0) & (place < len(ours))
        inside[inside] = ours[place[inside]] != theirs[inside]
        return len(np.unique(place[inside]))

    def tie(
        self,
        stamp: float,
        run: object,
        values: Mapping[object, float],
        first_of_run: bool,
        held: Callable[[int], bool] | None = None,
    ) -> tuple[SegmentStart, int | None] | None:
        """Tie a segment to the fitted ones; None for a fresh start.

        Parameters
        ----------
        stamp, run, values : time, run and columns of the segment's first row
        first_of_run : bool
            Whether no segment of its run came before it.
        held : callable, optional
            Whether a fitted segment holds rows of this one, where more than the first row is known. A clock that says
            so proves little: each log of an instrument may count its seconds from its own start.

        Returns
        -------
        start : SegmentStart
        replay : int or None
            Kept row up to which the fitted record must be replayed, None for the state at the end of the fitted segment
            (where `start.step` is a time), or for no state at all (where it is None).
        """
        key = self._segment_before(stamp, run)
        if key is None:
            return None
        start, stop, _ = self.record.segments[key]
        zero = self.record.stamp(start)
        row = self._first_row_at_or_after(key, stamp)
        if row == stop:  # after the fitted segment
            step = self.between(stamp, self.record.stamp(stop - 1))
            follows = first_of_run and (self.max_gap is None or step <= self.max_gap)
            return (SegmentStart(key, zero, step), None) if follows else None
        if self.record.stamp(row) == stamp:  # a fitted row, unless another log counts its time from the same zero
            if any(values[name] != kept[row] for name, kept in self.record.columns.items()):
                return None
            if held is not None and not held(key):
                return None
            if row == start:
                return SegmentStart(key, zero, None), None
            return (SegmentStart(key, zero, self.step_before(key, stamp)), row) if self.stride else None
        if self.stride == 0:
            return None
        step = self.step_before(key, stamp)
        hole = self.between(self.record.stamp(row), self._stamp_before(row))
        passed_over = self.record.is_skipped(row - 1)
        if passed_over or hole > 1.5 * self.stride * self.usual_step:  # rows that were left out of the fit
            return SegmentStart(key, zero, step), row
        if self.stride > 1 and held is not None and held(key):  # rows that were not kept
            return SegmentStart(key, zero, step), row
        return None

    def _holds(self, key: int, record: Record, segment: Segment) -> bool:
        """True if rows repeat those of a fitted segment."""
        kept, (begin, end, _) = self.record, self.record.segments[key]
        first, last = record.stamp(segment.start), record.stamp(segment.stop - 1)
        low = bisect_left(range(end), first, begin, key=kept.stamp)
        high = bisect_right(range(end), last, begin, key=kept.stamp)
        sides = (kept, low, high), (record, segment.start, segment.stop)
        (one, start, stop), (other, at, until) = sorted(sides, key=lambda side: side[2] - side[1])
        # Sixteen rows of one time are compared, to distinguish a fitted record from another log by the same clock.
        met, equal, steps = 0, 0, max(16 // len(record.segments), 3) - 1
        for k in sorted({start + (stop - 1 - start) * i // steps for i in range(steps + 1)}) if stop > start else ():
            place = bisect_left(range(until), one.stamp(k), at, key=other.stamp)
            if place < until and other.stamp(place) == one.stamp(k):
                met += 1
                ours, theirs = _values(one, one.row(k)), _values(other, other.row(place))
                equal += all(ours[name] == theirs[name] or np.isnan(ours[name] + theirs[name]) for name in ours)
        return equal > 0 and 2 * equal > met - (self.stride > 0)

    def _segment_before(self, stamp: float, run: object) -> int | None:
        """The last fitted segment of this run up to `stamp`."""
        best, best_stamp = None, -np.inf
        for key, (first, of_run) in enumerate(self._segment_starts):
            if best_stamp <= first <= stamp and (of_run == run or run is None or of_run is None):
                best, best_stamp = key, first
        return best

    def _first_row_at_or_after(self, key: int, stamp: float) -> int:
        """The first kept row from a time on."""
        low, high, _ = self.record.segments[key]
        while low < high:
            middle = (low + high) // 2
            if self.record.stamp(middle) < stamp:
                low = middle + 1
            else:
                high = middle
        while self.record.is_skipped(low):  # a segment does not end with one
            low += 1
        return low

    def step_before(self, key: int, stamp: float) -> float:
        """Time since the row before, in a fitted segment [s]."""
        row = self._first_row_at_or_after(key, stamp)
        return 0.0 if row == self.record.segments[key].start else self.between(stamp, self._stamp_before(row))

    def _stamp_before(self, row: int) -> float:
        """Stamp of the last kept row before `row`."""
        row -= 1
        while self.record.is_skipped(row):  # a segment does not begin with one
            row -= 1
        return self.record.stamp(row)

    def first_row(self, record: Record) -> int:
        """Number of a record's first row among the fitted ones."""
        first = record.segments[0]
        kept = self.record.columns
        assert self.record.times.ticks is not None
        numbers: NDArray[np.intp] = self.record.times.ticks
        if self.stride == 0:  # its beginning is known
            ahead = numbers[: min(HEAD, self.record.segments[0].stop)] - numbers[0]
            ahead = first.start + ahead[ahead < first.n_rows]
            repeats = all(np.array_equal(record.columns[n][ahead], values[: len(ahead)]) for n, values in kept.items())
            return int(numbers[0]) - first.start if repeats else self.n_fitted
        candidates: NDArray[np.intp] = np.arange(len(numbers))
        for name, values in kept.items():
            candidates = candidates[values[candidates] == record.columns[name][first.start]]
        for name, values in kept.items():  # a fingerprint of a few rows more, all candidates at once
            if self.stride > 1:
                break
            for ahead in np.unique(np.geomspace(1, max(first.stop - first.start - 1, 1), 32).astype(int)):
                if ahead < first.stop - first.start:
                    there = np.minimum(candidates + ahead, len(values) - 1)
                    value = record.columns[name][first.start + ahead]
                    same = values[there] == value if value == value else np.isnan(values[there])
                    candidates = candidates[same | (candidates + ahead >= len(values))]
        whole = [c for c in candidates if numbers[c] - first.start + record.n_rows <= self.n_fitted]
        longer = [c for c in candidates if numbers[c] - first.start + record.n_rows > self.n_fitted]
        for candidate in (*whole[:64], *longer[:64]):
            first_row = int(numbers[candidate]) - first.start
            overlap = min(self.n_fitted - first_row, record.n_rows)
            if overlap < record.n_rows and not any(len(np.unique(values[candidate:])) > 16 for values in kept.values()):
                continue  # a few equal temperatures at the end are chance
            if self._repeats(record, first_row, numbers):
                return first_row
        return self.n_fitted

    def _repeats(self, record: Record, first_row: int, numbers: NDArray[np.intp]) -> bool:
        inside = (numbers >= first_row) & (numbers < first_row + record.n_rows)
        rows = numbers[inside] - first_row
        if self.stride == 1 and first_row + record.n_rows <= self.n_fitted:
            used = np.concatenate([np.arange(segment.start, segment.stop) for segment in record.segments])
            if not np.isin(used, rows).all():
                return False
        return len(rows) > 0 and all(
            np.array_equal(np.asarray(record.columns[name][rows], float), values[inside], equal_nan=True)
            for name, values in self.record.columns.items()
        )


def _values(record: Record, row: int) -> dict[object, float]:
    """Values of a row by column."""
    return {name: float(column[row]) for name, column in record.columns.items()}
