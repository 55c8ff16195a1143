"""What a log says, by Python's own csv, float and datetime: a second reading of the documented rules.

Nothing here is taken from the package's readers but the words that stand for no value.
"""

import csv
import math
import re
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from thermocorr.records.grammar import MINUS, MISSING, NO_VALUE

MOST = 1e40
_PLAIN = frozenset("0123456789+-.eE")
_USUAL = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?(Z|[+-]\d\d:\d\d)?", re.ASCII)
_FRACTION = re.compile(r"(?<=[0-9]{2})\.([0-9]+)")
_SHORT_DAY = re.compile(r"([0-9]{4})-([0-9]{1,2})-([0-9]{1,2})(?![0-9])")
_FIRST, _LAST = (int(datetime(year, 1, 1, tzinfo=UTC).timestamp()) * 10**9 for year in (1880, 2170))


@dataclass
class Roles:
    """Which column plays which role; `kind` is that of the model's times."""

    temperature: str
    reading: str
    kind: str
    time: str | None = None
    others: tuple[str, ...] = ()
    run: str | None = None
    numeric_runs: bool = False


@dataclass
class Row:
    """One line of a log: its number and what it must come to."""

    number: int
    verdict: str
    """"row" must be used, "may" may be, "out" must be left out and named, "skipped" says nothing."""
    fields: list[str] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)
    stamp: Any = None
    run: Any = None


@dataclass
class Log:
    """A whole log; `header` is None where it must be refused."""

    header: list[str] | None
    rows: list[Row] = field(default_factory=list)
    torn: bool = False  # whether something stands behind the last line end


def fields(line: bytes) -> list[str] | None:
    """Fields of a line without its line end; None for what is no line of text, [] for an empty one."""
    line = line.removesuffix(b"\r")
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError:
        return None
    if any(mark in text for mark in "\0\r\v\f"):
        return None
    try:
        rows = list(csv.reader([text], strict=True))
    except csv.Error:
        return text.split(",") if '"' not in text else None  # only a field longer than csv allows
    return rows[0] if rows else []


def header(line: bytes) -> list[str] | None:
    """Names of the columns; None for a header that must be refused."""
    names = fields(line.removeprefix(b"\xef\xbb\xbf"))
    if not names or (len(names) == 1 and (";" in names[0] or "\t" in names[0])):
        return None
    named = [name for name in names if name]
    return names if len(set(named)) == len(named) else None


def number(cell: str) -> float | None:
    """The number in a cell, NaN where it says that there is none, None where it is no number."""
    cell = cell.strip(" \t").translate(MINUS)
    word = cell.lower()
    if cell in MISSING or word in NO_VALUE or word.lstrip("+-") in NO_VALUE:
        return math.nan
    if not cell or not _PLAIN.issuperset(cell):
        return None
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if abs(value) <= MOST else None


def switch(cell: str) -> float | None:
    """The same for a recorded column, which may be true or false."""
    words = {"True": 1.0, "TRUE": 1.0, "true": 1.0, "False": 0.0, "FALSE": 0.0, "false": 0.0}
    return words.get(cell.strip(" \t"), number(cell))


def date(cell: str) -> tuple[int, bool, bool] | None:
    """Nanoseconds since 1970, whether with a zone, whether in the usual form; None for what is no date."""
    cell = cell.strip()
    if not cell.isascii():
        return None
    digits = _FRACTION.search(cell)
    plain = cell if digits is None else cell[: digits.start()] + cell[digits.end() :]
    plain = _SHORT_DAY.sub(lambda day: "-".join((day[1], day[2].zfill(2), day[3].zfill(2))), plain, count=1)
    plain = re.sub(r" (?=Z$|[+-][0-9:]+$)", "", plain)
    try:
        when = datetime.fromisoformat(plain)
    except ValueError:
        return None
    zoned = when.tzinfo is not None
    since = when - (datetime(1970, 1, 1, tzinfo=UTC) if zoned else datetime(1970, 1, 1))
    stamp = since // timedelta(microseconds=1) * 1000 + (int(digits[1][:9].ljust(9, "0")) if digits else 0)
    if not _FIRST <= stamp <= _LAST:
        return None
    return stamp, zoned, _USUAL.fullmatch(cell) is not None


def stamp(cell: str, kind: str) -> tuple[Any, bool] | None:
    """The time in a cell, and whether it must be read; None where the row has none of this kind."""
    if kind == "seconds":
        seconds = number(cell.strip())
        return None if seconds is None or math.isnan(seconds) else (seconds, True)
    found = date(cell)
    if found is None or found[1] != (kind == "datetime with time zone"):
        return None
    return found[0], found[2]


def label(cell: str, numeric: bool) -> Any:
    """The label of a run; None where there is none."""
    if cell.strip(" \t") in MISSING:
        return None
    value = number(cell) if numeric else None
    return cell if value is None or math.isnan(value) else value


def log(content: bytes, roles: Roles) -> Log:
    """What the rules make of a log, line by line."""
    *lines, torn = content.split(b"\n")
    names = header(lines[0]) if lines else None
    wanted = [roles.temperature, roles.reading, *roles.others, *(n for n in (roles.time, roles.run) if n is not None)]
    if names is None or any(name not in names for name in wanted):
        return Log(None)
    return Log(names, [_row(n, line, names, roles) for n, line in enumerate(lines[1:], 2)], bool(torn))


def _row(n: int, line: bytes, names: list[str], roles: Roles) -> Row:
    found = fields(line)
    if found is None:
        return Row(n, "out")
    comment = found and found[0].lstrip().startswith("#") and len(found) != len(names)
    if not found or found == names or comment:
        return Row(n, "skipped", found)
    if len(found) != len(names):
        return Row(n, "out", found)
    at = dict(zip(names, found, strict=True))
    values = {name: number(at[name]) for name in (roles.temperature, roles.reading)}
    values |= {name: switch(at[name]) for name in roles.others}
    when = (None, True) if roles.time is None else stamp(at[roles.time], roles.kind)
    run = label(at[roles.run], roles.numeric_runs) if roles.run is not None else None
    if None in values.values() or when is None or (roles.run is not None and run is None):
        return Row(n, "out", found)
    return Row(n, "row" if when[1] else "may", found, values, when[0], run)  # type: ignore[arg-type]
