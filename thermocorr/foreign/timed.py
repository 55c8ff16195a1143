"""The column of times of a log that was read: dates and times of day joined, every way of writing them understood."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import quoted
from ..records.files import TIME_NAMES, require_column
from ..records.times import dates_once, steps_back_an_hour, summer_time_text
from ..records.types import kind_of
from ..records.units import name_and_unit, unit_of
from .clocks import SPANS, Understood, understood
from .how import ForeignTable, HowToRead
from .values import first_cell, is_moment

DATES = ("date", "datum", "day", "tag")
UNITS_IN_NAMES = {
    "ms": "ms", "millis": "ms", "milliseconds": "ms", "us": "us", "micros": "us", "min": "min", "mins": "min",
    "minute": "min", "minutes": "min", "minuten": "min", "h": "h", "hr": "h", "hrs": "h", "hour": "h", "hours": "h",
    "stunden": "h", "heures": "h", "horas": "h", "d": "d", "days": "d", "tage": "d", "jours": "d", "dias": "d",
}  # fmt: skip
"""Last word of the name of a column of times, in small letters -> their unit; another column's may mean anything."""
CLOCKS = ("time", "clock", "zeit", "uhrzeit", "time of day", "heure", "hora")
"""Names, in small letters, of columns of dates and of times of day."""


def with_times(table: ForeignTable, column: str | None, how: HowToRead) -> ForeignTable:
    """The log with its times as dates, spans or seconds; text in the forms of ISO 8601 stays as it came.

    `table` (ForeignTable). `column` (str, optional): The column of times; without one only `HowToRead.sort` could be
    asked for, which needs one. `how` (HowToRead). Raises RecordError for times that can be read in two ways, and
    those that cannot be read.
    """
    if column is None:
        if how.time_format or how.timezone or how.sort:
            raise RecordError("--time-format, --timezone and --sort are for a column of times. Name it with --time.")
        return table
    frame, words = _joined(table.frame, column)
    read = in_seconds(frame, column) if how.names_times() else None
    read = read or understood(frame[column], how.time_format, how.timezone)
    if read.times is not frame[column]:
        by_size = read.unix and how.names_times()
        as_came = frame[column] if by_size or kind_of(read.times) in ("number", "span") else None
        table, frame = replace(table, as_came=as_came), frame.assign(**{column: read.times})
    table = table.with_said(frame, words, read.said)
    return _sorted(table, column) if how.sort else table


def time_column(names: Iterable[Any], named: str | None, how: HowToRead) -> str | None:
    """The column of times: as named, or called like one and nothing else by the user; None where there is none."""
    try:
        return require_column(names, named, "time", TIME_NAMES, how.no_times)
    except RecordError:
        return None


def in_seconds(frame: pd.DataFrame, column: str) -> Understood | None:
    """Times that are numbers of a unit that the file names, other than seconds; None for any others.

    Raises RecordError for dates and times of day that are whole numbers in two columns.
    """
    if kind_of(frame[column]) != "number":
        return None
    dates = [name for name in frame.columns if _plain_name(name) in DATES and name != column]
    if _plain_name(column) in CLOCKS and any(_is_yyyymmdd(frame[name]) for name in dates):
        raise RecordError(
            f"{quoted(dates[0])} and {quoted(column)} look like a date and a time of day in whole numbers. Write them "
            "in one column, as 2024-05-31T14:00:00, or say --time-format for one that has both."
        )
    unit = unit_of_times(column, frame.attrs.get("units", {}))
    return Understood(frame[column].astype(float) * SPANS[unit], f"times in {unit}") if unit else None


def unit_of_times(column: str, units: Mapping[str, str]) -> str:
    """The unit of times that are numbers, one of `SPANS`; "" for seconds, and where nobody says it.

    `column` (str): Name of the times, which may end with their unit: ``time_ms``, ``elapsed hours``, ``Stunden``.
    `units` (mapping): Units that the file gives elsewhere, by names of columns.
    """
    unit = units.get(column) or unit_of(column, None) or _unit_in_name(column)
    return unit if unit in SPANS and unit != "s" else ""


def _unit_in_name(column: str) -> str:
    """The unit of time that a name ends with in a word; "" for none."""
    return UNITS_IN_NAMES.get(re.split(r"[\s_.(\[/]+", _plain_name(column))[-1], "")


def _is_yyyymmdd(values: pd.Series[Any]) -> bool:
    return kind_of(values) == "number" and bool(values.between(19_700_101, 21_001_231).all())


def _joined(frame: pd.DataFrame, column: str) -> tuple[pd.DataFrame, str]:
    """Dates in one column and times of day in another become one, under the name of the times."""
    pair = date_and_clock(frame, column)
    if pair is None:
        return frame, ""
    dates, clocks = pair
    together = frame[dates].astype("string").str.strip() + " " + frame[clocks].astype("string").str.strip()
    other = clocks if dates == column else dates
    rest = frame.drop(columns=[other]).assign(**{column: together.astype(object)})
    return rest, f"{quoted(dates)} and {quoted(clocks)} joined"


def date_and_clock(frame: pd.DataFrame, column: str) -> tuple[str, str] | None:
    """The columns of dates and of times of day, of which one is `column`; None where that has both, or neither."""
    if kind_of(frame[column]) != "text":
        return None
    cell = first_cell(frame[column])
    if not is_moment(cell):
        return None
    clock_only, date_only = ":" in cell and not _has_date(cell), ":" not in cell
    wanted = DATES if clock_only else CLOCKS if date_only else ()
    other = next((name for name in frame.columns if _plain_name(name) in wanted and name != column), None)
    if other is None or kind_of(frame[other]) != "text" or not is_moment(first_cell(frame[other])):
        return None
    return (str(other), column) if clock_only else (column, str(other))


def _has_date(cell: str) -> bool:
    return any(mark in cell.split(":")[0] for mark in "/-.") or " " in cell.split(":")[0].strip()


def _plain_name(name: object) -> str:
    return name_and_unit(str(name))[0].strip().lower()


def _sorted(table: ForeignTable, column: str) -> ForeignTable:
    times = dates_once(table.frame[column])
    if kind_of(times) == "text":  # the record says what is wrong with it
        return table
    _refuse_summer_time(times)
    order = np.argsort(times.to_numpy(), kind="stable")
    moved = int((order != np.arange(len(order))).sum())
    if not moved:
        return table
    if table.as_came is not None:
        table = replace(table, as_came=table.as_came.iloc[order].reset_index(drop=True))
    return table.with_said(table.frame.iloc[order].reset_index(drop=True), f"sorted by time: {moved} rows moved")


def _refuse_summer_time(times: pd.Series[Any]) -> None:
    """Refuse to sort local times whose only steps back are those of the end of summer time: two hours would mix."""
    if not pd.api.types.is_datetime64_dtype(times.dtype) or times.isna().any():
        return
    steps = times.diff().dt.total_seconds().to_numpy()[1:]
    back, usual = np.flatnonzero(steps < 0), float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if len(back) and all(_is_put_back(times, k + 1, -steps[k], usual) for k in back.tolist()):
        row = int(back[0]) + 1
        raise RecordError(summer_time_text(row, times.iloc[row], times.iloc[row - 1]))


def _is_put_back(times: pd.Series[Any], row: int, back: float, usual: float) -> bool:
    """Whether a row steps back by an hour and those behind it go on, not one or a few that came late."""
    ahead = times.iloc[row:].to_numpy()
    behind = ahead > times.iloc[row - 1].to_datetime64()
    last = int(behind.argmax()) - 1 if behind.any() else 0
    jump = (ahead[last + 1] - ahead[last]) / np.timedelta64(1, "s") if behind.any() else 0.0
    return steps_back_an_hour(back, usual) and jump <= back / 2
