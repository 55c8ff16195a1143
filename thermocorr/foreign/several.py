"""Several files as one log: those of a logger that begins a new one each day, a run each, or columns of one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing, quoted
from ..records.times import dates_once
from ..records.types import kind_of
from ..records.units import unit_of
from .how import ForeignTable, HowToRead
from .log_files import read_log
from .long_form import on_times
from .timed import time_column, with_times

RUN = "file"
"""Column of the names of files, each a run."""
FOLLOWS = 10.0
"""Steps of a log after which, at most, the next file of the same logger begins."""


def read_logs(
    paths: Sequence[str | Path],
    how: HowToRead,
    *,
    join: bool = False,
    time: str | None = None,
    apart: bool = False,
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
    if not len(steps) or not (ends > 0).all() or not (ends <= FOLLOWS * steps.median()).all():
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
    table = with_times(table, column, how)
    return table.with_said(table.frame.assign(**{column: dates_once(table.frame[column])}))


def _time_name(frame: pd.DataFrame, time: str | None, how: HowToRead) -> str | None:
    """The column of times of one of several files, which need not all have the one that is named."""
    return time_column(frame.columns, time if time in frame.columns else None, how)


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
                f"The times of {paths[0]} are {clocks[0]}, those of {path} {clock}: they cannot be joined."
            )


def _names(paths: Sequence[str | Path]) -> list[str]:
    names = [Path(path).name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def _with_units(frame: pd.DataFrame, tables: Sequence[ForeignTable]) -> pd.DataFrame:
    units = {name: unit for table in tables for name, unit in table.frame.attrs.get("units", {}).items()}
    if units:
        frame.attrs["units"] = units
    return frame
