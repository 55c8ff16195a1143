"""Logs larger than memory: their numbers in temporary files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from typing import IO, Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing

_INDEX = object()
"""Stands for the name of the index among those of the columns."""


def gathered(frames: Iterator[pd.DataFrame]) -> pd.DataFrame:
    """Parts of a log, one below the other, as a frame whose columns are mapped from temporary files.

    Numbers, switches and dates are kept in double precision and 64 bits; the files are gone when the frame is.
    Raises RecordError for parts with other columns, and for columns of any other kind.
    """
    files: dict[Any, IO[bytes]] = {}
    first, rows = None, 0
    with ExitStack() as stack:  # what is mapped stays, though its file has no name and is closed
        for part in frames:
            if not isinstance(part, pd.DataFrame):
                raise RecordError(
                    f"Parts of a log are frames; this one is a {type(part).__name__}. Give paths in a list."
                )
            first = part if first is None else first
            if list(part.columns) != list(first.columns) or type(part.index) is not type(first.index):
                raise RecordError(f"Parts of a log have other columns: {listing(first)}, and {listing(part)}.")
            for name, column in _columns(part):
                if name not in files:
                    files[name] = stack.enter_context(tempfile.TemporaryFile())
                files[name].write(_numbers(name, column).tobytes())
            rows += len(part)
        if first is None or not rows:
            raise RecordError("The log has 0 rows.")
        columns = {name: _mapped(files[name], column) for name, column in _columns(first)}
    times = columns.pop(_INDEX, None)
    frame = pd.DataFrame(columns, copy=False)
    if times is not None:
        frame.index = pd.Index(times, copy=False, name=first.index.name)
    frame.attrs = dict(first.attrs)
    return frame


def _columns(part: pd.DataFrame) -> Iterator[tuple[Any, pd.Series]]:
    """The index, if it is one of times, and the columns."""
    if not isinstance(part.index, pd.RangeIndex):
        yield _INDEX, part.index.to_series()
    yield from part.items()


def _numbers(name: Any, column: pd.Series) -> np.ndarray:
    if column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype):
        index: Any = pd.Index(column)
        ticks: np.ndarray = index.as_unit("ns").asi8
        return ticks
    if not pd.api.types.is_numeric_dtype(column.dtype):
        raise RecordError(f"The column {name!r} holds {column.dtype}, no numbers: leave it out of the parts.")
    return column.to_numpy(float, na_value=np.nan)


def _mapped(file: IO[bytes], like: pd.Series) -> Any:
    """The content of a file as an array of the kind of a column."""
    file.flush()
    values = np.memmap(file, np.float64 if like.dtype.kind in "biuf" else np.int64, "r")
    if like.dtype.kind == "m":
        return values.view("m8[ns]")
    if isinstance(like.dtype, pd.DatetimeTZDtype):
        return pd.DatetimeIndex(values.view("M8[ns]"), copy=False).tz_localize("UTC").tz_convert(like.dtype.tz)
    return values.view("M8[ns]") if like.dtype.kind == "M" else values
