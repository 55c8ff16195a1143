"""The lines of a log that a command was given: of plain CSV as they stand, of everything else as plain CSV."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from ..files.appending import Position
from ..foreign import ForeignTable, HowToRead, read_log, with_times
from ..foreign.containers import FEATHER, PACKED, SHEETS
from ..foreign.live_lines import LineTranslator
from ..foreign.log_files import plain_head
from ..foreign.timed import time_column
from ..records import RecordError
from ..records.files import format_of
from ..records.paths import existing_file
from ..records.types import kind_of
from .lines import CHUNK, FileLines, Lines, PipeLines
from .stopping import StopSignal


class TableLines(Lines):
    """Rows of a table that is no plain CSV, such as Parquet, as lines of plain CSV, every digit of them.

    Parameters
    ----------
    path : Path
    stop : StopSignal
    how : HowToRead, optional
        What the user says of the file.
    time : str, optional
        The column of times; by default the first that is called like one.
    """

    def __init__(self, path: Path, stop: StopSignal, how: HowToRead | None = None, time: str | None = None):
        self.path, self.stop = path, stop
        how = how or HowToRead()
        table = read_log(path, how)
        index = table.frame.index
        self.stamped = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex)
        self.time_name = str(index.name) if self.stamped and index.name is not None else "time"
        """Name of the index, where that holds the times, or of the column that does."""
        column = None if self.stamped else time_column(table.frame.columns, time, how)
        if column is not None:
            table, self.time_name = with_times(table, column, how), column
        self.frame = _numbers_as_came(table)
        self.said = table.said
        """How the file was understood."""
        self._first_line = table.first_line

    def __iter__(self) -> Iterator[bytes | None]:
        written: dict[str, Any] = {"index": self.stamped, "index_label": self.time_name}
        yield self.frame[:0].to_csv(**written).encode()
        for start in range(0, len(self.frame), CHUNK):
            for line in self._text(self.frame[start : start + CHUNK], written).removesuffix("\n").split("\n"):
                if self.stop:
                    return
                yield f"{line}\n".encode()

    def place(self, number: int) -> str:
        """The line of the file, where each row is one; else the row of the table."""
        return f"row {number - 1}" if self._first_line is None else f"line {number - 2 + self._first_line}"

    def units(self) -> Mapping[str, str]:
        """Units that the file names, below its header or in its cells."""
        return dict(self.frame.attrs.get("units", {}))

    def _text(self, part: pd.DataFrame, written: dict[str, Any]) -> str:
        try:
            part = part.assign(**{name: _written(part[name]) for name in part.columns})
            text: str = part.to_csv(header=False, **written)
            return text
        except (ValueError, ArithmeticError, NotImplementedError) as error:  # dates that Python does not know
            reason = " ".join(str(error).split())
            raise RecordError(f"{self.path} cannot be read row by row: {reason}. Are its dates damaged?") from None


def _numbers_as_came(table: ForeignTable) -> pd.DataFrame:
    """The frame of a table; times that are numbers which the log explains as they came, for `LogRows`."""
    as_numbers = table.as_came is not None and kind_of(table.as_came) == "number"
    return table.as_it_came() if as_numbers else table.frame


def _written(column: pd.Series[Any]) -> pd.Series[Any]:
    """A column whose text is its numbers' in double precision, and stands on one line."""
    if column.dtype.kind == "f":
        return column.astype(float)
    return column.replace({r"[\r\n\0]": " "}, regex=True) if kind_of(column) == "text" else column


class TranslatedLines(Lines):
    """Lines of a foreign log that grows, as plain CSV.

    Parameters
    ----------
    lines : FileLines
    translator : LineTranslator
    """

    def __init__(self, lines: FileLines, translator: LineTranslator):
        self.lines, self.translator = lines, translator
        self._seen = 0

    def __iter__(self) -> Iterator[bytes | None]:
        dialect = self.translator.dialect
        for line in self.lines:
            if line is None:
                yield None
                continue
            if self.lines.restarted:
                self.lines.restarted, self.restarted, self._seen = False, True, 0
            self._seen += 1
            if self._seen == dialect.header + 1:
                yield self.translator.header()
            elif self._seen > dialect.first:
                yield self.translator.row(line)
        self.rest = self.lines.rest

    def position(self) -> Position | None:
        """How far the lines have come."""
        return self.lines.position()

    def place(self, number: int) -> str:
        """The line of the file: others may stand before its header."""
        return f"line {number + self.translator.dialect.first - 1}"

    def units(self) -> Mapping[str, str]:
        """Units below the header."""
        return self.translator.dialect.units

    def skip_to(self, at: Position | None) -> bool:
        """Go on behind `at`, if this is the file that stood there."""
        self._seen = max(self._seen, self.translator.dialect.first)
        return self.lines.skip_to(at)

    def close(self) -> None:
        """Close the file."""
        self.lines.close()


def open_lines(
    log: str,
    follow: bool,
    idle: float | None,
    stop: StopSignal,
    how: HowToRead | None = None,
    time: str | None = None,
) -> Lines:
    """The lines of what a command was given: the name of a file, or - for standard input."""
    how = how or HowToRead()
    if log == "-":
        _refuse_foreign("standard input", how)
        return PipeLines(sys.stdin.fileno(), idle, stop)
    path = existing_file(log)
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            _refuse_foreign(str(path), how)
            return PipeLines(os.open(path, os.O_RDONLY), idle, stop, own=True)
        if _is_native(path, how, time):
            return FileLines(path, follow, idle, stop)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror}.") from None
    if follow:
        said = format_of(path)
        if said is not None or path.suffix.lower() in (*SHEETS, *FEATHER, *PACKED):
            what = path.suffix if said is None else said.name
            raise RecordError(f"{path} is {what}, which cannot be followed while it grows. Leave out --follow.")
        translator = LineTranslator(path, how, lambda names: time_column(names, time, how))
        return TranslatedLines(FileLines(path, follow, idle, stop), translator)
    return TableLines(path, stop, how, time)


def _refuse_foreign(what: str, how: HowToRead) -> None:
    if how.says_something():
        raise RecordError(f"{what} is read line by line, as plain CSV. Give a file to read it in another way.")


def _is_native(path: Path, how: HowToRead, time: str | None) -> bool:
    """Whether the lines of a file, as they stand, are plain CSV with times that need no understanding."""
    try:
        head = plain_head(path, how)
    except RecordError:  # whoever reads the lines says what is wrong with them
        return True
    if head is None:
        return False
    column = time_column(head.frame.columns, time, how)
    try:
        read = head if column is None else with_times(head, column, how)
    except RecordError:  # the whole file may tell more
        return False
    return not head.said and _numbers_as_came(read).equals(head.frame)
