"""Drafts: what a file is to hold, written beside it until it can take its place."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import stat
import time
from pathlib import Path
from typing import Any

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
