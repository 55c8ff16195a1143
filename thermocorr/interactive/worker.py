"""The process that computes: it holds the bench, does what it is told, and finds out the rest while nobody asks."""

from __future__ import annotations

import _thread
import os
import queue
import shutil
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any

from ..estimators.threads import one_blas_thread
from ..foreign import HowToRead
from ..records import RecordError
from .arrangement import Settings
from .bench import Bench
from .own_effects import effects_in
from .roles import guessed
from .session_file import reopened, with_steps
from .snapshots import snapshot
from .source import built_in, opened
from .takeaway import taken
from .tiles import Store

CANCELLED = "Cancelled: everything stands as it was."


@dataclass(frozen=True, kw_only=True)
class Opening:
    """What a workbench is opened with."""

    paths: tuple[str, ...] = ()
    """Files of the log; none for a built-in record."""
    sample: str = ""
    """Which built-in record; the first by default."""
    names: tuple[str, ...] = ()
    """What they are called, if that is not their paths' ends."""
    how: HowToRead = field(default_factory=HowToRead)
    join: bool = False
    named: dict[str, str] = field(default_factory=dict)
    """Columns whose role the user has said."""
    settings: Settings = field(default_factory=Settings)
    own_file: str = ""
    session: str = ""
    """File of a session to go on with."""
    steps: Any = None
    """Steps to stand on the bench, as a session file has them."""

    def bench(self, store: Store) -> Bench:
        """The bench, its log read; RecordError where that cannot be."""
        own = effects_in(self.own_file) if self.own_file else ()
        if self.session:
            bench = reopened(self.session, store, own)
        else:
            if self.paths:
                source = opened(self.paths, self.how, join=self.join, names=self.names)
            else:
                source = built_in(self.sample)
            roles = guessed(source.frame, **self.named)
            bench = Bench(source, store, roles=roles, settings=self.settings, own=own, own_file=self.own_file)
        if self.steps is not None:
            bench = with_steps(bench, self.steps)
        return bench


class Interruptible:
    """Work that another thread may interrupt, once, and nothing but this work."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running = self._asked = self._raised = False
        signal.signal(signal.SIGINT, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        # a key pressed in the terminal is nothing to this process: it ends the server, which ends it
        if self._running and self._asked and not self._raised:
            self._raised = True
            raise KeyboardInterrupt

    def interrupt(self) -> None:
        """Interrupt what is running, if anything is."""
        with self._lock:
            if self._running and not self._asked:
                self._asked = True
                _thread.interrupt_main()

    def run(self, work: Callable[[], Any]) -> tuple[bool, Any]:
        """Whether the work came to its end, and what it returned."""
        self._asked = self._raised = False
        try:
            self._running = True
            result = work()
            with self._lock:
                self._running = False
            return True, result
        except KeyboardInterrupt:
            return False, None
        finally:
            self._running = False


class Worker:
    """The loop of the process.

    Parameters
    ----------
    pipe : Connection
        To the server. What comes: ("do", number, asked), ("take", number, kind), ("open", number, Opening) and
        ("cancel",). What goes: ("snapshot", dict, curves, charts, steps), ("progress", text), ("done", number, result)
        and ("failed", number, sentence).
    folder : str
        Where curves and what is taken away are put; removed at the end.
    """

    def __init__(self, pipe: Connection, folder: str):
        self.pipe = pipe
        self.folder = Path(folder)
        self.store = Store(folder)
        self.bench: Bench | None = None
        self.work = Interruptible()
        self.messages: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
        self.chore = False
        self.failure = ""
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            try:
                message = self.pipe.recv()
            except (EOFError, OSError):  # the server has gone
                shutil.rmtree(self.folder, ignore_errors=True)
                os.kill(os.getpid(), signal.SIGTERM)  # from a thread: nothing else ends the main one at once
                return
            if message[0] == "cancel":
                self.work.interrupt()
                continue
            self.messages.put(message)
            if self.chore:
                self.work.interrupt()

    def say(self, *message: Any) -> None:
        """Send to the server."""
        self.pipe.send(message)

    def show(self) -> None:
        """Send what the screen shows."""
        bench = self.bench
        if bench is None:
            return
        curves = {key: dict(found.curves) for key, found in bench.kept.items()}
        charts = {key: found.charts for key, found in bench.kept.items() if found.charts is not None}
        steps = [act.node() for act in bench.acts]
        self.say("snapshot", snapshot(bench), curves, charts, steps)

    def run(self, opening: Opening) -> None:
        """Open a log, then do what comes."""
        self.messages.put(("open", 0, opening))
        while True:
            chore = None
            if self.messages.empty() and self.bench is not None:
                chore = self.bench.next_chore()
            if chore is not None:
                self._do_chore(*chore)
            else:
                self.say("progress", "")
                self._answer(*self.messages.get())

    def _do_chore(self, words: str, work: Callable[[], None]) -> None:
        self.say("progress", words)
        self.chore = True
        ended, _ = self.work.run(work) if self.messages.empty() else (True, None)
        self.chore = False
        if not ended and self.messages.empty() and self.bench is not None and self.bench.current is not None:
            for name in ("errors", "diagnosis"):  # cancelled by the user: not begun again by itself
                self.bench.current.said.setdefault(name, "Stopped. Judge again to go on.")
            self.bench.current.charts = self.bench.current.charts or []
        self.show()

    def _answer(self, kind: str, number: int, given: Any) -> None:
        words = {"open": "reading the log", "take": "writing"}.get(kind, "fitting the model")
        self.say("progress", words)
        try:
            ended, result = self.work.run(lambda: getattr(self, f"_{kind}")(given))
        except MemoryError:
            self.say("failed", number, "There is not enough memory for this. Open a shorter log.")
        except (ValueError, TypeError, ArithmeticError, OSError, ImportError, RecordError) as error:
            self.say("failed", number, " ".join(str(error).split()) or type(error).__name__)
        else:
            self.show()
            self.say("done", number, result) if ended else self.say("failed", number, CANCELLED)

    def _open(self, opening: Opening) -> None:
        bench = opening.bench(self.store)
        bench.start()
        self.bench = bench

    def _do(self, asked: dict[str, Any]) -> dict[str, Any]:
        if self.bench is None:
            raise RecordError("No log is open.")
        return self.bench.perform(asked)

    def _take(self, kind: str) -> str:
        if self.bench is None:
            raise RecordError("No log is open.")
        return str(taken(self.bench, kind, self.folder))


def serve(pipe: Connection, folder: str, opening: Opening, not_its_own: Connection | None = None) -> None:
    """What the process runs.

    Parameters
    ----------
    pipe : Connection
    folder : str
    opening : Opening
    not_its_own : Connection, optional
        The server's end of the pipe, which a forked process must close to see that the server has gone.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if not_its_own is not None:
        not_its_own.close()
    with one_blas_thread():
        Worker(pipe, folder).run(opening)
