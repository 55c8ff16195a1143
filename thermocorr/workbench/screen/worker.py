"""The process that computes, and can be interrupted."""

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
from types import FrameType
from typing import Any

from ...model.progress import one_blas_thread
from .desk import LOOKS, Desk, Opening


class Interruptible:
    """Work that another thread may interrupt once."""

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
        """Interrupt what runs, or the work of a number."""
        with self._lock:
            if self._running and not self._asked and number in (None, self.number):
                self._asked = True
                _thread.interrupt_main()

    def run(self, work: Callable[[], None]) -> bool:
        """True if the work came to its end."""
        with self._lock:
            self._asked = self._raised = False
            self.number += 1
        try:
            self._running = True
            work()
            with self._lock:
                self._running = False
            return True
        except KeyboardInterrupt:
            return False
        finally:
            self._running = False


class ProcessDesk(Desk):
    """A desk at the end of a pipe; looking needs no waiting.

    `pipe` (Connection): To the server; brings messages, or None to cancel. `folder` (str): Of logs that were dropped on
    the page; removed at the end.
    """

    def __init__(self, pipe: Connection, folder: str):
        super().__init__(None, self._send, chores=False)
        self.pipe, self.folder = pipe, folder
        self.work = Interruptible()
        self.messages: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._chore = 0
        """Number of the work that is a chore, while one is done."""
        self._sending = threading.Lock()

    def _send(self, message: dict[str, Any]) -> None:
        with self._sending:
            self.pipe.send(message)

    def _listen(self) -> None:
        with contextlib.suppress(EOFError, OSError):  # the server has gone
            while True:
                message = self.pipe.recv()
                if message is None:
                    self.work.interrupt()
                elif message["what"] in LOOKS:
                    self.hear(message)
                else:
                    self.messages.put(message)
                    if self._chore:
                        self.work.interrupt(self._chore)
        shutil.rmtree(self.folder, ignore_errors=True)
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))  # nothing else ends it at once

    def carried(self, work: Callable[[], None], chore: bool = False) -> bool:
        """Do some work; False if it was cancelled."""
        self._chore = self.work.number + 1 if chore else 0
        ended = self.work.run(work) if not chore or self.messages.empty() else True
        self._chore = 0
        return ended or (chore and not self.messages.empty())

    def serve(self, opening: Opening) -> None:
        """Open a log, then answer messages and find out."""
        self.messages.put({"what": "open", "number": 0, "given": opening})
        threading.Thread(target=self._listen, daemon=True).start()
        while True:
            if not self.messages.empty() or not self.chore():
                self.hear(self.messages.get())


def serve(pipe: Connection, folder: str, opening: Opening, not_its_own: Connection | None = None) -> None:
    """Run the process.

    `pipe` (Connection). `folder` (str). `opening` (Opening). `not_its_own` (Connection, optional): The server's end
    of the pipe, which a forked process must close to see that the server has gone.
    """
    for name in ("SIGTERM", "SIGHUP", "SIGQUIT"):  # it ends with the server, which removes what it wrote
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if not_its_own is not None:
        not_its_own.close()
    with one_blas_thread(), contextlib.suppress(BrokenPipeError):
        ProcessDesk(pipe, folder).serve(opening)
