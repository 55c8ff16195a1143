"""A log in a file of any make as a frame, and in words how it was understood. The one door for every command."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

import pandas as pd

from ..records import RecordError
from ..records.errors import listing
from ..records.files import format_of, read_table
from ..records.paths import existing_file
from .containers import FEATHER, PACKED, SHEETS, feather, refuse_unread, spreadsheet, unpacked
from .how import ForeignTable, HowToRead
from .odd_numbers import nearly_numbers
from .text_tables import HEAD, first_lines, is_plain, text_table


def read_log(path: str | Path, how: HowToRead | None = None) -> ForeignTable:
    """Read a log: text with any separator, spreadsheets, Parquet, Feather, packed by gz or zip or not.

    Parameters
    ----------
    path : path
    how : HowToRead, optional

    Raises
    ------
    RecordError
        For a file that is missing, empty, or no table; one sentence that says what to pass.
    """
    path, how = existing_file(path), how or HowToRead()
    ending = path.suffix.lower()
    refuse_unread(path)
    if format_of(path) is not None:
        return ForeignTable(frame=read_table(path))
    if ending in FEATHER:
        return _filled(ForeignTable(frame=feather(path)), path)
    try:
        if ending in SHEETS:
            return _filled(_from_cells(spreadsheet(path, how.sheet), path, how), path)
        content, name = unpacked(path)
        said = (f"{name} in {path.name}",) if ending in PACKED else ()
        if ending in PACKED and format_of(name) is not None:
            raise RecordError(f"{path} holds {name}: unpack it, it is packed by itself.")
        return _filled(text_table(content, path, how, said), path)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None


def plain_head(path: Path, how: HowToRead) -> ForeignTable | None:
    """The first lines of a file that is CSV as this package writes it, as far as these tell; None for any other.

    Raises RecordError where they are no table.
    """
    if path.suffix.lower() in (*FEATHER, *SHEETS, *PACKED) or format_of(path) is not None:
        return None
    with path.open("rb") as file:
        head = first_lines(file.read(HEAD))
    if not is_plain(head, how):
        return None
    return text_table(head[: head.rfind(b"\n") + 1] or head, path, how)


def _from_cells(cells: pd.DataFrame, path: Path, how: HowToRead) -> ForeignTable:
    """A sheet, by the way of text: headers, units and preambles are found as in a file of text."""
    out = io.StringIO()
    written = csv.writer(out, lineterminator="\n")
    days = [_are_days(cells[name]) for name in cells.columns]
    for row in cells.itertuples(index=False):
        written.writerow([_cell_text(cell, day) for cell, day in zip(row, days, strict=True)])
    return text_table(out.getvalue().encode(), path, replace(how, separator=",", encoding=None, decimal="."), ())


def _are_days(cells: Any) -> bool:
    """Whether the dates of a column of a sheet are days without a time: midnights, all of them."""
    return all(cell.time() == time() for cell in cells if isinstance(cell, datetime))


def _cell_text(cell: Any, day: bool) -> str:
    if cell is None:
        return ""
    if isinstance(cell, datetime):
        return cell.date().isoformat() if day else cell.isoformat(sep=" ")
    if isinstance(cell, date | time):
        return cell.isoformat()
    return repr(cell) if isinstance(cell, float) else str(cell)


def _filled(table: ForeignTable, path: Path) -> ForeignTable:
    """A table with rows, and what is said of columns that are no numbers for a few cells."""
    if len(table.frame) == 0:
        raise RecordError(f"{path} has a header ({listing(table.frame.columns)}) but no rows.")
    frame, said = nearly_numbers(table.frame)
    return table.with_said(frame, *said)
