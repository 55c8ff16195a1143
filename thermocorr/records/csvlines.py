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
_NO_MARKS = bytes(set(range(256)) - set(b',"\n') - set("".join(_CONTROLS).encode()))
"""Bytes that say nothing of where fields and lines end."""
BLOCK = 1 << 18
"""Bytes that are checked together, up to the end of a line: they stay in the cache of a processor."""
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


def header_of(line: bytes, place: str = "line 1") -> list[str]:
    """Names of the columns, from the first line of a log, which may stand at another `place` behind comments.

    Raises RecordError for a line that is no header, and for names that stand twice.
    """
    if len(line) > LONGEST:  # millions of names would take a gigabyte
        raise RecordError(f"The header, {place}, has more than {LONGEST} bytes. Is it a CSV log?")
    try:
        names = fields_of(line.removeprefix(BOM))
    except RecordError as error:
        raise RecordError(f"The header, {place}, cannot be read: {error}.") from None
    if not names:
        empty = f"{place[:1].upper()}{place[1:]} is empty"
        raise RecordError(f"{empty}: a header line with the columns' names is needed, then one line per sample.")
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
    rows = 0
    while start < end:
        cut = content.find(b"\n", min(start + BLOCK, end - 1), end) + 1
        block, start = content[start:cut], cut
        plain = _plain_rows(block, n_columns)
        rows += plain or _checked_rows(block, n_columns, line)
        line += plain or block.count(b"\n")
    return rows, end


def _plain_rows(block: bytes, n_columns: int) -> int:
    """How many rows these lines are, if all of them are rows without quotes; 0 where they need a closer look."""
    marks = block.translate(None, _NO_MARKS)
    row = b"," * (n_columns - 1) + (b"\r\n" if marks.endswith(b"\r\n") else b"\n")
    rows = len(marks) // len(row)
    if n_columns == 1 or marks != row * rows or (b"\r" in row and block.count(b"\r\n") != rows):
        return 0
    return rows if _is_text(block) else 0


def _is_text(block: bytes) -> bool:
    try:
        return block.isascii() or bool(block.decode("utf-8"))
    except UnicodeDecodeError:
        return False


def _checked_rows(block: bytes, n_columns: int, line: int) -> int:
    """How many rows these lines are, looked at one by one where one of their bytes is unusual."""
    ends = _places(block, b"\n") + 1
    starts = np.concatenate(([0], ends[:-1]))
    empty = _empty(block, starts, ends)
    for row in np.flatnonzero(_suspects(block, starts, n_columns) & ~empty):
        try:
            found = fields_of(block[starts[row] : ends[row]])
            if len(found) != n_columns:
                raise RecordError(miscounted(len(found), n_columns))
        except RecordError as error:
            raise RecordError(f"line {row + line}: {error}") from None
    return len(ends) - int(empty.sum())


def _places(block: bytes, byte: bytes) -> Places:
    return np.asarray(np.flatnonzero(np.frombuffer(block, np.uint8) == byte[0]))


def _empty(block: bytes, starts: Places, ends: Places) -> Chosen:
    short = np.asarray(ends - starts <= 2)
    for row in np.flatnonzero(short):
        short[row] = block[starts[row] : ends[row]] in (b"\n", b"\r\n")
    return short


def _suspects(block: bytes, starts: Places, n_columns: int) -> Chosen:
    """Lines that need a closer look: another number of commas, quotes, bytes that are no plain text."""
    commas = np.searchsorted(_places(block, b","), np.append(starts, len(block)))
    suspects = np.asarray(np.diff(commas) != n_columns - 1)
    for mark in (b'"', b"\0", b"\v", b"\f"):
        suspects |= _holding(_places(block, mark), starts)
    content = np.frombuffer(block, np.uint8)
    returns = _places(block, b"\r")  # one stands before each line feed, or before none
    suspects |= _holding(returns[content[returns + 1] != ord("\n")], starts)
    if not _is_text(block):
        suspects |= _holding(np.flatnonzero(content > 127), starts)
    return suspects


def _holding(places: Places, starts: Places) -> Chosen:
    """Lines that hold one of these bytes."""
    found = np.zeros(len(starts), bool)
    found[np.searchsorted(starts, places, side="right") - 1] = True
    return found
