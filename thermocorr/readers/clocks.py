"""Times as loggers write them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing, option, quoted
from ..records.times import steps_back_an_hour, summer_time_text
from .cells import MOMENT, OF_DAY, ZONE, Options, is_number, varies

_MONTHS = {
    word: month
    for month, words in {
        "jan": "ene gen", "feb": "fév", "mar": "mär mrz mrt", "apr": "abr avr", "may": "mai mag mei", "jun": "giu",
        "jul": "jui lug", "aug": "aoû ago", "sep": "set", "oct": "okt ott", "dec": "dez déc dic",
    }.items()
    for word in words.split()
}  # fmt: skip
"""Beginnings of the names of months elsewhere -> the English ones."""
_DATES = (
    (r"\d{4}-w\d\d-\d", ("%G-W%V-%u",)), (r"\d{4}(?P<s>[-/.])\d{1,2}(?P=s)\d{1,2}", ("%Y{s}%m{s}%d",)),
    (r"\d{1,2}\.\d{1,2}\.\d{4}", ("%d.%m.%Y",)), (r"\d{1,2}\.\d{1,2}\.\d{2}", ("%d.%m.%y",)),
    (r"\d{1,2}(?P<s>[-/ ])\d{1,2}(?P=s)\d{4}", ("%d{s}%m{s}%Y", "%m{s}%d{s}%Y")),
    (r"\d{1,2}(?P<s>[-/])\d{1,2}(?P=s)\d{2}", ("%d{s}%m{s}%y", "%m{s}%d{s}%y", "%y{s}%m{s}%d")),
    (r"\d{1,2} [a-z]{3} \d{4}", ("%d %b %Y",)), (r"\d{1,2} [a-z]{3} \d{2}", ("%d %b %y",)),
    (r"[a-z]{3} \d{1,2} \d{4}", ("%b %d %Y",)), (r"(?:19|20)\d\d \d{1,3}(?= )", ("%Y %j",)),
    (r"(?:19|20)\d{6}", ("%Y%m%d",)), (r"\d{6}(?=[ _]\d{6}$)", ("%y%m%d",)),
)  # fmt: skip
"""Pattern of a date -> formats of `strptime` that it may be written in."""
_TIMES = ((r"\d{1,2}:\d\d:\d{1,2}\.\d+", ":%M:%S.%f"), (r"\d{1,2}:\d\d:\d{1,2}", ":%M:%S"), (r"\d{1,2}:\d\d", ":%M"),
          (r"\d{1,2}\.\d\d\.\d\d", ".%M.%S"), (r"\d{6}", "%M%S"), (r"\d{4}", "%M"))  # fmt: skip
"""Pattern of a time of day -> its format behind the hours."""
_ELAPSED = r"\d+:\d\d(:\d{1,2}(\.\d+)?)?|-?\d+ ?d(?:ays?)?,?( \d\d:\d\d:\d\d(\.\d+)?)?"
DAYS = {"excel": 25_569.0, "matlab": 719_529.0, "mjd": 40_587.0, "jd": 2_440_587.5}
"""Count of days -> its number of 1970-01-01."""
SINCE_1970 = {"unix": 1.0, "unix ms": 1e-3, "unix us": 1e-6, "unix ns": 1e-9}
"""Count since 1970-01-01, in UTC -> its unit [s]."""
LABVIEW = 2_082_844_800.0
"""Seconds from 1904-01-01, which LabVIEW counts from, to 1970-01-01."""
SPANS = {
    word: seconds
    for words, seconds in (
        ("ns nanoseconds", 1e-9), ("us usec micros microseconds", 1e-6), ("d day days tage jours dias doy", 86_400.0),
        ("ms msec msecs millis millisecond milliseconds millisekunden", 1e-3),
        ("s sec secs second seconds sekunden", 1.0),
        ("min mins mn minute minutes minuten minutos", 60.0), ("h hr hrs hour hours stunden std heures horas", 3600.0),
    )
    for word in words.split()
}  # fmt: skip
"""Unit of time, in small letters -> [s]."""
PARTS = {"year": "%Y", "month": "%m", "day": "%d", "hour": "%H", "minute": "%M", "second": "%S"}
"""Columns of parts of a date."""
FRACTIONS = re.compile(r"ms|msec|millis.*|fraction.*", re.IGNORECASE)
"""Columns of parts of a second."""
_EARLY, _LATE = 10_957.0, 27_394.0
"""Days from 1970 to 2000 and to 2045: numbers between them may be dates."""
_TIME_NAMES = re.compile(
    r"time|zeit|date|datum|stamp|^ts$|_ts$|^t$|epoch|unix|elapsed|uptime"
    r"|seconds?(?: since|$)|sekunden$|millis|fecha|heure|horod"
    r"|mjd|^jd|datenum|hhmm|x_value|temps$|^ms$|^t_(?:ms|s|min|h)$|^\W*(h|min|minutes|minuten|stunden)\W*$",
    re.IGNORECASE,
)
"""Names that numbers have which are times."""
COUNTERS = re.compile(
    r"^\W*(#|no\.?|nr\.?|id\b.*|row|index|scan.*|record|rn|entry_id|sample|reading)\W*$", re.IGNORECASE
)
_DAYTIME = re.compile(r"hhmm|time|zeit|clock", re.IGNORECASE)
_NOW = ("now", "today")
"""Words that pandas takes for times."""
_ZONED = r":\d\d(?:[.,]\d+)? ?(?:Z|UTC|[-+]\d\d:?(?:\d\d)?)$"
LOCAL = re.compile(r"\d{4}-?\d\d-?\d\d(?:[T ]\d\d:?\d\d(?::?\d\d(?:[.,]\d+)?)?)?")
"""Dates of ISO 8601 without a zone."""
_MIDNIGHT = r"[ T]00:00(?::00)?(?:\.0+)?$"
_MONTH = r"(?<=\d)\.?[- ]*([^\W\d_]{3})[^\W\d_]*[- ,.]+(?=\d)|^([^\W\d_]{3})[^\W\d_]* (\d+),? (?=\d{4})"
_ZONE_IN_NAME = re.compile(r"(?:^|[\s\[(<,])(?:UTC|GMT)\s?(?P<offset>[+-]\d{1,2}(?::?\d{2})?)?(?:$|[\s\])>])")


@dataclass
class Clock:
    """How times are written, in one column or in several."""

    columns: list[str]
    format: str = ""
    """Of `strptime`; or "iso", "iso utc", "elapsed", "mm:ss", "seconds", "dates", a key of `DAYS` or `SINCE_1970`."""
    scale: float = 1.0
    """Unit of seconds, or of `fraction` [s]."""
    digits: int = 0
    """Of a time of day in a whole number."""
    zone: str = ""
    """Of local times."""
    fraction: str = ""
    """Column of parts of a second."""

    def no_times(self) -> pd.Index:
        """Times of the kind that it gives, none of them."""
        zoned = self.zone or self.format in ("iso utc", *SINCE_1970) or "%z" in self.format
        dated = self.format.startswith("iso") or self.format in (*DAYS, "labview", "dates")
        if not zoned and not dated and not re.search("%[dju]", self.format):
            return pd.TimedeltaIndex([], name="time")
        return pd.DatetimeIndex([], tz="UTC" if zoned else None, name="time")

    def times(self, frame: pd.DataFrame) -> pd.Index:
        """Dates, or seconds; NaT or NaN for other cells."""
        times = self._whole(frame)
        if isinstance(times, pd.DatetimeIndex) and len(times):  # a year of another age is damaged
            first, last = times.min().year, times.max().year
            times = times if 1900 <= first <= last <= 2200 else times.where((times.year >= 1900) & (times.year <= 2200))
        if not self.fraction:
            return times
        part = np.round(frame[self.fraction].to_numpy(float) * self.scale, 9)
        part[~((part >= 0) & (part < 1))] = np.nan
        return times + (pd.to_timedelta(part, unit="s") if isinstance(times, pd.DatetimeIndex) else part)

    def _whole(self, frame: pd.DataFrame) -> pd.Index:
        cells = frame[self.columns[0]]
        if self.format == "dates":
            spans = pd.api.types.is_timedelta64_dtype(cells.dtype)
            return pd.Index(cells.dt.total_seconds()) if spans else pd.DatetimeIndex(cells)
        if self.format in SINCE_1970:
            numbers = pd.to_datetime(cells, unit=self.format[5:] or "s", errors="coerce", utc=True)  # type: ignore[call-overload]
            return pd.DatetimeIndex(numbers).as_unit("ns").round("us")
        if self.format in DAYS or self.format == "labview":
            seconds = cells - LABVIEW if self.format == "labview" else (cells - DAYS[self.format]) * 86_400.0
            return pd.DatetimeIndex(pd.to_datetime(np.round(seconds * 1e3), unit="ms", errors="coerce"))
        if self.format == "seconds":
            counted = cells.to_numpy(float) * self.scale
            return pd.Index(np.where(np.abs(counted) < 9e9, counted, np.nan))  # 290 years, as far as spans reach
        if self.format.startswith("iso"):
            utc = self.format == "iso utc"
            if cells.dtype.kind == "M" and len(self.columns) == 1:
                return pd.DatetimeIndex(cells)
            text = self.text(frame)
            text = text.mask(text.isin(_NOW))
            if utc or text.str.len().nunique() > 1:  # some may have a zone, and others none
                text = text.where(text.str.contains(_ZONED, na=False) if utc else text.str.fullmatch(LOCAL, na=False))
            times = pd.to_datetime(text, format="ISO8601", errors="coerce", utc=utc)
            return pd.DatetimeIndex(times) if times.dtype.kind == "M" else pd.DatetimeIndex([pd.NaT] * len(times))
        text = _in_english(self.text(frame))
        if self.format in ("elapsed", "mm:ss"):
            text = text.where(text.str.contains(":|d", na=False))
            text = "00:" + text if self.format == "mm:ss" else text.where(text.str.count(":") != 1, text + ":00")
            return pd.Index(pd.to_timedelta(text, errors="coerce").dt.total_seconds())
        return self._strptime(text)

    def _strptime(self, text: pd.Series) -> pd.Index:
        text = text.mask(text.isin(_NOW))
        late = text.str.contains(" 24:00", regex=False, na=False)
        text = text.str.replace(" 24:00", " 00:00", regex=False) if late.any() else text
        utc, form = "%z" in self.format, self.format
        values = pd.to_datetime(text, format=form, errors="coerce", utc=utc)
        bare = form.replace(".%f", "")
        for other in (bare, bare.replace("%S", "%S.%f"), bare.replace(":%S", "")):  # parts that come and go
            if values.isna().any():
                values = values.fillna(pd.to_datetime(text, format=other, errors="coerce", utc=utc))
        values = values + pd.to_timedelta(late.astype(int), unit="D") if late.any() else values
        if not re.search("%[dju]", form):
            return pd.Index((values - values.dt.normalize()).dt.total_seconds())
        return pd.DatetimeIndex(values)

    def text(self, frame: pd.DataFrame) -> pd.Series:
        """The cells of all columns, with blanks between them."""
        cells = [_as_text(frame[name], self.digits) for name in self.columns]
        if len(cells) > 1 and cells[0].head(100).str.contains(_MIDNIGHT, na=False).all():
            cells[0] = cells[0].str.replace(_MIDNIGHT, "", regex=True)  # the date alone
        return reduce(lambda text, more: text + " " + more, cells)

    def in_zone(self, times: pd.Index, last: pd.Timestamp | None = None) -> pd.Index:
        """Local times in `zone` as UTC.

        `last` (Timestamp, optional): The time before the first of them. Raises RecordError for times that no clock
        showed, and for hours that may be the first or the second.
        """
        if not self.zone or not isinstance(times, pd.DatetimeIndex) or times.tz is not None:
            return times
        known = np.asarray(times.notna())
        gone = known & np.asarray(times.tz_localize(self.zone, ambiguous=True, nonexistent="NaT").isna())
        if gone.any():
            raise RecordError(
                f"No clock in {self.zone} showed {times[gone][0]}: summer time began. Is it the zone of the log?"
            )
        twice = known & np.asarray(times.tz_localize(self.zone, ambiguous="NaT").isna())
        back = np.cumsum(np.diff(times.asi8, prepend=times.asi8[:1]) < 0) > 0
        ways = [times.tz_localize(self.zone, ambiguous=summer).tz_convert("UTC") for summer in (True, False, ~back)]
        if not twice.any():
            return ways[0]
        steps = [_steps(way if last is None else way.insert(0, last)) for way in ways]
        largest = [step.max(initial=0.0) if (step > 0).all() else np.inf for step in steps]
        best = int(np.argmin(largest))
        others = [size for way, size in zip(ways, largest, strict=True) if not way.equals(ways[best])]
        if last is None and min(others) <= 1.5 * largest[best] < np.inf:
            raise RecordError(
                f"{times[twice][0]} was there twice, when summer time ended, and the rows do not tell which it is. "
                "Write times in UTC, or leave that hour out."
            )
        return ways[best]


def _as_text(column: pd.Series, digits: int = 0) -> pd.Series:
    """Cells as text; a time of day at full width."""
    if not is_number(column):
        return column.astype(str).str.strip()
    text = (column.astype("Int64") if (column.dropna() % 1 == 0).all() else column).astype("string")
    return text.str.zfill(digits) if _DAYTIME.search(str(column.name)) else text


def _in_english(text: pd.Series) -> pd.Series:
    """Dates in English letters and plain signs."""
    seen = " ".join(text.dropna().head(50)).lower()
    for here, pattern, put in (
        (r"\d[ap]\.? ?m|[ap]\. ?m| [ap] m", r" ?([AaPp])\.? ?[Mm]\.?$", r" \1m"),
        ("utc|gmt|z", r" ?(?:UTC|GMT|[Zz])$", "Z"),
        (r"(^| )[^\W\d_]{2,3}\.?,? \d", r"^[^\W\d_]{2,3}\.?,? ", ""),  # the day of the week
        (r"\d\.?[- ]?[^\W\d_]{3}|[^\W\d_]{3,} \d+,? \d{4}", _MONTH, _month),
        (r":\d\d \d{4}( |$)", r"^([A-Za-z]{3}) +(\d+) ([\d:]+) (\d{4})$", r"\2 \1 \4 \3"),  # as C writes it
        (r":\d\d[,:]\d{3}", r"(:\d\d)[,:](\d{3,9})", r"\1.\2"),
        (r", |  |\dt\d|_|\d{8}:", r",? +|(?<=\d)[Tt](?=\d)|(?<=\d)_(?=\d)|(?<=\d{8}):(?=\d)", " "),
    ):
        text = text.str.replace(pattern, put, regex=True) if re.search(here, seen) else text
    return text


def _month(found: re.Match[str]) -> str:
    day_first = found[1] is not None
    return f" {_MONTHS.get(found[1].lower(), found[1])} " if day_first else f"{found[2]} {found[3]} "


def _formats(cell: str) -> list[str]:
    """Formats of `strptime` for a date, a time, or both."""
    for shape, forms in (*_DATES, ("", ("",))):
        date = re.match(shape, cell)
        rest = cell[date.end() :] if date else ""
        gap = " " if rest.startswith(" ") else ""
        for clock, form in (*_TIMES, ("", "")) if date else ():
            tail = re.fullmatch(clock + r"(?P<half> [ap]m)?(?P<zone>Z| ?[-+]\d\d:?\d\d)?", rest[len(gap) :], re.I)
            if date and tail and (gap or not shape or not clock or re.fullmatch(r"\d{14}|\d{12}", cell)):
                hour = "" if not clock else "%I" if tail["half"] else "%H"
                end = (" %p" if tail["half"] else "") + (
                    (" " if tail["zone"][0] == " " else "") + "%z" if tail["zone"] else ""
                )
                return [one.format(s=date.groupdict().get("s")) + gap + hour + form + end for one in forms]
    return []


def one_date(text: str) -> pd.Timestamp | None:
    """A date as a user writes it; None for none.

    Raises RecordError for a date that has two readings, and one that there is not.

    Examples
    --------
    >>> one_date("07.05.2024 08:30"), one_date("2024-05-07")
    (Timestamp('2024-05-07 08:30:00'), None)
    """
    cells = _in_english(pd.Series([text.strip()], dtype="string"))
    forms = _formats(str(cells.iloc[0]).lower().replace("z", "Z"))
    iso = re.match(r"\d{4}-\d\d-\d\d", text.strip())
    if iso or not re.search(r"\d[-/. ]\S+[-/. ]\d|\d{8}", text) or not forms or "%d" not in forms[0]:
        return None
    read = (pd.to_datetime(cells, format=form, errors="coerce").iloc[0] for form in forms)
    found = list(dict.fromkeys(time for time in read if pd.notna(time)))
    if len(found) == 1:
        return found[0]
    if not found:
        raise RecordError(f"{text!r} is no date that there is. Write it as 2024-05-31T14:00:00.")
    read_as, written = (" or ".join(f"{time:{form}}" for time in found) for form in ("%d %B %Y", "%Y-%m-%dT%H:%M:%S"))
    raise RecordError(f"Is {text!r} {read_as}? Write the one that is meant as {written}.")


def as_seconds(times: pd.Index) -> np.ndarray:
    """Seconds, of dates since 1970; NaN for a missing time."""
    if isinstance(times, pd.DatetimeIndex | pd.TimedeltaIndex):
        return np.where(times.isna(), np.nan, times.as_unit("ns").asi8 / 1e9)
    return times.to_numpy(float)


def _steps(times: pd.Index) -> np.ndarray:
    """Steps between those times that are known [s]."""
    seconds = as_seconds(times)
    return np.diff(seconds[np.isfinite(seconds)])


def unwrapped(times: pd.Index, clock: Clock, last: float | None = None) -> pd.Index:
    """Times of day that go on past midnight [s]."""
    if isinstance(times, pd.DatetimeIndex) or clock.format == "seconds" or np.nanmax(times, initial=0.0) >= 86_400:
        return times
    values = as_seconds(times)
    turns = np.cumsum(np.diff(values, prepend=values[:1] if last is None else [last % 86_400]) < -43_200)
    days = turns + (0 if last is None else last // 86_400)
    whole: pd.Index = pd.Index(values + 86_400.0 * days)
    return whole


def refuse_two_hours(times: pd.Index) -> None:
    """Raise RecordError for local times that repeat an hour."""
    steps = np.diff(as_seconds(times))
    back = np.flatnonzero(steps < 0)
    local = isinstance(times, pd.DatetimeIndex) and times.tz is None
    if not local or len(back) != 1 or back[0] + 1 >= len(steps):
        return
    row, usual = int(back[0]), float(np.median(np.abs(steps)))
    if steps[row + 1] <= 2.0 * usual and steps_back_an_hour(float(-steps[row]), usual):
        raise RecordError(summer_time_text(row + 1, times[row + 1], times[row]))


def find_clock(frame: pd.DataFrame, units: dict[str, str], said: Options) -> Clock | None:
    """The best clock: it fits all rows and rises most evenly.

    None where no column has times. Raises RecordError where two ways are left.
    """
    columns = [str(name) for name in frame if name not in said.others]
    if said.time is not None and said.time not in frame:
        raise RecordError(f"There is no column {quoted(said.time)} for {option('time')}; there are {listing(frame)}.")
    lower = {name.lower().strip(): name for name in columns}
    if said.time is None and sum(part in lower for part in PARTS) >= 4:
        parts = [part for part in PARTS if part in lower]
        return Clock([lower[part] for part in parts], " ".join(PARTS[part] for part in parts))
    ways = [_of_text(frame, tried, said) for tried in _texts(frame, columns, lower, said)]
    if not any(ways):
        named = [said.time] if said.time else [name for name in columns if _may_count(name) and _counts(frame[name])]
        if not named and all(name.isdigit() for name in columns):  # a log without names
            first = next((name for name in columns if _counts(frame[name])), None)
            named = [first] if first is not None and _is_even(frame[first]) else []
        ways = [_of_numbers(frame, name, units.get(name, ""), said) for name in named if is_number(frame[name])]
    good = [_rising(frame, clocks) for clocks in ways if clocks]
    universal = [one for one in good if re.search("utc", one[0].columns[0], re.I)]
    clock = max(universal or good, key=lambda one: round(one[1], 2), default=(None, 0.0))[0]
    if clock is None:
        return None
    return _with_fraction(frame, replace(clock, zone=said.timezone or zone_in_name(clock.columns[0])))


def _may_count(name: str) -> bool:
    bare = re.split(r"[\[(]", name)[0].strip()
    return bool(_TIME_NAMES.search(name) or _TIME_NAMES.search(bare)) and not COUNTERS.match(name) and bare != "T"


def _counts(column: pd.Series) -> bool:
    """True for numbers that are not all the same."""
    return is_number(column) and (varies(column) or len(column) == 1)


def _is_even(column: pd.Series) -> bool:
    """True if numbers rise evenly and do not count rows."""
    steps = np.diff(column.to_numpy(float))
    return len(steps) > 0 and steps[0] > 0 and steps[0] != 1 and bool((steps == steps[0]).all())


def _texts(frame: pd.DataFrame, columns: list[str], lower: dict[str, str], said: Options) -> list[list[str]]:
    """Columns of dates and times as text."""
    stamps, dates, clocks, half = list[str](), list[str](), list[str](), list[str]()
    for name in columns:
        cells = frame[name].dropna().head(100)
        if pd.api.types.is_datetime64_any_dtype(cells) or pd.api.types.is_timedelta64_dtype(cells):
            midnights = cells.dtype.kind == "M" and bool((cells == cells.dt.normalize()).all())
            (dates if midnights else stamps).append(name)
            continue
        if is_number(frame[name]) or not len(cells):
            continue
        cells = _as_text(cells)
        if (cells.str.fullmatch(MOMENT)).mean() > 0.5 or (said.time_format and name == said.time):
            first = _first_moment(cells)
            alone = re.fullmatch(f"{OF_DAY}{ZONE}?", first)
            whole = re.search(r":|\d[T _]\d{4,6}$", first) and not cells.str.contains(_MIDNIGHT).all()
            (clocks if alone else stamps if whole else dates).append(name)
        elif cells.str.fullmatch(r"[AaPp]\.? ?[Mm]\.?").mean() > 0.8:
            half = [name]
    numbers = [name for name in columns if is_number(frame[name]) and re.search(f"dat|{_DAYTIME.pattern}", name, re.I)]
    numbers = [name for name in numbers if (frame[name] % 1 == 0).all()]
    dates += [n for n in numbers if re.search("dat", n, re.I) and frame[n].between(19_700_101, 21_001_231).all()]
    hours = [n for n in numbers if _DAYTIME.search(n) and (frame[n] % 100 < 60).all() and frame[n].max() <= 240_000]
    days = [[name] for name in dates] + ([[lower["year"], lower["doy"]]] if {"year", "doy"} <= set(lower) else [])
    pairs = [[*day, clock, *half] for day in days for clock in [*clocks, *hours]]
    moving = [name for name in stamps if varies(frame[name]) or len(frame) == 1]
    tries = [[name] for name in moving] + pairs or [[name, *half] for name in clocks] or [[name] for name in dates]
    if said.time is not None:
        tries = [tried for tried in tries if said.time in tried] or [[said.time]]
    return [tried for tried in tries if len(tried) > 1 or not is_number(frame[tried[0]]) or tried[0] in dates]


def _first_moment(cells: pd.Series) -> str:
    """The first cell that is a date or time."""
    moments = cells[cells.str.fullmatch(MOMENT, na=False)]
    return str(moments.iloc[0] if len(moments) else cells.iloc[0])


def _of_text(frame: pd.DataFrame, columns: list[str], said: Options) -> list[Clock]:
    """Ways to read text columns as times."""
    typed = frame[columns[0]].dtype.kind in "mM" or isinstance(frame[columns[0]].dtype, pd.DatetimeTZDtype)
    if typed and len(columns) == 1:
        return [Clock(list(columns), "iso" if frame[columns[0]].dtype.kind == "M" else "dates")]
    hours = [frame[name].max() for name in columns if _DAYTIME.search(name) and is_number(frame[name])]
    top = max(hours, default=np.inf)
    base = Clock(list(columns), said.time_format or "", digits=4 if top <= 2400 else 6 if top <= 240_000 else 0)
    some = frame.iloc[np.unique(np.linspace(0, len(frame) - 1, 60).astype(int))]
    raw = base.text(some)
    first = _first_moment(raw.dropna())
    cell = _first_moment(_in_english(raw.dropna())).lower().replace("z", "Z")
    forms = [said.time_format] if said.time_format else _formats(cell)
    if not said.time_format and re.match(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(?!.*[ap]\.? ?m)|$)", first):
        forms = ["iso utc" if re.search(_ZONED, first) else "iso", *forms]
    elif not said.time_format and re.fullmatch(_ELAPSED, cell):
        forms = ["mm:ss" if re.search(r"m{1,2}:ss|min:sec", columns[0], re.I) else "elapsed"]
    ways = [replace(base, format=form) for form in forms]
    known = [float(pd.notna(one.times(some)).mean()) for one in ways]
    return [one for one, share in zip(ways, known, strict=True) if share >= max(known) - 0.1 > 0.2]


def _of_numbers(frame: pd.DataFrame, name: str, unit: str, said: Options) -> list[Clock]:
    """Ways to read a column of numbers as times."""
    values, base = frame[name].dropna(), Clock([name])
    low, high = values.quantile([0.1, 0.9]).tolist()  # a damaged row decides nothing
    if said.time_format == "seconds":
        return [replace(base, format="seconds", scale=_span(name, unit) or 1.0)]
    if said.time_format:
        return [replace(base, format="%H%M" if said.time_format == "hhmm" else said.time_format, digits=4)]
    inside = re.search(r"[\[(](.*?)[\])]", name)
    scale = _span(name, unit)
    if inside and scale is None and not re.search(r"utc|gmt|local|iso|:|[-+]\d", inside[1], re.I):
        form = option("time_format", "'seconds'")
        raise RecordError(f"{inside[1]!r} in {quoted(name)} is no unit of time known here. Say {form}.")
    if re.search(r"(?<![a-z])hhmm(?![a-z])", name.lower()):
        return [replace(base, format="%H%M", digits=4)]
    whole = bool((values % 1 == 0).all())
    if whole and low > 1.9e13 and high < 2.1e13:
        return [replace(base, format="%Y%m%d%H%M%S")]
    days = {key: (low * size / 86_400, high * size / 86_400) for key, size in SINCE_1970.items()}
    days |= {key: (low - zero, high - zero) for key, zero in DAYS.items()}
    days |= {"labview": ((low - LABVIEW) / 86_400, (high - LABVIEW) / 86_400)}
    fit = [replace(base, format=key) for key, (first, last) in days.items() if first > _EARLY and last < _LATE]
    words = re.split(r"[^a-zµ]+", name.lower())
    named = [one for one in fit if one.format in words]
    if named or high > 1e8:  # no elapsed time is years long
        return named or fit
    if scale is not None:
        return [replace(base, format="seconds", scale=scale)]
    step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    if not fit or step > 7:
        return [replace(base, format="seconds")]
    parts = step < 1 and abs(step * 1e4 - round(step * 1e4)) > 1e-6  # no decimal step: minutes, as parts of a day
    return fit[:1] if parts else [*fit[:1], replace(base, format="seconds")]


def _span(name: str, unit: str) -> float | None:
    """The unit of a column of times [s], or None."""
    words = [word for word in re.split(r"[^a-zµ]+", name.lower()) if word]
    return SPANS.get(unit.lower(), SPANS.get(words[-1]) if words else None)


def _rising(frame: pd.DataFrame, clocks: list[Clock]) -> tuple[Clock, float]:
    """The one clock that fits best and goes back least.

    Returns it and the share of its steps that are the usual one, less that of steps back.
    """
    few = frame.iloc[:: max(1, len(frame) // 2000)]
    first = clocks[0]
    if first.format.startswith("iso") and pd.notna(first.times(few)).all():
        clocks = clocks[:1]
    frame = frame if len(clocks) > 1 else few
    read = [(one, unwrapped(one.times(frame), one)) for one in clocks]
    known = [float(pd.notna(times).mean()) for _, times in read]
    order = [k for k in np.argsort(np.negative(known), kind="stable") if known[k] >= max(known) - 0.1]
    read = [read[k] for k in order]
    steps = [_steps(times) for _, times in read]
    back = [int((step < 0).sum()) for step in steps]
    usual = [float(np.median(step)) if len(step) else 0.0 for step in steps]
    gaps = [step.max(initial=0.0) / max(size, 1e-9) for step, size in zip(steps, usual, strict=True)]
    gaps = [gap if count == min(back) else np.inf for gap, count in zip(gaps, back, strict=True)]
    left = [k for k, gap in enumerate(gaps) if gap <= 10 * min(gaps) + 1e-9]
    clock, step = read[left[0]][0], steps[left[0]]
    own = as_seconds(read[left[0]][1])
    left = [k for k in left if k == left[0] or np.nanmax(np.abs(as_seconds(read[k][1]) - own), initial=0.0) > 0]
    if len(left) > 1:
        forms = [option("time_format", repr(read[k][0].format)) for k in left]
        raise RecordError(
            f"The times in {' and '.join(map(quoted, clock.columns))}, such as {clock.text(frame).iloc[0]!r}, can be "
            f"read either way: say {' or '.join(forms)}."
        )
    if not len(step) or usual[left[0]] <= 0:
        return clock, 1.0 if len(frame) == 1 else -1.0
    same = np.mean(np.abs(step - usual[left[0]]) <= 0.02 * usual[left[0]] + 1e-3)
    return clock, float(same - np.mean(step < 0))


def _with_fraction(frame: pd.DataFrame, clock: Clock) -> Clock:
    """The clock, with its column of fractions if there is one."""
    name = next(
        (n for n in map(str, frame) if FRACTIONS.fullmatch(n) and n not in clock.columns and is_number(frame[n])), None
    )
    if name is None or clock.format in ("seconds", *DAYS, *SINCE_1970) or not varies(frame[name]):
        return clock
    scale = 1.0 if name.lower().startswith("f") else 1e-3
    whole = not (as_seconds(clock.times(frame)) % 1 > 0).any()
    return (
        replace(clock, fraction=name, scale=scale)
        if whole and (frame[name] * scale).between(0, 1, "left").mean() > 0.9
        else clock
    )


def zone_in_name(column: str) -> str:
    """The UTC offset in a column's name: ``+08:00``, or "".

    Examples
    --------
    >>> zone_in_name("Datetime[UTC+8]"), zone_in_name("Date Time, GMT-07:00"), zone_in_name("Time (UTC)")
    ('+08:00', '-07:00', '+00:00')
    """
    found = _ZONE_IN_NAME.search(column)
    if found is None:
        return ""
    sign, digits = (found["offset"] or "+0")[0], (found["offset"] or "+0")[1:].replace(":", "")
    hours, minutes = (digits, "00") if len(digits) <= 2 else (digits[:-2], digits[-2:])
    return f"{sign}{hours:0>2}:{minutes}"
