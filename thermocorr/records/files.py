"""Logs in files, for every command: CSV and Parquet in, by the file's ending."""

from __future__ import annotations

import io
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from .by_arrow import table_by_arrow
from .csvlines import CUT, check_lines, checked_names, header_of
from .errors import RecordError, listing, quoted, warn
from .grammar import MISSING
from .parquet import open_parquet
from .paths import existing_file
from .units import name_and_unit

TIME_NAMES = (
    "time", "timestamp", "datetime", "date", "time_s", "date/time", "date time", "date_time", "time stamp", "_time",
    "zeit", "zeitstempel", "datum", "uhrzeit", "t", "x_value", "datum/uhrzeit", "datum/zeit", "datum uhrzeit",
    "datum und uhrzeit", "date and time", "ts",
)  # fmt: skip
"""Columns that are taken as times where none is named, the first that is there."""
HEAD = 1 << 16
"""Bytes that tell of what type columns are."""
LONG = 1 << 21
"""Bytes from which it is worth loading a faster reader."""
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

    Parameters
    ----------
    content : bytes
        The file, or what it was translated to.
    path : Path
        What it is called in messages.
    names : list of str, optional
        Of the columns, where `content` begins behind its header.
    line : int
        The number of its first line in the file.

    Raises RecordError for the first line that is no row of the table.
    """
    if not content or content.isspace():
        if names is not None:
            return pd.DataFrame(columns=names)
        raise RecordError(
            f"{path} is empty: a header line with the columns' names is needed, then one line per sample."
        )
    start = 0 if names is not None else content.find(b"\n") + 1 or len(content)
    try:
        names = checked_names(names) if names is not None else header_of(content[:start])
        rows, end = check_lines(content, len(names), start, line + (start > 0))
    except RecordError as error:
        raise RecordError(f"{path} cannot be read as a table: {error}") from None
    if end < len(content) and start < len(content):
        warn(f"The last line of {path} is left out: {CUT}.")
    names = [name or f"Unnamed: {i}" for i, name in enumerate(names)]
    if len(set(names)) < len(names):
        raise RecordError(f"{path} has columns without a name, and others called {listing(names)}. Name them all.")
    if not rows:
        return pd.DataFrame(columns=names)
    frame = _rows(content, start, end, names)
    infinite = [name for name in names if frame[name].dtype.kind == "f" and np.isinf(frame[name]).any()]
    if infinite:  # more than a number can hold, or a word for it: cells that stay as they stand
        frame[infinite] = _cells(content, start, end, names, infinite)
    if len(frame) != rows:  # two readers that disagree: trust neither
        raise RecordError(f"{path} cannot be read as a table: {rows} lines gave {len(frame)} rows.")
    return frame


def _rows(content: bytes, start: int, end: int, names: list[str]) -> pd.DataFrame:
    """The lines of a part of a file as a table, the fastest way."""
    if end - start > LONG:
        behind = content.find(b"\n", start + HEAD) + 1
        head = _cells(content[start:behind], 0, behind - start, names)
        frame = table_by_arrow(content, start, end, head, _NONE)
        if frame is not None:
            return frame
    return _cells(content, start, end, names)


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


def require_column(
    names: Iterable[Any],
    name: str | None,
    option: str,
    guesses: tuple[str, ...] = (),
    taken: Collection[str | None] = (),
) -> str:
    """The column that an option names, or the first of `guesses` that is there and not `taken` by another option.

    Where none is there as it stands, capitals and a unit behind the name do not count: "Temperature [°C]".

    Raises RecordError for a name that is none of the columns, and where no column is named and none can be guessed.
    """
    columns = [str(column) for column in names]
    if name is None:
        free = [column for column in columns if column not in taken]
        bare = {name_and_unit(column)[0].strip().lower(): column for column in reversed(free)}
        for known in ({column: column for column in free}, bare):
            for guess in guesses:
                if guess in known:
                    return known[guess]
        raise RecordError(f"Which column is the {option}? Say it with --{option}; there are {listing(columns)}.")
    if name not in columns:
        raise RecordError(f"There is no column {quoted(name)} for --{option}; there are {listing(columns)}.")
    return name
