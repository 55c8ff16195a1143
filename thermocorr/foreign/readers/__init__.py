"""Logs that are no tables: a reader for each, found by the first lines of the file.

A reader is a module with two functions. ``recognises(lines)`` says whether the first lines (list of str) are its own;
``read(lines, reading)`` makes a frame of all of them, and says in words how. Of several readers that know a file, the
one with the least `PLACE` reads it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pkgutil import iter_modules
from typing import NamedTuple

import pandas as pd


class Reader(NamedTuple):
    """Reader of the logs of one kind of program."""

    recognises: Callable[[Sequence[str]], bool]
    read: Callable[[Sequence[str], str | None], tuple[pd.DataFrame, str]]


_MODULES = [import_module(f".{file.name}", __name__) for file in iter_modules(__path__)]
READERS = tuple(
    Reader(module.recognises, module.read) for module in sorted(_MODULES, key=lambda module: float(module.PLACE))
)
"""The first that recognises a file reads it."""


def reader_of(lines: Sequence[str]) -> Reader | None:
    """The reader of a file that begins with these lines; None for a table."""
    filled = [line for line in lines if line.strip()]
    # Characters of a line at most: no program of these writes longer ones
    if max(map(len, filled), default=0) > 2000:
        return None
    return next((reader for reader in READERS if filled and reader.recognises(filled)), None)
