"""A file of results that grows row by row, and can be taken up again where it stood."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from .drafts import lock, sync_folder
from .writer import Name, OutputError, Outputs

_TAIL = 4096
_PIECE = 1 << 20


class Position(NamedTuple):
    """How far a file had come: its length, and a digest of what stood just before."""

    length: int
    digest: str

    def fits(self, path: Path) -> bool:
        """Whether the file has at least this length, and stood here once."""
        try:
            with path.open("rb") as file:
                return position(file.fileno(), self.length) == self
        except OSError:
            return False


def position(descriptor: int, length: int) -> Position:
    """The position `length` of an open file, whose own place in it is kept."""
    begin, place = max(0, length - _TAIL), os.lseek(descriptor, 0, os.SEEK_CUR)
    tail = _read(descriptor, begin, length - begin)
    os.lseek(descriptor, place, os.SEEK_SET)
    return Position(begin + len(tail), hashlib.sha256(tail).hexdigest())


def _read(descriptor: int, start: int, count: int) -> bytes:
    """Bytes from the middle of an open file, fewer where it ends."""
    os.lseek(descriptor, start, os.SEEK_SET)
    pieces: list[bytes] = []
    while count > 0 and (piece := os.read(descriptor, min(count, _PIECE))):
        pieces.append(piece)
        count -= len(piece)
    return b"".join(pieces)


class AppendedFile:
    """Whole rows, one after the other; what a full disk cuts short is taken away again.

    Parameters
    ----------
    path : path
    descriptor : int
        Of the open file. It is locked: two processes do not write one file.
    """

    def __init__(self, path: Name, descriptor: int):
        self.path = Path(path)
        self._descriptor = descriptor
        self._regular = os.path.isfile(self.path)
        if self._regular and not lock(descriptor):  # a terminal and /dev/null are for all
            os.close(descriptor)
            raise OutputError(f"{path} is being written by another process. Wait for it, or name another file.")
        self._length = os.fstat(descriptor).st_size if self._regular else 0

    @classmethod
    def new(cls, path: Name, inputs: Iterable[Name] = (), force: bool = False, first: bytes = b"") -> AppendedFile:
        """A file with its first row in its place, under the rules of `Outputs`.

        A device is opened once: who reads a named pipe would take the first closing for the end.
        """
        device = os.path.exists(path) and not os.path.isfile(path)
        with Outputs(inputs, force) as outputs:
            if device:
                outputs.claim(path)
            else:
                outputs.write(path, first)
        file = cls._opened(path, os.O_WRONLY if device else os.O_RDWR)
        if device:
            file.write(first)
        return file

    @classmethod
    def resumed(cls, path: Name, at: Position) -> AppendedFile:
        """A file that stood at `at` once; rows may have come since."""
        if not at.fits(Path(path)):
            raise OutputError(
                f"{path} is not the file that the saved state goes with: it was changed or replaced since. Name "
                "another file for the rows to come, or bring it back."
            )
        return cls._opened(path)

    @classmethod
    def _opened(cls, path: Name, access: int = os.O_RDWR) -> AppendedFile:
        """Open it; a pipe for writing alone, else it would read itself and never break."""
        try:
            return cls(path, os.open(path, access | getattr(os, "O_BINARY", 0)))
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"{path} cannot be written: {error.strerror}.") from None

    def rows_behind(self, length: int) -> list[bytes]:
        """Whole rows behind the first `length` bytes; a torn one at the end is taken away."""
        rest = _read(self._descriptor, length, self._length - length)
        whole = rest.rfind(b"\n") + 1
        self.cut(length + whole)
        return rest[:whole].splitlines(keepends=True)

    def cut(self, length: int) -> None:
        """Take away what stands behind the first `length` bytes."""
        os.ftruncate(self._descriptor, length)
        self._length = length

    def write(self, rows: bytes) -> None:
        """Append whole rows; OutputError, and no part of them, where they cannot all be written."""
        try:
            if self._regular:
                os.lseek(self._descriptor, self._length, os.SEEK_SET)
            left = memoryview(rows)
            while left:
                left = left[os.write(self._descriptor, left) :]
        except BrokenPipeError:
            raise
        except OSError as error:
            if self._regular:
                with contextlib.suppress(OSError):
                    os.ftruncate(self._descriptor, self._length)
            raise OutputError(
                f"{self.path} cannot be written: {error.strerror}. The rows so far stand in it."
            ) from None
        self._length += len(rows)

    def commit(self) -> Position | None:
        """Bring all rows to the disk; returns where the file stands now, None for a device."""
        if not self._regular:
            return None
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            raise OutputError(f"{self.path} cannot be written: {error.strerror}.") from None
        return position(self._descriptor, self._length)

    def close(self) -> None:
        """Close the file; the folder knows it for good."""
        with contextlib.suppress(OSError):
            os.close(self._descriptor)
        if self._regular:
            sync_folder(self.path.resolve().parent)
