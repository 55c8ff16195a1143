"""The process that computes: it holds the bench, does what it is told, and finds out the rest while nobody asks."""

from __future__ import annotations

import _thread
import contextlib
import os
import queue
import shutil
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any

from ...estimators.progress import one_blas_thread
from ...records import RecordError
from ..bench import Bench
from ..learning import sentence
from ..opening import Opening
from ..snapshots import snapshot
from ..takeaway import past_node, taken
from ..tiles import Store

CANCELLED = "Cancelled: everything stands as it was."


class Interruptible:
    """Work that another thread may interrupt, once, and nothing but this work."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running = self._asked = self._raised = False
        self.number = 0
        """Which work it is, counted from the first."""
        signal.signal(signal.SIGINT, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        # a key pressed in the terminal is nothing to this process: it ends the server, which ends it
        if self._running and self._asked and not self._raised:
            self._raised = True
            raise KeyboardInterrupt

    def interrupt(self, number: int | None = None) -> None:
        """Interrupt what is running, if anything is; only the work of a number, if one is given."""
        with self._lock:
            if self._running and not self._asked and number in (None, self.number):
                self._asked = True
                _thread.interrupt_main()

    def run(self, work: Callable[[], Any]) -> tuple[bool, Any]:
        """Whether the work came to its end, and what it returned."""
        with self._lock:
            self._asked = self._raised = False
            self.number += 1
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

    `pipe` (Connection): To the server. What comes: ("do", number, asked), ("take", number, kind), ("open", number,
    Opening) and ("cancel",). What goes: ("snapshot", dict, curves, charts, past), ("progress", text), ("done",
    number, result) and ("failed", number, sentence). `folder` (str): Where curves and what is taken away are put;
    removed at the end.
    """

    def __init__(self, pipe: Connection, folder: str):
        self.pipe = pipe
        self.folder = Path(folder)
        self.store = Store(folder)
        self.bench: Bench | None = None
        self.work = Interruptible()
        self.messages: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
        self.chore = 0
        """Number of the work that is a chore, while one is done."""
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            try:
                message = self.pipe.recv()
            except (EOFError, OSError):  # the server has gone
                shutil.rmtree(self.folder, ignore_errors=True)
                os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))  # nothing else ends it at once
                return
            if message[0] == "cancel":
                self.work.interrupt()
                continue
            self.messages.put(message)
            if self.chore:
                self.work.interrupt(self.chore)

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
        self.say("snapshot", snapshot(bench), curves, charts, past_node(bench.past))

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
        self.chore = self.work.number + 1
        ended, _ = self.work.run(work) if self.messages.empty() else (True, None)
        self.chore = 0
        if not ended and self.messages.empty() and self.bench is not None and self.bench.current is not None:
            for name in ("errors", "diagnosis"):  # cancelled by the user: not begun again by itself
                self.bench.current.said.setdefault(name, "Stopped. Judge again to go on.")
            self.bench.current.charts = self.bench.current.charts or []
        self.show()

    def _answer(self, kind: str, number: int, given: Any) -> None:
        words = {"open": "reading the log", "take": "writing"}.get(kind, "fitting the model")
        self.say("progress", words)
        before = self._stands()
        try:
            ended, result = self.work.run(lambda: getattr(self, f"_{kind}")(given))
            self.show()
        except MemoryError:
            self.say("failed", number, "There is not enough memory for this. Open a shorter log.")
        except Exception as error:  # effects of the user's own raise whatever they like
            self.say("failed", number, sentence(error))
        else:
            cancelled = not ended and self._stands() is before
            self.say("failed", number, CANCELLED) if cancelled else self.say("done", number, result or {})

    def _stands(self) -> Any:
        """What is another object as soon as something was done."""
        return None if self.bench is None else self.bench.past

    def _open(self, opening: Opening) -> None:
        bench = opening.bench(self.store)
        if self.bench is not None:  # its curves stay until the other one stands
            kept = self.bench.kept.values()
            bench.needed = frozenset(name for found in kept for name in found.curves.values())
        bench.start()
        self.bench, bench.needed = bench, frozenset()

    def _do(self, asked: dict[str, Any]) -> dict[str, Any]:
        if self.bench is None:
            raise RecordError("The log is still being read, or cannot be. Try again in a moment.")
        return self.bench.perform(asked)

    def _take(self, kind: str) -> str:
        if self.bench is None:
            raise RecordError("The log is still being read, or cannot be. Try again in a moment.")
        return str(taken(self.bench, kind, self.folder))


def serve(pipe: Connection, folder: str, opening: Opening, not_its_own: Connection | None = None) -> None:
    """What the process runs.

    `pipe` (Connection). `folder` (str). `opening` (Opening). `not_its_own` (Connection, optional): The server's end
    of the pipe, which a forked process must close to see that the server has gone.
    """
    for name in ("SIGTERM", "SIGHUP", "SIGQUIT"):  # it ends with the server, which removes what it wrote
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if not_its_own is not None:
        not_its_own.close()
    with one_blas_thread(), contextlib.suppress(BrokenPipeError):
        Worker(pipe, folder).run(opening)
