"""The one writer of every output: drafts, marks, appended results, nothing torn."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import shutil
import signal
import stat
import threading
import time
from collections.abc import Iterable, Iterator
from os import PathLike
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO, NamedTuple

from ..records import RecordError
from ..records.errors import way

TEXT_MARK = "# Written by thermocorr"
"""First line of a text file."""
_MARKS = (
    re.compile(rb'\{\s*"format": "thermocorr '),  # model file
    re.compile(rb'\{\s*"nbformat": 4,.{0,2000}thermocorr', re.DOTALL),  # notebook of the workbench
    re.compile(rb'\{"stream": \{"format": "thermocorr stream'),  # state of a live correction
    re.compile(rb'<!DOCTYPE html>.{0,4000}<meta name="generator" content="thermocorr">', re.DOTALL),  # report
    re.compile(rb"/\*.{0,2000}Made by thermocorr", re.DOTALL),  # C source
    re.compile(re.escape(TEXT_MARK.encode())),
    re.compile(  # corrected log: its last columns
        rb"[^\n]*\bcorrected(_thermocorr)?,(model(_thermocorr)?,residual(_thermocorr)?|bias(_thermocorr)?),"
        rb"flag(_thermocorr)?(,smoothed(_thermocorr)?)?(,reference(_thermocorr)?)?(,u(_thermocorr)?)?"
        rb"(,u_smoothed(_thermocorr)?)?\r?\n"
    ),
)


def bears_mark(path: Path) -> bool:
    """True if thermocorr wrote this file, or nothing is in it."""
    with path.open("rb") as file:
        # Bytes of a file that are looked at; the header line of a wide log is long
        head = file.read(1 << 16)
    return not head or any(mark.match(head) for mark in _MARKS)


SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Keep SIGINT and SIGTERM waiting, until the end of the block.

    The handlers are put aside: a signal that is only masked comes through where the process has more than one thread.
    Outside of the main thread, which alone handles signals, there is nothing to keep waiting.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        for number, handler in before.items():
            if handler is not None:  # else it is not Python's
                signal.signal(number, note)
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        for late in came:
            signal.raise_signal(late)


try:
    import fcntl
except ImportError:  # pragma: no cover - Windows: drafts of killed processes stay
    fcntl = None  # type: ignore[assignment]

ENDING = ".draft"
KEPT = ".before"
"""Ending of what a set of files keeps of those that it replaces, until all have taken their places."""
_OLD = 60.0  # what was kept so long ago [s] has been forgotten by a process that was killed
_SHOWN = 40  # characters of the target's name in that of its draft: names may be as long as the file system allows


class Draft:
    """An open draft of `target`, with the mode and owner of the file that it is to replace.

    It is locked while it lives: a draft that nobody holds was left by a process that was killed, and is removed when
    the next one for the same target is made.
    """

    def __init__(self, target: Path):
        self.target = target
        remove_left(target)
        while not self._opened():  # swept away by another one before it was locked
            pass

    def _opened(self) -> bool:
        self.path = draft_name(self.target)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
        descriptor = os.open(self.path, flags, 0o666)
        try:
            if not lock(descriptor) or not os.fstat(descriptor).st_nlink:
                os.close(descriptor)
                return False
            _resemble(descriptor, self.target)
            self.file = os.fdopen(descriptor, "w+b")
        except BaseException:
            os.close(descriptor)
            self.path.unlink(missing_ok=True)
            raise
        return True

    def finish(self) -> None:
        """Bring everything to the disk."""
        self.file.flush()
        os.fsync(self.file.fileno())

    def replace(self) -> None:
        """Take the target's place; what was written stays open."""
        os.replace(self.path, self.target)

    def close(self) -> None:
        """Close the file; a draft that has not taken its place is removed."""
        with contextlib.suppress(OSError):  # a full disk, which has been said
            self.file.close()
        self.path.unlink(missing_ok=True)


def draft_name(target: Path, ending: str = ENDING) -> Path:
    """A name that no file has, beside the target."""
    return target.with_name(f"{_beginning(target)}{secrets.token_hex(8)}{ending}")


def remove_left(target: Path) -> None:
    """Remove what killed processes left of this target: drafts that nobody holds, and files kept long ago."""
    if fcntl is None:  # pragma: no cover
        return
    named = re.compile(re.escape(_beginning(target)) + f"[0-9a-f]{{16}}({re.escape(ENDING)}|{re.escape(KEPT)})")
    for left in target.parent.iterdir():
        if not named.fullmatch(left.name):
            continue
        with contextlib.suppress(OSError), left.open("rb") as file:
            if left.name.endswith(KEPT) and time.time() - left.stat().st_ctime < _OLD:
                continue
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            left.unlink()


def sync_folder(folder: Path) -> None:
    """Bring names of files to the disk, where the system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _beginning(target: Path) -> str:
    return f".{target.name[:_SHOWN]}."


def lock(descriptor: int) -> bool:
    """Lock an open file; False where another one holds it. File systems without locks give all what they want."""
    if fcntl is None:  # pragma: no cover
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _resemble(descriptor: int, target: Path) -> None:
    """Mode and owner of the file that is to be replaced; a new file has what the process gives."""
    try:
        there: Any = target.stat()
    except FileNotFoundError:
        return
    own = os.fstat(descriptor)
    if hasattr(os, "fchown") and (own.st_uid, own.st_gid) != (there.st_uid, there.st_gid):
        with contextlib.suppress(PermissionError):
            os.fchown(descriptor, there.st_uid, there.st_gid)
    if hasattr(os, "fchmod"):
        os.fchmod(descriptor, stat.S_IMODE(there.st_mode))


Name = str | PathLike[str]


class OutputError(OSError, RecordError):
    """A file cannot be written, or must not be; what stood there before stands there still."""


class Outputs:
    """A set of output files that take their places together.

    Each file is written as a draft in its own folder, brought to the disk, and renamed when the whole set is ready:
    whatever goes wrong before, nothing has changed. Renaming follows links, and keeps mode and owner. (A process that
    is killed between two renamings leaves whole files, some of them new.)

    `inputs` (paths): Files that are read: none of them may be written. `force` (bool, default False): Overwrite files
    that thermocorr did not write.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> with Outputs(inputs=["log.csv"]) as outputs:
    ...     outputs.write(folder / "a.txt", "one")
    ...     outputs.write(folder / "b.txt", "two")
    >>> sorted(path.name for path in folder.iterdir())
    ['a.txt', 'b.txt']
    """

    def __init__(self, inputs: Iterable[Name] = (), force: bool = False):
        self.force = force
        self._inputs = [Path(path) for path in inputs]
        self._claimed: dict[Path, Path] = {}
        self._opened: set[Path] = set()
        self._drafts: list[Draft] = []
        self._devices: list[BinaryIO] = []

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.commit()
        else:
            self.discard()

    def claim(self, path: Name) -> Path:
        """Say early that a file will be written: its folder is made, and all reasons against it are raised now.

        Raises OutputError for an input or another output under whatever name, a file without thermocorr's mark
        (unless forced), a folder in its place, a place that cannot be written to.
        """
        path = Path(path)
        with _said(path):
            target = _target(path)
            self._refuse_same(path, target)
            if target.is_dir():
                raise OutputError(f"{path} is a directory and cannot be written. Name a file in it.")
            if target.exists() and _regular(target) and not self.force and not bears_mark(target):
                raise OutputError(
                    f"{path} is there already and was not written by thermocorr. Name another file, or overwrite it "
                    f"with {way('--force', 'force=True')}."
                )
            target.parent.mkdir(parents=True, exist_ok=True)
            if not os.access(target if target.exists() and not _regular(target) else target.parent, os.W_OK):
                raise OutputError(f"{path} cannot be written: no permission. Choose another place.")
            self._claimed[target] = path
        return target

    def open(self, path: Name) -> BinaryIO:
        """A file to write to; it takes its place at `commit`. Devices and pipes are written to at once."""
        with _said(Path(path)):
            target = _target(path)
            if target not in self._claimed:
                self.claim(path)
            elif target in self._opened:
                raise OutputError(f"{path} would be written twice by this command. Name another file for one of them.")
            self._opened.add(target)
            if target.exists() and not _regular(target):
                self._devices.append(target.open("wb"))
                return self._devices[-1]
            with uninterrupted():
                self._drafts.append(Draft(target))
            return self._drafts[-1].file

    def write(self, path: Name, content: str | bytes) -> None:
        """Write a whole file; it takes its place at `commit`."""
        data = content.encode("utf-8") if isinstance(content, str) else content
        file = self.open(path)
        with _said(Path(path)):
            file.write(data)
            file.flush()

    def commit(self) -> None:
        """Let all files take their places; if one cannot, none does."""
        try:
            self._close_devices()
            for draft in self._drafts:
                with _said(self._claimed[draft.target]):
                    draft.finish()
            with uninterrupted():
                self._replace(self._drafts)
        finally:
            self._close_drafts()

    def discard(self) -> None:
        """Forget what was written."""
        self._close_drafts()
        with contextlib.suppress(OSError):
            self._close_devices()

    def _close_drafts(self) -> None:
        with uninterrupted():
            while self._drafts:
                self._drafts.pop().close()

    def _close_devices(self) -> None:
        while self._devices:
            self._devices.pop().close()

    def _replace(self, drafts: list[Draft]) -> None:
        kept: dict[Path, Path | None] = {}
        replaced: list[Path] = []
        try:
            for draft in drafts if len(drafts) > 1 else ():  # all that needs space, before anything changes
                with _said(self._claimed[draft.target]):
                    kept[draft.target] = _kept(draft.target)
            for draft in drafts:
                with _said(self._claimed[draft.target]):
                    draft.replace()
                replaced.append(draft.target)
        except BaseException:
            for target in reversed(replaced):
                before = kept.pop(target)
                with contextlib.suppress(OSError):  # what cannot be brought back stays beside its place
                    target.unlink(missing_ok=True) if before is None else os.replace(before, target)
            raise
        finally:
            for before in kept.values():
                if before is not None:
                    before.unlink(missing_ok=True)
            for folder in {draft.target.parent for draft in drafts}:
                sync_folder(folder)

    def _refuse_same(self, path: Path, target: Path) -> None:
        for other in self._inputs:
            if _same(target, other):
                raise OutputError(
                    f"{path} is read by this command ({other}): its results would destroy it. Name another file."
                )
        for other in self._claimed:
            if _same(target, other):
                raise OutputError(f"{path} would be written twice by this command. Name another file for one of them.")


def write_file(path: Name, content: str | bytes, *, inputs: Iterable[Name] = (), force: bool = False) -> Path:
    """Write one file as a whole, see `Outputs`; whatever goes wrong, the one that was there before stays."""
    with Outputs(inputs, force) as outputs:
        outputs.write(path, content)
    return Path(path)


@contextlib.contextmanager
def _said(path: Path) -> Iterator[None]:
    """Turn what the system says about a file into a sentence."""
    try:
        yield
    except OutputError:
        raise
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path} cannot be written: {reason}. What was there is unchanged.") from None


def _kept(target: Path) -> Path | None:
    """A second name for what is to be replaced, to bring it back; None where there is nothing."""
    if not target.exists():
        return None
    kept = draft_name(target, KEPT)
    try:
        os.link(target, kept)
    except OSError:  # file systems without links
        try:
            shutil.copy2(target, kept)
        except BaseException:
            kept.unlink(missing_ok=True)
            raise
    return kept


def _target(path: Name) -> Path:
    """Path of a file through links. A device keeps its name: the pipe behind /dev/stdout has no other."""
    path = Path(path)
    return path if path.exists() and not _regular(path) else Path(os.path.realpath(path))


def _regular(path: Path) -> bool:
    return stat.S_ISREG(path.stat().st_mode)


def _same(target: Path, other: Path) -> bool:
    """True if two names mean one file, through links too."""
    with contextlib.suppress(OSError):
        return target.samefile(other)
    return target == Path(os.path.realpath(other))


_TAIL = 4096
_PIECE = 1 << 20


class Position(NamedTuple):
    """Position in a file: its length, and a digest of the bytes just before."""

    length: int
    digest: str

    def fits(self, path: Path) -> bool:
        """True if the file has at least this length, and stood here once."""
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

    `path` (path). `descriptor` (int): Of the open file. It is locked: two processes do not write one file.
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
