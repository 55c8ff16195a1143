"""Times of a stream as numbers; a mean that follows."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ..records import History, RecordError, seconds_of
from ..records.times import BEYOND, EARLIEST, LATEST, Times, date_of_text, span_of
from ..records.types import LARGEST

_NS = 1_000_000_000
_EPOCH, _EPOCH_UTC = datetime(1970, 1, 1), datetime(1970, 1, 1, tzinfo=UTC)
_ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?(Z|[+-]\d\d:\d\d)?", re.ASCII)
"""The usual form, which `pandas.Timestamp` reads as `pandas.to_datetime(..., format="ISO8601")` does, but faster."""


class Clock:
    """Stamps of one kind of time, see `Times.stamp`."""

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
        """Stamps of many times, or of `next_rows`."""
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
            return self._within_range(
                (time - (_EPOCH_UTC if zoned else _EPOCH)) // timedelta(microseconds=1) * 1000, time
            )
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


class Tracker:
    """Exponential mean: ``u += (1 - exp(-dt/tau)) (value - u)``.

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
        """The mean after a value; untrusted ones change nothing."""
        if trusted:
            if self.last is not None and seconds > self.last:
                self.value -= math.expm1((self.last - seconds) / self.time_constant) * (value - self.value)
            self.last = seconds
        return self.value

    def many(self, seconds: np.ndarray, values: np.ndarray, trusted: np.ndarray) -> np.ndarray:
        """The mean after each of many values, shape (n,)."""
        rows = zip(seconds.tolist(), values.tolist(), trusted.tolist(), strict=True)
        return np.array([self.one(*row) for row in rows], float)
