"""Roles of a log's columns (temperature, reading, times): one guess for every door."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing, quoted
from ..records.files import TIME_NAMES
from ..records.types import kind_of
from ..records.units import DEGREES, TEMPERATURES, name_and_unit, unit_of
from .values import first_cell, is_moment

READINGS = re.compile(
    r"reading|measur|dmm|bridge|brücke|messwert|anzeige|spannung|widerstand|tension|voltage|volt|resist|value|output|frequency|freq|weight"
    r"|gewicht|load|force|kraft|strain|tilt|mass|poids|peso|^[uvr]$",
    re.I,
)
"""Names that readings go by."""
SURROUNDINGS = re.compile(
    r"humid|feucht|^rh|pressure|druck|baro|suppl|batt|^setp|set[_ ]?point|target|rssi|quality|serial|logged|connected"
    r"|attached|detached|stopped|end of file|signal|status|alarm"
    r"|^(ms|msec|sub|lat|lon|elevation|ele)$|(?<![a-z])(dew|wind(?!ing)|solar|rain|state|flag|error)",
    re.I,
)
"""Names of what is recorded with a reading."""
SPREADS = re.compile(r"(?<![a-z])(std|stdev|stddev|sd|sigma|var|variance)(?![a-z])", re.I)
"""Names of what says how much a quantity varied, and not how large it was."""
RUN = "file"
"""Column of the names of files, each a run."""
RUNS = ("run", "run_id", "run id", RUN)
"""Names, in small letters, that labels of runs go by; several files are such runs."""
CLOCKS = re.compile(
    r"(?:^|(?<=relative )|(?<=sample ))(hhmm|elapsed|uptime|epoch|unix|seconds?|secs?|millis|ms|time(?:stamp)?|zeit"
    r"|laufzeit|minuten|sekunden|temps|tiempo|tid|datenum|doy|mjd|jd|t[_ ]ms|ts)(?![a-z])|(?<![a-z])ts$",
    re.I,
)
"""Beginnings of names of times that are numbers."""
FEWEST = 10
"""Rows from which a column that counts them is told."""


class Roles(NamedTuple):
    """Columns of a log by what they are; None for what a person must say."""

    temperature: str | None
    reading: str | None
    time: str | None
    run: str | None
    in_doubt: dict[str, tuple[str, ...]]
    """Role that could not be told -> columns that it may be."""
    why: dict[str, str]
    """Role that was told from more than a name -> how."""

    def sentence(self) -> str:
        """The columns that neither a user named nor a name told, in words: "'weight' as the reading, the only ..."."""
        return ", ".join(f"{quoted(getattr(self, role))} as the {role} ({why})" for role, why in self.why.items())

    def ask(self, roles: Sequence[str], columns: Sequence[Any]) -> None:
        """Raise RecordError where one of these roles could not be told, for all of them at once."""
        unknown = [role for role in roles if getattr(self, role) is None]
        if not unknown:
            return
        *first, last = unknown
        which = f"columns are the {', the '.join(first)} and the {last}" if first else f"column is the {last}"
        between = {name for role in unknown for name in self.in_doubt.get(role, ())}
        likely = [name for name in columns if name in between]
        headless = "; the file has no header: write a line of names above it" if str(columns[0]) == "1" else ""
        without = ". Rows without times: --sampling-period 15s" if "time" in unknown else ""
        of = f"as likely are {listing(likely, 20)}" if len(likely) > 1 else f"there are {listing(columns, 20)}"
        raise RecordError(
            f"Which {which}? Say it with {', '.join(f'--{role}' for role in unknown)}; {of}{headless}{without}."
        )


def guess(
    frame: pd.DataFrame,
    *,
    temperature: str | None = None,
    reading: str | None = None,
    reference: str | None = None,
    time: str | None = None,
    run: str | None = None,
    no_times: Collection[str] = (),
) -> Roles:
    """Guess the roles of a log's columns from names, units and values; what the user says stays.

    `frame` (DataFrame): The log, read. `temperature`, `reading`, `reference`, `time`, `run` (str, optional): What the
    user says; a reference, which the reading is compared with, is never guessed.
    `no_times` (collection of str): Columns that are something else than the times. Raises
    RecordError where the temperature or the reading has cells that are words.
    """
    why: dict[str, str] = {}
    in_doubt: dict[str, tuple[str, ...]] = {}
    given = {name for name in (temperature, reading, reference, time, run) if name}
    known = set(given)
    if time is None and not isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex):
        time = time_of(frame, {*known, *no_times}, why)
    if run is None:
        run = next((str(c) for c in frame.columns if str(c).strip().lower() in RUNS and str(c) not in known), None)
    known |= {name for name in (time, run) if name}
    words = frame.attrs.get("words", {})
    numbers = [str(c) for c in frame.columns if kind_of(frame[c]) == "number" or str(c) in words]
    numbers = [name for name in numbers if name not in known and not is_counter(frame[name]) and frame[name].count()]
    thermometers = [name for name in numbers if _is_temperature(name, frame)]
    others = [name for name in numbers if name not in thermometers]
    stated = [name for name in thermometers if unit_of(name, frame) in DEGREES]
    thermometers = stated or thermometers  # a unit that stands there says more than a name
    others = [name for name in others if not _stands(frame[name])] or others
    measured = [name for name in others if not SURROUNDINGS.search(name) and not SPREADS.search(name.replace("_", " "))]
    if reference is not None:
        own = thermometers if _is_temperature(reference, frame) and thermometers else numbers
        if reading is None and own:
            reading = closest(frame, own, reference)
            why["reading"] = f"closest to {quoted(reference)}"
        thermometers = [name for name in thermometers if name != reading]
        measured, others = ([name for name in some if name != reading] for some in (measured, others))
        if temperature is None and reading is not None and not thermometers:
            temperature, why["temperature"] = reading, "its own"
    if temperature is None:
        exact = [
            name for name in thermometers if bare_name(name) in ("temperature", "ambient_temperature", "temperatur")
        ]
        found = exact[:1] or moving(frame, thermometers)
        if len(found) > 1:
            temperature = leading(frame, found)
            why["temperature"] = f"it leads {listing([name for name in found if name != temperature], 3)}"
        elif found:
            temperature = found[0]
        elif len(others) == 1 and reading is not None:
            temperature, why["temperature"] = others[0], "the only other column"
        in_doubt["temperature"] = tuple(others)
    if reading is None:
        called = [name for name in measured if READINGS.search(name_and_unit(name)[0].strip())]
        exact = [name for name in numbers if bare_name(name) == "reading" and name != temperature]
        found = next((names for names in (exact, called, measured, others) if len(names) == 1), [])
        if found:
            reading = found[0]
            if found not in (exact, called):
                why["reading"] = "the only other column" if len(others) == 1 else "the others are of its surroundings"
        in_doubt["reading"] = tuple(called if len(called) > 1 else measured or others)
    if temperature is None and reading is not None:
        rest = [name for name in others if name != reading]
        if len(rest) == 1 and not SURROUNDINGS.search(rest[0]) and not _stands(frame[rest[0]]):
            temperature, why["temperature"] = rest[0], "the only other column"
    told = {"temperature": temperature, "reading": reading, "time": time}
    for role, name in told.items():
        alike = [] if name is None else [str(c) for c in frame.columns if _plain(str(c)) == _plain(name)]
        if name is not None and name not in given and len(alike) > 1 and name != _plain(name):  # one name for several
            told[role], in_doubt[role] = None, tuple(alike)
            why.pop(role, None)
    temperature, reading, time = told.values()
    for name in (temperature, reading):
        if name in words:
            raise RecordError(
                f"{quoted(name)} holds {words[name]!r} in some rows, and no number. If it says that there is no value, "
                f"pass --na={shlex.quote(words[name])}; if these rows are damaged, pass over them with --skip-bad-rows."
            )
    return Roles(temperature, reading, time, run, in_doubt, why)


_ZONE = re.compile(r"(?:^|[\s\[(<,])(?:UTC|GMT)\s?(?P<offset>[+-]\d{1,2}(?::?\d{2})?)?(?:$|[\s\])>])")


def zone_in_name(column: str) -> str:
    """The offset from UTC that the name of a column of times gives, as ``+08:00``; "" for none.

    Examples
    --------
    >>> zone_in_name("Datetime[UTC+8]"), zone_in_name("Date Time, GMT-07:00"), zone_in_name("Time (UTC)")
    ('+08:00', '-07:00', '+00:00')
    """
    found = _ZONE.search(column)
    if found is None:
        return ""
    sign, digits = (found["offset"] or "+0")[0], (found["offset"] or "+0")[1:].replace(":", "")
    hours, minutes = (digits, "00") if len(digits) <= 2 else (digits[:-2], digits[-2:])
    return f"{sign}{hours:0>2}:{minutes}"


def reading_among(names: Sequence[str]) -> str | None:
    """The reading of several series, by their names alone; None where several could be it, or none."""
    others = [name for name in names if not TEMPERATURES.search(name) and not SURROUNDINGS.search(name)]
    called = [name for name in others if READINGS.search(name)]
    return next((some[0] for some in (called, others) if len(some) == 1), None)


def time_of(frame: pd.DataFrame, taken: Collection[str] = (), why: dict[str, str] | None = None) -> str | None:
    """The column of times: by its name, as the only one of dates, or as numbers that are called like times."""
    names = [str(name) for name in frame.columns if str(name) not in taken]
    dates = [name for name in names if _has_dates(frame[name])]
    universal = [name for name in dates if zone_in_name(name) == "+00:00"]
    time = universal[0] if len(dates) > len(universal) == 1 else named_time(names)
    if time is not None and not (time in dates and _stands(frame[time])):
        return time
    dates = [name for name in dates if not _stands(frame[name])] or dates
    if dates:
        steady = min(dates, key=lambda name: _unevenness(frame[name]))
        if why is not None:
            why["time"] = "the only column of dates" if len(dates) == 1 else "of the columns of dates the steadiest"
        return steady
    clocks = [name for name in names if name.strip().lower() == "hhmm"]
    clocks = clocks or [name for name in names if CLOCKS.search(name.strip()) and _rises(frame[name])]
    if not clocks and all(name.isdigit() for name in map(str, frame.columns)):  # no name tells anything
        clocks = [name for name in names[:1] if _rises(frame[name])]
    if clocks and why is not None:
        why["time"] = "it goes forward from row to row"
    return next(iter(clocks), None)


def named_time(names: Sequence[str]) -> str | None:
    """The column of times by its name alone, whatever stands behind it in brackets; None where none is called so.

    Examples
    --------
    >>> named_time(["T", "Datetime[UTC+8]"]), named_time(["T", "R"])
    ('Datetime[UTC+8]', None)
    """
    exact = {name: name for name in reversed(names)}
    bare = {bare_name(name): name for name in reversed(names) if bare_name(name) != "t"}
    cut = {re.split(r"[\[(<,]", name)[0].strip().lower(): name for name in reversed(names) if name.strip() != "T"}
    cut.pop("t", None)
    return next((known[name] for known in (exact, bare, cut) for name in TIME_NAMES if name in known), None)


def is_counter(column: pd.Series[Any]) -> bool:
    """True if a column counts the rows, whatever it is called: whole numbers, each one more than the one before."""
    if kind_of(column) != "number" or len(column) < FEWEST:
        return False
    values = column.to_numpy(float)
    return bool(values[0] % 1 == 0 and (np.diff(values) == 1).all())


def closest(frame: pd.DataFrame, names: Sequence[str], reference: str) -> str:
    """The column that differs least from the reference: it measures the same."""
    true = _values(frame[reference])
    return min(names, key=lambda name: float(np.nanmedian(np.abs(_values(frame[name]) - true))))


def moving(frame: pd.DataFrame, names: Sequence[str]) -> list[str]:
    """Of several thermometers those that move: no set points, whose few levels stand while others change."""
    moved = {name: float(np.mean(np.diff(_values(frame[name])) != 0)) for name in names}
    # Share of the steps of the liveliest thermometer in which another one moves, at most, if it is a set point
    found = [name for name in names if moved[name] > 0.1 * max(moved.values(), default=0.0)]
    return found or list(names)


def leading(frame: pd.DataFrame, names: Sequence[str]) -> str:
    """Of several thermometers the one whose changes the others follow: heat reaches it first.

    Two are compared by the change over k rows of one against that over the k rows behind it of the other, and the other
    way round, where k (1, 2, 4, ...) tells them apart most.
    """
    # Rows at most that tell which of two thermometers leads
    rows = np.column_stack([_values(frame[name].iloc[:20_000]) for name in names])
    rows = rows[np.isfinite(rows).all(axis=1)]
    ahead = np.zeros(len(names))
    for a, b in combinations(range(len(names)), 2):
        lead = _lead(rows[:, a], rows[:, b])
        ahead[a] += lead > 0
        ahead[b] += lead < 0
    return names[int(ahead.argmax())]


def _lead(x: np.ndarray, y: np.ndarray) -> float:
    """Lead of x over y, from -1 to 1; positive where x leads."""
    most, k = 0.0, 1
    while 8 * k <= len(x):
        dx, dy = x[k:] - x[:-k], y[k:] - y[:-k]
        size = float(np.std(dx) * np.std(dy))
        if size > 0:
            lead = float(np.mean(dx[:-k] * dy[k:]) - np.mean(dx[k:] * dy[:-k])) / size
            most = lead if abs(lead) > abs(most) else most
        k *= 2
    return most


def _plain(name: str) -> str:
    """A name without the number of its column, which one that stands there several times has."""
    return re.sub(r" \(column \d+\)$", "", name)


def bare_name(name: object) -> str:
    """A column's name without its unit, in small letters."""
    return name_and_unit(str(name))[0].strip().lower()


def _is_temperature(name: str, frame: pd.DataFrame) -> bool:
    unit = unit_of(name, frame)
    if unit in DEGREES:
        return not SURROUNDINGS.search(name) and not SPREADS.search(name.replace("_", " "))
    called = not unit and bool(TEMPERATURES.search(name_and_unit(name)[0].strip()))
    return called and not SURROUNDINGS.search(name) and not SPREADS.search(name.replace("_", " "))


def _has_dates(column: pd.Series[Any]) -> bool:
    kind = kind_of(column)
    return kind in ("date", "span") or (kind == "text" and is_moment(first_cell(column)))


def _values(column: Any) -> np.ndarray:
    """Numbers of a column, NaN for its words."""
    return np.asarray(pd.to_numeric(column, errors="coerce"), float)


def _stands(column: pd.Series[Any]) -> bool:
    """True if a column has one value alone."""
    return len(column) > 1 and column.nunique() == 1


def _unevenness(column: Any) -> float:
    """Spread of the steps of dates over the usual one; large for other values and for steps back."""
    times = pd.to_datetime(column, errors="coerce", format="mixed", utc=True) if kind_of(column) == "text" else column
    steps = times.diff().dt.total_seconds().to_numpy()[1:]
    usual = float(np.median(steps)) if len(steps) and np.isfinite(steps).all() else 0.0
    return float(np.mean(np.abs(steps - usual)) / usual) if usual > 0 else np.inf


def _rises(column: pd.Series[Any]) -> bool:
    """True if numbers go up from row to row."""
    return kind_of(column) == "number" and bool((np.diff(column.to_numpy(float)) > 0).all()) and len(column) > 1
