"""Where the lines of a log come from: a file, one that grows, a pipe. Whole lines only."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from ..files.appending import Position, position
from ..foreign.values import is_unit, is_value
from ..records import RecordError
from ..records.csvlines import LONGEST, fields_of
from ..records.grammar import is_missing
from .stopping import StopSignal

POLL = 0.1
"""Time between looks at a log that does not grow [s]."""
PATIENCE = 1.0
"""How long the rest of a line is waited for once the command is told to stop [s]."""
CHUNK = 1 << 16
"""Bytes, or rows, that are read together."""


class Lines:
    """Base: iterate for whole lines, each with its line end; None where nothing is new at the moment."""

    rest = b""
    """What came behind the last whole line, once the lines have ended."""
    restarted = False
    """Whether the next line is the first of another file."""

    def __iter__(self) -> Iterator[bytes | None]:
        raise NotImplementedError

    def position(self) -> Position | None:
        """How far the lines have come in their file; None where they cannot be had again."""
        return None

    def place(self, number: int) -> str:
        """Where the line of this number, the header being the first, stands for who looks into the file."""
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

    Parameters
    ----------
    path : Path
    follow : bool
        Wait for more at the end.
    idle : float, optional
        End after so long without a new line [s]; never by default.
    stop : StopSignal
        Ends the lines.
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
        """How far the lines have come."""
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

    Parameters
    ----------
    descriptor : int
    idle, stop : see `FileLines`
    own : bool
        Close it at the end.
    """

    def __init__(self, descriptor: int, idle: float | None, stop: StopSignal, own: bool = False):
        self.descriptor, self.idle, self.stop, self.own = descriptor, idle, stop, own
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
        until = time.monotonic() + PATIENCE
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
        if not self._begun and self._before and _has_names(self._before, line):
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
    """Whether a comment is the header: the line behind it has as many cells, and these are values, or units alone."""
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
    """Whether a read would not wait."""
    if os.name == "nt":  # pragma: no cover
        return True
    return bool(select.select([descriptor], [], [], seconds)[0])


def _replaced(file: BinaryIO, path: Path) -> bool:
    try:
        now, opened = path.stat(), os.fstat(file.fileno())
    except FileNotFoundError:  # being replaced: look again later
        return False
    return now.st_ino != opened.st_ino or now.st_size < file.tell()
