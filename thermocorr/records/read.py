"""From frames and arrays to a validated `Record`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta
from decimal import Decimal
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError, listing, option, quoted, times_word, warn, way
from .numbers import as_data, is_frame, numeric_column, span_text, span_texts
from .record import Record, Segment, holes
from .screen import missing_text, nothing_known_text, reading_of
from .times import (
    BEYOND,
    EARLIEST,
    LATEST,
    UNITS,
    Times,
    index_times,
    no_times_text,
    seconds_of,
    steps_back_an_hour,
    summer_time_text,
    times_from,
)
from .types import kind_of

GAP_STEPS = 10.0
"""A step of more than so many usual ones is a gap, where there is no `max_gap`."""
_CHUNK = 1 << 16  # rows looked at together, so that checks need no memory of the record's size


@dataclass(frozen=True)
class Layout:
    """Layout of the user's data; None leaves it to `read_record`."""

    temperature: object = None
    time: object = None
    run: object = None
    sampling_period: object = None
    max_gap: object = None
    reference: object = None
    """Column that the readings are compared with: what is learned is how much they differ."""

    def longest_step(self) -> float | None:
        """Longest step inside a segment [s]; None for no limit."""
        return None if self.max_gap is None else seconds_of(self.max_gap, "max_gap")


def read_record(X: Any, layout: Layout, *, y: Any = None, needed: Sequence[object] = (), quiet: bool = False) -> Record:
    """Validate a record and find its times and segments.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_columns)
        Times come from the column `layout.time`, else from an index of dates, periods, spans or dates in text, else
        rows are `sampling_period` apart. The temperature is the column `layout.temperature`, else the one called
        "temperature", else the first.
    layout : Layout
        Names of special columns and limits.
    y : array-like of shape (n_rows,), or WeightedReading, optional
        Readings; NaN where there is none.
    needed : sequence of column names
        Further columns that must be numbers. A row with a NaN in one of them, or in the temperature, is passed over as
        if it had not been recorded.
    quiet : bool
        Do not warn about the record's quality (it is noted in `Record.notes` all the same).

    Raises
    ------
    RecordError
        For what cannot be used: the message says what was found, where, and what to do.
    """
    X = as_data(X)
    frame = is_frame(X)
    n = len(X)
    name = temperature_column(X, layout, quiet)
    columns: dict[object, NDArray[Any]] = {}
    compared = (layout.reference,) if y is None and layout.reference is not None else ()  # for readings to come
    for column in dict.fromkeys((name, *needed, *compared)):
        columns[column] = numeric_column(X, column, "temperature" if column == name else "column")
    notes: list[str] = []
    times = _times(X, layout, frame, n, notes)
    runs, order = _runs(X, layout, times)
    reading, weight = reading_of(y, X, layout.reference)
    segments = _segments(times, runs, order, layout, notes)
    record = Record(
        times=times, temperature_name=name, columns=columns, segments=tuple(segments), order=order, weight=weight,
        reading=reading,
    )  # fmt: skip
    record = _known(record, layout, notes)
    record = replace(record, notes=tuple(notes))
    if not record.segments and record.times.kind not in ("rows", "seconds"):
        raise RecordError("The data have 0 rows. Check the file, or the selection that made them.")
    if not quiet:
        for note in notes:
            warn(note)
    return record


def check_order(record: Record, layout: Layout) -> None:
    """Refuse unordered rows under a `sampling_period`.

    Half the mean square of the steps over the variance (von Neumann 1941, Annals of Mathematical Statistics 12, 367) is
    1 for a shuffled record, and next to nothing for a temperature that is logged often enough to be followed.
    RecordError says what to do.
    """
    segment = record.longest()
    # Fifty rows of a record without times show whether they have an order.
    if layout.sampling_period is None or record.times.kind != "rows" or segment.n_rows < 50:
        return
    rows = record.kept(segment.start, min(segment.stop, segment.start + _CHUNK))
    T = np.asarray(record.columns[record.temperature_name][rows], float)
    ratio = np.mean(np.square(np.diff(T))) / (2.0 * np.var(T) or np.inf)
    if ratio > 1.0 - 3.0 / np.sqrt(len(T)):
        raise RecordError(
            f"The rows are {span_text(record.times.period)} apart, and their temperatures change from row to row as if "
            "they had been shuffled. Give the rows in the order in which they were recorded: split with shuffle=False "
            f"or TimeSeriesSplit, or name a column of times with {option('time')}."
        )


def check_max_gap(record: Record, layout: Layout) -> None:
    """Refuse a `max_gap` shorter than nearly all steps.

    For records that are learned from: a few rows that are corrected may be as far apart as they like.

    Raises ValueError in the words of scikit-learn's parameter checks.
    """
    most = layout.longest_step()
    if most is None:
        return
    parts = [record.kept_places(start, min(stop, start + _CHUNK)) for start, stop, _ in record.segments[:_CHUNK]]
    steps = record.times.steps(record.rows_at(np.concatenate(parts)[:_CHUNK]))[1:]
    steps = steps[steps > 0]
    # Where nine tenths of the steps are longer than `max_gap`, rows stand alone and nothing can be learned.
    if len(steps) and (steps > most).mean() >= 0.9:
        usual = float(np.median(steps))
        raise ValueError(
            f"The 'max_gap' parameter must be longer than the usual step between rows, which is {span_text(usual)}: "
            f"each row would be a segment of its own. Got {span_text(most)}. Leave it out, or pass "
            f"{option('max_gap', f'{3 * usual:.5g}')}."
        )


def times_of(X: Any, layout: Layout) -> Times:
    """Times of the rows, unsorted and unchecked."""
    return _times(X, layout, is_frame(X), len(X), [])


def temperature_column(X: Any, layout: Layout, quiet: bool = False) -> object:
    """Name (frames) or number (arrays) of the temperature column."""
    wanted = layout.temperature
    if not is_frame(X):
        count = X.shape[1]
        if wanted is None:
            return 0
        if not isinstance(wanted, int | np.integer) or not 0 <= wanted < count:
            raise RecordError(
                f"temperature={wanted!r} is not a column of an array with {count} columns. Give its number, "
                f"0 to {count - 1}, or pass a DataFrame with named columns."
            )
        return int(wanted)
    special = {layout.time, layout.run, layout.reference} - {None}
    if wanted is None:
        candidates = [column for column in X.columns if column not in special]
        if "temperature" in candidates or not candidates:
            return "temperature"
        if len(candidates) > 1 and not quiet:
            warn(
                f"No column is called 'temperature': the first one, {candidates[0]!r}, is taken. Say which of "
                f"{listing(candidates)} it is with {option('temperature')}."
            )
        return candidates[0]
    return wanted


def _times(X: Any, layout: Layout, frame: bool, n: int, notes: list[str]) -> Times:
    if layout.time is not None:
        if not frame or layout.time not in X.columns:
            found = f"Its columns are {listing(X.columns)}" if frame else "An array has no named columns"
            raise RecordError(
                f"There is no time column {layout.time!r} in the data. {found}. Name one with {option('time')}."
            )
        return times_from(X[layout.time], f"The time column {layout.time!r}")
    if frame and (times := index_times(X.index)) is not None:
        if layout.sampling_period is not None:
            notes.append(
                f"The data have times of their own: {way('--sampling-period', 'sampling_period')} is not used."
            )
        return times
    if layout.sampling_period is None:
        dates = next((name for name in getattr(X, "columns", ()) if kind_of(X[name]) == "date"), None)
        here = (
            ""
            if dates is None
            else f"The column {quoted(dates)} holds dates: take them with {option('time', repr(dates))}. "
        )
        python = "sampling_period=..., time=<column>, or a DataFrame with a DatetimeIndex"
        passed = way("--sampling-period or --time", python)
        notes.append(
            "The data have no times: rows are taken as 1 s apart, so time constants count in samples. "
            f"{here}{no_times_text(X.index if isinstance(X, pd.DataFrame) else None)}Pass {passed}."
        )
        return Times(n, "rows")
    return Times(n, "rows", period=seconds_of(layout.sampling_period, "sampling_period"))


def _runs(X: Any, layout: Layout, times: Times) -> tuple[NDArray[Any] | None, NDArray[np.intp] | None]:
    """Run codes in time order, and that order."""
    if layout.run is None:
        return None, None
    if not is_frame(X):
        if not isinstance(layout.run, int | np.integer) or not 0 <= layout.run < X.shape[1]:
            raise RecordError(f"run={layout.run!r} is not a column of an array with {X.shape[1]} columns.")
        labels = pd.Series(X[:, layout.run])
    elif layout.run not in X.columns:
        raise RecordError(
            f"There is no run column {layout.run!r} in the data. Its columns are {listing(X.columns)}. "
            f"Name one with {option('run')}."
        )
    else:
        labels = X[layout.run]
        if labels.ndim != 1:
            raise RecordError(f"The run column stands over {labels.shape[1]} columns. Give columns unique names.")
    codes, names = factorized(labels, f"The run column {layout.run!r}")
    order = None
    if (np.diff(codes) < 0).any():
        if times.ticks is None:
            raise RecordError(
                "Runs are interleaved and rows have no times. Sort the rows by run, or name a time column with "
                f"{option('time')}."
            )
        order = np.argsort(codes, kind="stable")
        codes = codes[order]
    return np.asarray(names, dtype=object)[codes], order


def _segments(
    times: Times, runs: NDArray[Any] | None, order: NDArray[np.intp] | None, layout: Layout, notes: list[str]
) -> list[Segment]:
    """Cut where the run changes, and where a gap exceeds max_gap."""
    cuts = [np.zeros(1, np.intp)]
    if runs is not None:
        cuts.append(np.flatnonzero(runs[1:] != runs[:-1]) + 1)
    starts_run = set(np.concatenate(cuts).tolist())
    if times.ticks is not None:
        cuts.append(_check_steps(times, order, starts_run, layout, notes))
    edges = np.unique(np.concatenate((*cuts, [times.n]))).tolist()
    return [Segment(start, stop, None if runs is None else runs[start]) for start, stop in pairwise(edges)]


def _steps_from(start: int, times: Times, order: NDArray[np.intp] | None) -> NDArray[np.float64]:
    """Steps to the rows of a chunk [s], in time order."""
    stop = min(start + _CHUNK + 1, times.n)
    return times.steps(slice(start, stop) if order is None else order[start:stop])[1:]


def _inside(start: int, steps: NDArray[np.float64], starts_run: set[int]) -> NDArray[np.bool_]:
    """True for steps within one run, shape (n,)."""
    inside = np.ones(len(steps), bool)
    inside[[k - 1 - start for k in starts_run if start < k <= start + len(steps)]] = False
    return inside


def _known(record: Record, layout: Layout, notes: list[str]) -> Record:
    """The record without rows that lack a needed value."""
    n, gone = record.n_rows, [np.zeros(0, np.intp)]
    for start in range(0, n, _CHUNK):
        rows = record.rows(start, min(start + _CHUNK, n))
        if any(np.isnan(column[rows].sum(dtype=float)) for column in record.columns.values()):
            bad = np.logical_or.reduce([np.isnan(column[rows]) for column in record.columns.values()])
            gone.append(np.flatnonzero(bad) + start)
    missing = np.concatenate(gone)
    if not len(missing):
        return record
    max_gap = layout.longest_step()
    known = record.passing_over(missing, max_gap)
    if not known.segments:
        raise RecordError(nothing_known_text(record))
    said = f"{missing_text(record, missing)}. {'It is' if len(missing) == 1 else 'They are'} passed over as if "
    said += f"{'it' if len(missing) == 1 else 'they'} had not been recorded"
    longest, usual = _longest_hole(known), known.usual_step()
    if longest:
        said += f": temperature is taken as a straight line across, for {span_text(longest)} at most"
        if max_gap is None and longest > GAP_STEPS * usual:
            said += f". Pass {option('max_gap', f'{3 * usual:.5g}')} to start a new segment after long ones"
    its = f"{'its reading' if len(missing) == 1 else 'their readings'} too, fill short holes first"
    notes.append(f"{said}. To use {its}{way('', ', for example with X.interpolate(limit=5)')}.")
    return known


def _longest_hole(record: Record) -> float:
    """The longest step over skipped rows [s]; 0 for none."""
    return float(record.steps_over(*holes(record.skipped)).max(initial=0.0))


def _check_steps(
    times: Times, order: NDArray[np.intp] | None, starts_run: set[int], layout: Layout, notes: list[str]
) -> NDArray[np.intp]:
    """Ends of gaps; RecordError for times that stand or go back."""
    n = times.n
    max_gap = layout.longest_step()
    if order is None and times.even_step is not None and times.even_step <= (np.inf if max_gap is None else max_gap):
        return np.zeros(0, np.intp)
    found, wide, first, usual = [], [], None, None
    for start in range(0, n - 1, _CHUNK):
        steps = _steps_from(start, times, order)
        inside = _inside(start, steps, starts_run)
        if not inside.any():
            continue
        if first is None:  # of its steps within runs the usual one is the median, and no shorter than the least
            first, least = start, float(steps[inside].min())
        if steps.min() > 0 and steps.max() <= (GAP_STEPS * least if max_gap is None else max_gap):
            continue
        bad = inside & (steps <= 0)
        if bad.any():
            # Rows of which a fifth of the steps go back in time have no order: shuffled ones have half.
            shuffled = bad.sum() > 0.2 * inside.sum() and not bad.all()
            usual = float(np.median(steps[inside & (steps > 0)])) if (inside & (steps > 0)).any() else 0.0
            _refuse_order(times, order, start + 1 + int(bad.argmax()), layout, shuffled, usual)
        limit = max_gap
        if limit is None:
            if usual is None:
                early = _steps_from(first, times, order)
                usual = float(np.median(early[_inside(first, early, starts_run)]))
            limit = GAP_STEPS * usual
        gaps = np.flatnonzero(inside & (steps > limit))
        found.extend((gaps + start + 1).tolist())
        wide.extend(steps[gaps].tolist())
    if max_gap is not None:
        return np.asarray(found, np.intp)
    if found:
        row = found[0] - 1 if order is None else int(order[found[0] - 1])
        advice = 3 * (usual or 1)
        notes.append(
            f"Sampling has {times_word(len(found), 'gap')}, the first after row {row} "
            f"({' where '.join(span_texts((wide[0], usual or 0.0)))} is usual). Temperature is taken as a straight "
            f"line across. Pass {option('max_gap', f'{advice:.5g}')} to start a new segment there."
        )
    return np.zeros(0, np.intp)


def _is_ahead(times: Times, early: int, row: int, late: int, usual: float) -> bool:
    """True if a row's time is far ahead of its neighbours'."""
    on, ahead = (times.between(times.stamp(k), times.stamp(early)) for k in (late, row))
    return 0 < on <= GAP_STEPS * usual < ahead


def _refuse_order(
    times: Times, order: NDArray[np.intp] | None, k: int, layout: Layout, shuffled: bool, usual: float
) -> None:
    row, before = (k, k - 1) if order is None else (int(order[k]), int(order[k - 1]))
    back = times.between(times.stamp(before), times.stamp(row))
    if times.kind == "datetime" and not shuffled and steps_back_an_hour(back, usual):
        raise RecordError(summer_time_text(row, times.label(row), times.label(before)))
    early = k - 2 if order is None else int(order[k - 2])
    if k > 1 and not shuffled and _is_ahead(times, early, before, row, usual):
        raise RecordError(
            f"Row {before} stands far ahead of the others: {times.label(before)} between {times.label(early)} in row "
            f"{early} and {times.label(row)} in row {row}. Is its time damaged? Correct it, or leave the row out."
        )
    split = way(
        "sort them with --skip-bad-rows",
        "split with shuffle=False or TimeSeriesSplit; a search that draws rows at random, such as HalvingGridSearchCV, "
        "cannot be used (GridSearchCV can)",
    )
    hint = (
        f"The rows are shuffled: {split}. If these are no times, name the column that has them: {option('time')}."
        if shuffled
        else f"Sort the rows by time{way(' (--skip-bad-rows)', '')}; if the log holds several runs, name their column "
        f"with {option('run')}; local times without a zone step back when summer time ends."
        if layout.run is None
        else "Sort the rows of each run by time."
    )
    if times.stamp(row) == times.stamp(before):
        raise RecordError(_twice_text(times, order, row, before, layout))
    raise RecordError(f"Time goes backward at row {row}: {times.label(row)} follows {times.label(before)}. {hint}")


def _twice_text(times: Times, order: NDArray[np.intp] | None, row: int, before: int, layout: Layout) -> str:
    """Message on rows that share a time."""
    steps = times.steps(slice(0, times.n) if order is None else order)[1:]
    more = int((steps == 0).sum()) - 1 if layout.run is None else 0
    each = 1 < more + 1 == times.n / 2
    count = "; every time stands there twice" if each else f", and {more} more like these" if more else ""
    stamps = "X.index" if layout.time is None else f"X[{layout.time!r}]"
    first = way(
        "--skip-bad-rows keeps the first", f"with keep = ~{stamps}.duplicated(), X[keep], y[keep] has the first"
    )
    advice = "Drop every second row" if each else "Drop one of each" if more else "Drop one of them"
    return (
        f"Two rows have the same time {times.label(row)}: rows {before} and {row}{count}. {advice}, or write their "
        f"mean ({first}); if summer time ended then, {way('pass --timezone', 'give times with their zone')}; if the "
        f"log holds several runs, name their column with {option('run')}."
    )


LABELS = (str, bool, int, float, Decimal, np.number, np.bool_, date, timedelta, np.datetime64, np.timedelta64)
"""What may label a run: dates and spans of pandas are dates and spans of Python too."""


def factorized(labels: pd.Series[Any], what: str) -> tuple[NDArray[np.intp], pd.Index[Any]]:
    """Codes of labels, and the distinct labels.

    Raises RecordError for labels that are missing, of other types than `LABELS`, or dates and spans out of reach.
    """
    missing = labels.isna().to_numpy()
    if missing.any():
        raise RecordError(f"{what} is empty in row {missing.argmax()}. Label every row.")
    alike = labels.dtype.kind in "biufmM" and not isinstance(labels.dtype, pd.ArrowDtype)
    try:
        for row, value in enumerate(() if alike or isinstance(labels.dtype, pd.StringDtype) else labels):
            if not isinstance(value, LABELS):
                raise RecordError(
                    f"{what} holds a {type(value).__name__} in row {row}. Label runs with text, numbers or dates."
                )
    except (ArithmeticError, pd.errors.OutOfBoundsDatetime):  # a date that pandas cannot hand over
        raise RecordError(f"{what} holds dates out of reach. {BEYOND}") from None
    codes, names = pd.factorize(labels)
    check_dates(codes, names, what)
    return codes, names


def refuse_labels_of_rows(labels: pd.Series[Any], column: object) -> None:
    """Refuse labels that differ in nearly every row."""
    try:
        count = labels.nunique()
    except (TypeError, ArithmeticError, ValueError):  # what can be no label: the record says so
        return
    # More than twenty runs of fewer than eight rows on average are no runs: something else is in their column.
    if count > 20 and len(labels) < 8 * count:
        raise RecordError(
            f"{quoted(column)} has {count} different values in {len(labels)} rows: each run needs many rows. Is it the "
            "right column for the runs?"
        )


def check_dates(codes: NDArray[np.intp], names: pd.Index[Any], what: str) -> None:
    """Refuse labels of dates beyond a clock of nanoseconds."""
    if isinstance(names, pd.DatetimeIndex | pd.TimedeltaIndex):
        unit = 1_000_000_000 // UNITS[names.unit]
        far = np.flatnonzero((names.asi8 > LATEST // unit) | (names.asi8 < EARLIEST // unit))
        if len(far):
            seconds = int(names.asi8[far[0]]) // UNITS[names.unit]
            shown = np.datetime64(seconds, "s") if isinstance(names, pd.DatetimeIndex) else f"a span of {seconds} s"
            raise RecordError(f"{what} is {shown} in row {int((codes == far[0]).argmax())}. {BEYOND}")
        return
    for k, name in enumerate(names):
        if out_of_reach(name):
            raise RecordError(f"{what} is {name!s:.60} in row {int((codes == k).argmax())}. {BEYOND}")


def out_of_reach(label: Any) -> bool:
    """True if a label is such a date or span."""
    try:
        if isinstance(label, timedelta | np.timedelta64):
            value: int = pd.Timedelta(label).value
        elif isinstance(label, date | np.datetime64):
            value = pd.Timestamp(label).value
        else:
            return False
    except (ArithmeticError, ValueError):
        return True
    return not EARLIEST <= value <= LATEST
