"""Signals that end a command between two rows, not within one."""

from __future__ import annotations

import signal
import threading
from types import FrameType


class Stopped(Exception):
    """A command was told to stop, and did so in good order."""

    def __init__(self, number: int, where: str):
        super().__init__(where)
        self.status = 128 + number
        """Exit status, as shells have it: 130 for SIGINT, 143 for SIGTERM."""


class StopSignal:
    """Notes SIGINT and SIGTERM while it is entered; a second one of them interrupts at once.

    Outside of the main thread, where signals cannot be caught, it never notes any.
    """

    number: int | None = None
    """The signal that came; None so far."""

    def __enter__(self) -> StopSignal:
        self._before = {}
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def __bool__(self) -> bool:
        return self.number is not None

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.number is not None:
            raise KeyboardInterrupt
        self.number = number
