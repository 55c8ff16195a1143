"""Logs in one file or several: read, joined, explained."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from datetime import date, datetime, time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import existing_file, listing, quoted, times_word
from ..records.files import format_of, read_table
from ..records.times import dates_once
from ..records.types import kind_of
from ..records.units import unit_of
from .containers import FEATHER, PACKED, SHEETS, feather, refuse_unread, spreadsheet, unpacked
from .how import ForeignTable, HowToRead
from .long_form import on_times
from .roles import RUN, guess, time_of
from .sniffing import TOTALS
from .text_tables import text_table
from .timed import with_times
from .values import nearly_numbers, without


def read_log(path: str | Path, how: HowToRead | None = None) -> ForeignTable:
    """Read a log: text with any separator, spreadsheets, Parquet, Feather, packed by gz or zip or not.

    `path` (path). `how` (HowToRead, optional). Raises RecordError for a file that is missing, empty, or no table; one
    sentence that says what to pass.
    """
    path, how = existing_file(path), how or HowToRead()
    ending = path.suffix.lower()
    refuse_unread(path)
    if format_of(path) is not None:
        return (
            _filled(ForeignTable(frame=read_table(path)), path, how)
            if how.missing
            else ForeignTable(frame=read_table(path))
        )
    if ending in FEATHER:
        return _filled(ForeignTable(frame=feather(path)), path, how)
    try:
        if ending in SHEETS:
            return _filled(_from_cells(spreadsheet(path, how.sheet), path, how), path, how)
        content, name = unpacked(path)
        said = (f"{name} in {path.name}",) if ending in PACKED else ()
        if ending in PACKED and format_of(name) is not None:
            raise RecordError(f"{path} holds {name}: unpack it, it is packed by itself.")
        return _filled(text_table(content, path, how, said), path, how)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None


def _from_cells(cells: pd.DataFrame, path: Path, how: HowToRead) -> ForeignTable:
    """A sheet, by the way of text: headers, units and preambles are found as in a file of text."""
    out = io.StringIO()
    written = csv.writer(out, lineterminator="\n")
    days = [_are_days(cells[name]) for name in cells.columns]
    for row in cells.itertuples(index=False):
        written.writerow([_cell_text(cell, day) for cell, day in zip(row, days, strict=True)])
    return text_table(out.getvalue().encode(), path, replace(how, separator=",", encoding=None, decimal="."), ())


def _are_days(cells: Any) -> bool:
    """True if the dates of a column of a sheet are days without a time: midnights, all of them."""
    return all(cell.time() == time() for cell in cells if isinstance(cell, datetime))


def _cell_text(cell: Any, day: bool) -> str:
    if cell is None:
        return ""
    if isinstance(cell, datetime):
        return cell.date().isoformat() if day else cell.isoformat(sep=" ")
    if isinstance(cell, date | time):
        return cell.isoformat()
    return repr(cell) if isinstance(cell, float) else str(cell)


def _filled(table: ForeignTable, path: Path, how: HowToRead) -> ForeignTable:
    """A table with rows, and what is said of columns that are no numbers for a few cells."""
    if len(table.frame) == 0:
        raise RecordError(f"{path} has a header ({listing(table.frame.columns)}) but no rows.")
    table = _without_totals(table)
    if how.missing:
        frame, said = without(table.frame, how.missing)
        table = table.with_said(frame, *said)
    frame, said = nearly_numbers(table.frame)
    return table.with_said(frame, *said)


def _without_totals(table: ForeignTable) -> ForeignTable:
    """The table without the totals that a program wrote below its rows."""
    frame, last = table.frame, 0
    while last < len(frame) - 1 and str(frame.iloc[len(frame) - 1 - last, 0]).strip().lower() in TOTALS:
        last += 1
    if not last or (frame.iloc[: len(frame) - last, 0].astype("string").str.strip().str.lower().isin(TOTALS)).any():
        return table
    rows = frame.iloc[: len(frame) - last].copy()
    for name in rows.columns:
        numbers = pd.to_numeric(rows[name], errors="coerce") if kind_of(rows[name]) == "text" else None
        if numbers is not None and numbers.notna().equals(rows[name].notna()):
            rows[name] = numbers
    return replace(table, first_line=None).with_said(rows, f"without {times_word(last, 'row')} of totals below")


def read_logs(
    paths: Sequence[str | Path], how: HowToRead, *, join: bool = False, time: str | None = None, apart: bool = False
) -> ForeignTable:
    """One file, or several: joined by their times, one log where each goes on where another ends, else a run each.

    Times of one file are left as they came; with `apart` each of several is a run in any case.
    """
    if len(paths) == 1:
        return read_log(paths[0], how)
    if join:
        return joined(paths, time, how)
    runs = as_runs(paths, time, how)
    return runs if apart else _following(runs, _time_name(runs.frame, time, how))


def as_runs(paths: Sequence[str | Path], time: str | None, how: HowToRead) -> ForeignTable:
    """Files with the same columns, one below the other; `RUN` tells which row is whose.

    Raises RecordError for files with other columns.
    """
    tables = [_timed(path, time, how) for path in paths]
    first = tables[0].frame
    for path, table in zip(paths[1:], tables[1:], strict=True):
        if set(table.frame.columns) != set(first.columns):
            raise RecordError(
                f"{path} has the columns {listing(table.frame.columns)}, and {paths[0]} has {listing(first.columns)}. "
                "Files that belong together in time, such as a room's and an instrument's, are joined by --join."
            )
    for path, table in zip(paths[1:], tables[1:], strict=True):
        for name in first.columns:
            one, other = (unit_of(name, frame) for frame in (first, table.frame))
            if one != other:
                raise RecordError(
                    f"{quoted(name)} is in {other or 'no unit'} in {path}, in {one or 'no unit'} in {paths[0]}."
                )
    if RUN in first.columns:
        raise RecordError(f"There is a column {quoted(RUN)} already: name the runs yourself, in one file, with --run.")
    names = _names(paths)
    parts = [table.frame.assign(**{RUN: name}) for name, table in zip(names, tables, strict=True)]
    _refuse_other_clocks(parts, paths, time, how)
    said = tuple(dict.fromkeys(word for table in tables for word in table.said))
    frame = pd.concat(parts, ignore_index=True)
    came = [table.as_came for table in tables if table.as_came is not None]
    as_came = pd.concat(came, ignore_index=True) if len(came) == len(tables) else None
    runs = ForeignTable(frame=frame, said=said, as_came=as_came)
    return runs.with_said(_with_units(frame, tables), f"{len(paths)} files, a run each")


def _following(runs: ForeignTable, column: str | None) -> ForeignTable:
    """Runs as one log, where each begins within a few steps of another's end; else as they are."""
    if column is None or kind_of(times := runs.frame[column]) not in ("date", "number") or times.isna().any():
        return runs
    if kind_of(times) == "date":
        times = (times - times.iloc[0]).dt.total_seconds()
    parts = sorted((part for _, part in times.groupby(runs.frame[RUN], sort=False)), key=lambda part: part.iloc[0])
    steps = pd.concat([part.diff() for part in parts]).dropna()
    ends = pd.Series([after.iloc[0] - before.iloc[-1] for before, after in pairwise(parts)])
    # Steps of a log after which, at most, the next file of the same logger begins
    if not len(steps) or not (ends > 0).all() or not (ends <= 10.0 * steps.median()).all():
        return runs
    order, (*said, _) = np.concatenate([part.index for part in parts]), runs.said
    frame = runs.frame.loc[order].drop(columns=[RUN]).reset_index(drop=True)
    came = None if runs.as_came is None else runs.as_came.loc[order].reset_index(drop=True)
    one = replace(runs, said=tuple(said), as_came=came)
    return one.with_said(frame, f"{len(parts)} files that follow on one another, one log")


def joined(paths: Sequence[str | Path], time: str | None, how: HowToRead) -> ForeignTable:
    """Files of one stretch of time: the rows of the one with the reading, and of the others their columns there.

    A straight line between two of their values, none before the first and behind the last.
    """
    tables = [_timed(path, time, how) for path in paths]
    columns = [_time_name(table.frame, time, how) for table in tables]
    main = next((k for k, table in enumerate(tables) if how.reading in table.frame.columns), None)
    if main is None:
        main = next((k for k, table in enumerate(tables) if "reading" in table.frame.columns), None)
    if main is None:
        told = [k for k, table in enumerate(tables) if guess(table.frame, time=columns[k]).reading is not None]
        main = told[0] if len(told) == 1 else None
    if main is None:
        raise RecordError("In which file is the reading? Name its column with --reading.")
    if any(column is None for column in columns):
        at = columns.index(None)
        raise RecordError(f"{paths[at]} has no column of times that is called so. Files are joined by their times.")
    _refuse_other_clocks([table.frame for table in tables], paths, time, how)
    left: list[str] = []
    frame, index = tables[main].frame, _index(tables[main].frame, str(columns[main]))
    for k, table in enumerate(tables):
        if k == main:
            continue
        source = table.frame.set_index(_index(table.frame, str(columns[k]))).drop(columns=[str(columns[k])])
        source = source[~source.index.duplicated(keep="last")].sort_index()
        for name in source.columns:
            if kind_of(source[name]) not in ("number", "switch"):
                left.append(str(name))
                continue
            known = source[name][source[name].notna()]
            label = name if name not in frame.columns else f"{name} ({Path(paths[k]).stem})"
            if label in frame.columns:
                raise RecordError(f"Several files have a column {quoted(name)}: name the columns, or the files, apart.")
            values = on_times(known, index) if len(known) else np.full(len(frame), np.nan)
            if not np.isfinite(values).any():
                raise RecordError(f"{paths[k]} has no {quoted(name)} at any time of {paths[main]}. Is its clock right?")
            if kind_of(source[name]) == "switch":
                values = np.where(np.isnan(values), np.nan, values >= 0.5)
            frame = frame.assign(**{str(label): values})
    said = tuple(dict.fromkeys(word for table in tables for word in table.said))
    words = f"{len(paths)} files joined on the times of {Path(paths[main]).name}"
    words += f", without {listing(left)} (no numbers)" if left else ""
    together = ForeignTable(frame=frame, said=said, as_came=tables[main].as_came)
    return together.with_said(_with_units(frame, tables), words)


def _timed(path: str | Path, time: str | None, how: HowToRead) -> ForeignTable:
    table = read_log(path, how)
    column = _time_name(table.frame, time, how)
    if column is None:
        return table
    own = with_times(table, column, replace(how, timezone=None))  # of several files one may have its zone already
    zoned = isinstance(dates_once(own.frame[column]).dtype, pd.DatetimeTZDtype)
    table = own if zoned or how.timezone is None else with_times(table, column, how)
    return table.with_said(table.frame.assign(**{column: dates_once(table.frame[column])}))


def _time_name(frame: pd.DataFrame, time: str | None, how: HowToRead) -> str | None:
    """The column of times of one of several files, which need not all have the one that is named."""
    return time if time in frame.columns else time_of(frame, how.no_times)


def _index(frame: pd.DataFrame, column: str) -> Any:
    times = frame[column]
    return pd.Index(times) if kind_of(times) != "number" else pd.Index(times.astype(float))


def _refuse_other_clocks(
    frames: Sequence[pd.DataFrame], paths: Sequence[str | Path], time: str | None, how: HowToRead
) -> None:
    """Refuse files of which one has dates and another seconds, or only some a zone."""
    clocks = []
    for frame in frames:
        column = _time_name(frame, time, how)
        dtype = None if column is None else frame[column].dtype
        zoned = isinstance(dtype, pd.DatetimeTZDtype)
        clocks.append(None if column is None else "dates with a zone" if zoned else f"{kind_of(frame[column])}s")
    for path, clock in zip(paths[1:], clocks[1:], strict=True):
        if clock != clocks[0]:
            raise RecordError(
                f"The times of {paths[0]} are {clocks[0]}, those of {path} {clock}: they cannot be joined. "
                "If those without a zone are local times, say --timezone."
            )


def _names(paths: Sequence[str | Path]) -> list[str]:
    names = [Path(path).name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def _with_units(frame: pd.DataFrame, tables: Sequence[ForeignTable]) -> pd.DataFrame:
    units = {name: unit for table in tables for name, unit in table.frame.attrs.get("units", {}).items()}
    if units:
        frame.attrs["units"] = units
    return frame
