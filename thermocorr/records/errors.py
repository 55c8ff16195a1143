"""What is raised and warned about records: what was found, where, and what to do."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

_WITHIN = (__name__.partition(".")[0], "contextlib")
"""This package, and what stands between two of its functions."""


class RecordError(ValueError):
    """The record cannot be used as it is; the message names the place and the remedy."""


class RecordWarning(UserWarning):
    """The record can be used, but its user should know something first."""


def warn(text: str) -> None:
    """Warn of something in a record, at the line outside of this package that led to it: there it is said once."""
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _WITHIN:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, RecordWarning, stacklevel=level)


@contextmanager
def said_once() -> Iterator[None]:
    """Warn once of each thing while models are fitted to parts of a record: texts that differ in numbers are alike.

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
    """A name for a message: ``'a'``; the beginning of one that is long."""
    return repr(name) if len(repr(name)) <= 60 else f"{repr(name)[:57]}..."


def times_word(count: int, noun: str) -> str:
    """``1 gap``, ``3 gaps``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
