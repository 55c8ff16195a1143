"""Times as other programs write them: dates, zones, clocks next to dates."""

from __future__ import annotations

import re
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import quoted
from ..records.times import BEYOND, EPOCHS, LARGEST_SECONDS, UNIX, dates_once, unix_unit
from ..records.types import kind_of
from .values import CLOCK, DAYS, ELAPSED, first_cell, is_number

PUT_BACK = 15 * 60 * 10**9
"""Least step back where clocks are put back [ns]; a smaller one is a correction of the clock."""


def in_zone(times: pd.Series[Any], zone: str) -> pd.Series[Any]:
    """Local times as UTC; the hour that comes twice is told apart by the order of the rows.

    Raises RecordError for a zone that is not known, times with a zone of their own, and times that no clock showed.
    """
    try:
        ZoneInfo(zone)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise RecordError(
            f"--timezone {zone!r} is not known. Zones are called Europe/Berlin, America/New_York, UTC."
        ) from None
    if not pd.api.types.is_datetime64_any_dtype(times.dtype):
        times = _dates_in_zone(times, zone)
    if isinstance(times.dtype, pd.DatetimeTZDtype):
        raise RecordError(f"The times have a zone of their own already: leave out --timezone {zone}.")
    again = _second_time(times, zone)
    try:
        local = times.dt.tz_localize(zone, ambiguous=again, nonexistent="NaT")
    except ValueError as error:  # pragma: no cover - what pandas may find beyond
        raise RecordError(f"--timezone {zone}: {' '.join(str(error).split())}.") from None
    bad = local.isna().to_numpy() & times.notna().to_numpy()
    if bad.any():
        row = int(bad.argmax())
        raise RecordError(
            f"No clock in {zone} showed {times.iloc[row]} (row {row}): summer time began then, and an hour is left "
            "out. Is the logger set to another zone, or to winter time all the year?"
        )
    result: pd.Series[Any] = local.dt.tz_convert("UTC")
    return result


def _dates_in_zone(times: pd.Series[Any], zone: str) -> pd.Series[Any]:
    read = dates_once(times)
    if kind_of(read) != "date":
        raise RecordError(f"--timezone {zone} is for dates: these times are none, or not all of them.")
    return read


def _second_time(times: pd.Series[Any], zone: str) -> np.ndarray:
    """True if each time is the first that the clock showed it (summer time), shape (n,).

    Within the hour that comes twice, rows before a step back are the first time, rows behind it the second. A record
    that begins within the hour and goes on behind it began the second time, one that ends within it the first.
    """
    values = times.to_numpy(dtype="datetime64[ns]").astype(np.int64)
    early, late = (
        times.dt.tz_localize(zone, ambiguous=np.full(len(times), first), nonexistent="shift_forward")
        for first in (True, False)
    )
    doubtful = (early != late).to_numpy()
    summer = np.ones(len(times), bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], doubtful, [False])).astype(int)))
    for start, stop in edges.reshape(-1, 2).tolist():
        steps = np.diff(values[start:stop])
        sparse = np.median(np.abs(np.diff(values))) >= PUT_BACK
        back = np.flatnonzero(steps <= (0 if sparse else -PUT_BACK))
        if len(back):
            summer[start + back[0] + 1 : stop] = False
        elif start == 0 and stop < len(times):
            summer[start:stop] = False
        elif start and stop < len(times):
            raise RecordError(
                f"The clock in {zone} showed {times.iloc[start]} (row {start}) twice, when summer time ended, and the "
                "rows around it do not tell which it was: none steps back. Log in UTC, or leave these rows out."
            )
    return summer


FAR = 10.0
"""A step longer than this many usual steps breaks the log."""
DAYS_OF_EXCEL = (25_569.0, 55_000.0)
"""Serial numbers of 1970 and 2050 in a spreadsheet, whose day 0 is 1899-12-30. Modified Julian days are more by now."""
DAY_ZERO = {"excel": 25_569.0, "matlab": 719_529.0, "mjd": 40_587.0, "jd": 2_440_587.5}
"""Forms of times that are numbers of days -> the number of 1970-01-01."""
DAY_WORDS = {"excel": "a spreadsheet", "matlab": "MATLAB", "mjd": "modified Julian dates", "jd": "Julian dates"}
DAYS_OF_MATLAB = (719_529.0, 748_750.0)
"""Day numbers of 1970 and 2050 in MATLAB, whose day 1 is the first of the year 0."""
_SECONDS = ("s", "sec", "second", "seconds", "elapsed")
_DATED = ("date", "datum", "timestamp", "datetime")
"""Words in the names of columns that hold seconds, and of those that hold dates."""
LABVIEW = 2_082_844_800.0
"""Seconds from 1904, from which LabVIEW counts, to 1970."""
SPANS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86_400.0, "s": 1.0}
"""Unit of a column of times -> its seconds."""

_DATES = {
    r"\d{1,2}\.\d{1,2}\.\d{4}": ("%d.%m.%Y",),
    r"\d{1,2}\.\d{1,2}\.\d{2}": ("%d.%m.%y",),
    r"\d{1,2}/\d{1,2}/\d{4}": ("%d/%m/%Y", "%m/%d/%Y"),
    r"\d{1,2}/\d{1,2}/\d{2}": ("%d/%m/%y", "%m/%d/%y", "%y/%m/%d"),
    r"\d{2}-\d{2}-\d{2}": ("%d-%m-%y", "%m-%d-%y", "%y-%m-%d"),
    r"\d{1,2}-\d{1,2}-\d{4}": ("%d-%m-%Y", "%m-%d-%Y"),
    r"\d{4}/\d{1,2}/\d{1,2}": ("%Y/%m/%d",),
    r"\d{4}\.\d{1,2}\.\d{1,2}": ("%Y.%m.%d",),
    r"\d{4}-\d{1,2}-\d{1,2}": ("%Y-%m-%d",),
    r"\d{1,2}-[A-Za-z]{3}-\d{4}": ("%d-%b-%Y",),
    r"\d{1,2}-[A-Za-z]{3}-\d{2}": ("%d-%b-%y",),
    r"\d{1,2} [A-Za-z]{3} \d{4}": ("%d %b %Y",),
    r"[A-Za-z]{3} \d{1,2},? \d{4}": ("%b %d %Y",),
    r"[A-Za-z]{3},? \d{1,2}[./]\d{1,2}[./]\d{4}": ("%a %d/%m/%Y", "%a %m/%d/%Y", "%a %d.%m.%Y"),
    r"[A-Za-z]{3},? \d{1,2} [A-Za-z]{3} \d{4}": ("%a %d %b %Y",),
}
"""How dates look, and which formats may be meant, of `strptime`."""
_COMMA = re.compile(r"(:\d\d),(\d)")
BEHIND_TIMES = re.compile(r"\s*(?:UTC|GMT)\s*$")
"""What may stand behind a time: it is UTC."""
_IN_WORDS = {"%d": "day", "%m": "month", "%Y": "year", "%y": "year", "%b": "month"}


class Understood(NamedTuple):
    """Times, and in words how they were read; nothing where there was nothing to understand."""

    times: pd.Series[Any]
    said: str = ""
    unix: bool = False
    """True if they are Unix times, which are UTC."""


def understood(values: pd.Series[Any], form: str | None = None, zone: str | None = None) -> Understood:
    """Times of a column as dates, spans or seconds.

    `values` (Series of shape (n,)): Text, numbers or dates. `form` (str, optional): A format of `strptime`, or
    "excel", "matlab", "mjd", "jd", "labview", "unix", "unix ms", "unix us", "unix ns", "hhmm", "seconds". `zone` (str,
    optional): Time zone of local times, such as "Europe/Berlin": they become UTC. Raises RecordError for dates that
    have two readings, and those that have none.
    """
    if kind_of(values) == "other":
        raise RecordError(f"{quoted(values.name)} holds lists, no times. Name another column.")
    if kind_of(values) == "text" and is_number(first_cell(values)):
        text: Any = values.astype("string").str.strip()
        numbers = pd.to_numeric(text, errors="coerce")
        if numbers.notna().all() and len(values):
            values = numbers.astype(float)
    if kind_of(values) == "text" and form is None and BEHIND_TIMES.search(first_cell(values)):
        return _in_utc(values, zone)
    read = _of_numbers(values, form) if kind_of(values) == "number" else _of_text(values, form)
    if zone is None:
        return read
    if read.unix:
        raise RecordError(f"{quoted(values.name)} has Unix times, which are UTC: leave out --timezone.")
    return Understood(in_zone(read.times, zone), f"{read.said + ', ' if read.said else ''}local time of {zone}")


def _in_utc(values: pd.Series[Any], zone: str | None) -> Understood:
    """Times with UTC or GMT behind them, in words."""
    if zone is not None:
        raise RecordError(f"{quoted(values.name)} says that its times are UTC: leave out --timezone.")
    text = values.astype("string").str.strip()
    bare: Any = text.str.replace(BEHIND_TIMES, "", regex=True)
    if (bare == text).any():
        row = int((bare == text).fillna(True).to_numpy().argmax())
        raise RecordError(
            f"{values.iloc[row]!r} in {quoted(values.name)}, row {row}, has no UTC behind it; others have."
        )
    read = _of_text(_named(bare.astype(object), values), None)
    times = read.times + "Z" if kind_of(read.times) == "text" else read.times.dt.tz_localize("UTC")
    return Understood(_named(times, values), ", ".join(filter(None, (read.said, "UTC"))))


def _of_numbers(values: pd.Series[Any], form: str | None) -> Understood:
    numbers = values.to_numpy(dtype=float, na_value=np.nan)
    known = numbers[np.isfinite(numbers)]
    if form is None and len(known):
        form = _form_of(known, str(values.name))
    if form is None or form == "seconds":
        return Understood(values)
    if form in DAY_ZERO:
        whole = np.round((numbers - DAY_ZERO[form]) * 86_400e3)  # to the millisecond, as spreadsheets show them
        return Understood(_counted(whole, "ms", values), f"days of {DAY_WORDS[form]}")
    if form == "hhmm":
        clocks = clocks_of_digits(values)
        if clocks is None:
            raise RecordError(f"{quoted(values.name)} has numbers that are no hhmm: hours to 24, minutes below 60.")
        return Understood(_of_clocks(clocks).times, "hours and minutes as hhmm")
    if form == "labview":
        return Understood(_counted(np.round((numbers - LABVIEW) * 1e3), "ms", values), "seconds since 1904")
    if "%" in form:
        whole_text: Any = pd.Series([f"{number:.0f}" for number in numbers], index=values.index, dtype="string")
        return Understood(_parsed(whole_text, values, form), f"times as {form}")
    unit = form.removeprefix("unix").strip() or "s"
    if unit not in ("s", *EPOCHS):
        raise _unknown_form(form)
    if unit == "s":
        return Understood(values, "Unix times in seconds", unix=True)
    dates = _counted(values if unit == "ns" else values.astype(float), unit, values)
    return Understood(dates, f"Unix times in {unit}", unix=True)


def _counted(numbers: Any, unit: Any, values: pd.Series[Any]) -> pd.Series[Any]:
    """Dates from numbers of a unit since 1970."""
    try:
        return _named(pd.to_datetime(numbers, unit=unit), values)
    except (ValueError, ArithmeticError):  # pandas' dates end in 2262
        row = int(np.argmax(np.abs(np.nan_to_num(np.asarray(numbers, float)))))
        raise RecordError(f"{quoted(values.name)} is {values.iloc[row]} in row {row}. {BEYOND}") from None


def _form_of(known: np.ndarray, name: str) -> str | None:
    """Form of time of numbers of this size; None for seconds."""
    low, high = float(known.min()), float(known.max())
    unit = unix_unit(low, high)
    if unit is not None:
        return f"unix {unit}"
    if UNIX[0] + LABVIEW <= low and high < UNIX[1] + LABVIEW:
        raise RecordError(
            f"Are the numbers in {quoted(name)}, such as {known[0]:.10g}, seconds since 1904, as LabVIEW counts them? "
            "Say it with --time-format labview, or --time-format seconds if they are seconds and no dates."
        )
    if np.median(known) >= LARGEST_SECONDS:  # one damaged time is none of these
        raise RecordError(
            f"{quoted(name)} has numbers such as {high:.0f}: no seconds, and no Unix times of this century. Say what "
            "they are with --time-format, such as %Y%m%d%H%M%S."
        )
    words = re.split(r"[^a-z]+", name.lower())
    if _looks_like_hhmm(known, words):
        return "hhmm"
    julian = next((word for word in words if word in ("mjd", "jd")), None)
    if julian is not None and low > DAY_ZERO[julian]:
        return julian
    if any(word in _SECONDS for word in words) or low < DAYS_OF_EXCEL[0]:
        return None
    step = float(np.median(np.abs(np.diff(known)))) if len(known) > 1 else 0.0
    dense = len(known) > 1 and bool((known % 1.0).any()) and step < 0.5
    in_excel = high < DAYS_OF_EXCEL[1]
    in_matlab = DAYS_OF_MATLAB[0] <= low and high < DAYS_OF_MATLAB[1]
    # Steps of logs in whole days and weeks
    if not dense and not (in_excel and (step in (0.5, 1.0, 7.0) or any(word in _DATED for word in words))):
        return None
    parts = known * 86_400.0  # a minute is 0.000694 days: a few decimals are none, and whole seconds are many
    whole = (np.round(known, 4) != known).any() and np.mean(np.abs(parts - np.round(parts)) < 0.05) >= 0.9
    if not (dense and whole and (in_excel or in_matlab)):
        raise RecordError(
            f"Are the numbers in {quoted(name)}, such as {known[0]:.10g}, seconds, or days of a spreadsheet or of "
            "another clock? Say it with --time-format seconds, excel, matlab, mjd or jd."
        )
    return "excel" if in_excel else "matlab"


def clocks_of_digits(values: pd.Series[Any]) -> pd.Series[Any] | None:
    """Whole numbers as times of day, ``2340`` or ``234000`` as ``23:40:00``; None for others: no minute is above 59."""
    numbers = values.to_numpy(dtype=float, na_value=np.nan)
    if not len(numbers) or not (numbers == np.floor(numbers)).all() or numbers.min() < 0:
        return None
    numbers = numbers * (100.0 if numbers.max() <= 2400 else 1.0)
    hours, minutes, seconds = numbers // 10_000, numbers // 100 % 100, numbers % 100
    if not ((minutes < 60) & (seconds < 60) & (numbers <= 240_000)).all():
        return None
    text = [f"{h:02.0f}:{m:02.0f}:{s:02.0f}" for h, m, s in zip(hours, minutes, seconds, strict=True)]
    return pd.Series(text, index=values.index, name=values.name, dtype=object)


def _looks_like_hhmm(known: np.ndarray, words: list[str]) -> bool:
    """True if numbers are times of day as hhmm: they are called so, or their steps are even as such and not as seconds.

    Raises RecordError where they may be either.
    """
    if "hhmm" in words:
        return True
    clocks = clocks_of_digits(pd.Series(known)) if known.max() <= 2400 and known[0] >= 100 else None
    if clocks is None or len(known) < 3:
        return False
    shown, steps = np.diff(known // 100 * 60 + known % 100) % 1440, np.diff(known)
    if (shown == shown[0]).all() and not (steps == steps[0]).all():
        return True
    even = (shown == shown[0]).all() and (steps == steps[0]).all()
    if ((shown == steps).all() or even) and {"time", "zeit", "clock", "uhrzeit"} & set(words):
        raise RecordError(
            f"Are the numbers, such as {known[0]:.0f}, seconds, or times of day as hhmm? Say it with --time-format "
            "seconds or --time-format hhmm."
        )
    return False


_MINUTES = re.compile(r"m{1,2}:ss|min:sec", re.IGNORECASE)
"""What the name of times says that are minutes and seconds, and no hours and minutes."""


def _of_text(values: pd.Series[Any], form: str | None) -> Understood:
    """Text in the form that all of it has; text in the forms of ISO 8601, and what is no text, stays."""
    if kind_of(values) != "text":
        return Understood(values)
    if form is not None:
        return Understood(_parsed(values.astype("string").str.strip(), values, form), f"times as {form}")
    if _MINUTES.search(str(values.name)) and re.fullmatch(r"\d+:\d\d(?:[.,]\d+)?", first_cell(values)):
        hours = "0:" + values.astype("string").str.strip().str.replace(",", ".")
        return Understood(_named(pd.to_timedelta(hours, errors="coerce"), values), "minutes and seconds")
    if re.fullmatch(CLOCK, first_cell(values)) or re.fullmatch(ELAPSED, first_cell(values)):
        return _of_clocks(values)
    if re.fullmatch(DAYS, first_cell(values)):
        return _of_spans(values)
    date = date_form(values)
    if date is None:
        commas = values.astype("string").str.contains(",", regex=False).any()
        return Understood(values.map(point_for_comma, na_action="ignore") if commas else values)
    text = values.astype("string").str.strip()
    times = _dates(text, date)
    order = ", ".join(_IN_WORDS[part] for part in re.findall("%[dmYyb]", date))
    return Understood(_named(times, values), f"dates as {order}")


def point_for_comma(cell: str) -> str:
    """A time in the form of ISO 8601 with a point before the fraction of a second, where the form allows a comma too.

    Examples
    --------
    >>> point_for_comma("2024-05-06 08:00:00,250")
    '2024-05-06 08:00:00.250'
    """
    return _COMMA.sub(r"\1.\2", cell)


def date_form(values: pd.Series[Any]) -> str | None:
    """Format of the dates in a column of text, as for `strptime`; None for ISO 8601, and for no dates.

    Raises RecordError for dates that have two readings, and those that have none.
    """
    forms = _forms(first_cell(values))
    if not forms:
        return None
    text = values.astype("string").str.strip()
    readings = {date: _dates(text, date) for date in forms}
    whole = {date: times for date, times in readings.items() if times.notna().all()}
    if not whole:
        raise _unread(values, text, readings)
    if len(whole) > 1:
        forward = {date: times for date, times in whole.items() if not (times.diff() < pd.Timedelta(0)).any()}
        whole = forward if len(forward) == 1 else whole
    if len(whole) > 1:  # through midnight only one of them goes on in the usual step
        odd = {date: _odd_steps(times) for date, times in whole.items()}
        even = {date: times for date, times in whole.items() if odd[date] == min(odd.values())}
        whole = even if len(even) == 1 else whole
    if len(whole) > 1:
        one = next(iter(whole.values()))
        row = int(np.argmax(np.logical_or.reduce([(one != other).to_numpy() for other in whole.values()])))
        read = " or ".join(f"{times.iloc[row]:%d %B %Y} ({date})" for date, times in whole.items())
        if any(other.iloc[row] != one.iloc[row] for other in whole.values()):
            raise RecordError(
                f"Is {text.iloc[row]!r} in {quoted(values.name)}, row {row}, {read}? Every row can be read either way. "
                f"Say which it is with --time-format, such as --time-format '{_whole_form(next(iter(whole)), text)}'."
            )
    return next(iter(whole))


def _odd_steps(times: pd.Series[Any]) -> int:
    """Number of steps that go back, or are far longer than the usual one."""
    steps = times.diff().dt.total_seconds().to_numpy()[1:]
    return int(((steps < 0) | (steps > FAR * np.median(steps))).sum()) if len(steps) else 0


def _forms(cell: str) -> tuple[str, ...]:
    """Formats that a date may be meant in; none for ISO 8601, which every reader knows, and for what is no date."""
    parts = re.fullmatch(rf"(?P<date>.*?)(?:[T ,]+{CLOCK})?", cell)
    forms = next((forms for look, forms in _DATES.items() if parts and re.fullmatch(look, parts["date"])), ())
    return () if forms == ("%Y-%m-%d",) and not (parts and parts["half"]) else forms


def one_date(text: str) -> Any:
    """A date that a user writes, in any form that logs have; None for what has none of them, such as ISO 8601.

    Raises RecordError for a date that has two readings, and one that has none.

    Examples
    --------
    >>> one_date("07.05.2024 08:30"), one_date("2024-05-07")
    (Timestamp('2024-05-07 08:30:00'), None)
    """
    text = text.strip()
    forms = _forms(text)
    if not forms:
        return None
    read = [_dates(pd.Series([text], dtype="string"), form).iloc[0] for form in forms]
    found = list(dict.fromkeys(time for time in read if not pd.isna(time)))
    if len(found) == 1:
        return found[0]
    if not found:
        raise RecordError(f"{text!r} is no date that there is. Write it as 2024-05-31T14:00:00.")
    read_as, written = (" or ".join(f"{time:{form}}" for time in found) for form in ("%d %B %Y", "%Y-%m-%dT%H:%M:%S"))
    raise RecordError(f"Is {text!r} {read_as}? Write the one that is meant as {written}.")


def _whole_form(date: str, text: pd.Series[Any]) -> str:
    """Format of cells, times of day included, as for `strptime`."""
    parts = re.fullmatch(rf"(?P<date>.*?)(?:(?P<between>[T ,]+){CLOCK})?", str(text.iloc[0]))
    if parts is None or not parts["clock"]:
        return date
    clock = "%I:%M" if parts["half"] else "%H:%M"
    clock += ":%S" if parts["clock"].count(":") == 2 else ""
    clock += str(parts[0])[parts.start("fraction") - 1] + "%f" if parts["fraction"] else ""
    clock += ":%f" if parts["third"] else ""
    between = str(parts[0])[parts.end("clock") : parts.start("half")] if parts["half"] else ""
    return f"{date}{parts['between']}{clock}{between.lstrip('.,:0123456789')}{'%p' if parts['half'] else ''}"


def _of_clocks(values: pd.Series[Any]) -> Understood:
    """Times of day without a date: spans, where they go on."""
    text = values.astype("string").str.strip()
    spans = times_of_day(text)
    if spans.isna().any() or (spans.diff() < pd.Timedelta(0)).any():
        since = _elapsed(text)
        if since is not None:
            return Understood(_named(since, values), "hours, minutes and seconds since a start")
        row = int(spans.isna().to_numpy().argmax() or (spans.diff() < pd.Timedelta(0)).to_numpy().argmax())
        raise RecordError(
            f"The times in {quoted(values.name)} have no date, and {text.iloc[row]!r} in row {row} does not follow on. "
            "A column of dates next to it is joined with it where it is called date."
        )
    return Understood(_named(spans, values), "times of day without a date")


def times_of_day(text: pd.Series[Any]) -> pd.Series[Any]:
    """Times of day as spans since the first midnight; NaT for other text.

    A day is added where the clock steps back and goes on in the usual step, as it does through midnight.
    """
    spans = pd.to_timedelta(_day_share(text.astype("string"))["span"])
    steps = spans.diff().dt.total_seconds()
    usual = float(steps[steps > 0].median()) if (steps > 0).any() else 0.0
    midnight = (steps < 0) & (steps + 86_400 <= FAR * usual)
    return spans + pd.to_timedelta(midnight.cumsum(), unit="D")


def _of_spans(values: pd.Series[Any]) -> Understood:
    """Days and times of day since a start, as pandas writes spans."""
    text = values.astype("string").str.strip()
    spans = pd.to_timedelta(text.where(text.str.fullmatch(DAYS)), errors="coerce")
    if spans.isna().any():
        row = int(spans.isna().to_numpy().argmax())
        raise RecordError(
            f"{values.iloc[row]!r} in {quoted(values.name)}, row {row}, is no time since a start, as {text.iloc[0]!r}."
        )
    return Understood(_named(spans, values), "days and times since a start")


def _elapsed(text: pd.Series[Any]) -> Any:
    """Times since a start, of more than a day; None for what does not go on."""
    parts = text.str.extract(f"^{ELAPSED}$")
    digits: Any = "0." + parts["fraction"].fillna("0")
    shown = [pd.to_numeric(parts[name], errors="coerce").astype(float) for name in ("hours", "minutes", "seconds")]
    seconds = 3600.0 * shown[0] + 60.0 * shown[1] + shown[2] + pd.to_numeric(digits).astype(float)
    if seconds.isna().any() or (seconds.diff() < 0).any() or seconds.max() >= LARGEST_SECONDS:
        return None
    return pd.to_timedelta((seconds * 1e9).round(), unit="ns")


def _dates(text: pd.Series[Any], date: str) -> pd.Series[Any]:
    """Text as dates in one form, with a time of day or without; NaT for what is not."""
    at_once = pd.to_datetime(text, format=_whole_form(date, text), errors="coerce") if len(text) else None
    if at_once is not None and at_once.notna().all() and at_once.dt.year.between(1678, 2261).all():
        return at_once.astype("datetime64[ns]")
    parts = text.str.extract(rf"^(?P<date>.*?)(?:[T ,]+(?P<rest>{CLOCK}))?$")
    days = pd.to_datetime(parts["date"].str.replace(",", ""), format=date.replace(",", ""), errors="coerce")
    days = days.where(days.dt.year.between(1678, 2261))  # what nanoseconds reach
    share = _day_share(parts["rest"])
    known = parts["rest"].isna() | share["span"].notna()
    return (days.astype("datetime64[ns]") + share["span"].fillna(pd.Timedelta(0))).where(known)


def _day_share(text: pd.Series[Any]) -> pd.DataFrame:
    """Time since midnight, as `span`; NaT for what is no time of day."""
    parts = text.str.strip().str.extract(f"^{CLOCK}$")
    shown: Any = parts["clock"].str.extract(r"^(\d+):(\d+)(?::(\d+))?$")
    hours, minutes, seconds = (pd.to_numeric(shown[k], errors="coerce").astype(float) for k in range(3))
    half = parts["half"].str.replace(r"[.\s]", "", regex=True).str.lower()
    hours = hours.where(half.isna(), hours % 12 + 12.0 * (half == "pm").fillna(False).astype(float))
    digits: Any = "0." + parts["fraction"].fillna(parts["third"]).fillna("0")
    fraction = pd.to_numeric(digits).astype(float)
    whole = hours * 3600 + minutes * 60 + seconds.fillna(0.0)
    whole = whole.where(((hours < 24) | (whole == 86_400)) & (minutes < 60) & ~(seconds >= 61))  # 24:00 is midnight
    nanoseconds = whole * 1e9 + (fraction * 1e9).round()
    return pd.DataFrame({"span": pd.to_timedelta(nanoseconds, unit="ns")})


def _parsed(text: pd.Series[Any], values: pd.Series[Any], form: str) -> pd.Series[Any]:
    """Text in a form that the user says."""
    try:
        times = pd.to_datetime(text, format=form, errors="coerce")
    except ValueError:
        raise _unknown_form(form) from None
    bad = (times.isna() & text.notna()).to_numpy()
    if bad.any():
        row = int(bad.argmax())
        raise RecordError(f"{text.iloc[row]!r} in {quoted(values.name)}, row {row}, is not written as {form!r}.")
    return _named(times, values)


def _named(times: Any, values: pd.Series[Any]) -> pd.Series[Any]:
    """Times under the name of the column that they were read from."""
    return pd.Series(times, index=values.index, name=values.name)


def _unknown_form(form: str) -> RecordError:
    return RecordError(
        f"--time-format {form!r} is not known. Write it as for strptime (%d.%m.%Y %H:%M:%S), or one of excel, "
        "matlab, mjd, jd, labview, unix, unix ms, unix us, unix ns, hhmm, seconds."
    )


def _unread(values: pd.Series[Any], text: pd.Series[Any], readings: dict[str, pd.Series[Any]]) -> RecordError:
    """No form reads every row: name the first row that the best one does not read."""
    form, times = max(readings.items(), key=lambda item: int(item[1].notna().sum()))
    row = int((times.isna() & text.notna()).to_numpy().argmax())
    missing = times.isna() & text.isna()
    if missing.any() and not (times.isna() & text.notna()).any():
        row = int(missing.to_numpy().argmax())
        return RecordError(f"{quoted(values.name)} has no time in row {row}. Every row needs its time.")
    return RecordError(
        f"{text.iloc[row]!r} in {quoted(values.name)}, row {row}, is no date like the others, which are written as "
        f"{form}. Mend the row, or say the format with --time-format."
    )
