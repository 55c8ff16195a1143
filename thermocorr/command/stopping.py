"""Signals that end a command: in good order, and where rows are read, between two of them."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN = 0.01
"""After this time [s] a signal comes again that came where nothing can be raised."""


class Stopped(Exception):
    """A command was told to stop, and did so in good order."""

    def __init__(self, number: int, where: str):
        super().__init__(where)
        self.status = 128 + number
        """Exit status, as shells have it: 130 for SIGINT, 143 for SIGTERM."""


class Terminated(SystemExit):
    """SIGTERM ends the command: what cleans up does so, nothing else is done."""


class Endings:
    """Lets SIGINT and SIGTERM end the command by an exception, while it is entered.

    Where nothing can be raised (in a destructor, in a callback of the import system) Python would print the exception
    and go on: the signal comes again a moment later instead. Outside of the main thread nothing is done.
    """

    def __enter__(self) -> Endings:
        self._main = threading.current_thread() is threading.main_thread()
        if self._main:
            self._hook, sys.unraisablehook = sys.unraisablehook, self._unraised
            self._before = signal.signal(signal.SIGTERM, _terminate)
        self._again: threading.Timer | None = None
        return self

    def __exit__(self, *_: object) -> None:
        if self._main:
            if self._again is not None:  # the command has ended without it
                self._again.cancel()
            signal.signal(signal.SIGTERM, self._before)
            sys.unraisablehook = self._hook

    def _unraised(self, what: sys.UnraisableHookArgs) -> None:
        number = {KeyboardInterrupt: signal.SIGINT, Terminated: signal.SIGTERM}.get(what.exc_type)
        if number is None:
            self._hook(what)
        else:
            self._again = threading.Timer(AGAIN, signal.raise_signal, (number,))
            self._again.start()


@contextmanager
def held_back() -> Iterator[None]:
    """Lets SIGINT and SIGTERM wait until this is left: modules are loaded whole.

    An exception that is raised in the middle of one in C is lost: numpy says that it cannot be imported.
    """
    came: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated(128 + number)


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
        if self.number is not None and number == signal.SIGTERM:
            _terminate(number, frame)
        if self.number is not None:
            raise KeyboardInterrupt
        self.number = number
