"""Processes to be ended: children of this process, which have its imports, and new ones."""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import struct
import subprocess
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

from .calls import Calls, Disturbance

PATIENCE = 60.0
"""A process that lives longer hangs [s]."""
SMALL = {
    (correcting, "STATE_EVERY"): 0.01,  # short logs meet as many savings as long ones
    (correcting, "BLOCK"): 100,
    (reading, "POLL"): 0.005,
    (drafts, "_OLD"): 0.0,  # what a killed process kept is old at once
}
"""Constants of the package that are other ones in children."""
LOOK = 0.0005
"""Time between looks at a process [s]."""
SIGNALS = {signal.SIGINT, signal.SIGTERM}


@dataclass
class Ended:
    """How a process ended, and what it said."""

    status: int
    """Exit status; less than 0 for the signal that ended it."""
    out: str
    err: str
    calls: int
    """File calls that it made."""
    seconds: float
    hangs: bool = False


@dataclass
class Feed:
    """What is handed over to a process piece by piece."""

    pieces: deque[bytes] = field(default_factory=deque)
    write: Callable[[bytes], Any] = len
    pause: float = 0.0
    """Between two pieces [s]."""
    finish: Callable[[], Any] | None = None
    """Called once, behind the last piece."""
    complete: Callable[[], bool] | None = None
    """Whether the process has done all that is to come: it is then told to end."""


class Process:
    """Base: a running process; `pid`, its pipes, and whether it has ended."""

    pid: int
    out: int
    err: int
    count: mmap.mmap | None = None

    def poll(self) -> int | None:
        """Its status, once it has ended."""
        raise NotImplementedError

    def attend(self, disturbance: Disturbance | None = None, feed: Feed | None = None) -> Ended:
        """Feed it, send the signal in time, wait until it has ended."""
        wanted, feed = disturbance or Disturbance(), feed or Feed()
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
        calls = struct.unpack("q", self.count[:8])[0] if self.count is not None else 0
        out, err = (text.decode("utf-8", "replace") for text in told)
        return Ended(status, out, err, calls, time.monotonic() - began, hangs)

    def _listen(self, told: list[bytes]) -> None:
        for k, descriptor in enumerate((self.out, self.err)):
            with contextlib.suppress(BlockingIOError):
                while piece := os.read(descriptor, 1 << 16):
                    told[k] += piece


class Child(Process):
    """A copy of this process that does some work, with signals as a new process has them.

    Parameters
    ----------
    work : callable
        Returns the exit status.
    folder : Path
        Where it works.
    stdin : int, optional
        Descriptor to read from; nothing by default.
    disturbance : Disturbance, optional
        What happens at a call.
    """

    def __init__(
        self,
        work: Callable[[], int],
        folder: Path,
        stdin: int | None = None,
        disturbance: Disturbance | None = None,
        close: tuple[int, ...] = (),
    ):
        (self.out, out), (self.err, err) = os.pipe(), os.pipe()
        self.count = mmap.mmap(-1, 8)
        self._status: int | None = None
        calls = Calls(disturbance, self.count)
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
                _become((given, out, err), folder, calls, work)
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


class NewProcess(Process):
    """A new process of the command `thermocorr`."""

    def __init__(self, arguments: list[str], folder: Path, package: Path):
        environment = {**os.environ, "PYTHONPATH": str(package)}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "thermocorr", *arguments],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: signal.signal(
                signal.SIGINT, signal.SIG_DFL
            ),  # ignored where this runs in the background
        )
        assert self._process.stdout is not None and self._process.stderr is not None
        self.pid = self._process.pid
        self.out, self.err = (os.dup(pipe.fileno()) for pipe in (self._process.stdout, self._process.stderr))
        self._process.stdout.close()
        self._process.stderr.close()
        for descriptor in (self.out, self.err):
            os.set_blocking(descriptor, False)

    def poll(self) -> int | None:
        """Its status, once it has ended."""
        return self._process.poll()
