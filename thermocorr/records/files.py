"""Tables in files: their paths, formats and lines of CSV.

A row is one line, with as many fields as the header. What differs is refused and named by its line: it is never taken
for a shorter row, a shorter number, or an index in front.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError, existing_file, listing, quoted, warn
from .grammar import MISSING
from .parquet import open_parquet

Places = NDArray[np.intp]
Chosen = NDArray[np.bool_]
_CONTROLS = {"\0": "zero byte", "\r": "carriage return", "\v": "vertical tab", "\f": "form feed"}
_NO_MARKS = bytes(set(range(256)) - set(b',"\n') - set("".join(_CONTROLS).encode()))
"""Bytes that say nothing of where fields and lines end."""
BLOCK = 1 << 18
"""Bytes that are checked together, up to the end of a line: they stay in the cache of a processor."""
LONGEST = 1 << 20
"""Bytes of a header, and of a line of a stream, at most: a longer one is no row of a log."""
_VALUE = re.compile(
    r"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?|[0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4}[T ]?[0-9:.,]*Z?"
)
"""Numbers and dates."""
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
    """True if a line of a log is a comment: it begins with #, and has another number of fields."""
    return line.lstrip().startswith("#") and n_fields != n_columns


def header_of(line: bytes, place: str = "line 1") -> list[str]:
    """Names of the columns, from the first line of a log, which may stand at another `place` behind comments.

    Raises RecordError for a line that is no header.
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
    numbered = names == [str(k) for k in range(1, len(names) + 1)]  # by whoever read a file without a header
    if names[0] and not numbered and all(_is_value(name) for name in filter(None, names)):
        raise RecordError(
            f"{place[:1].upper()}{place[1:]} is a row already ({listing(names, 3)}), and no header. Write a line "
            "with the names of the columns above it, such as time,temperature,reading."
        )
    return distinct_names(names)


def _is_value(cell: str) -> bool:
    """True if a cell is a number or a date, which are never names."""
    return _VALUE.fullmatch(cell.strip()) is not None


def distinct_names(names: list[str]) -> list[str]:
    """The names of a header; those that stand there several times with the number of their column: nobody guesses.

    Examples
    --------
    >>> distinct_names(["time", "note", "note", ""])
    ['time', 'note (column 2)', 'note (column 3)', '']
    """
    counted = Counter(filter(None, names))
    return [f"{name} (column {k})" if counted[name] > 1 else name for k, name in enumerate(names, 1)]


class RowError(RecordError):
    """A line of a file that is no row of its table."""


def miscounted(found: int, wanted: int) -> str:
    """Message on a row with the wrong number of fields."""
    return f"it has {found} fields where the header has {wanted}"


def check_lines(content: bytes, n_columns: int, start: int, line: int = 2) -> tuple[int, int]:
    """Check every line behind the header of a whole file.

    `content` (bytes): The file. `n_columns` (int): Fields of the header. `start` (int): Where the line behind the
    header begins. `line` (int): Its number in the file. Returns rows (int): lines with fields; empty ones do not
    count. Returns end (int): where the last whole line ends: a line that the file breaks off in is left out. Raises
    RecordError for the first line that is no row of the table.
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
    """Number of rows, if all lines are rows without quotes; 0 where they need a closer look."""
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
    """Number of rows, each line checked by itself where one of its bytes is unusual."""
    ends = _places(block, b"\n") + 1
    starts = np.concatenate(([0], ends[:-1]))
    empty = _empty(block, starts, ends)
    for row in np.flatnonzero(_suspects(block, starts, n_columns) & ~empty):
        try:
            found = fields_of(block[starts[row] : ends[row]])
            if len(found) != n_columns:
                raise RecordError(miscounted(len(found), n_columns))
        except RecordError as error:
            raise RowError(f"line {row + line}: {error}") from None
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


TIME_NAMES = (
    "time", "timestamp", "datetime", "date", "time_s", "date/time", "date time", "date_time", "date-time", "time stamp",
    "_time", "zeit", "zeitstempel", "datum", "uhrzeit", "t", "x_value", "datum/uhrzeit", "datum/zeit", "datum uhrzeit",
    "datum und uhrzeit", "date and time", "ts", "created_at", "horodatage", "fecha", "tijd",
)  # fmt: skip
"""Columns that are taken as times where none is named, the first that is there."""
_NONE = sorted(MISSING)
EVERY_DIGIT: dict[str, Any] = (
    {"float_precision": "round_trip"} if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1) else {}
)
"""How pandas is told to read numbers as they were written: a matter of course from 3.1 on."""


class Format(NamedTuple):
    """A format of files that are read as a whole."""

    name: str
    read: Callable[[Path], pd.DataFrame]


def format_of(path: str | Path) -> Format | None:
    """The format that the ending of a file's name says, one of `FORMATS`; None for CSV."""
    return FORMATS.get(Path(path).suffix.lower())


def read_table(path: str | Path) -> pd.DataFrame:
    """Read a log: Parquet by its ending (.parquet, .pq), else CSV with a header line.

    Every line of a CSV file must have as many fields as its header. A last line without a line end is left out, with a
    RecordWarning.

    Raises RecordError with one sentence for a file that is missing, empty, or no table.
    """
    path = existing_file(path)
    try:
        said = format_of(path)
        frame = _read_csv(path) if said is None else said.read(path)
    except UnicodeDecodeError as error:
        raise RecordError(f"{path} is not text in UTF-8 (byte {error.start + 1}). Save it as CSV in UTF-8.") from None
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None
    if len(frame) == 0:
        raise RecordError(f"{path} has a header ({listing(frame.columns)}) but no rows.")
    return frame


def _read_csv(path: Path) -> pd.DataFrame:
    return csv_table(path.read_bytes(), path)


def csv_table(content: bytes, path: Path, names: list[str] | None = None, line: int = 1) -> pd.DataFrame:
    """Read plain CSV: commas, decimal points, UTF-8.

    `content` (bytes): The file, or what it was translated to. `path` (Path): What it is called in messages. `names`
    (list of str, optional): Of the columns, where `content` begins behind its header. `line` (int): The number of its
    first line in the file. Raises RecordError for the first line that is no row of the table.
    """
    if not content or content.isspace():
        if names is not None:
            return pd.DataFrame(columns=names)
        raise RecordError(
            f"{path} is empty: a header line with the columns' names is needed, then one line per sample."
        )
    start = 0 if names is not None else content.find(b"\n") + 1 or len(content)
    try:
        names = distinct_names(names) if names is not None else header_of(content[:start])
        rows, end = check_lines(content, len(names), start, line + (start > 0))
    except RecordError as error:
        raise type(error)(f"{path} cannot be read as a table: {error}") from None
    if end < len(content) and start < len(content):
        warn(f"The last line of {path} is left out: {CUT}.")
    names = [name or f"Unnamed: {i}" for i, name in enumerate(names)]
    if len(set(names)) < len(names):
        raise RecordError(f"{path} has columns without a name, and others called {listing(names)}. Name them all.")
    if not rows:
        return pd.DataFrame(columns=names)
    frame = _cells(content, start, end, names)
    infinite = [name for name in names if frame[name].dtype.kind == "f" and np.isinf(frame[name]).any()]
    if infinite:  # more than a number can hold, or a word for it: cells that stay as they stand
        frame[infinite] = _cells(content, start, end, names, infinite)
    if len(frame) != rows:  # two readers that disagree: trust neither
        raise RecordError(f"{path} cannot be read as a table: {rows} lines gave {len(frame)} rows.")
    return frame


def _cells(content: bytes, start: int, end: int, names: list[str], as_text: list[str] | None = None) -> pd.DataFrame:
    """The lines of a part of a file as a table: with columns of numbers, or these columns alone, as text."""
    options: dict[str, Any] = {**EVERY_DIGIT, "dtype": dict.fromkeys(as_text or (), str), "usecols": as_text}
    lines = io.BytesIO(content[:end])  # no copy of a whole file
    lines.seek(start)
    frame: pd.DataFrame = pd.read_csv(
        lines,
        header=None,
        names=names,
        index_col=False,
        low_memory=False,
        keep_default_na=False,
        na_values=_NONE,
        **options,
    )
    return frame


def _read_parquet(path: Path) -> pd.DataFrame:
    try:
        frame: pd.DataFrame = open_parquet(path).read(use_threads=False).to_pandas()
    except ImportError as error:
        raise RecordError(f"{path} is Parquet. {error}") from None
    except (ValueError, ArithmeticError) as error:
        raise RecordError(f"{path} cannot be read as a table of Parquet: {' '.join(str(error).split())}.") from None
    return frame


FORMATS = {ending: Format("Parquet", _read_parquet) for ending in (".parquet", ".pq")}
"""Ending -> format of files that are no CSV."""


def require_column(names: Iterable[Any], name: str, option: str) -> str:
    """The column that an option names; RecordError where there is none."""
    columns = [str(column) for column in names]
    if name not in columns:
        raise RecordError(f"There is no column {quoted(name)} for --{option}; there are {listing(columns)}.")
    return name


def csv_text(rows: Iterable[Sequence[str]]) -> bytes:
    """Rows as lines of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode("utf-8")
