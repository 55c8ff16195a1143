"""Screening: values that are no measurements.

A reading that is refused is not learned from. The row of an input that is refused is passed over as if it had not been
recorded: the lags go straight across, and are not poisoned. What later rows are screened by is known from these
and those before, so that blocks, live samples and the record itself agree: the codes for "no value" that the record has
or could not hold, the spikes of the fitted record, by time and value, temperatures that look like another unit, and how
each input moves (`thermocorr.records.gate`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..equations.outliers import ABSURD, ALL_CODES, CHUNK, MOST, OVERLOAD, Found, Usual, found_in, usual_of
from .errors import RecordError, listing, quoted, times_word, way
from .gate import JUMP, Gate, Motion, excursions
from .numbers import is_frame, numeric_column, numeric_reading
from .record import Record, Refused
from .times import Floats
from .types import Column, Number, Stamp
from .units import OtherUnit, first_median, unit_told_by

_CHUNK = 1 << 16  # rows looked at together, so that checks need no memory of the record's size


def missing_text(record: Record, missing: NDArray[np.intp]) -> str:
    """Sentence on rows that lack a value.

    `record` (Record). `missing` (array of shape (n,)): The rows, in time order; one at least.
    """
    row = record.row(int(missing[0]))
    lacks = listing(name for name, values in record.columns.items() if np.isnan(values[row]))
    at = "" if record.times.kind == "rows" else f" at {record.times.label(row)}"
    have = "has" if len(missing) == 1 else "have"
    return (
        f"{times_word(len(missing), 'row')} of {record.n_rows} {have} a missing value, the first is row {row} "
        f"({lacks}{at})"
    )


def nothing_known_text(record: Record) -> str:
    """Message on a record without one complete row."""
    n = record.n_rows
    empty = [name for name in record.columns if _is_empty(record, name)]
    where = f"in {listing(empty)}" if empty else f"in every needed column ({listing(record.columns)})"
    lack = f"all {n} values are missing" if len(empty) == 1 else f"all {n} rows have a missing value"
    check = (
        "the column's name and the file it comes" if len(empty) == 1 else "the columns' names and the file they come"
    )
    return f"No row has a number {where}: {lack}. Check {check} from."


def _is_empty(record: Record, name: object) -> bool:
    values = record.columns[name]
    return all(np.isnan(values[start : start + _CHUNK]).all() for start in range(0, record.n_rows, _CHUNK))


@dataclass(frozen=True)
class WeightedReading:
    """Readings and their weights: the y of a fit."""

    y: Any
    """As the user gave them."""
    weight: Floats
    """Shape (n_rows,); zero for a reading that is not learned from."""


def reading_of(y: Any, X: Any, reference: object = None) -> tuple[NDArray[Any] | None, Floats | None]:
    """Readings as numbers, and weights or None.

    With a `reference`, a column of X, what they differ from it by.
    """
    if y is None:
        return None, None
    weight = y.weight if isinstance(y, WeightedReading) else None
    reading = error_of(y.y if isinstance(y, WeightedReading) else y, X, reference)
    return (reading if weight is None else left_out(reading, np.flatnonzero(weight == 0))), weight


def error_of(y: Any, X: Any, reference: object = None) -> NDArray[Any]:
    """Readings as numbers, less those of a `reference`."""
    reading = numeric_reading(y, X)
    if reference is None:
        return reading
    if not is_frame(X):
        raise RecordError("A reference is a named column. Pass a DataFrame, for example pandas.DataFrame(X).")
    return np.asarray(reading - numeric_column(X, reference, "reference"), float)


SAMPLES, SAMPLE_ROWS = 16, 256
"""Stretches, and rows of each, that show what is usual in a long record."""
MOST_KEPT = 10_000
"""Spikes that are known again in later rows at most."""
LISTED = 10
"""Rows that a note lists."""
SPIKE, SENTINEL, OTHER_UNIT, REPEAT = "spike", "sentinel", "other unit", "repeat"

Rows = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Screen of one quantity, row by row."""

    middle: Number = 0.0
    """A usual value."""
    codes: tuple[Number, ...] = ()
    """Numbers that stand for "no value"; beyond 1e30 all do."""
    spikes: dict[Stamp, Number] = field(default_factory=dict)
    """Time stamp and value of each spike of the fitted record."""
    elsewhere: tuple[OtherUnit, ...] = field(default=(), compare=False)
    """What is a usual value in another unit, and none in the fitted one."""
    motion: Motion | None = None
    """How an input moves; None for readings, which may do what they like."""

    @cached_property
    def _between(self) -> tuple[float, float]:
        """The codes next to the usual value, below and above."""
        low = max((code for code in self.codes if code < self.middle), default=-OVERLOAD)
        high = min((code for code in self.codes if code > self.middle), default=OVERLOAD)
        return low, high

    def coded(self, values: NDArray[Any]) -> Rows:
        """Numbers of the values that are codes."""
        low, high = self._between
        near = np.flatnonzero((values <= low) | (values >= high))
        return near[np.isin(values[near], self.codes) | (np.abs(values[near]) >= OVERLOAD)] if len(near) else near

    def in_other_unit(self, values: NDArray[Any]) -> Rows:
        """Numbers of the values that look like another unit."""
        found = np.zeros(len(values), bool)
        for low, high, _ in self.elsewhere:
            found |= (values > low) & (values < high)
        return np.flatnonzero(found)

    def spiked(self, values: NDArray[Any], stamp_of: Callable[[int], Any]) -> Rows:
        """Numbers of the values that are known spikes."""
        if not self.spikes:
            return np.zeros(0, np.intp)
        alike = np.flatnonzero(np.isin(values, list(self.spikes.values())))
        return np.array([k for k in alike.tolist() if self.spikes.get(stamp_of(k)) == values[k]], np.intp)

    def reason(self, value: float, stamp: Any) -> str:
        """Why a value is refused: "sentinel", "spike", "other unit", or ""."""
        low, high = self._between
        if (value <= low or value >= high) and (abs(value) >= OVERLOAD or value in self.codes):
            return SENTINEL
        if self.spikes and self.spikes.get(stamp) == value:
            return SPIKE
        return OTHER_UNIT if unit_told_by(value, self.elsewhere) else ""

    def reasons(self, values: NDArray[Any], stamp_of: Callable[[int], Any]) -> list[tuple[Rows, str]]:
        """`reason` of many values: their numbers, by reason."""
        found = (
            (self.in_other_unit(values), OTHER_UNIT), (self.spiked(values, stamp_of), SPIKE),
            (self.coded(values), SENTINEL),
        )  # fmt: skip
        return [(rows, reason) for rows, reason in found if len(rows)]


@dataclass(frozen=True, kw_only=True)
class Screen:
    """Screen of each input and of the reading."""

    inputs: dict[Column, Limits] = field(default_factory=dict)
    """By column, the temperature first."""
    reading: Limits = field(default_factory=Limits)

    def without_codes(self, record: Record, max_gap: float | None) -> Record:
        """The record without codes and values in another unit.

        A record that is in another unit as a whole is left as it is, to be refused.
        """
        for column, limits in self.inputs.items():
            values, coded, odd = record.columns[column], [], []
            for low, high in _chunks(record):  # as floats: 1e30 is none of half precision
                chunk = np.asarray(values[record.rows(low, high)], float)
                coded.append(low + limits.coded(chunk))
                odd.append(low + limits.in_other_unit(chunk))
            record = without(record, column, SENTINEL, np.concatenate(coded), max_gap)
            elsewhere = np.concatenate(odd)
            if not len(elsewhere) or not unit_told_by(first_median(record, column), limits.elsewhere):
                record = without(record, column, OTHER_UNIT, elsewhere, max_gap)
        return record

    def without_spikes(self, record: Record, max_gap: float | None) -> Record:
        """The record without the inputs' known spikes."""
        for column, limits in self.inputs.items():
            if limits.spikes:
                values, found = record.columns[column], []
                for low, high in _chunks(record):
                    found.append(low + limits.spiked(values[record.rows(low, high)], _stamps_from(record, low)))
                record = without(record, column, SPIKE, np.concatenate(found), max_gap)
        return record

    def gated(self, record: Record, zero: float, max_gap: float | None) -> Record:
        """The record with held inputs, and twins of doubted ones."""
        columns, twins, accepted = dict(record.columns), dict(record.twins), dict(record.accepted)
        held = np.zeros(record.n_rows, bool)
        for column, gate, rows in self._chunks_of_inputs(record, max_gap):
            values = np.asarray(record.columns[column][rows], float)
            found = gate.many(values, record.times.seconds(rows, zero))
            if found is None:
                continue
            held[rows] |= found.held
            if found.held.any():
                if columns[column] is record.columns[column]:
                    columns[column] = np.array(record.columns[column][:], float)
                columns[column][rows] = found.value
            if not np.isnan(found.twin).all():
                twin = twins.setdefault(column, np.full(record.n_rows, np.nan))
                twin[rows] = np.where(np.isnan(found.twin), twin[rows], found.twin)
            if found.accepted.any():
                accepted.setdefault(column, np.zeros(record.n_rows, bool))[rows] |= found.accepted
        if not (held.any() or twins):
            return record
        return replace(record, columns=columns, known_moments={}, held=held, twins=twins, accepted=accepted)

    def _chunks_of_inputs(self, record: Record, max_gap: float | None) -> Iterator[tuple[Any, Gate, Any]]:
        """Each input, its gate, and the user's rows."""
        for column, limits in self.inputs.items():
            if limits.motion is None:
                continue
            run: object = self
            for segment in record.segments:
                if segment.run != run:
                    run, gate = segment.run, Gate(limits.motion, np.inf if max_gap is None else max_gap)
                for start in range(segment.start, segment.stop, CHUNK):
                    rows = record.kept(start, min(start + CHUNK, segment.stop))
                    if isinstance(rows, slice) or len(rows):
                        yield column, gate, rows


def _stamps_from(record: Record, first: int) -> Callable[[int], Any]:
    """Time stamps of the rows from `first` on, in time order."""
    return lambda k: record.stamp(first + k)


def _chunks(record: Record) -> Iterator[tuple[int, int]]:
    """The rows inside segments, a chunk at a time."""
    for segment in record.segments:
        for start in range(segment.start, segment.stop, CHUNK):
            yield start, min(start + CHUNK, segment.stop)


def screened(record: Record, max_gap: float | None = None, thermometers: Collection[Any] = ()) -> tuple[Record, Screen]:
    """A screened record, and the screen for later rows.

    Parameters
    ----------
    record : Record
    max_gap : float, optional
        A longer step starts a new segment [s], so temperatures that are refused for longer do as well.
    thermometers : collection of columns
        Temperatures beyond the first.

    Returns
    -------
    record : Record
        `refused` and `notes` say what was left out.
    screen : Screen

    Raises
    ------
    RecordError
        Where no temperature is left.
    """
    limits = {}
    for column in (*record.columns, None):
        values = record.reading if column is None else record.columns[column]
        if values is None:
            continue
        usual = usual_of(_sampled(record, values), record.n_used)
        stretches = [(segment.start, segment.stop) for segment in record.segments]
        found = found_in(partial(_values, record, values), stretches, usual)
        spikes = found.true_spikes(record.n_used)
        if column is not None and usual.middle in (usual.low, usual.high):
            spikes = spikes[:0]  # it rests at an end, such as no rain: a pulse is what it is recorded for
        if len(found.repeats) and column == record.temperature_name:  # a device may well stand still as long
            record = replace(record, notes=(*record.notes, _seldom(record, found.repeats)))
        repeats = found.repeats if column is None else found.repeats[:0]
        refused = (SENTINEL, found.codes), (SPIKE, spikes), (REPEAT, repeats)
        for reason, positions in refused:
            if len(positions):
                record = without(record, column, reason, positions, max_gap)
        limits[column] = _limits(record, column, values, usual, found, spikes)
    motions: dict[Any, Motion] = {}
    for column in (record.temperature_name, *thermometers):  # a current may go there and back, a room does not
        longest = np.inf if max_gap is None else max_gap
        motions[column] = Motion.of(record, column)
        positions = excursions(record, column, motions[column], longest)
        if 0 < len(positions) <= min(MOST * record.n_used, MOST_KEPT):
            values = np.asarray(record.columns[column][record.rows_at(positions)], float).tolist()
            met = {record.stamp(k): value for k, value in zip(positions.tolist(), values, strict=True)}
            limits[column] = replace(limits[column], spikes={**limits[column].spikes, **met})
            record, motions = without(record, column, JUMP, positions, max_gap), {}
    if record.refused:
        notes = tuple(_note(refused) for refused in record.refused)
        record = replace(record, notes=(*record.notes, *notes))
    inputs = {n: replace(limits[n], motion=motions.get(n) or Motion.of(record, n)) for n in record.columns}
    return record, Screen(inputs=inputs, reading=limits.get(None, Limits()))


def _sampled(record: Record, column: NDArray[Any]) -> list[Floats]:
    """Stretches of consecutive values, sampled from a long record."""
    ends = np.cumsum([segment.n_rows for segment in record.segments]).tolist()
    if ends[-1] <= SAMPLES * SAMPLE_ROWS:
        parts = [(segment.start, segment.stop) for segment in record.segments]
    else:
        parts = []
        for place in np.linspace(0, ends[-1] - SAMPLE_ROWS, SAMPLES).astype(int).tolist():
            number = bisect_right(ends, place)
            stop = record.segments[number].stop
            start = stop - ends[number] + place
            parts.append((start, min(start + SAMPLE_ROWS, stop)))
    rows = [record.rows(start, stop) for start, stop in parts]
    return [np.asarray(column[some], float) for some in rows]


def _values(record: Record, column: NDArray[Any], low: int, high: int) -> Floats:
    """Values of a column between two rows in time order."""
    return np.asarray(column[record.rows(low, high)], float)


def _limits(record: Record, name: Any, column: NDArray[Any], usual: Usual, found: Found, spikes: Rows) -> Limits:
    """Limits for later rows: codes and spikes."""
    met = np.unique(np.asarray(column[record.rows_at(_few(found.codes))], float)).tolist() if len(found.codes) else []
    left = record.reading_moments() if name is None else record.moments(name)
    far = ALL_CODES[(left.low > ALL_CODES) | (left.high < ALL_CODES)]
    far = far[usual.outside(far, ABSURD)] if usual.range > 0 else far[:0]
    codes = sorted({code for code in (*met, *far.tolist()) if abs(code) < OVERLOAD})
    kept = spikes[:MOST_KEPT]
    values = np.asarray(column[record.rows_at(kept)], float).tolist() if len(kept) else []
    known = {record.stamp(k): value for k, value in zip(kept.tolist(), values, strict=True)}
    return Limits(middle=usual.middle, codes=tuple(codes), spikes=known)


def _few(positions: Rows) -> Rows:
    """Some of many rows, evenly spread."""
    return positions[:: max(1, len(positions) // MOST_KEPT)]


def without(record: Record, column: Any, reason: str, positions: Rows, max_gap: float | None) -> Record:
    """A record with some values of an input refused."""
    of_reading = column is None
    positions = np.sort(positions) if of_reading else np.setdiff1d(positions, record.skipped)
    if not len(positions):
        return record
    rows = record.rows_at(positions)
    what = "reading" if of_reading else "temperature" if column == record.temperature_name else quoted(column)
    values: Any = record.reading if of_reading else record.columns[column]
    seconds = record.times.seconds(rows, record.first_stamp())
    refused = (*record.refused, Refused(what, reason, rows, np.asarray(values[rows], float), seconds))
    if of_reading:
        return replace(record, reading=left_out(values, rows), refused=refused)
    cut = replace(record, refused=refused).passing_over(positions, max_gap)
    if not cut.segments:
        raise RecordError(
            f"No value in {quoted(column)} is accepted: all {record.n_used} rows are refused as {reason}s. "
            f"Check the column, or {way('fit in Python with screen=False', 'pass screen=False')}."
        )
    return cut


def left_out(values: NDArray[Any], rows: Rows) -> Floats:
    """A copy of a column in which some rows are missing."""
    kept = np.array(values, float)
    kept[rows] = np.nan
    return kept


def _seldom(record: Record, repeats: Rows) -> str:
    """Note on a temperature that is measured rarely."""
    return (
        f"{quoted(record.temperature_name)} repeats the row before in {len(repeats)} of {record.n_used} rows, and then "
        "moves on by many digits: it is measured less often than the readings. What the room does in between is not "
        'seen, and a device may seem ahead of its thermometer ("lead"). Log it as often as the readings.'
    )


def _note(refused: Refused) -> str:
    """One line on what was left out."""
    count = len(refused.rows)
    if refused.reason == REPEAT:
        return (
            f"{times_word(count, 'reading')} {'repeats' if count == 1 else 'repeat'} the row before exactly: the "
            "instrument measures less often than it is logged. The first row of each reading is learned from."
        )
    rows = [str(row) for row in refused.rows[:LISTED].tolist()]
    more = f" and {count - LISTED} more" if count > LISTED else ""
    which = times_word(count, refused.what if refused.what in ("reading", "temperature") else "value")
    of = "" if refused.what in ("reading", "temperature") else f" of {refused.what}"
    said = f"{which}{of} left out as {refused.reason}{'' if count == 1 else 's'}"
    return f"{said}: row{'' if count == 1 else 's'} {', '.join(rows)}{more}."
