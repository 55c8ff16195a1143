"""Lines of a foreign log, one by one, as plain CSV: for a log that grows while it is read."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pandas as pd

from ..records import RecordError
from ..records.files import csv_text, fields_of
from ..records.times import dates_once
from .clocks import BEHIND_TIMES, date_form, point_for_comma, understood
from .how import HowToRead
from .roles import zone_in_name
from .sniffing import Dialect
from .text_tables import first_lines, head_dialect, text_table
from .timed import date_and_clock, unit_of_times, with_times
from .values import CLOCK, is_moment, is_number

ZONED = re.compile(r"\d(?:Z|[+-]\d{2}:?\d{2})$")
"""The end of a time with a zone of its own."""


class LineTranslator:
    """Turns the lines of a log into plain CSV, in the way that its first lines are written.

    `path` (Path): The log, which has its header and some rows already. `how` (HowToRead). `time` (callable): Finds
    the column of times of a frame; None where there is none. Raises RecordError where the first lines do not tell.
    """

    def __init__(self, path: Path, how: HowToRead, time: Callable[[pd.DataFrame], str | None]):
        with path.open("rb") as file:
            head = first_lines(file.read(1 << 16))
        if b"\0" not in head[:100]:
            # Lines, those before the header included, from which a dialect is told: a damaged one behind them is left
            # out
            head = b"".join(head.splitlines(keepends=True)[:40])
        text, found = head_dialect(head, how)
        if text is None or found is None or text.name.startswith("UTF-16") or text.name.startswith("UTF-32"):
            raise RecordError(f"{path} cannot be followed while it grows: it is no table, or in UTF-16.")
        whole = [
            name for name in ("timezone", "sort", "skip_bad_rows", "drop_duplicates", "missing") if getattr(how, name)
        ]
        if whole:
            named = ", ".join("--na" if name == "missing" else f"--{name.replace('_', '-')}" for name in whole)
            raise RecordError(f"{named} {'needs' if len(whole) == 1 else 'need'} the whole log: leave out --follow.")
        self._format = how.time_format
        if self._format is not None and "%" not in self._format:
            raise RecordError(f"--time-format {self._format!r} needs the whole log: leave out --follow.")
        self.encoding = "utf-8" if text.name == "UTF-8" else how.encoding or "cp1252"
        self.dialect: Dialect = found
        rows = [found.fields(line) for line in text.text.split("\n")[found.first :] if line.strip()]
        rows = [row[: len(found.names)] for row in rows if len(row) >= len(found.names)]
        # Rows that must be there before a dialect is told from them
        if len(rows) < (2 if how.time_format is None else 1):
            raise RecordError(f"{path} has too few rows to tell how it is written. Follow it once there are some.")
        frame = pd.DataFrame(rows, columns=list(found.names), dtype=object)
        frame.attrs["units"] = dict(found.units)
        column = time(frame)
        pair = None if column is None else date_and_clock(frame, column)
        self._joined = None if pair is None else tuple(found.names.index(name) for name in pair)
        self._time = None if column is None else found.names.index(column)
        self._in_utc = column is not None and BEHIND_TIMES.search(str(frame[column].iloc[0])) is not None
        local = (
            column is not None
            and is_moment(str(frame[column].iloc[0]))
            and not ZONED.search(str(frame[column].iloc[0]))
        )
        self._zone = zone_in_name(str(column)) if local else ""
        if self._in_utc:
            frame = frame.assign(**{str(column): frame[column].str.replace(BEHIND_TIMES, "", regex=True)})
        self._date = self._form_of(frame, column, pair, how)

        self._refuse_other_reading(head, path, how, time)

    @staticmethod
    def _form_of(frame: pd.DataFrame, column: str | None, pair: tuple[str, str] | None, how: HowToRead) -> str | None:
        if column is None or how.time_format is not None:
            return None
        numbers = is_number(str(frame[column].iloc[0])) and not unit_of_times(column, frame.attrs["units"])
        read = understood(frame[column]) if numbers else None
        if read is not None and read.times.dtype.kind == "M" and not read.unix:  # those of Unix are told row by row
            raise RecordError("Dates as such numbers need the whole log: leave out --follow.")
        return date_form(frame[column] if pair is None else frame[pair[0]] + " " + frame[pair[1]])

    def _refuse_other_reading(
        self, head: bytes, path: Path, how: HowToRead, time: Callable[[pd.DataFrame], str | None]
    ) -> None:
        """Raise RecordError where the first lines, one by one, have other times than the same lines as a whole log."""
        lines = head.split(b"\n")
        width = len(fields_of(self.header()))
        rows = [line for line in lines[self.dialect.first :] if line.strip()]
        good = [line for line in rows if len(fields_of(self.row(line))) == width]
        if not good:
            form = "" if self._format is None else f" with times as {self._format!r}"
            raise RecordError(f"None of the first lines of {path} is a row{form}. Leave out --follow, or mend them.")
        head = b"\n".join([*lines[: self.dialect.first], *good, b""])
        whole = text_table(head, path, how)
        each = text_table(self.header() + b"".join(map(self.row, good)), path, HowToRead())
        column, own = time(whole.frame), time(each.frame)
        if column is None and own is None:
            return
        with contextlib.suppress(RecordError, KeyError):
            each = replace(each, frame=each.frame[[own]])  # nothing is joined with a time that comes alone
            one = dates_once(with_times(whole, column, how).frame[str(column)])
            other = dates_once(with_times(each, own, HowToRead()).frame[str(own)])
            if one.dtype.kind == other.dtype.kind and (one.to_numpy() == other.to_numpy()).all():
                return
        raise RecordError(f"The times of {path} need the whole log: leave out --follow.")

    def header(self) -> bytes:
        """The line of names."""
        return csv_text([[name for k, name in enumerate(self.dialect.names) if not self._is_dropped(k)]])

    def row(self, line: bytes) -> bytes:
        """A line as plain CSV; an empty one for a comment; as it stands where it is no row, for others to complain."""
        text = line.decode(self.encoding, errors="replace").rstrip("\r\n")
        try:
            cells = self.dialect.row(text)
            if cells is None:
                return b"\n"
            if self._time is not None and len(cells) == len(self.dialect.names):
                said = cells[self._time] if self._joined is None else " ".join(cells[k].strip() for k in self._joined)
                cells[self._time] = self._moment(said)
        except ValueError:
            return csv_text([[f"{text[:60]!r} is not written as the rows before"]])
        return csv_text([[cell for k, cell in enumerate(cells) if not self._is_dropped(k)]])

    def _is_dropped(self, k: int) -> bool:
        """True if a column has gone into that of the times."""
        return self._joined is not None and k in self._joined and k != self._time

    def _moment(self, cell: str) -> str:
        """A date in the form of ISO 8601; ValueError for one that is written in another way."""
        if self._in_utc:
            bare = BEHIND_TIMES.sub("", cell)
            if bare == cell:
                raise ValueError(cell)
            return f"{self._local(bare.strip())}Z"
        return f"{self._local(cell)}{self._zone}"

    def _local(self, cell: str) -> str:
        """A date without a zone behind it."""
        if self._format is not None:
            return datetime.strptime(cell.strip(), self._format).isoformat()
        if self._date is None:
            return point_for_comma(cell)
        found = re.fullmatch(rf"(?P<date>.*?)(?:[T ,]+{CLOCK})?", cell.strip())
        assert found is not None  # anything is a date
        day = datetime.strptime(found["date"].replace(",", ""), self._date)
        if found["clock"] is None:
            return day.isoformat()
        hours, minutes, *seconds = map(int, found["clock"].split(":"))
        midnight = hours == 24 and minutes == sum(seconds) == 0
        if (hours > 23 and not midnight) or minutes > 59 or sum(seconds) > 60:
            raise ValueError(cell)
        if found["half"]:
            hours = hours % 12 + 12 * found["half"].lower().startswith("p")
        moment = day + timedelta(hours=hours, minutes=minutes, seconds=seconds[0] if seconds else 0)
        fraction = found["fraction"] or found["third"]
        return moment.isoformat() + (f".{fraction}" if fraction else "")
