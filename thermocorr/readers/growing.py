"""Later lines, and logs larger than memory."""

from __future__ import annotations

import codecs
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import IO, Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing
from .cells import is_typed, split
from .clocks import Clock, as_seconds, unwrapped
from .form import Form, header_of
from .log import begin_of, start_of

_LONGEST = 1 << 20
"""Characters of a line at most: a longer one is not a row."""
_PREAMBLE = 100
"""Lines among which the names of the columns are looked for."""


class Growing:
    """Reads a log as it grows.

    Parameters
    ----------
    form : Form, optional
        Of the log that a model was fitted to; without one, plain CSV is read: commas and decimal points.
    needed : sequence of str
        Columns of numbers that a plain CSV must have.
    clock : Clock, optional
        Times of a plain CSV; None for a log without times.
    """

    def __init__(self, form: Form | None, needed: Sequence[str], clock: Clock | None = None):
        self.form, self.needed, self.clock = form, list(needed), clock
        self.lines = 0
        """Lines read."""
        self.last: pd.Timestamp | pd.Timedelta | None = None
        self._decoder = codecs.getincrementaldecoder(form.encoding if form else "utf-8-sig")("replace")
        self._rest, self._begun = "", False

    def feed(self, new: bytes) -> tuple[pd.DataFrame | None, list[str]]:
        """The rows that these bytes complete, and notes; or None.

        Raises RecordError for a log in another form, and for a header of other columns.
        """
        text = self._rest + self._decoder.decode(new).replace("\r\n", "\n").replace("\r", "\n")
        whole, _, self._rest = text.rpartition("\n")
        if len(self._rest) > _LONGEST:
            raise RecordError(f"The log has a line of more than {_LONGEST} characters. Is it text?")
        text = whole + "\n" if whole else ""
        if not self._begun and text.strip():
            at = self._begin(text, last=False)
            if at is None:
                self._rest = text + self._rest
                return None, []
            self.lines, text, self._begun = text.count("\n", 0, at), text[at:], True
        return self._rows(text) if text.strip() else (None, [])

    def end(self) -> None:
        """Raise RecordError for a log that ends too early."""
        if not self._begun and "\n" in self._rest and self._rest.strip():
            self._begin(self._rest, last=True)

    def header(self) -> pd.DataFrame | None:
        """An empty frame of the log's columns; None before they are known."""
        if not self._begun or self.form is None:
            return None
        index = pd.RangeIndex(0) if self.form.clock is None else self.form.clock.no_times()
        return pd.DataFrame({name: pd.Series(dtype=float) for name in self.form.columns}, index)

    @property
    def cut(self) -> bool:
        """True if a line has not ended yet."""
        return bool(self._rest.strip())

    def _begin(self, text: str, last: bool) -> int | None:
        """Where the rows begin; None where that is not known yet."""
        lines = text.split("\n")
        if self.form is not None:
            if self.form.long:
                raise RecordError(
                    "The log has one value a line: its columns are put together in a whole file. Give it as one."
                )
            if (at := start_of(text, self.form)) is not None and (self.form.header or self.form.templates):
                return at
            for k, line in enumerate(lines[:_PREAMBLE]):
                cells = split(line, self.form.separator or "\n")
                if self._is_row(cells):
                    return begin_of(k, lines)
                if len(cells) > 1 and set(cells) >= set(self.form.names) and self.form.header:
                    self.form = replace(self.form, names=cells, header=header_of(line))
                    rows = k + self.form.below
                    return begin_of(rows, lines) if len(lines) > rows else None
        first = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), 0)
        names = split(lines[first], ",")
        times = [] if self.clock is None else self.clock.columns
        wanted = [*self.needed, *times]
        if set(wanted) <= set(names):
            columns = [name for name in names if name not in times]
            head = header_of(lines[first])
            self.form = Form(names=names, header=head, below=1, columns=columns, numbers=self.needed, clock=self.clock)
            return begin_of(first + 1, lines)
        if len(lines) < _PREAMBLE and self.form is not None and not last:
            return None
        missing = listing([name for name in wanted if name not in names])
        raise RecordError(
            f"The log has no column {missing}; it has {listing(names)}. Give it as a whole file to read another form."
        )

    def _is_row(self, cells: list[str]) -> bool:
        form = self.form
        if form is None or form.templates or len(cells) != len(form.names):
            return False
        numbers = [cell for name, cell in zip(form.names, cells, strict=True) if name in form.numbers and cell]
        return bool(numbers) and all(is_typed(cell, form.decimal) for cell in numbers)

    def _rows(self, text: str) -> tuple[pd.DataFrame | None, list[str]]:
        form = self.form
        assert form is not None
        if form.header and form.names and form.names[0] in text:  # the same names in another order
            lines = text.split("\n")
            for k, line in enumerate(lines):
                cells = split(line, form.separator) if form.names[0] in line else []
                if not form.is_header(line) and cells and set(cells) == set(form.names):
                    before, notes = self._rows("\n".join([*lines[:k], ""]))
                    self.form = replace(form, names=cells, header=header_of(line))
                    self.lines += 1
                    after, more = self._rows("\n".join(lines[k + 1 :]))
                    parts = [part for part in (before, after) if part is not None]
                    return pd.concat(parts) if parts else None, notes + more
        if not text.strip():
            self.lines += text.count("\n")
            return None, []
        frame, notes = form.later(text, self.lines + 1)
        self.lines += text.count("\n")
        if form.clock is not None:
            frame.index = self._times(frame.index, form.clock)
            self.last = frame.index[-1] if len(frame) else self.last
        return (frame if len(frame) else None), notes

    def _times(self, times: pd.Index, clock: Clock) -> pd.Index:
        """Times that continue those before."""
        if isinstance(times, pd.DatetimeIndex):
            last = self.last if isinstance(self.last, pd.Timestamp) else None
            return (clock.in_zone(times, last) if times.tz is None else times.tz_convert("UTC")).rename("time")
        last_seconds = None if self.last is None else float(as_seconds(pd.Index([self.last]))[0])
        return pd.to_timedelta(unwrapped(times, clock, last_seconds).to_numpy(float).round(9), unit="s").rename("time")


_INDEX = object()
"""Stands for the name of the index among those of the columns."""


def gathered(frames: Iterator[pd.DataFrame]) -> pd.DataFrame:
    """Parts of a log as one frame, mapped from temporary files.

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
    """A file's content as an array, mapped."""
    file.flush()
    values = np.memmap(file, np.float64 if like.dtype.kind in "biuf" else np.int64, "r")
    if like.dtype.kind == "m":
        return values.view("m8[ns]")
    if isinstance(like.dtype, pd.DatetimeTZDtype):
        return pd.DatetimeIndex(values.view("M8[ns]"), copy=False).tz_localize("UTC").tz_convert(like.dtype.tz)
    return values.view("M8[ns]") if like.dtype.kind == "M" else values
