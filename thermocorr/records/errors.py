"""Errors and warnings about a user's data."""

from __future__ import annotations

import inspect
import re
import shlex
import stat
import unicodedata
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np


def printable(text: object, kept: str = "") -> str:
    r"""Text without control and bidirectional characters.

    Control and format characters, lone surrogates and characters that Unicode has not assigned (all of its category C)
    and separators of lines and paragraphs become the escapes that Python writes for them. All else stays: blanks of
    any width, accents, every script.

    `text` (object): Whatever names a column, a unit or a run; ``str`` of it is taken. `kept` (str): Characters of
    those kinds that stay as they are.

    Examples
    --------
    >>> print(printable("\x1b[31mΔT \u202egnorw [°C]\n"))
    \x1b[31mΔT \u202egnorw [°C]\n
    """
    plain = str(text)
    if plain.isascii() and plain.isprintable():
        return plain
    return "".join(c if c in kept or not _steers(c) else c.encode("unicode_escape").decode("ascii") for c in plain)


def _steers(character: str) -> bool:
    category = unicodedata.category(character)
    # Separators of lines and paragraphs end a line as a newline does.
    return category.startswith("C") or category in ("Zl", "Zp")


_WITHIN = (__name__.partition(".")[0], "contextlib")
"""This package, and what stands between two of its functions."""


class RecordError(ValueError):
    """The record cannot be used; the message names the remedy."""


class RecordWarning(UserWarning):
    """The record can be used, with a reservation."""


_door = ["Python"]
"""Where the log came in: what is to be done is said in its words."""


@contextmanager
def as_command() -> Iterator[None]:
    """Say what is to be done in options of the command."""
    _door.append("command")
    try:
        yield
    finally:
        _door.pop()


def way(command: str, python: str) -> str:
    """Advice for the command line, or for Python."""
    return command if _door[-1] == "command" else python


def option(name: str, value: str = "...") -> str:
    """A parameter as passed: ``max_gap=60``, or ``--max-gap 60``."""
    flag = f"--{name.replace('_', '-')}"
    return way(flag if value in ("...", "True") else f"{flag} {shlex.quote(value.strip(chr(39)))}", f"{name}={value}")


@contextmanager
def noted() -> Iterator[list[str]]:
    """Collect the messages of record warnings, in place of showing them."""
    notes: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        try:
            yield notes
        finally:
            notes += (str(one.message) for one in caught if issubclass(one.category, RecordWarning))


def warn(text: str) -> None:
    """Warn once, at the caller's line outside of this package."""
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _WITHIN:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, RecordWarning, stacklevel=level)


@contextmanager
def said_once() -> Iterator[None]:
    """Warn once of each thing, whatever its numbers.

    As a decorator, of a function that does so.
    """
    seen = set()
    with warnings.catch_warnings():
        show: Any = warnings.showwarning

        def once(message: Any, category: Any, *place: Any, **more: Any) -> None:
            if issubclass(category, RecordWarning):
                said = _NUMBERS.sub("#", str(message))
                if said in seen:
                    return
                seen.add(said)
            show(message, category, *place, **more)

        warnings.showwarning = once
        yield


_NUMBERS = re.compile(r"\b\d[\d.,:e+-]*(?: ?[^\W\d_]+)?")
"""Numbers, with the word behind them, which may be a unit, or differ for one and for many."""


def listing(names: Iterable[object], limit: int = 8) -> str:
    """Names for a message: ``'a', 'b', 'c' and 3 more``."""
    items = list(names)
    said = ", ".join(map(quoted, items[:limit]))
    return said if len(items) <= limit else f"{said} and {len(items) - limit} more"


def quoted(name: object) -> str:
    """A name for a message, in quotes, shortened."""
    return repr(name) if len(repr(name)) <= 60 else f"{repr(name)[:57]}..."


def times_word(count: int, noun: str) -> str:
    """``1 gap``, ``3 gaps``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def check_int(function: str, name: str, value: Any, low: int) -> int:
    """An int of at least `low`; ValueError for others."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= low:
        return int(value)
    raise ValueError(
        f"The '{name}' parameter of {function} must be an int in the range [{low}, inf). Got {value!r} instead."
    )


def check_bool(function: str, name: str, value: Any) -> bool:
    """A bool; ValueError for others, such as "False"."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise ValueError(f"The '{name}' parameter of {function} must be True or False. Got {value!r} instead.")


def existing_file(path: str | PathLike[str]) -> Path:
    """The path of a readable file; RecordError for others."""
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise RecordError(
            f"There is no file {path}. Check its name and the folder you are in ({Path.cwd()})."
        ) from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    if stat.S_ISDIR(mode):
        raise RecordError(f"{path} is a folder. Name the log file in it.")
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        raise RecordError(f"{path} is a device, and may never end. Name a log file.")
    return path
