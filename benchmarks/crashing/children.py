"""Children of this process, which have its imports; at a time or at a call that changes files they are disturbed."""

import builtins
import contextlib
import errno
import io
import mmap
import os
import resource
import signal
import struct
import sys
import time
import traceback
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import thermocorr.command.analyze  # children find it loaded, as what follows
import thermocorr.command.cli as cli
import thermocorr.command.correct as correcting
import thermocorr.command.export_c  # noqa: F401
import thermocorr.command.lines as reading
import thermocorr.files.writer as drafts

NEEDS_SPACE = ("open", "write", "fsync", "replace", "link", "mkdir")  # calls that a full disk refuses
OTHERS = ("ftruncate", "fchmod", "unlink")


@dataclass(frozen=True)
class Disturbance:
    """What happens to a process."""

    signal: int | None = None
    when: float | None = None  # the signal is sent so long after the start [s]
    call: int | None = None  # the signal, or the error, comes at this call, counted from 1
    place: str = "before"
    """Where in the call the signal comes: before it, after it, or when half of the bytes are written."""
    full: str = ""
    """The disk is full at the call: "once", or from it "on"."""
    limit: int | None = None  # no file may have more bytes

    def __str__(self) -> str:
        if self.limit is not None:
            return f"{self.limit} bytes"
        if self.call is not None:
            return f"call {self.call} ({self.full or self.place})"
        return "" if self.when is None else f"{self.when * 1e3:.1f} ms"


class Calls:
    """Counts the calls of this process once it is installed, and lets a disturbance happen. Cannot be removed.

    The count is shared with the parent, who reads there how many calls there were.
    """

    def __init__(self, disturbance: Disturbance | None, count: mmap.mmap):
        self.disturbance, self._count = disturbance or Disturbance(), count
        self._counted = NEEDS_SPACE if self.disturbance.full else (*NEEDS_SPACE, *OTHERS)

    def install(self) -> None:
        """Put a counter before each call."""
        if self.disturbance.limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.disturbance.limit,) * 2)
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


PATIENCE = 60.0  # a process that lives longer hangs [s]
SMALL = {
    (correcting, "STATE_EVERY"): 0.01,  # short logs meet as many savings as long ones
    (correcting, "BLOCK"): 100,
    (reading, "POLL"): 0.005,
    (drafts, "_OLD"): 0.0,  # what a killed process kept is old at once
}
"""Constants of the package that are other ones in children."""
LOOK = 0.0005  # time between looks at a process [s]
SIGNALS = {signal.SIGINT, signal.SIGTERM}


@dataclass
class Ended:
    """How a process ended, and what it said."""

    status: int  # exit status; less than 0 for the signal that ended it
    err: str
    calls: int  # file calls that it made
    seconds: float
    hangs: bool = False


@dataclass
class Feed:
    """What is handed over to a process piece by piece."""

    pieces: deque[bytes] = field(default_factory=deque)
    write: Callable[[bytes], Any] = len
    pause: float = 0.0  # between two pieces [s]
    finish: Callable[[], Any] | None = None  # called once, behind the last piece
    complete: Callable[[], bool] | None = None
    """Whether the process has done all that is to come: it is then told to end."""


class Child:
    """A copy of this process that does some work in a folder, with signals as a new process has them.

    It reads from `stdin`, or nothing; `close` are descriptors that are not its own.
    """

    def __init__(
        self, work: Callable[[], int], folder: Path, stdin: int | None = None, disturbance: Disturbance | None = None,
        close: tuple[int, ...] = (),
    ):  # fmt: skip
        (self.out, out), (self.err, err) = os.pipe(), os.pipe()
        self.count, self.disturbance = mmap.mmap(-1, 8), disturbance or Disturbance()
        self._status: int | None = None
        sys.stdout.flush()
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # until the child is ready for them
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # in a process with threads
                self.pid = os.fork()
            if self.pid == 0:
                for descriptor in (self.out, self.err, *close):
                    os.close(descriptor)
                given = os.open(os.devnull, os.O_RDONLY) if stdin is None else stdin
                _become((given, out, err), folder, Calls(self.disturbance, self.count), work)
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        for descriptor in (out, err):
            os.close(descriptor)
        for descriptor in (self.out, self.err):
            os.set_blocking(descriptor, False)

    def poll(self) -> int | None:
        """Its status, once it has ended."""
        if self._status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self._status = os.waitstatus_to_exitcode(status) if pid else None
        return self._status

    def attend(self, feed: Feed | None = None) -> Ended:
        """Feed it, send the signal in time, wait until it has ended."""
        wanted, feed = self.disturbance, feed or Feed()
        began, due, sent, hangs = time.monotonic(), 0.0, wanted.when is None, False
        told: list[bytes] = [b"", b""]
        while (status := self.poll()) is None:
            now = time.monotonic() - began
            if not sent and now >= wanted.when:  # type: ignore[operator]
                os.kill(self.pid, wanted.signal)  # type: ignore[arg-type]
                sent = True
            if feed.pieces and now >= due:
                feed.write(feed.pieces.popleft())
                due = now + feed.pause
            if not feed.pieces and feed.finish is not None:
                feed.finish()
                feed.finish = None
            if wanted.when is None and feed.complete is not None and not feed.pieces and feed.complete():
                os.kill(self.pid, signal.SIGTERM)
                feed.complete = None
            if now > PATIENCE and not hangs:
                hangs = True
                os.kill(self.pid, signal.SIGKILL)
            self._listen(told)
            time.sleep(LOOK)
        self._listen(told)
        for descriptor in (self.out, self.err):
            os.close(descriptor)
        err = told[1].decode("utf-8", "replace")
        return Ended(status, err, struct.unpack("q", self.count[:8])[0], time.monotonic() - began, hangs)

    def _listen(self, told: list[bytes]) -> None:
        for k, descriptor in enumerate((self.out, self.err)):
            with contextlib.suppress(BlockingIOError):
                while piece := os.read(descriptor, 1 << 16):
                    told[k] += piece


def _become(streams: tuple[int, int, int], folder: Path, calls: Calls, work: Callable[[], int]) -> NoReturn:
    """What the child does, to its end."""
    status, begun, done = 1, False, False
    try:
        for k, descriptor in enumerate(streams):
            os.dup2(descriptor, k)
        sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
        os.chdir(folder)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        for (module, name), value in SMALL.items():
            assert hasattr(module, name), f"{module.__name__} has no {name}"
            setattr(module, name, value)
        calls.install()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        begun = True
        status = work()
        done = True
        sys.stdout.flush()
    except KeyboardInterrupt as interrupt:
        if begun and not done and not _before_the_first_line(interrupt):  # else in lines that no other process has
            traceback.print_exc()
        if not done:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGINT)
    except SystemExit as ended:
        status = int(ended.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def _before_the_first_line(interrupt: KeyboardInterrupt) -> bool:
    """Whether it was raised where a function is entered that would have caught it: nothing in it can."""
    last = traceback.extract_tb(interrupt.__traceback__)[-1]
    return last.name == "main" and last.lineno == cli.main.__code__.co_firstlineno
