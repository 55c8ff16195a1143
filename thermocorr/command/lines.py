"""Lines of a log as they come: from a file that grows, a pipe, a table."""

from __future__ import annotations

import os
import select
import stat
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import pandas as pd

from ..files.writer import Position, position
from ..foreign import ForeignTable, HowToRead, read_log, time_of, with_times
from ..foreign.containers import FEATHER, PACKED, SHEETS
from ..foreign.live_lines import LineTranslator
from ..foreign.several import plain_head
from ..foreign.values import is_unit, is_value
from ..records import RecordError
from ..records.errors import existing_file
from ..records.files import LONGEST, csv_text, fields_of, format_of
from ..records.grammar import is_missing
from ..records.types import kind_of
from .stopping import StopSignal

POLL = 0.1
"""Time between looks at a log that does not grow [s]."""
CHUNK = 1 << 16
"""Bytes, or rows, that are read together."""


class Lines:
    """Base: iterate for whole lines, each with its line end; None where nothing is new at the moment."""

    rest = b""
    """What came behind the last whole line, once the lines have ended."""
    restarted = False
    """True if the next line is the first of another file."""

    def __iter__(self) -> Iterator[bytes | None]:
        raise NotImplementedError

    def position(self) -> Position | None:
        """Position in the file; None where the lines cannot be read again."""
        return None

    def place(self, number: int) -> str:
        """Name of a line in messages; number 1 is the header."""
        return f"line {number}"

    def units(self) -> Mapping[str, str]:
        """Units of columns that the log names elsewhere than in its header, as far as its head tells them."""
        return {}

    def skip_to(self, at: Position | None) -> bool:
        """Go on behind `at`, if this is the file that stood there."""
        return False

    def close(self) -> None:
        """Let go of the file."""


class FileLines(Lines):
    """Lines of a file; with `follow`, also those that are still to be written.

    A file that is cut or replaced (a log that rotates) is read from its beginning again.

    `path` (Path). `follow` (bool): Wait for more at the end. `idle` (float, optional): End after so long without a
    new line [s]; never by default. `stop` (StopSignal): Ends the lines.
    """

    def __init__(self, path: Path, follow: bool, idle: float | None, stop: StopSignal):
        self.path, self.follow, self.idle, self.stop = path, follow, idle, stop
        self._file: BinaryIO = path.open("rb")
        self._offset = 0

    def __iter__(self) -> Iterator[bytes | None]:
        last = time.monotonic()
        while not self.stop:
            line = self._file.readline(LONGEST)
            _refuse_endless(line, self.path)
            self.rest = b"" if line.endswith(b"\n") else line
            if line.endswith(b"\n"):
                self._offset += len(line)
                last = time.monotonic()
                yield line
                continue
            if not self.follow or (self.idle is not None and time.monotonic() - last > self.idle):
                return
            self._file.seek(self._offset)
            yield None
            time.sleep(POLL)
            if _replaced(self._file, self.path):
                self._file.close()
                self._file, self._offset, self.restarted = self.path.open("rb"), 0, True
        self.rest = b""  # the next run reads it, whole

    def position(self) -> Position | None:
        """Position in the file."""
        return position(self._file.fileno(), self._offset)

    def skip_to(self, at: Position | None) -> bool:
        """Go on behind `at`, if this is the file that stood there."""
        if at is None or not at.fits(self.path):
            return False
        self._offset = at.length
        self._file.seek(at.length)
        return True

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class PipeLines(Lines):
    """Lines of a pipe. Told to stop, it still gives what it has read, to the end of the last line.

    `descriptor` (int). `idle`, `stop` (see `FileLines`). `own` (bool): Close it at the end. `names` (sequence of str):
    Of the columns, where there is no header.
    """

    def __init__(
        self, descriptor: int, idle: float | None, stop: StopSignal, own: bool = False, names: Sequence[str] = ()
    ):
        self.descriptor, self.idle, self.stop, self.own = descriptor, idle, stop, own
        self._header = csv_text([names]) if names else b""
        self._comments = 0
        """Lines before the header, which are passed over."""
        self._begun = False
        self._before = b""
        """The comment before the line that is to come."""

    def __iter__(self) -> Iterator[bytes | None]:
        descriptor = self.descriptor
        last = time.monotonic()
        while not self.stop:
            if not _ready(descriptor, POLL):
                yield None
                if self.idle is not None and time.monotonic() - last > self.idle:
                    return
                continue
            piece = os.read(descriptor, CHUNK)
            if not piece:
                return
            last = time.monotonic()
            *whole, self.rest = (self.rest + piece).split(b"\n")
            _refuse_endless(self.rest, "The stream")
            for line in whole:
                yield from self._behind_comments(line)
        # How long the rest of a line is waited for once the command is told to stop [s]
        until = time.monotonic() + 1.0
        while self.rest and time.monotonic() < until:  # the line that is being written
            if _ready(descriptor, POLL):
                piece = os.read(descriptor, 1)
                self.rest += piece
                if piece in (b"", b"\n"):
                    break
        if self.rest.endswith(b"\n"):
            line, self.rest = self.rest, b""
            yield line

    def _behind_comments(self, line: bytes) -> Iterator[bytes]:
        """The line, but for comments before the header; the last of them is the header where rows follow at once."""
        if not self._begun and line.lstrip().startswith(b"#"):
            self._comments += 1
            self._before = line
            return
        if not self._begun and self._header:
            self._comments -= 1
            yield self._header
        elif not self._begun and self._before and _has_names(self._before, line):
            self._comments -= 1
            yield self._before + b"\n"
        self._begun = True
        yield line + b"\n"

    def place(self, number: int) -> str:
        """The line of the stream: comments may have come before its header."""
        return f"line {number + self._comments}"

    def close(self) -> None:
        """Close the pipe."""
        if self.own:
            os.close(self.descriptor)


def _has_names(comment: bytes, behind: bytes) -> bool:
    """True if a comment is the header: the line behind it has as many cells, and these are values, or units alone."""
    try:
        cells = fields_of(behind)
        if len(cells) < 2 or len(fields_of(comment)) != len(cells):
            return False
    except RecordError:
        return False
    known = [cell for cell in cells if not is_missing(cell)]
    return all(map(is_unit, known)) or 2 * sum(map(is_value, known)) >= len(known)


def _refuse_endless(line: bytes, what: object) -> None:
    if len(line) >= LONGEST and not line.endswith(b"\n"):
        raise RecordError(f"{what} has a line of more than {LONGEST} bytes. Is it a CSV log?")


def _ready(descriptor: int, seconds: float) -> bool:
    """True if a read would not wait."""
    if os.name == "nt":  # pragma: no cover
        return True
    return bool(select.select([descriptor], [], [], seconds)[0])


def _replaced(file: BinaryIO, path: Path) -> bool:
    try:
        now, opened = path.stat(), os.fstat(file.fileno())
    except FileNotFoundError:  # being replaced: look again later
        return False
    return now.st_ino != opened.st_ino or now.st_size < file.tell()


class TableLines(Lines):
    """Rows of a table that is no plain CSV, such as Parquet, as lines of plain CSV, every digit of them.

    `path` (Path). `stop` (StopSignal). `how` (HowToRead, optional): What the user says of the file. `time` (str,
    optional): The column of times; by default the first that is called like one.
    """

    def __init__(self, path: Path, stop: StopSignal, how: HowToRead | None = None, time: str | None = None):
        self.path, self.stop = path, stop
        how = how or HowToRead()
        table = read_log(path, how)
        index = table.frame.index
        self.stamped = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex)
        self.time_name = str(index.name) if self.stamped and index.name is not None else "time"
        """Name of the index, where that holds the times, or of the column that does."""
        column = None if self.stamped else _times_in(table.frame, time, how)
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

    `lines` (FileLines). `translator` (LineTranslator).
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
        """Position in the file."""
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
    form: Mapping[str, str] | None = None,
) -> Lines:
    """The lines of what a command was given: the name of a file, or - for standard input.

    `form` is how the log of the model was written, see `ForeignTable.form`: a log that grows is read so where its own
    first lines do not tell.
    """
    how = how or HowToRead()
    if log == "-":
        _refuse_foreign("standard input", how)
        return PipeLines(sys.stdin.fileno(), idle, stop, names=how.names)
    path = existing_file(log)
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            _refuse_foreign(str(path), how)
            return PipeLines(os.open(path, os.O_RDONLY), idle, stop, own=True, names=how.names)
        if _is_native(path, how, time):
            return FileLines(path, follow, idle, stop)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror}.") from None
    if follow:
        said = format_of(path)
        if said is not None or path.suffix.lower() in (*SHEETS, *FEATHER, *PACKED):
            what = path.suffix if said is None else said.name
            raise RecordError(f"{path} is {what}, which cannot be followed while it grows. Leave out --follow.")
        translator = _translator(path, how, time, dict(form or {}))
        return TranslatedLines(FileLines(path, follow, idle, stop), translator)
    return TableLines(path, stop, how, time)


def _translator(path: Path, how: HowToRead, time: str | None, form: dict[str, str]) -> LineTranslator:
    """The reader of a growing log, by its own first lines, or by the form of the model's log."""

    def times(frame: pd.DataFrame) -> str | None:
        return _times_in(frame, time, how)

    try:
        return LineTranslator(path, how, times)
    except RecordError:
        known: dict[str, Any] = {name: value for name, value in form.items() if getattr(how, name) is None}
        if not known:
            raise
        try:
            return LineTranslator(path, replace(how, **known), times)
        except RecordError:
            pass
        raise


def _times_in(frame: pd.DataFrame, named: str | None, how: HowToRead) -> str | None:
    """The column of times, as named or found; None for one that is not there."""
    return time_of(frame, how.no_times) if named is None else named if named in frame.columns else None


def _refuse_foreign(what: str, how: HowToRead) -> None:
    if replace(how, names=()).says_something():
        raise RecordError(f"{what} is read line by line, as plain CSV. Give a file to read it in another way.")


def _is_native(path: Path, how: HowToRead, time: str | None) -> bool:
    """True if the lines of a file, as they stand, are plain CSV with times that need no understanding."""
    try:
        head = plain_head(path, how)
    except RecordError:  # whoever reads the lines says what is wrong with them
        return True
    if head is None:
        return False
    column = _times_in(head.frame, time, how)
    try:
        read = head if column is None else with_times(head, column, how)
    except RecordError:  # the whole file may tell more
        return False
    return not head.said and _numbers_as_came(read).equals(head.frame)
