"""The calls by which a process changes files, counted; at one of them something happens."""

from __future__ import annotations

import builtins
import errno
import io
import mmap
import os
import resource
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

NEEDS_SPACE = ("open", "write", "fsync", "replace", "link", "mkdir")
"""Calls that a full disk refuses."""
OTHERS = ("ftruncate", "fchmod", "unlink")


@dataclass(frozen=True)
class Disturbance:
    """What happens to a process."""

    signal: int | None = None
    when: float | None = None
    """The signal is sent so long after the start [s]."""
    call: int | None = None
    """The signal, or the error, comes at this call, counted from 1."""
    place: str = "before"
    """Where in the call the signal comes: before it, after it, or when half of the bytes are written."""
    full: str = ""
    """The disk is full at the call: "once", or from it "on"."""
    limit: int | None = None
    """No file may have more bytes."""
    linkless: bool = False
    """The file system has no hard links."""

    def __str__(self) -> str:
        if self.limit is not None:
            return f"{self.limit} bytes"
        if self.call is not None:
            return f"call {self.call} ({self.full or self.place})"
        return "" if self.when is None else f"{self.when * 1e3:.1f} ms"


class Calls:
    """Counts the calls of this process once it is installed, and lets a disturbance happen. Cannot be removed.

    Parameters
    ----------
    disturbance : Disturbance, optional
    count : mmap
        Shared with the parent, who reads there how many calls there were.
    """

    def __init__(self, disturbance: Disturbance | None, count: mmap.mmap):
        self.disturbance, self._count = disturbance or Disturbance(), count
        self._counted = NEEDS_SPACE if self.disturbance.full else (*NEEDS_SPACE, *OTHERS)

    def install(self) -> None:
        """Put a counter before each call."""
        if self.disturbance.limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.disturbance.limit,) * 2)
        if self.disturbance.linkless:
            os.link = _no_links
        for name in self._counted:
            setattr(os, name, self._wrapped(name, getattr(os, name)))
        builtins.open = io.open = self._opening(io.open)  # type: ignore[assignment]

    def call(self, name: str, real: Callable[..., Any], *given: Any, **named: Any) -> Any:
        """Make a call, or what happens in its place."""
        number = struct.unpack("q", self._count[:8])[0] + 1
        self._count[:8] = struct.pack("q", number)
        wanted = self.disturbance
        on = wanted.full == "on" and number > (wanted.call or 0) > 0 and name != "replace"  # which brings files back
        if wanted.full and (number == wanted.call or on):
            if name == "write" and len(given[-1]) > 1 and number == wanted.call and wanted.full == "on":
                return real(*given[:-1], memoryview(given[-1])[: len(given[-1]) // 2])  # a short write comes first
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if wanted.signal is None or number != wanted.call:
            return real(*given, **named)
        if wanted.place == "half" and name == "write":
            real(*given[:-1], memoryview(given[-1])[: len(given[-1]) // 2])
        done = real(*given, **named) if wanted.place == "after" else None
        os.kill(os.getpid(), wanted.signal)
        if wanted.place == "half" and name == "write":
            return len(given[-1]) // 2
        return done if wanted.place == "after" else real(*given, **named)

    def _wrapped(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def called(*given: Any, **named: Any) -> Any:
            printed = name == "write" and given[0] in (1, 2)
            return real(*given, **named) if printed else self.call(name, real, *given, **named)

        return called

    def _opening(self, real: Callable[..., Any]) -> Callable[..., Any]:
        """`open` whose files count what is written to them."""
        calls = self

        class Raw(io.FileIO):
            def write(self, data: Any) -> Any:
                return calls.call("write", super().write, bytes(data))

        def opened(
            file: Any, mode: str = "r", buffering: int = -1, encoding: Any = None, errors: Any = None,
            newline: Any = None, closefd: bool = True, opener: Any = None,
        ) -> Any:  # fmt: skip
            if not set(mode) & set("wax+"):
                return real(file, mode, buffering, encoding, errors, newline, closefd, opener)
            plain = mode.replace("b", "").replace("t", "")
            made = [Raw, plain, closefd, opener]
            raw = Raw(file, *made[1:]) if isinstance(file, int) else calls.call("open", Raw, file, *made[1:])
            buffer = io.BufferedRandom(raw) if "+" in plain else io.BufferedWriter(raw)
            return buffer if "b" in mode else io.TextIOWrapper(buffer, encoding, errors, newline)

        return opened


def _no_links(*given: Any, **named: Any) -> None:
    raise OSError(errno.EPERM, os.strerror(errno.EPERM))
