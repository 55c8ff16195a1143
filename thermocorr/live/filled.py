"""Clock and smoothing of a stream."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..equations import MovingAverage
from ..estimators import DynamicBiasRegressor
from ..estimators.uncertainty.joint import ErrorWalk
from ..records import History, RecordError, seconds_of
from ..records.errors import quoted
from ..records.grammar import LARGEST
from ..records.labels import check_dates, out_of_reach
from ..records.numbers import as_numbers, as_pandas, is_frame, numeric_column
from ..records.screen import Limits
from ..records.segments import Flags
from ..records.times import BEYOND, EARLIEST, LATEST, Times, date_of_text, span_of


class Tracker:
    """Mean under an exponential weight of the time since: ``u += (1 - exp(-dt/tau)) (value - u)``.

    `time_constant` (float or time span): tau [s]. `start` (float): u before the first value.
    """

    def __init__(self, time_constant: Any, start: float):
        self.time_constant = seconds_of(time_constant, "track")
        self.start = float(start)
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self.value = self.start
        self.last: float | None = None

    def one(self, seconds: float, value: float, trusted: bool) -> float:
        """The mean, after a value that came at `seconds`; one that is not trusted changes nothing."""
        if trusted:
            if self.last is not None and seconds > self.last:
                self.value -= math.expm1((self.last - seconds) / self.time_constant) * (value - self.value)
            self.last = seconds
        return self.value

    def many(self, seconds: np.ndarray, values: np.ndarray, trusted: np.ndarray) -> np.ndarray:
        """The mean after each of many values, shape (n,)."""
        rows = zip(seconds.tolist(), values.tolist(), trusted.tolist(), strict=True)
        return np.array([self.one(*row) for row in rows], float)


_NS = 1_000_000_000
_EPOCH, _EPOCH_UTC = datetime(1970, 1, 1), datetime(1970, 1, 1, tzinfo=UTC)
_ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?(Z|[+-]\d\d:\d\d)?", re.ASCII)
"""The usual form, which `pandas.Timestamp` reads as `pandas.to_datetime(..., format="ISO8601")` does, but faster."""
_MICROSECOND = timedelta(microseconds=1)


class Clock:
    """Stamps of one kind of time, see `Times.stamp`: nanoseconds, seconds or row numbers."""

    def __init__(self, history: History):
        self.kind = history.kind
        self.next_row = history.n_fitted
        period = float(history.record.times.period)
        self.unit = {"rows": period, "seconds": 1.0}.get(self.kind, 1.0 / _NS)
        """Length of one stamp [s], to rounding; see `seconds`."""
        self._per = {"rows": 1.0, "seconds": 1.0}.get(self.kind, float(_NS))
        self._times = period if self.kind == "rows" else 1.0
        convert: dict[str, Callable[[Any], float]] = {
            "rows": self._row,
            "seconds": self._seconds,
            "timedelta": self._span,
            "datetime": partial(self._date, zoned=False),
            "datetime with time zone": partial(self._date, zoned=True),
        }
        self.stamp = convert[self.kind]
        """Function that turns one time into its stamp; RecordError for what is no time of this kind."""

    def between(self, later: Any, earlier: Any) -> Any:
        """Difference of two stamps (or arrays of them) [s]."""
        return (later - earlier) * self._times / self._per

    def stamps(self, times: Times) -> np.ndarray:
        """Stamps of many times, shape (n,); rows without times have those of `next_rows`."""
        if times.kind != self.kind:
            raise RecordError(
                f"The fitted record has times of kind {self.kind!r}, these rows have {times.kind!r}. Give both the "
                "same kind of time (dates with or without zone, time spans, seconds, or none at all)."
            )
        return times.stamps()

    def next_rows(self, n: int) -> np.ndarray:
        """Stamps of the next `n` rows of a record without times."""
        self.next_row += n
        return np.arange(self.next_row - n, self.next_row)

    def times(self, stamps: np.ndarray) -> Times:
        """The times that these stamps mean."""
        per_second = 1 if self.kind in ("rows", "seconds") else _NS
        return Times(len(stamps), self.kind, stamps, per_second, self._times)

    def _refuse(self, time: Any, wanted: str) -> RecordError:
        return RecordError(f"A sample's time must be {wanted}, as in the fitted record. Got {time!r} instead.")

    def _row(self, time: Any) -> int:
        if time is not None:
            raise self._refuse(time, "None (the next row)")
        self.next_row += 1
        return self.next_row - 1

    def _seconds(self, time: Any) -> float:
        try:
            seconds = float(time)
        except (TypeError, ValueError):
            seconds = math.nan
        if not abs(seconds) <= LARGEST:
            raise self._refuse(time, "a number of seconds")
        return seconds

    def _span(self, time: Any) -> int:
        try:
            value: Any = pd.Timedelta(time, unit="s") if isinstance(time, int | float) else span_of(time)
        except (TypeError, ValueError, OverflowError):
            value = pd.NaT
        if value is pd.NaT:
            raise self._refuse(time, "a time span or a number of seconds")
        return self._within_range(value.value, time) if value.unit == "ns" else self._nanoseconds(value, time)

    def _date(self, time: Any, zoned: bool) -> int:
        kind, wanted = type(time), f"a date {'with' if zoned else 'without'} a time zone"
        if kind is pd.Timestamp and (time.tzinfo is not None) == zoned:
            return self._nanoseconds(time, time)
        if kind is datetime and (time.tzinfo is not None) == zoned:
            return self._within_range((time - (_EPOCH_UTC if zoned else _EPOCH)) // _MICROSECOND * 1000, time)
        date = self._parsed(time, wanted)
        if (date.tzinfo is not None) != zoned:
            raise self._refuse(time, wanted)
        return self._nanoseconds(date, time)

    def _nanoseconds(self, value: Any, time: Any) -> int:
        """Stamp of a date or span of pandas."""
        try:
            return self._within_range(value.value, time)
        except (OverflowError, ValueError):
            raise self._beyond(time) from None

    def _within_range(self, stamp: int, time: Any) -> int:
        if not EARLIEST <= stamp <= LATEST:
            raise self._beyond(time)
        return stamp

    def _beyond(self, time: Any) -> RecordError:
        return RecordError(f"A sample's time is {time!s:.60}. {BEYOND}")

    def _parsed(self, time: Any, wanted: str) -> Any:
        date: Any = pd.NaT
        try:
            if isinstance(time, datetime | np.datetime64) or (isinstance(time, str) and _ISO_DATE.fullmatch(time)):
                date = pd.Timestamp(time)
            elif isinstance(time, str):
                date = date_of_text(time)
        except OverflowError:
            raise self._beyond(time) from None
        except (TypeError, ValueError):
            pass
        if date is pd.NaT:
            raise self._refuse(time, wanted)
        return date


NO_TEMPERATURE = "no temperature"
"""Flag of a sample that lacks a temperature, or a column that the model needs."""


class Corrected(NamedTuple):
    """Result for one sample."""

    corrected: float
    """Reading less bias, eq. (24); NaN without a reading."""
    bias: float
    """What was taken away; NaN without a temperature."""
    flags: tuple[str, ...]
    """Every reason for distrust, the weightiest first; empty where there is none."""
    smoothed: float = math.nan
    """Moving average of the corrected reading, eq. (26); NaN unless asked for."""
    reference: float = math.nan
    """Tracked U0; NaN unless asked for."""
    u: float = math.nan
    """Standard uncertainty of the corrected reading; NaN unless asked for."""
    u_smoothed: float = math.nan
    """Standard uncertainty of the moving average; NaN unless both are asked for."""

    @property
    def flag(self) -> str:
        """The weightiest reason for distrust, as in `DynamicBiasRegressor.flags`; "" where there is none."""
        return self.flags[0] if self.flags else ""


COLUMNS = {"flag": "flags"}
"""Name of a result -> attribute of `Answers`, where they differ."""


class Answers:
    """Results for many samples, column by column."""

    def __init__(self, n: int):
        self.corrected, self.bias, self.smoothed, self.reference = (np.full(n, np.nan) for _ in range(4))
        self.u, self.u_smoothed = (np.full(n, np.nan) for _ in range(2))
        self.flags = Flags(n)

    def __setitem__(self, rows: slice, samples: Sequence[Corrected]) -> None:
        for name, column in zip(Corrected._fields, zip(*samples, strict=True), strict=True):
            if name != "flags":
                getattr(self, name)[rows] = column
            elif any(column):
                for k, sample in zip(range(rows.start, rows.stop), samples, strict=True):
                    self.flags[k] = sample.flag

    def frame(self, X: Any, names: Sequence[str]) -> pd.DataFrame:
        """The columns of these names, beside the rows of X."""
        result = {name: getattr(self, COLUMNS.get(name, name)) for name in names}
        result["flag"] = self.flags.column()
        return pd.DataFrame(result, index=X.index if isinstance(X, pd.DataFrame) else None)

    def spread(self, why: np.ndarray, reference: float) -> Answers:
        """Columns with rows between that got nothing, for a reason; `reference` was tracked before them."""
        out, kept = Answers(len(why)), why == ""
        for name, column in vars(self).items():
            getattr(out, name)[kept] = column
        out.flags[~kept] = why[~kept]
        last = np.maximum.accumulate(np.where(kept, np.arange(len(kept)), -1))
        out.reference = np.where(last < 0, reference, out.reference[last])
        return out


def one_number(value: Any) -> float:
    """A float; NaN for None. RecordError for text, TypeError for what is of another type."""
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else RecordError
        raise kind(
            "A sample's temperature, reading and columns must be numbers, None or NaN where there is none. "
            f"Got {value!r:.60} instead."
        ) from None


def _floats(values: Any) -> np.ndarray:
    """A column as floats of its own, NaN for what is missing or infinite; TypeError or ValueError for text."""
    array = np.array(values, float)
    array[np.isinf(array)] = np.nan
    return array


def _whole(column: Any) -> Any:
    """All rows of a column; pandas' as they are, for a slice of one copies what is said about it (`attrs`)."""
    return column if isinstance(column, pd.Series | pd.DataFrame) else column[:]


def readings(y: Any, n: int) -> np.ndarray:
    """Readings as floats, NaN where there is none, shape (n,)."""
    given = _whole(as_pandas(y))
    try:
        values = _floats(given)
    except (TypeError, ValueError):  # the same, or a sentence about what is wrong
        given = given if isinstance(given, pd.Series) else np.asarray(given)
        values = _floats(as_numbers(given, "The reading y", "reading"))
    values = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if values.shape != (n,):
        raise RecordError(
            f"X has {n} rows and y has the shape {values.shape}. Each row needs one reading (NaN where none)."
        )
    return values


def column_of(X: Any, name: Any, role: Any) -> np.ndarray:
    """A column as floats, NaN for what is missing; RecordError, in a sentence, for one that is none."""
    try:
        return _floats(_whole(X[name]) if is_frame(X) else X[:, name])
    except (KeyError, IndexError, TypeError, ValueError):
        return _floats(numeric_column(X, name, role))  # the same, or a sentence about what is wrong


def refused_rows(inputs: Mapping[Any, Limits], stamps: np.ndarray, values: Any) -> np.ndarray | None:
    """Why each row is passed over, "" where it is not; None where all are believed."""
    lacking = np.flatnonzero(~np.logical_and.reduce([np.isfinite(column) for column in values.values()]))
    found = [
        each for name, limits in inputs.items() for each in limits.reasons(values[name], lambda k: stamps[k].item())
    ]
    found.append((lacking, NO_TEMPERATURE))
    if not any(len(rows) for rows, _ in found):
        return None
    why = np.full(len(stamps), "", dtype=object)
    for rows, reason in found:
        why[rows] = reason
    return why


def checked_label(label: Any, column: Any) -> Any:
    """The label of a sample's run; RecordError for one that is missing, and for a date out of reach."""
    if type(label) is not str:
        if pd.isna(label):
            raise RecordError(f"The sample has no label of its run in {quoted(column)}. Label every sample.")
        if out_of_reach(label):
            raise RecordError(f"The label of the sample's run is {label!s:.60}. {BEYOND}")
    return label


def stretches(labels: pd.Series[Any] | None, n: int) -> list[tuple[int, int, Any]]:
    """Stretches of rows of the same run: first row, row after the last, label."""
    if labels is None:
        return [(0, n, None)]
    if labels.isna().any():
        raise RecordError(f"Row {int(labels.isna().argmax())} has no label of its run. Label every row.")
    codes, names = pd.factorize(labels)
    check_dates(codes, names, "The column of the run's label")
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), n]
    return [(low, high, labels.iloc[low]) for low, high in pairwise(edges)]


class LiveErrors:
    """Standard uncertainties of corrected readings: those of `DynamicBiasRegressor.correct` with ``return_std=True``.

    A model that has searched its time constants carries the lags of the whole spectrum beside its own.

    `model` (DynamicBiasRegressor): Fitted.
    """

    def __init__(self, model: DynamicBiasRegressor):
        self.joint = joint = model._joint_errors()
        self._walk = ErrorWalk(model, joint, removed=True)
        own, history = model.features_.effect_list(), model.features_.history_
        more = [i for i, effect in enumerate(joint.effects) if all(effect is not each for each in own)]
        self.effects = [*own, *(joint.effects[i] for i in more)]
        """Effects of the model, and what its errors need beside them."""
        ends = zip(history.end_states, joint.history.end_states, strict=True)
        self.history: History = replace(
            history, end_states=tuple([*states, *(wide[i] for i in more)] for states, wide in ends)
        )
        """The fitted record, with the states of all these effects."""
        edges = np.cumsum([0, *(effect.n_columns() for effect in self.effects)])
        place = {
            id(effect): range(low, high) for effect, (low, high) in zip(self.effects, pairwise(edges), strict=True)
        }
        self._columns = [column for effect in joint.effects for column in place[id(effect)]]
        self._mean_variances: dict[int, float] = {}

    def variances(
        self, columns: np.ndarray, seconds: np.ndarray, temperature: np.ndarray, bias: np.ndarray, key: int | None
    ) -> np.ndarray:
        """Variance of the bias (less what it shares with the noise), and of the noise over its usual one, shape (2, n).

        `columns` are those of all `effects`, shape (n, p); `key` is the fitted segment that the rows belong to.
        """
        errors = self._walk.errors(columns[:, self._columns], seconds, temperature, bias, key)
        return np.stack((errors.bias - 2 * errors.shared, errors.noise))

    def u(self, variances: np.ndarray, count: int = 1) -> np.ndarray:
        """Standard uncertainty of corrected readings, or of the mean of the last `count`, shape (n,).

        The bias of a mean is taken to be as sure as that of its last reading.
        """
        noise = self.joint.noise.variance if count == 1 else self._mean_variance(count)
        return np.asarray(np.sqrt(np.maximum(variances[0] + noise * variances[1], 0.0)))

    def of_block(
        self, variances: np.ndarray, corrected: np.ndarray, average: MovingAverage | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Standard uncertainties of a block's corrected readings, and of their moving averages, before these go on."""
        variances[:, np.isnan(corrected)] = np.nan
        of_mean = np.full(len(corrected), np.nan)
        if average is not None:
            counts = np.minimum(np.cumsum(np.isfinite(corrected)) + len(average.values), average.count)
            for count in np.unique(counts).tolist():
                of_mean[counts == count] = self.u(variances[:, counts == count], max(count, 1))
        return self.u(variances), of_mean

    def _mean_variance(self, count: int) -> float:
        """Variance of the mean of the noise of so many readings a usual step apart."""
        if count not in self._mean_variances:
            noise = replace(self.joint.noise, size_seconds=np.zeros(0), sizes=np.zeros(0))
            self._mean_variances[count] = sum(noise.of_mean(np.arange(count) * self.history.usual_step))
        return self._mean_variances[count]


Numbers = tuple[tuple[float, ...], ...]
NOTHING = (0.0, 0.0, 0.0, 0.0)
"""What is said of a sample that has no filled cell, and feels none, where no hole has ended a segment."""


class LiveFilling:
    """State of the imputation in a stream.

    It counts every sample whose time goes on, those that lack all thermometers too: a stream passes over these.

    `model` (DynamicBiasRegressor). `continues` (bool): Whether the stream may continue the fitted record.
    """

    def __init__(self, model: DynamicBiasRegressor, continues: bool):
        features = model.features_
        self.filling, self.history, self.continues = features.filling_, features.history_, continues
        self.law = model._filling_error()
        self.max_gap = np.inf if self.history.max_gap is None else self.history.max_gap
        self.ranges = [(one.column, *one.range) for one in self.filling.stand_ins]
        self.n_ended = 0
        self.put(None, None, ())

    def put(self, last: Any, run: Any, remembered: Numbers) -> None:
        """Go on where `remembered` was taken, after a sample of this time and run."""
        self._pending: list[tuple[Any, dict[Any, float]]] = []
        self.last, self.run = last, run
        n = len(self.filling.stand_ins)
        self._states = [np.array(each) for each in remembered[:n]] or None
        sizes = [len(law.weights) + 1 for law in self.law.laws]
        felt = zip(remembered[n:], sizes, strict=False)
        self._felt: list[np.ndarray] | None = [np.array(each).reshape(size, size) for each, size in felt] or None

    def state(self, clock: Clock) -> tuple[Any, Any, Numbers]:
        """Time and run of the last sample, and what is remembered: the arguments of `put`."""
        self._catch_up(clock)
        return self.last, self.run, self._remembered()

    def _remembered(self) -> Numbers:
        """State of each stand-in, then the covariance of each column's error with the lags."""
        states = [each.tolist() for each in self._states or ()]
        felt = [each.ravel().tolist() for each in self._felt or ()]
        return tuple(tuple(each) for each in (*states, *felt))

    def widths(self, n_parts: int) -> list[int]:
        """Number of values in each part of the state; without errors where there are fewer parts."""
        if n_parts == len(self.filling.stand_ins):
            return [one.width for one in self.filling.stand_ins]
        return [*(one.width for one in self.filling.stand_ins), *((len(law.weights) + 1) ** 2 for law in self.law.laws)]

    def one(self, stamp: Any, run: Any, values: dict[Any, float], clock: Clock) -> Any:
        """Look at one sample as `rows` does; one that lacks nothing and feels nothing is kept for later."""
        begins = not self._pending and (self.last is None or run != self.run)
        plain = (
            not begins
            and run == self.run
            and self._felt is None
            and stamp > (self._pending[-1][0] if self._pending else self.last)
        )
        given = [(values[one.column], one.limits) for one in self.filling.stand_ins]
        if plain and all(math.isfinite(value) and not limits.reason(value, stamp) for value, limits in given):
            self._pending.append((stamp, values))
            # Samples that lack nothing are looked at together: one by one takes seventeen times as long
            if len(self._pending) == 256:
                self._catch_up(clock)
            return (0.0, 0.0, self.n_ended, 0.0)
        arrays = {name: np.array([value]) for name, value in values.items()}
        felt = self.rows(np.array([stamp]), run, arrays, clock)[0].tolist()
        values.update({name: float(value[0]) for name, value in arrays.items()})
        return felt

    def _catch_up(self, clock: Clock) -> None:
        """Look at the samples that lack nothing."""
        if self._pending:
            stamps, rows = zip(*self._pending, strict=True)
            self._pending = []
            values = {name: np.array([row[name] for row in rows], float) for name in self.filling.columns}
            self.rows(np.array(stamps), self.run, values, clock)

    def rows(self, stamps: np.ndarray, run: Any, values: dict[Any, np.ndarray], clock: Clock) -> np.ndarray:
        """Fill missing cells of the next samples of one run, in place.

        Returns array of shape (n, 4): standard deviation of the bias by filled cells, 0 where none is felt; 1 where
        one of the row's own is; how many segments have been ended by holes so far, `n_ended`; and which of the
        stand-ins have filled a cell, a bit for each.
        """
        self._catch_up(clock)
        result = np.zeros((len(stamps), len(NOTHING)))
        result[:, 2] = self.n_ended
        same_run = self.last is not None and run == self.run
        before = np.maximum.accumulate(np.concatenate(([self.last if same_run else stamps[0]], stamps)))[:-1]
        late = stamps <= before
        late[0] &= same_run
        rows = np.flatnonzero(~late)  # the others will be refused
        if not len(rows):
            return result
        steps = np.asarray(clock.between(stamps[rows], before[rows]), float)
        fresh = steps > self.max_gap
        fresh[0] |= not same_run
        if fresh[0]:
            self._states = self._felt = None
            if self.last is None and self.continues:
                end, steps[0] = self.filling.before(self.history, stamps[rows[0]].item(), run)
                self._states = None if end is None else list(end)
        edges = [0, *(np.flatnonzero(fresh[1:]) + 1).tolist(), len(rows)]
        for low, high in pairwise(edges):
            if low:
                self._states = self._felt = None
            result[rows[low:high]] = self._piece(rows[low:high], stamps, steps[low:high], values)
        self.last, self.run = stamps[rows[-1]].item(), run
        return result

    def _piece(
        self, rows: np.ndarray, stamps: np.ndarray, steps: np.ndarray, values: dict[Any, np.ndarray]
    ) -> np.ndarray:
        given = {name: values[name][rows] for name in self.filling.columns}
        believed = self.filling.screened(given, lambda k: stamps[rows[k]].item())
        filled = self.filling.fill(believed, steps, self._states)
        self._states = filled.states
        error = np.zeros(len(rows))
        edges = [0, *(np.flatnonzero(filled.begins[1:]) + 1).tolist(), len(rows)]
        for low, high in pairwise(edges):
            some, gone = ({name: each[low:high] for name, each in of.items()} for of in (filled.values, filled.errors))
            felt = None if filled.begins[low] else self._felt
            error[low:high], self._felt = self.law.of_rows(some, gone, steps[low:high], felt)
        for name in self.filling.columns:
            if name in filled.errors:
                values[name] = np.array(values[name], float)
                values[name][rows] = filled.values[name]
        if not any(each.any() for each in self._felt or ()):
            self._felt = None
        own = np.logical_or.reduce([np.isfinite(each) for each in filled.errors.values()])
        ended = self.n_ended + np.cumsum(filled.begins)
        self.n_ended = int(ended[-1])
        bits = sum(2.0**k * np.isfinite(each) for k, each in enumerate(filled.errors.values()))
        return np.column_stack((error, own, ended, bits))


def outside(ranges: Sequence[tuple[Any, float, float]], values: dict[Any, float]) -> bool:
    """True if a further column lies outside its fitted range."""
    return any(not low <= values[column] <= high for column, low, high in ranges)
