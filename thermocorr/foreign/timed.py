"""The column of times of a log that was read: dates and times of day joined, every way of writing them understood."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import quoted, times_word
from ..records.times import dates_once, steps_back_an_hour, summer_time_text
from ..records.types import kind_of
from ..records.units import unit_of
from .clocks import SPANS, Understood, clocks_of_digits, understood
from .how import ForeignTable, HowToRead
from .roles import bare_name, zone_in_name
from .values import first_cell, is_moment

DATES = ("date", "datum", "day", "tag")
UNITS_IN_NAMES = {
    word: unit
    for unit, words in {
        "ms": "ms msec msecs millis millisecond milliseconds millisekunden", "ns": "ns nanoseconds",
        "us": "us usec micros microseconds", "min": "min mins mn minute minutes minuten minutos",
        "h": "h hr hrs hh hour hours stunden std heures horas", "d": "d day days tage jours dias doy",
        "s": "s sec secs second seconds sekunden secondes segundos",
    }.items()
    for word in words.split()
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
        if how.time_format or how.timezone or how.sort or how.drop_duplicates:
            raise RecordError(
                "--time-format, --timezone and --skip-bad-rows are for a column of times: name it with --time."
            )
        return table
    frame, words = _joined(table.frame, column)
    read = in_seconds(frame, column) if how.names_times() else None
    read = read or understood(frame[column], how.time_format, how.timezone)
    read = read if how.timezone else _in_named_zone(read, column)
    frame, read = _with_fraction(frame, read, column)
    frame, read = _with_days(frame, read, column)
    if read.times is not frame[column]:
        by_size = read.unix and how.names_times()
        as_came = frame[column] if by_size or kind_of(read.times) in ("number", "span") else None
        table, frame = replace(table, as_came=as_came), frame.assign(**{column: read.times})
    table = table.with_said(frame, words, read.said)
    table = _sorted(table, column) if how.sort else table
    return _once_each(table, column, how.run) if how.drop_duplicates else table


DAY_NUMBERS = ("day", "tag", "doy", "jday", "day of year", "day_of_year")
"""Names of columns that number the days of times of day, in small letters."""


def _with_days(frame: pd.DataFrame, read: Understood, column: str) -> tuple[pd.DataFrame, Understood]:
    """Times of day with the numbers of their days, which stand in a column of their own."""
    name = next((n for n in frame.columns if bare_name(n) in DAY_NUMBERS and n != column), None)
    if name is None or kind_of(read.times) != "span" or kind_of(frame[name]) != "number":
        return frame, read
    days = frame[name].astype(float)
    steps = days.diff().iloc[1:]
    if not ((steps >= 0) & (steps % 1 == 0)).all() or not (steps > 0).any():
        return frame, read
    of_day = read.times.dt.total_seconds() % 86_400.0
    times = pd.to_timedelta(((days - days.iloc[0]) * 86_400.0 + of_day) * 1e9, unit="ns")
    return frame.drop(columns=[name]), Understood(times, f"times of day with the days of {quoted(name)}")


FRACTIONS = {"fractional seconds": 1.0, "fraction": 1.0, "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3}
"""Names of columns of parts of a second, in small letters, and what one is [s]."""


def _with_fraction(frame: pd.DataFrame, read: Understood, column: str) -> tuple[pd.DataFrame, Understood]:
    """Dates to the second with the fractions that stand in a column of their own."""
    name = next((n for n in frame.columns if bare_name(n) in FRACTIONS and n != column), None)
    times = None if name is None else dates_once(read.times)
    if times is None or kind_of(times) not in ("date", "span") or kind_of(frame[name]) != "number":
        return frame, read
    part = frame[name].astype(float) * FRACTIONS[bare_name(name)]
    whole = times.dt.microseconds if kind_of(times) == "span" else times.dt.microsecond
    if not part.between(0, 1, inclusive="left").all() or (whole != 0).any() or part.nunique() < 2:
        return frame, read
    added = times + pd.to_timedelta((part * 1e9).round(), unit="ns")
    return frame.drop(columns=[name]), Understood(added, ", ".join(filter(None, (read.said, f"with {quoted(name)}"))))


def _once_each(table: ForeignTable, column: str, run: str | None) -> ForeignTable:
    """The log without rows whose time stands in a row before, of the same run."""
    keys = pd.DataFrame({"time": dates_once(table.frame[column]), "run": table.frame[run] if run else 0})
    again = keys.duplicated().to_numpy()
    if not again.any():
        return table
    came = table.as_came
    table = replace(table, first_line=None, as_came=None if came is None else came[~again].reset_index(drop=True))
    words = f"{times_word(int(again.sum()), 'row')} with the time of one before left out"
    return table.with_said(table.frame[~again].reset_index(drop=True), words)


def _in_named_zone(read: Understood, column: str) -> Understood:
    """Dates without a zone in the one that the name of their column gives, as UTC."""
    zone = zone_in_name(column)
    times = dates_once(read.times) if zone else read.times
    if not zone or not pd.api.types.is_datetime64_dtype(times.dtype):
        return read
    offset = pd.Timedelta(f"{zone[1:]}:00") * (-1 if zone[0] == "-" else 1)
    words = f"times of UTC{'' if zone == '+00:00' else zone}"
    return Understood((times - offset).dt.tz_localize("UTC"), ", ".join(filter(None, (read.said, words))))


def in_seconds(frame: pd.DataFrame, column: str) -> Understood | None:
    """Times that are numbers of a unit that the file names, other than seconds; None for any others.

    Raises RecordError for a unit that is not known, and for numbers where another column has dates.
    """
    if kind_of(frame[column]) != "number":
        return None
    said = _said_unit(column, frame.attrs.get("units", {}))
    if said and said not in SPANS and said.lower() not in UNITS_IN_NAMES and _unit_in_name(column) == "":
        raise RecordError(
            f"{quoted(column)} has numbers, and {said!r} is no unit of time that is known. Say what they are with "
            "--time-format, such as --time-format seconds."
        )
    dates = next((n for n in frame.columns if n != column and bare_name(n) in DATES and _is_date(frame[n])), None)
    if dates is not None:
        raise RecordError(
            f"{quoted(dates)} has dates, and {quoted(column)} numbers that are no times of day such as 2340. Write "
            f"both in one column, as 2024-05-31T14:00:00, or say --time {shlex.quote(str(dates))} or --time-format "
            "seconds."
        )
    unit = unit_of_times(column, frame.attrs.get("units", {}))
    return Understood(frame[column].astype(float) * SPANS[unit], f"times in {unit}") if unit else None


def unit_of_times(column: str, units: Mapping[str, str]) -> str:
    """The unit of times that are numbers, one of `SPANS`; "" for seconds, and where nobody says it.

    `column` (str): Name of the times, which may end with their unit: ``time_ms``, ``elapsed hours``, ``Stunden``.
    `units` (mapping): Units that the file gives elsewhere, by names of columns.
    """
    said = _said_unit(column, units)
    unit = said if said in SPANS else UNITS_IN_NAMES.get(said.lower().rstrip(".")) or _unit_in_name(column)
    return unit if unit in SPANS and unit != "s" else ""


def _said_unit(column: str, units: Mapping[str, str]) -> str:
    """Text in the place of a unit of times: below the name, or in brackets at its end; no zone, and no form."""
    inside = re.fullmatch(r".*[\[(<]([^\[\]()<>]*)[\])>]\s*", column)
    said = units.get(column) or unit_of(column, None) or (inside[1].strip() if inside else "")
    return "" if _NO_UNIT.search(said) else said


_NO_UNIT = re.compile(r"UTC|GMT|local|[A-Z]{3,4}$|[dDmMyYhHsS]+[-/.: ][dDmMyYhHsS]|hhmm|^TS$|^[A-Z][a-z]+/[A-Z]")
"""What brackets behind the name of times may say that is no unit: a zone, or how they are written."""


def _unit_in_name(column: str) -> str:
    """The unit of time that a name ends with in a word; "" for none."""
    words = [word for word in re.split(r"[\s_.(\[/]+", bare_name(column)) if word]
    return UNITS_IN_NAMES.get(words[-1], "") if words else ""


def _joined(frame: pd.DataFrame, column: str) -> tuple[pd.DataFrame, str]:
    """Dates, times of day and halves of the day in columns of their own become one, under the name of the times."""
    parted = _with_half(_in_text(frame, column), column)
    pair = date_and_clock(parted.frame, column)
    if pair is None:
        if parted.half is None:
            return frame, ""
        return parted.frame.drop(columns=[parted.half]), f"{quoted(column)} and {quoted(parted.half)} joined"
    dates, clocks = pair
    cells = [parted.frame[name].astype("string").str.strip() for name in pair]
    cells[0] = cells[0].str.replace(_MIDNIGHT, "", regex=True)
    other = [name for name in (dates, clocks, parted.half) if name not in (column, None)]
    rest = frame.drop(columns=other).assign(**{column: (cells[0] + " " + cells[1]).astype(object)})
    half = "" if parted.half is None else f" and {quoted(parted.half)}"
    return rest, f"{quoted(dates)}{',' if half else ' and'} {quoted(clocks)}{half} joined"


class _Parted(NamedTuple):
    frame: pd.DataFrame
    half: str | None = None
    """The column that says AM or PM."""


def _in_text(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    """The frame with dates such as 20240531 and times of day such as 2340, side by side in numbers, as text."""
    dates = next((n for n in frame.columns if bare_name(n) in DATES and (n == column or _is_date(frame[n]))), None)
    clocks = next((n for n in frame.columns if bare_name(n) in (*CLOCKS, "hhmm") and n != dates), None)
    if dates is None or clocks is None or column not in (dates, clocks) or kind_of(frame[clocks]) != "number":
        return frame
    shown = clocks_of_digits(frame[clocks])
    if shown is None or not _is_date(frame[dates]):
        return frame
    if kind_of(frame[dates]) == "number":
        days = frame[dates].astype("int64").astype("string")
        frame = frame.assign(**{dates: (days.str[:4] + "-" + days.str[4:6] + "-" + days.str[6:]).astype(object)})
    return frame.assign(**{clocks: shown})


def _is_date(values: pd.Series[Any]) -> bool:
    """True if a column has dates, in text or as numbers such as 20240531."""
    if kind_of(values) == "number":
        return bool(values.between(19_700_101, 21_001_231).all())
    return kind_of(values) == "text" and is_moment(first_cell(values))


def _with_half(frame: pd.DataFrame, column: str) -> _Parted:
    """The frame with AM and PM, of a column of their own, behind the times of day that need them."""
    half = next((name for name in frame.columns if kind_of(frame[name]) == "text" and _is_half(frame[name])), None)
    pair = date_and_clock(frame, column) or (column, column)
    clocks = frame[pair[1]]
    hours = clocks.astype("string").str.extract(r"(\d{1,2}):\d\d")[0] if half and kind_of(clocks) == "text" else None
    if half is None or hours is None or hours.isna().any() or (hours.astype(int) > 12).any():
        return _Parted(frame)
    text = clocks.astype("string").str.strip() + " " + frame[half].astype("string").str.strip()
    return _Parted(frame.assign(**{pair[1]: text.astype(object)}), str(half))


def _is_half(values: pd.Series[Any]) -> bool:
    halves = values.astype("string").str.strip().str.fullmatch(r"[AaPp]\.?\s?[Mm]\.?")
    return len(values) > 0 and bool(halves.fillna(False).all())


def date_and_clock(frame: pd.DataFrame, column: str) -> tuple[str, str] | None:
    """The columns of dates and of times of day, of which one is `column`; None where that has both, or neither."""
    if kind_of(frame[column]) != "text":
        return None
    cell = first_cell(frame[column])
    if not is_moment(cell):
        return None
    clock_only, date_only = ":" in cell and not _has_date(cell), ":" not in cell
    if not (clock_only or date_only):
        return None
    wanted = DATES if clock_only else CLOCKS
    fits = [name for name in frame.columns if name != column and _is_part(frame[name], ":" if date_only else "")]
    other = next((name for name in fits if bare_name(name) in wanted), fits[0] if len(fits) == 1 else None)
    if other is None:
        return None
    return (str(other), column) if clock_only else (column, str(other))


_MIDNIGHT = re.compile(r"[ T]00:00(?::00(?:[.]0+)?)?$")


def _is_part(values: pd.Series[Any], mark: str) -> bool:
    """True if a column has times of day alone (`mark` ":"), or dates alone ("")."""
    cell = first_cell(values) if kind_of(values) == "text" else ""
    if not mark and _MIDNIGHT.search(cell):  # dates with a time of day that is always midnight
        return bool(values.astype("string").str.strip().str.contains(_MIDNIGHT).fillna(True).all())
    return is_moment(cell) and ((":" in cell and not _has_date(cell)) if mark else ":" not in cell)


def _has_date(cell: str) -> bool:
    return any(mark in cell.split(":")[0] for mark in "/-.") or " " in cell.split(":")[0].strip()


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
    """True if a row steps back by an hour and those behind it go on, not one or a few that came late."""
    ahead = times.iloc[row:].to_numpy()
    behind = ahead > times.iloc[row - 1].to_datetime64()
    last = int(behind.argmax()) - 1 if behind.any() else 0
    jump = (ahead[last + 1] - ahead[last]) / np.timedelta64(1, "s") if behind.any() else 0.0
    return steps_back_an_hour(back, usual) and jump <= back / 2
