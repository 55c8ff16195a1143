"""Lines of a foreign log, one by one, as plain CSV: for a log that grows while it is read."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import pandas as pd

from ..records import RecordError
from .clocks import BEHIND_TIMES, date_form, point_for_comma, understood
from .how import HowToRead
from .sniffing import Dialect
from .text_tables import first_lines, head_dialect
from .timed import date_and_clock, unit_of_times
from .values import CLOCK, is_number

LINES = 40
"""Lines, those before the header included, from which a dialect is told: a damaged one behind them is left out."""
FEWEST_ROWS = 2
"""Rows that must be there before a dialect is told from them."""


class LineTranslator:
    """Turns the lines of a log into plain CSV, in the way that its first lines are written.

    `path` (Path): The log, which has its header and some rows already. `how` (HowToRead). `time` (callable): Finds
    the column of times among names; None where there is none. Raises RecordError where the first lines do not tell.
    """

    def __init__(self, path: Path, how: HowToRead, time: Callable[[tuple[str, ...]], str | None]):
        with path.open("rb") as file:
            head = first_lines(file.read(1 << 16))
        if b"\0" not in head[:100]:
            head = b"".join(head.splitlines(keepends=True)[:LINES])
        text, found = head_dialect(head, how)
        if text is None or found is None or text.name.startswith("UTF-16") or text.name.startswith("UTF-32"):
            raise RecordError(f"{path} cannot be followed while it grows: it is no table, or in UTF-16.")
        if how.timezone or how.sort:
            raise RecordError("--timezone and --sort need the whole log: leave them out, or leave out --follow.")
        self.encoding = "utf-8" if text.name == "UTF-8" else how.encoding or "cp1252"
        self.dialect: Dialect = found
        rows = [found.fields(line) for line in text.text.split("\n")[found.first :] if line.strip()]
        rows = [row[: len(found.names)] for row in rows if len(row) >= len(found.names)]
        if len(rows) < FEWEST_ROWS:
            raise RecordError(f"{path} has too few rows to tell how it is written. Follow it once there are some.")
        frame = pd.DataFrame(rows, columns=list(found.names), dtype=object)
        frame.attrs["units"] = dict(found.units)
        column = time(found.names)
        pair = None if column is None else date_and_clock(frame, column)
        self._joined = None if pair is None else tuple(found.names.index(name) for name in pair)
        self._time = None if column is None else found.names.index(column)
        self._in_utc = column is not None and BEHIND_TIMES.search(str(frame[column].iloc[0])) is not None
        if self._in_utc:
            frame = frame.assign(**{str(column): frame[column].str.replace(BEHIND_TIMES, "", regex=True)})
        self._date = self._form_of(frame, column, pair, how)

    @staticmethod
    def _form_of(frame: pd.DataFrame, column: str | None, pair: tuple[str, str] | None, how: HowToRead) -> str | None:
        if how.time_format is not None:
            raise RecordError("--time-format needs the whole log: leave it out, or leave out --follow.")
        if column is None:
            return None
        numbers = is_number(str(frame[column].iloc[0])) and not unit_of_times(column, frame.attrs["units"])
        read = understood(frame[column]) if numbers else None
        if read is not None and read.times.dtype.kind == "M" and not read.unix:  # those of Unix are told row by row
            raise RecordError("Dates as such numbers need the whole log: leave out --follow.")
        return date_form(frame[column] if pair is None else frame[pair[0]] + " " + frame[pair[1]])

    def header(self) -> bytes:
        """The line of names."""
        return self._line([name for k, name in enumerate(self.dialect.names) if not self._is_dropped(k)])

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
            return self._line([f"{text[:60]!r} is not written as the rows before"])
        return self._line([cell for k, cell in enumerate(cells) if not self._is_dropped(k)])

    def _is_dropped(self, k: int) -> bool:
        """Whether a column has gone into that of the times."""
        return self._joined is not None and k in self._joined and k != self._time

    def _moment(self, cell: str) -> str:
        """A date in the form of ISO 8601; ValueError for one that is written in another way."""
        if self._in_utc:
            bare = BEHIND_TIMES.sub("", cell)
            if bare == cell:
                raise ValueError(cell)
            return f"{self._local(bare.strip())}Z"
        return self._local(cell)

    def _local(self, cell: str) -> str:
        """A date without a zone behind it."""
        if self._date is None:
            return point_for_comma(cell)
        found = re.fullmatch(rf"(?P<date>.*?)(?:[T ,]+{CLOCK})?", cell.strip())
        assert found is not None  # anything is a date
        day = datetime.strptime(found["date"].replace(",", ""), self._date)
        if found["clock"] is None:
            return day.isoformat()
        hours, minutes, *seconds = map(int, found["clock"].split(":"))
        if hours > 23 or minutes > 59 or sum(seconds) > 60:
            raise ValueError(cell)
        if found["half"]:
            hours = hours % 12 + 12 * found["half"].lower().startswith("p")
        moment = day + timedelta(hours=hours, minutes=minutes, seconds=seconds[0] if seconds else 0)
        fraction = found["fraction"] or found["third"]
        return moment.isoformat() + (f".{fraction}" if fraction else "")

    @staticmethod
    def _line(cells: list[str]) -> bytes:
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerow(cells)
        return out.getvalue().encode()
