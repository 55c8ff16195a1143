"""Times of records: dates, spans, seconds, or rows."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError, option, quoted, way
from .types import LARGEST, Check, Counted, Positive, kind_of

UNIX = (9.4e8, 2.6e9)
"""Unix times in seconds, 1999 to 2052."""
EPOCHS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
"""Unit of Unix times -> how many are a second."""


def unix_unit(low: float, high: float) -> str | None:
    """Unit of Unix times, "s", "ms", "us" or "ns"; else None.

    Examples
    --------
    >>> unix_unit(1.7e12, 1.8e12), unix_unit(0.0, 1.7e12)
    ('ms', None)
    """
    units = {"s": 1.0, **EPOCHS}
    return next((unit for unit, n in units.items() if UNIX[0] * n <= low and high < UNIX[1] * n), None)


def refuse_no_seconds(numbers: NDArray[np.float64], where: str, first_row: int = 0) -> None:
    """Raise RecordError for numbers that are no seconds.

    `numbers` (array of shape (n_rows,)). `where` (str): What they are, in words. `first_row` (int): Number of the
    first of them in its log.
    """
    # A single time, of a sample that just came, may be damaged: three are judged together.
    if len(numbers) < 3:
        return
    begins = f"{where} is {numbers[0]:.0f} in row {first_row}, and so on:"
    unit = unix_unit(float(numbers.min()), float(numbers.max()))
    if unit in EPOCHS:
        said = f"Say so with --time-format 'unix {unit}'"
        dates = f"Make dates of them with pandas.to_datetime(..., unit={unit!r})"
        raise RecordError(
            f"{begins} these are Unix times in {unit}, and numbers are taken as seconds. {way(said, dates)}."
        )
    if np.median(numbers) >= 1e10:  # 300 years are no seconds of a log; one damaged time does not move the median
        raise RecordError(
            f"{begins} no seconds, and no Unix times of this century. "
            f"{way('Say what they are with --time-format', 'Make dates, spans or seconds of them')}."
        )


def index_times(index: pd.Index) -> Times | None:
    """Times of an index; None for one without.

    Raises RecordError for an index of times of which some are missing or unreadable, naming the first.
    """
    if isinstance(index, pd.PeriodIndex):
        index = index.to_timestamp(how="start")
    kind = "text" if isinstance(index, pd.MultiIndex) else kind_of(index)
    if kind not in ("date", "span") and not (kind == "text" and len(index) and _is_date(index[0])):
        return None
    return times_from(index, "The index")


def _is_date(label: object) -> bool:
    """True if an index label is a date; digits are not."""
    if not isinstance(label, str | date):
        return False
    text = str(label).strip()
    return not text.isdigit() and not pd.isna(date_of_text(text))


def no_times_text(index: pd.Index | None) -> str:
    """Advice on an index without times, or ""."""
    if index is None or not len(index):
        return ""
    if isinstance(index, pd.MultiIndex):
        return f"The index has {index.nlevels} levels: make columns of them with X.reset_index(). "
    if kind_of(index) != "number":
        return (
            f"The index holds {quoted(index[0])} and so on, no dates in a form of ISO 8601: make dates of it with "
            "pandas.to_datetime, if they are some. "
        )
    numbers = index.to_numpy(dtype=float, na_value=np.nan)
    if (np.diff(numbers) == 1).all() and not numbers[0] % 1:
        return ""
    steps = np.diff(numbers)
    skips = (steps > 0).all() and not (numbers % 1).any() and np.median(steps) == 1
    missing = (
        f"It skips {steps.sum() - len(steps):.0f} numbers, and the rows around these are taken as neighbours: keep all "
        "rows, readings NaN where they are unknown, and do not shuffle folds. "
    )
    return (
        f"The index holds numbers, {numbers[0]:.10g} to {numbers[-1]:.10g}, which are not taken as times: if they are "
        "seconds, make a column of them, as with X.assign(seconds=X.index) and time='seconds'. "
        f"{missing if skips else ''}"
    )


_LETTERS = {"d": "D", "w": "W", "H": "h", "S": "s"}
"""Units of spans, of one letter, as they may be written and as every version of pandas has them."""
_BARE = re.compile(r"[+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?")
"""A number without a unit, which pandas would count in nanoseconds."""
_COMMA = re.compile(r"[0-9],[0-9]")
"""A decimal comma or one between thousands, which pandas would pass over: 1,5 h as 15 h."""
_UNIT_LETTER = re.compile(r"(?<![^\W\d_])[dwHSTLUN](?![^\W\d_])")
"""A unit of one letter that some version of pandas has warned of."""


_DAY_SPAN = re.compile(r"(?<![0-9.,:])[0-9]{4}(?:[0-9]{4})?(?![0-9])|[0-9][./-][0-9]")
"""What tells a date from a time of day: a year, or numbers with what parts days from months."""


def date_of(value: Any) -> Any:
    """A date as pandas reads it; NaT without a day."""
    if isinstance(value, str) and not _DAY_SPAN.search(value):
        return pd.NaT
    try:
        date = pd.Timestamp(value)
        date.as_unit("ns")  # or it is out of reach
        return date
    except (ValueError, TypeError):
        return pd.NaT


def span_of(value: Any) -> Any:
    """A time span as pandas reads it; NaT for none.

    Text without a unit ("60") is a number of seconds, as a number is. A comma inside a number is refused, for it may
    stand before decimals or between thousands. Units are days and weeks, hours and seconds in small letters and in
    capitals: which of them are out of use differs between versions of pandas.

    Raises ValueError or TypeError for what is no span.

    Examples
    --------
    >>> span_of("1 d 2 H").total_seconds()
    93600.0
    >>> span_of("60").total_seconds()
    60.0
    """
    if isinstance(value, str):
        if _COMMA.search(value):
            raise ValueError("a comma inside a number")
        if _BARE.fullmatch(value.strip()):
            return pd.Timedelta(float(value), unit="s")
    if isinstance(value, str) and not value.strip().lstrip("+-").startswith("P"):  # ISO 8601 has capitals of its own
        value = _UNIT_LETTER.sub(_known_unit, value)
    return pd.Timedelta(value)


def _known_unit(found: re.Match[str]) -> str:
    """A one-letter unit for every version of pandas."""
    if found[0] not in _LETTERS:
        raise ValueError(f"invalid unit abbreviation: {found[0]}")
    return _LETTERS[found[0]]


def seconds_of(value: Any, name: str) -> float:
    """A time span in seconds, of a number or text.

    Raises ValueError in the words of scikit-learn's parameter checks.

    Examples
    --------
    >>> seconds_of("15 min", "time_constant")
    900.0
    """
    if isinstance(value, int | float | np.number) and not isinstance(value, bool | np.timedelta64):
        seconds = float(value)
    else:
        try:
            seconds = span_of(value).total_seconds()
        except (ValueError, TypeError):
            seconds = float("nan")
    if not (np.isfinite(seconds) and seconds > 0):
        raise ValueError(
            f"The {name!r} parameter must be a positive time: seconds, or a span such as '15 min'. "
            f"Got {value!r} instead."
        )
    return seconds


Floats = NDArray[np.float64]
Rows = slice | NDArray[np.intp]
Kind = Literal["datetime", "datetime with time zone", "timedelta", "seconds", "rows"]
PerSecond = Annotated[int, Check(lambda n: n in (1, 1_000, 1_000_000, 1_000_000_000), "1, 1000, 1000000 or 1000000000")]
_NS = 1_000_000_000
EARLIEST, LATEST = -2_840_140_800 * _NS, 6_311_433_600 * _NS
"""Nanoseconds from 1970 between which all dates and spans lie, 1880 and 2170: no difference of two of them wraps."""
BEYOND = "Times may lie between 1880 and 2170, and spans may last 200 years. Is the date damaged?"
UNITS = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": _NS}
"""Ticks in a second, by the unit that pandas counts in."""
_CHUNK = 1 << 16
"""Times that are looked at together."""
_DAY = "(?:[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}|[0-9]{8})"
_CLOCK = "[T ][0-9]{2}(?::?[0-9]{2}(?::?[0-9]{2}(?:[.][0-9]+)?)?)?"
_ZONE = " ?(?:Z|[+-][0-9]{2}(?::?[0-9]{2})?)"
_MIDNIGHT = re.compile(r"(?<=[T ])24:00(?=(?::00(?:[.]0+)?)?(?:$|Z|[ +-]))")
"""The end of a day as 24:00, which ISO 8601 allowed until 2019."""
_ISO_8601 = f"{_DAY}(?:{_CLOCK}(?:{_ZONE})?)?"
_ZONED = f"{_DAY}{_CLOCK}{_ZONE}"


@dataclass(frozen=True)
class Times:
    """Time stamps of `n` rows, read block by block.

    ``ticks`` are integers (`per_second` of them in a second), floats in seconds, or None for rows that are
    `period` seconds apart, the first of them being row number `first_row` of its log.
    """

    n: Counted
    kind: Kind
    ticks: NDArray[Any] | None = None
    per_second: PerSecond = 1
    period: Positive = 1.0
    first_row: Counted = 0

    def since_1970(self, stamp: float) -> float | None:
        """Date of a stamp [s since 1970], or None."""
        if self.kind.startswith("datetime"):
            return stamp / 1e9
        return float(stamp) if self.kind == "seconds" and UNIX[0] <= stamp < UNIX[1] else None

    def steps(self, rows: Rows, before: int | None = None) -> Floats:
        """Steps to each of `rows` from the row before [s].

        Rows of a slice follow one another. Where it is known that all steps are alike, they are not looked at again.
        """
        if not isinstance(rows, slice) and not len(rows):
            return np.zeros(0)
        if self.ticks is not None and self.kind == "rows":
            numbers = self.ticks[rows]
            first = 1 if before is None else numbers[0] - self.ticks[before]
            return np.concatenate(([first], np.diff(numbers))) * self.period
        if self.ticks is None:
            count = rows.stop - rows.start if isinstance(rows, slice) else len(rows)
            steps = np.full(count, self.period)
            if not isinstance(rows, slice):
                steps[1:] = np.diff(rows) * self.period
            if before is not None:
                steps[0] = ((rows.start if isinstance(rows, slice) else int(rows[0])) - before) * self.period
            return steps
        ticks = self.ticks[rows]
        if not isinstance(rows, slice) or self.__dict__.get("_even_ticks") is None:
            steps = np.empty(len(ticks))
            np.divide(ticks[1:] - ticks[:-1], self.per_second, out=steps[1:])
        else:
            steps = np.full(len(ticks), self.even_step)
        steps[0] = 1.0 if before is None else (ticks[0].item() - self.ticks[before].item()) / self.per_second
        return steps

    @property
    def even_step(self) -> float | None:
        """The common step of all rows [s], or None."""
        return None if self._even_ticks is None else float(self._even_ticks / self.per_second)

    @cached_property
    def _even_ticks(self) -> Any:
        """The common step in ticks; then the ends are the extremes."""
        if self.ticks is None or self.kind == "rows" or self.n < 2:
            return None
        first, second, last = (self.ticks[k].item() for k in (0, 1, -1))
        step = second - first
        if not step > 0 or (isinstance(step, int) and last - first != step * (self.n - 1)):
            return None
        chunks = (self.ticks[start : start + _CHUNK + 1] for start in range(0, self.n - 1, _CHUNK))
        return step if all((np.diff(chunk) == step).all() for chunk in chunks) else None

    @cached_property
    def longest_between_rows(self) -> float:
        """The longest step between neighbouring rows [s].

        No look at rows one by one is needed where it is no gap.
        """
        if self.ticks is None:
            return self.period
        if self.kind == "rows" or self.n < 2:
            return np.inf
        if self.even_step is not None:
            return self.even_step
        chunks = (self.ticks[start : start + _CHUNK + 1] for start in range(0, self.n - 1, _CHUNK))
        return float(max(np.diff(chunk).max() for chunk in chunks) / self.per_second)

    def ends(self) -> NDArray[Any]:
        """Ticks that include the least and the greatest."""
        assert self.ticks is not None
        return self.ticks if self._even_ticks is None else self.ticks[[0, -1]]

    def step_of(self, rows: Rows) -> float | None:
        """The common step of some rows [s], or None."""
        if not isinstance(rows, slice):
            return None
        return self.period if self.ticks is None else self.even_step

    def seconds(self, rows: Rows, origin: float = 0) -> Floats:
        """Seconds since `origin`, a stamp."""
        if self.ticks is None:
            number = np.arange(rows.start, rows.stop) if isinstance(rows, slice) else rows
            return np.asarray((number + self.first_row - origin) * self.period, float)
        if self.kind == "rows":
            return np.asarray((self.ticks[rows] - origin) * self.period, float)
        if self.kind == "seconds":
            return np.asarray(self.ticks[rows] - origin, float)
        whole, rest = divmod(int(origin), _NS // self.per_second)
        return np.asarray((self.ticks[rows] - whole) / self.per_second - rest / _NS, float)

    def stamp(self, row: int) -> float:
        """Absolute time of a row: nanoseconds for dates, else seconds."""
        if self.ticks is None:
            return row + self.first_row
        if self.kind == "rows":
            return int(self.ticks[row])
        if self.kind == "seconds":
            return float(self.ticks[row])
        return int(self.ticks[row]) * (_NS // self.per_second)

    def stamps(self) -> NDArray[Any]:
        """Absolute times of all rows, as `stamp` has them, shape (n,)."""
        if self.ticks is None:
            return np.arange(self.first_row, self.first_row + self.n)
        ticks = np.asarray(self.ticks[:])
        return ticks if self.kind in ("rows", "seconds") else ticks * (_NS // self.per_second)

    def between(self, later: float, earlier: float) -> float:
        """Difference of two stamps [s]."""
        if self.kind == "rows":
            return (later - earlier) * self.period
        return (later - earlier) / (_NS if self.kind.startswith(("datetime", "timedelta")) else 1)

    def label(self, row: int) -> str:
        """A row's time as a person writes it."""
        if self.ticks is None:
            return f"{self.stamp(row) * self.period:.10g} s"
        if self.kind == "seconds":
            return f"{self.ticks[row]:.10g} s"
        if self.kind == "timedelta":
            return str(pd.Timedelta(int(self.stamp(row)), unit="ns"))
        return str(pd.Timestamp(int(self.stamp(row))))


def steps_back_an_hour(back: float, usual: float) -> bool:
    """True if local times repeat an hour at the end of summer time.

    `back`, `usual` (float): The step back, positive, and the usual step between rows [s].
    """
    # When summer time ends, clocks are put back by an hour, and by half an hour on Lord Howe Island.
    return any(
        back == hour - usual or (hour - 1.5 * usual <= back <= hour + 0.5 * usual and usual <= hour / 4)
        for hour in (3600.0, 1800.0)
        if back > 0
    )


def summer_time_text(row: int, time: object, before: object) -> str:
    """Message on local times that repeat an hour."""
    zoned = "times that have it, as by X.index.tz_localize('Europe/Berlin', ambiguous='infer')"
    return (
        f"Time goes backward at row {row}: {time} follows {before}, as local times do when summer time ends. If so, "
        f"name the zone: {way('--timezone Europe/Berlin', zoned)}. Sorting would mix two hours. If the log holds "
        f"several runs, name their column with {option('run')}."
    )


def times_from(values: pd.Index | pd.Series, where: str) -> Times:
    """Times of an index or column, dates as text included.

    Raises RecordError for missing or unreadable times, naming the first.
    """
    if isinstance(values, pd.DatetimeIndex | pd.TimedeltaIndex):
        return _times_of_index(values, where)
    if isinstance(values, pd.Index):
        values = values.to_series(index=pd.RangeIndex(len(values)))
    if values.ndim != 1:
        raise RecordError(f"{where} stands over {values.shape[1]} columns. Give columns unique names.")
    n = len(values)
    dtype: Any = values.dtype
    if isinstance(dtype, pd.ArrowDtype) and dtype.kind in "mM":
        values = pd.Series(pd.Index(values.array.__arrow_array__().to_pandas()))
        dtype = values.dtype
    if pd.api.types.is_bool_dtype(dtype):
        raise RecordError(f"{where} holds true/false where times are needed. Give dates, time spans or seconds.")
    if kind_of(values) == "number":
        seconds = values.to_numpy(dtype=float, na_value=np.nan)
        _refuse_missing(~np.isfinite(seconds), where)
        return Times(n, "seconds", seconds_within_range(seconds, where))
    if not (pd.api.types.is_datetime64_any_dtype(dtype) or pd.api.types.is_timedelta64_dtype(dtype)):
        values = _parse(values, where)
        dtype = values.dtype
    _refuse_missing(values.isna().to_numpy(), where)
    kind: Kind = "timedelta" if pd.api.types.is_timedelta64_dtype(dtype) else "datetime"
    if isinstance(dtype, pd.DatetimeTZDtype):
        kind = "datetime with time zone"
        values = values.dt.tz_convert("UTC").dt.tz_localize(None)
    ticks = values.to_numpy()
    per_second = UNITS[np.datetime_data(ticks.dtype)[0]]
    return Times(n, kind, within_range(ticks.view("i8"), per_second, where), per_second)


def _times_of_index(index: pd.DatetimeIndex | pd.TimedeltaIndex, where: str) -> Times:
    """Times of an index of dates or spans, without a copy."""
    ticks = index.asi8
    kind: Kind = "timedelta"
    if isinstance(index, pd.DatetimeIndex):
        kind = "datetime" if index.tz is None else "datetime with time zone"
    times = Times(len(index), kind, ticks, UNITS[index.unit])
    ends = times.ends()
    if len(ends) and ends.min() == pd.NaT.value:
        _refuse_missing(np.asarray(index.isna()), where)
    within_range(ticks, times.per_second, where, ends=ends)
    return times


def within_range(
    ticks: NDArray[Any], per_second: int, where: str, first_row: int = 0, ends: NDArray[Any] | None = None
) -> NDArray[Any]:
    """The ticks; RecordError for dates out of range."""
    ends = ticks if ends is None else ends
    low, high = (limit // (_NS // per_second) for limit in (EARLIEST, LATEST))
    if len(ends) and (ends.max() > high or ends.min() < low):
        row = int(np.argmax((ticks > high) | (ticks < low)))
        date = np.datetime64(int(ticks[row]) // per_second, "s")
        raise RecordError(f"{where} is {date} in row {first_row + row}. {BEYOND}")
    return ticks


def seconds_within_range(seconds: Floats, where: str, first_row: int = 0) -> Floats:
    """The times; RecordError for seconds out of range.

    And for numbers that are Unix times in another unit.
    """
    if len(seconds) and np.abs(seconds).max() > LARGEST:
        row = int(np.argmax(np.abs(seconds) > LARGEST))
        raise RecordError(f"{where} is {seconds[row]:g} s in row {first_row + row}. Is the time damaged?")
    refuse_no_seconds(seconds, where, first_row)
    return seconds


def _refuse_missing(missing: NDArray[np.bool_], where: str) -> None:
    if missing.any():
        raise RecordError(
            f"{where} has no time in {missing.sum()} of {len(missing)} rows, the first is row {missing.argmax()}. "
            "Every row needs its time: drop these rows or fill their times."
        )


def _parse(values: pd.Series[Any], where: str) -> pd.Series[Any]:
    """Text to dates in UTC."""
    known = () if isinstance(values.dtype, pd.StringDtype) else values
    for row, value in enumerate(known):  # pandas would make text of anything
        if isinstance(value, bytes | list | dict | tuple | np.ndarray):
            raise RecordError(f"{where} holds a {type(value).__name__} in row {row}. Give dates, spans or seconds.")
    text = values.astype("string")
    text = text.str.strip()
    if len(values) and all(pd.to_numeric(part, errors="coerce").notna().all() for part in (text.iloc[:1], text)):
        raise RecordError(
            f"{where} holds numbers written as text, such as {values.iloc[0]!r}. Convert it to float (seconds) first."
        )
    parsed = _parse_dates(text)
    bad = (parsed.isna() & text.notna()).to_numpy()
    if bad.any():
        row = int(bad.argmax())
        command = "say another form with --time-format, or pass over damaged rows with --skip-bad-rows"
        python = "pandas.to_datetime(..., format=...)"
        raise RecordError(
            f"{where} cannot be read as a time in row {row}: {values.iloc[row]!r}. Write dates as "
            f"2024-05-31T14:00:00, or seconds as numbers; {way(command, 'say another form with ' + python)}."
        )
    return parsed


def _parse_dates(text: pd.Series[Any]) -> pd.Series[Any]:
    """Dates of ISO 8601 text; NaT for others.

    Raises RecordError where only some have a zone.
    """
    late = text.str.contains(_MIDNIGHT, na=False)
    text = text.str.replace(_MIDNIGHT, "00:00", regex=True) if late.any() else text
    whole = text.str.fullmatch(_ISO_8601, na=False)
    zoned = text.str.fullmatch(_ZONED, na=False)
    if (zoned != whole).any() and zoned.any():
        row = int((whole & ~zoned).to_numpy().argmax())
        raise RecordError(
            f"Some times have a zone and others none, the first in row {row}: {text.iloc[row]!r}. Write all with a "
            "zone, or all without."
        )
    dates = pd.to_datetime(text.where(whole), errors="coerce", format="ISO8601", utc=bool(zoned.any()))
    return dates + pd.to_timedelta(late.astype(int), unit="D") if late.any() else dates


def date_of_text(text: str) -> Any:
    """One date as a column reads it; NaT for others."""
    parsed = _parse_dates(pd.Series([text], dtype="string"))
    return parsed.iloc[0]
