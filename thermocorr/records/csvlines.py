"""Lines of a CSV log: fields, header, and what is wrong with a line. The one reader, for whole files and for streams.

A row is one line, with as many fields as the header. What differs is refused and named by its line: it is never taken
for a shorter row, a shorter number, or an index in front.
"""

from __future__ import annotations

import csv
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from .errors import RecordError, listing

Places = NDArray[np.intp]
Chosen = NDArray[np.bool_]
_CONTROLS = {"\0": "zero byte", "\r": "carriage return", "\v": "vertical tab", "\f": "form feed"}
LONGEST = 1 << 20
"""Bytes of a header, and of a line of a stream, at most: a longer one is no row of a log."""
BOM = b"\xef\xbb\xbf"
CUT = "it has no line end: it may have been cut while it was written. If it is whole, end it with a line end"


def fields_of(line: bytes) -> list[str]:
    """Fields of one line; none for an empty one.

    Raises RecordError for a line that is no text in UTF-8, holds control bytes, or leaves a quote open.
    """
    line = line[:-1] if line.endswith(b"\n") else line
    line = line[:-1] if line.endswith(b"\r") else line
    if not line:
        return []
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError as error:
        raise RecordError(f"byte {error.start + 1} of the line is not text in UTF-8") from None
    for mark, name in _CONTROLS.items():
        if mark in text:
            raise RecordError(f"it holds a {name}")
    if '"' not in text:
        return text.split(",")
    try:
        return next(csv.reader([text], strict=True))
    except csv.Error as error:
        reason = "a quoted field is not closed on its line" if "unexpected end" in str(error) else str(error)
        raise RecordError(f"it is no CSV: {reason}") from None


def is_comment(line: str, n_fields: int, n_columns: int) -> bool:
    """Whether a line of a log is none of its rows: it begins with #, and has another number of fields."""
    return line.lstrip().startswith("#") and n_fields != n_columns


def header_of(line: bytes) -> list[str]:
    """Names of the columns, from the first line of a log.

    Raises RecordError for a line that is no header, and for names that stand twice.
    """
    if len(line) > LONGEST:  # millions of names would take a gigabyte
        raise RecordError(f"The header, line 1, has more than {LONGEST} bytes. Is it a CSV log?")
    try:
        names = fields_of(line.removeprefix(BOM))
    except RecordError as error:
        raise RecordError(f"The header, line 1, cannot be read: {error}.") from None
    if not names:
        raise RecordError("Line 1 is empty: a header line with the columns' names is needed, then one line per sample.")
    if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
        raise RecordError(
            "The log seems to be separated by semicolons or tabs. A file is understood once it has some rows; a stream "
            "needs commas between its columns."
        )
    return checked_names(names)


def checked_names(names: list[str]) -> list[str]:
    """The names of a header; RecordError for one that stands twice."""
    counted = Counter(filter(None, names))
    twice = next((name for name in names if counted[name] > 1), None)
    if twice is not None:
        raise RecordError(
            f"The header has the name {twice!r} twice; its names are {listing(names)}. Give columns unique names."
        )
    return names


def miscounted(found: int, wanted: int) -> str:
    """What is wrong with a row of `found` fields."""
    return f"it has {found} fields where the header has {wanted}"


def check_lines(content: bytes, n_columns: int, start: int, line: int = 2) -> tuple[int, int]:
    """Check every line behind the header of a whole file.

    Parameters
    ----------
    content : bytes
        The file.
    n_columns : int
        Fields of the header.
    start : int
        Where the line behind the header begins.
    line : int
        Its number in the file.

    Returns
    -------
    rows : int
        Lines with fields; empty ones do not count.
    end : int
        Where the last whole line ends: a line that the file breaks off in is left out.

    Raises
    ------
    RecordError
        For the first line that is no row of the table.
    """
    end = max(content.rfind(b"\n") + 1, start)
    ends = np.asarray(_places(content, b"\n", start, end) + 1)
    starts = np.concatenate(([start], ends[:-1]))[: len(ends)]
    empty = _empty(content, starts, ends)
    suspects = _suspects(content, starts, ends, n_columns) & ~empty
    for row in np.flatnonzero(suspects):
        try:
            found = fields_of(content[starts[row] : ends[row]])
            if len(found) != n_columns:
                raise RecordError(miscounted(len(found), n_columns))
        except RecordError as error:
            raise RecordError(f"line {row + line}: {error}") from None
    return len(ends) - int(empty.sum()), end


def _places(content: bytes, byte: bytes, start: int, end: int) -> Places:
    here = np.frombuffer(content, np.uint8, end - start, start)
    return np.asarray(np.flatnonzero(here == byte[0]) + start)


def _empty(content: bytes, starts: Places, ends: Places) -> Chosen:
    short = np.asarray(ends - starts <= 2)
    for row in np.flatnonzero(short):
        short[row] = content[starts[row] : ends[row]] in (b"\n", b"\r\n")
    return short


def _suspects(content: bytes, starts: Places, ends: Places, n_columns: int) -> Chosen:
    """Lines that need a closer look: another number of commas, quotes, bytes that are no plain text."""
    if not len(ends):
        return np.zeros(0, bool)
    low, high = int(starts[0]), int(ends[-1])
    commas = _places(content, b",", low, high)
    suspects = np.asarray(np.diff(np.searchsorted(commas, np.append(starts, high))) != n_columns - 1)
    for mark in (b'"', b"\0", b"\v", b"\f"):
        if content.find(mark, low, high) >= 0:
            suspects |= _holding(_places(content, mark, low, high), starts, len(ends))
    returns = _places(content, b"\r", low, high)  # one stands before each line feed, or before none
    if len(returns):
        behind = np.frombuffer(content, np.uint8)[np.minimum(returns + 1, high - 1)]
        suspects |= _holding(returns[behind != ord("\n")], starts, len(ends))
    if not content.isascii():
        try:
            content.decode("utf-8")
        except UnicodeDecodeError:
            beyond = np.flatnonzero(np.frombuffer(content, np.uint8, high - low, low) > 127) + low
            suspects |= _holding(beyond, starts, len(ends))
    return suspects


def _holding(places: Places, starts: Places, n: int) -> Chosen:
    """Lines that hold one of these bytes."""
    found = np.zeros(n, bool)
    found[np.searchsorted(starts, places, side="right") - 1] = True
    return found
