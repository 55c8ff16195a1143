"""`thermocorr correct`: a log through a fitted model, a whole file, or line by line."""

from __future__ import annotations

import argparse
import os
import stat
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pandas as pd

from ..estimators import DynamicBiasRegressor
from ..estimators.unit_guard import UnitGuard
from ..files import Outputs
from ..files.model_file import load
from ..files.result_files import write_csv
from ..foreign import RUN, ForeignTable, HowToRead, read_log, time_of, with_times
from ..live.corrector import OnlineCorrector
from ..records import RecordError, RecordWarning
from ..records.errors import existing_file, listing, printable, quoted, times_word
from ..records.files import LONGEST, csv_text
from ..records.numbers import span_text
from ..records.times import dates_once
from ..records.units import unit_of
from .line_rows import LineRows
from .loading import OneColumn, add_table_options, how_to_read, number_or_span

POLL = 0.1
"""Time between looks at a log that does not grow [s]."""
REFUSED = ("stale time", "backward time")
"""Flags of rows that get no result for their time."""
MANY = 0.1
"""Share of flagged rows from which it is said how many there are."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `thermocorr correct`."""
    parser.add_argument(
        "log",
        nargs="?",
        default="-",
        help="a file as for analyze; - or nothing: plain CSV from standard input, line by line",
    )
    add_table_options(parser)
    parser.add_argument(
        "--model", required=True, metavar="FILE", help="model.json, as `thermocorr analyze --out` writes"
    )
    parser.add_argument(
        "--follow", action="store_true", help="read a file of plain CSV line by line, and go on as it grows"
    )
    parser.add_argument("--out", metavar="FILE", help="where to write a whole log (default: standard output)")
    parser.add_argument("--force", action="store_true", help="overwrite what is there already")
    columns = parser.add_argument_group("columns of the log (default: those of the model)")
    columns.add_argument(
        "--temperature",
        metavar="COLUMN",
        action="append",
        help="ambient temperature; for a model of several thermometers once more for each, in its order",
    )
    columns.add_argument("--reading", metavar="COLUMN", action=OneColumn, help="what the instrument shows")
    columns.add_argument("--time", metavar="COLUMN", action=OneColumn, help="dates (ISO 8601) or seconds")
    more = parser.add_argument_group("besides the corrected reading")
    more.add_argument(
        "--uncertainty",
        action="store_true",
        help="its standard uncertainty if no effect is missing, as `u`; that of the mean as `u_smoothed`",
    )
    more.add_argument(
        "--average", type=int, metavar="N", help="its mean over the last N samples, or those so far, as `smoothed`"
    )
    more.add_argument(
        "--track",
        metavar="SPAN",
        type=number_or_span,
        help="a slowly tracked U0, as `reference`: time constant, such as 2h",
    )


def run(options: argparse.Namespace, say: Callable[[str], None], progress: Callable[[str], None]) -> int:
    """Correct the log: results to standard output or --out, what is wrong with it to standard error.

    Returns 1 where rows were left out or refused for their time, else 0.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", RecordWarning)
        model = load(options.model)
        live = OnlineCorrector(model, average=options.average, track=options.track, uncertainty=options.uncertainty)
        if options.log == "-" or options.follow:
            return _followed(live, options)
        path = existing_file(options.log)
        if not stat.S_ISREG(path.stat().st_mode):
            raise RecordError(
                f"{path} is no regular file. Pass a pipe as standard input: thermocorr correct - < {path}"
            )
        return _whole(live, options, path)


def _complain(text: str) -> None:
    print(f"thermocorr: {printable(text)}", file=sys.stderr)


# --------------------------------------------------------------------------------------------------------- a whole file


def _whole(live: OnlineCorrector, options: argparse.Namespace, path: Path) -> int:
    """Read a file as `thermocorr analyze` does, and write it with its results."""
    model = live.model
    with Outputs([options.model, path], options.force) as outputs:
        if options.out is not None:
            outputs.claim(options.out)
        how = how_to_read(options)
        table = read_log(path, how)
        called = _called(model, options)
        reading = options.reading or model.reading_.name
        X, table = _as_fitted(model, table, called, options.time, how, path)
        if reading not in table.frame.columns:
            raise RecordError(_lacks(table.frame, reading, "reading"))
        y = pd.Series(table.frame[reading].to_numpy(), X.index, name=reading)
        y.attrs = {"units": {reading: unit_of(reading, table.frame)}}
        results = live.update_many(X, y)
        for words in table.said:
            _complain(f"read as: {words}")
        _say_flags(model, results["flag"], results["corrected"])
        stamped = isinstance(table.frame.index, pd.DatetimeIndex | pd.TimedeltaIndex)
        if options.out is not None:
            write_csv(outputs.open(options.out), table.as_it_came(), results, stamped)
        else:
            write_csv(sys.stdout.buffer, table.as_it_came(), results, stamped)
            sys.stdout.buffer.flush()
    return int(results["flag"].isin(REFUSED).any())


def _called(model: DynamicBiasRegressor, options: argparse.Namespace) -> dict[Any, str]:
    """Column of the log for each thermometer of the model that --temperature names."""
    given, own = options.temperature or [], list(model.thermometers_)
    if len(given) > 1 and len(given) != len(own):
        raise RecordError(
            f"--temperature names {len(given)} columns ({listing(given)}); the model has "
            f"{times_word(len(own), 'thermometer')}: {listing(own)}. Name one for each, in this order, or the first "
            "alone."
        )
    return dict(zip(own, given, strict=False))


def _lacks(frame: pd.DataFrame, name: object, option: str = "") -> str:
    hint = f" Name it with --{option}." if option else ""
    return f"The log has no column {quoted(name)}; it has {listing(frame.columns)}.{hint}"


def _as_fitted(
    model: DynamicBiasRegressor,
    table: ForeignTable,
    called: dict[Any, str],
    time_column: str | None,
    how: HowToRead,
    path: Path,
) -> tuple[pd.DataFrame, ForeignTable]:
    """The log's columns under the names of the fitted record, with times of its kind; and the log."""
    frame, history = table.frame, model.features_.history_
    stamped = isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex)
    used = [called.get(name, name) for name in (*model.thermometers_, *history.record.columns)]
    free = (*how.no_times, *map(str, used))
    own = time_column or (model.time if model.time in frame.columns else time_of(frame, free))
    if history.kind != "rows" and not stamped:
        if own is None or own not in frame.columns:
            raise RecordError(_lacks(frame, own or model.time or "time", "time"))
        table = with_times(table, own, how)
        frame = table.frame
    guard = UnitGuard.of(model)
    for name in guard.ranges:
        column = called.get(name, str(name))
        guard.check_temperature(name, unit_of(column, frame), column=column)
    taken = {old: new for new, old in called.items()}
    for name in (*model.thermometers_, *model.features_.history_.record.columns):
        if called.get(name, name) not in frame.columns:
            raise RecordError(
                _lacks(frame, called.get(name, name), "temperature" if name in model.thermometers_ else "")
            )
    X = frame.drop(columns=[name for name in taken.values() if name in frame.columns and name not in taken])
    X = X.rename(columns=taken)
    X.attrs = {"units": {taken.get(name, name): unit_of(name, frame) for name in frame.columns}}
    if history.kind != "rows" and not stamped:
        times = _times_as_fitted(dates_once(frame[own]), str(own), history.kind)
        X = X.assign(**{str(model.time): times}) if model.time is not None else X.set_index(pd.Index(times))
    elif stamped and model.time is not None:
        X[model.time] = X.index
    if model.run == RUN and RUN not in X:  # learned from several files, each a run: this is one more
        X[RUN] = path.name
    elif model.run is not None and model.run not in X:
        raise RecordError(_lacks(frame, model.run))
    return X, table


def _times_as_fitted(times: pd.Series[Any], name: str, kind: str) -> pd.Series[Any]:
    """Times of the fitted kind; RecordError where one has a zone and the other has none."""
    if kind == "timedelta" and times.dtype.kind in "if":
        return pd.to_timedelta(times, unit="s")
    zoned = kind == "datetime with time zone"
    if (
        times.dtype.kind != "M"
        or not kind.startswith("datetime")
        or isinstance(times.dtype, pd.DatetimeTZDtype) == zoned
    ):
        return times
    raise RecordError(
        f"The times in {quoted(name)} have no zone, and those that the model was fitted to have one: pass --timezone "
        "with the logger's, such as --timezone Europe/Berlin."
        if zoned
        else f"The times in {quoted(name)} have a zone, and those that the model was fitted to have none: write them "
        "as the fitted log has them, or fit the model to times with their zone (--timezone)."
    )


def _say_flags(model: DynamicBiasRegressor, flags: pd.Series[Any], corrected: pd.Series[Any]) -> None:
    """Say how many rows got no result, and how many are flagged, where these are many; with advice."""
    without = Counter(flags[corrected.isna()])
    if without:
        reasons = ", ".join(f"{count} {why}" for why, count in without.most_common())
        _complain(f"{sum(without.values())} of {times_word(len(flags), 'row')} got no result: {reasons}")
    found = Counter(flags[flags != ""])
    if sum(found.values()) <= MANY * len(flags):
        return
    said = f"{sum(found.values())} of {len(flags)} rows are flagged"
    said += ": " + ", ".join(f"{count} {flag}" for flag, count in found.most_common())
    for flag, count in found.most_common():
        if count > MANY * len(flags):
            said += _advice(model, flag)
    _complain(f"{said}.")


def _advice(model: DynamicBiasRegressor, flag: str) -> str:
    if flag == "washout":
        return (
            ". washout: the log lacks the time before them, which the model remembers for about "
            f"{span_text(model.washout_)}. Begin the log earlier"
        )
    if flag == "outside fitted range":
        low, high = model.reading_.temperature_range
        return (
            f". outside fitted range: the model was fitted to temperatures of {low:.4g} to {high:.4g} "
            f"{model.reading_.temperature_unit}. Fit it to a record that reaches further"
        )
    return ""


# -------------------------------------------------------------------------------------------------------- line by line


def _followed(live: OnlineCorrector, options: argparse.Namespace) -> int:
    """Answer every line of plain CSV at once, on standard output."""
    if options.out is not None:
        raise RecordError("Line by line, results go to standard output: write thermocorr correct ... > FILE.")
    if how_to_read(options).says_something():
        raise RecordError(
            "Lines are read as plain CSV. Give a whole file, without --follow, to read it in another way."
        )
    out = sys.stdout.buffer
    with _opened(options.log) as source:
        lines = _lines(source, options.follow, options.log)
        first = next(lines, b"")
        if not first:
            raise RecordError("The log is empty: a header line with the columns' names is needed, with a line end.")
        rows = LineRows(live, options, _called(live.model, options), _complain)
        out.write(csv_text([rows.begin(first)]))
        out.flush()
        for line in lines:
            answer = rows.answer(line)
            if answer is not None:
                out.write(csv_text([answer]))
                out.flush()
    if rows.summary():
        _complain(rows.summary())
    return int(rows.damaged)


def _opened(log: str) -> BinaryIO:
    """Standard input, of which a second name is closed, or the file."""
    return os.fdopen(os.dup(sys.stdin.fileno()), "rb") if log == "-" else existing_file(log).open("rb")


def _lines(source: BinaryIO, follow: bool, name: str) -> Iterator[bytes]:
    """Whole lines; of a log that is followed also those still to come."""
    rest, begun, wait = b"", False, follow and name != "-"
    while True:
        piece = source.readline(LONGEST)
        if len(rest) + len(piece) >= LONGEST and not piece.endswith(b"\n"):
            raise RecordError(f"The log has a line of more than {LONGEST} bytes. Is it CSV?")
        rest += piece
        if rest.endswith(b"\n"):
            yield rest
            rest, begun = b"", True
        elif wait:
            if os.fstat(source.fileno()).st_size < source.tell() or not Path(name).exists():
                raise RecordError(f"{name} was cut or replaced. Start the command again.")
            time.sleep(POLL)
        elif not piece:
            if rest and begun:
                _complain("the last line is left out: it has no line end, and may have been cut while it was written")
            return
