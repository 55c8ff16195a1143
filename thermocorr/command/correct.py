"""`thermocorr correct`: a log through a fitted model."""

from __future__ import annotations

import argparse
import os
import stat
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import pandas as pd

from ..live.corrector import OnlineCorrector
from ..model import DynamicBiasRegressor
from ..model.checks import UnitGuard
from ..output.model_file import load
from ..output.results import write_csv
from ..output.writer import Outputs
from ..readers import RUN, Options, read_logs
from ..readers.clocks import Clock
from ..readers.growing import Growing
from ..readers.roles import refuse_words
from ..records import RecordError, RecordWarning
from ..records.errors import existing_file, listing, printable, quoted, times_word
from ..records.numbers import span_text
from ..records.units import unit_of
from .loading import OneColumn, add_table_options, how_to_read, number_or_span

REFUSED = ("stale time", "backward time")
"""Flags of rows that get no result for their time."""
MANY = 0.1
"""Share of flagged rows at which their number is printed."""
SHOWN = 20
"""Notes on lines that are shown; further ones are counted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `thermocorr correct`."""
    parser.add_argument(
        "log", nargs="?", default="-", help="a file as for analyze; - or nothing: standard input, line by line"
    )
    add_table_options(parser)
    parser.add_argument(
        "--model", required=True, metavar="FILE", help="model.json, as `thermocorr analyze --out` writes"
    )
    parser.add_argument("--follow", action="store_true", help="read a file line by line, and go on as it grows")
    parser.add_argument("--out", metavar="FILE", help="where to write a whole log (default: standard output)")
    parser.add_argument("--force", action="store_true", help="overwrite what is there already")
    columns = parser.add_argument_group("columns of the log (default: those of the model)")
    columns.add_argument(
        "--temperature",
        metavar="COLUMN",
        action="append",
        help="ambient temperature; repeat for each thermometer of the model, in its order",
    )
    columns.add_argument("--reading", metavar="COLUMN", action=OneColumn, help="what the instrument shows")
    columns.add_argument("--time", metavar="COLUMN", action=OneColumn, help="dates or seconds")
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
    """Correct the log, to standard output or --out.

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


def _whole(live: OnlineCorrector, options: argparse.Namespace, path: Path) -> int:
    """Read a whole file, and write it with results."""
    columns = Columns.of(live.model, options)
    with Outputs([options.model, path], options.force) as outputs:
        if options.out is not None:
            outputs.claim(options.out)
        log = columns.read(path)
        X, y = columns.as_fitted(log, path.name)
        results = live.update_many(X, y)
        for words in log.attrs["notes"]:
            _complain(f"read as: {words}")
        _say_flags(live.model, results["flag"], results["corrected"])
        if options.out is not None:
            write_csv(outputs.open(options.out), log, results)
        else:
            _answer(log, results, header=True)
    return int(results["flag"].isin(REFUSED).any())


@dataclass(frozen=True)
class Columns:
    """The columns of a log, named as in the fitted record."""

    model: DynamicBiasRegressor
    how: Options
    reading: str
    called: dict[Any, str]
    """Thermometer of the model -> column of the log that --temperature names."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, options: argparse.Namespace) -> Columns:
        """The columns that the options and the model name."""
        given, own = options.temperature or [], list(model.thermometers_)
        if len(given) > 1 and len(given) != len(own):
            raise RecordError(
                f"--temperature names {len(given)} columns ({listing(given)}); the model has "
                f"{times_word(len(own), 'thermometer')}: {listing(own)}. Name one for each, in this order, or the "
                "first alone."
            )
        called = dict(zip(own, given, strict=False))
        reading = options.reading or str(model.reading_.name)
        used = tuple(str(called.get(name, name)) for name in model.features_.history_.record.columns)
        how = how_to_read(options)
        return cls(model, replace(how, others=(*how.others, *used, reading)), reading, called)

    @property
    def needed(self) -> list[str]:
        """Columns of numbers that the log must have."""
        names = dict.fromkeys([*self.model.thermometers_, *self.model.features_.history_.record.columns])
        return [*(str(self.called.get(name, name)) for name in names), self.reading]

    def read(self, path: Path) -> pd.DataFrame:
        """A whole file, in the fitted log's form if it can."""
        form = None if self.how.given().keys() - {"reading", "run"} else self.model.form_
        log = read_logs([path], self.how, form)
        if self.model.time in log.columns and self.how.time is None and form is None:
            log = read_logs([path], replace(self.how, time=str(self.model.time)))
        return log

    def as_fitted(self, log: pd.DataFrame, file: str) -> tuple[pd.DataFrame, pd.Series[Any]]:
        """X and y as the model needs them, or RecordError."""
        model, thermometers = self.model, self.model.thermometers_
        for name in dict.fromkeys([*thermometers, *model.features_.history_.record.columns, self.reading]):
            column = self.called.get(name, name)
            if column not in log.columns:
                role = "temperature" if name in thermometers else "reading" if name == self.reading else ""
                hint = f" Name it with --{role}." if role else " Was it renamed? --names calls all columns anew."
                raise RecordError(f"The log has no column {quoted(column)}; it has {listing(log.columns)}.{hint}")
            refuse_words(log, column)
        guard = UnitGuard.of(model)
        for name in guard.ranges:
            column = self.called.get(name, str(name))
            guard.check_temperature(name, unit_of(column, log), column=column)
        taken = {old: new for new, old in self.called.items()}
        X = log.drop(columns=[name for name in taken.values() if name in log.columns and name not in taken])
        X = self._with_times(X.rename(columns=taken))
        X.attrs = {"units": {taken.get(name, name): unit_of(name, log) for name in log.columns}}
        if model.run == RUN and RUN not in X:  # learned from several files, each a run: this is one more
            X[RUN] = file
        elif model.run is not None and model.run not in X:
            raise RecordError(f"The log has no column {quoted(model.run)}; it has {listing(log.columns)}.")
        y = pd.Series(log[self.reading].to_numpy(), X.index, name=self.reading)
        y.attrs = {"units": {self.reading: unit_of(self.reading, log)}}
        return X, y

    def _with_times(self, X: pd.DataFrame) -> pd.DataFrame:
        """The frame with times as the model has them."""
        kind, times = self.model.features_.history_.kind, X.index
        if kind == "rows":
            return X
        if isinstance(times, pd.RangeIndex):
            raise RecordError(
                f"The log has no times, and the fitted one had; it has {listing(X.columns)}. Name them with --time."
            )
        zoned = getattr(times, "tz", None) is not None
        if kind.startswith("datetime") and isinstance(times, pd.DatetimeIndex) and zoned != (kind != "datetime"):
            raise RecordError(
                "The times have a zone, and those that the model was fitted to have none: fit it to times with their "
                "zone (--timezone)."
                if zoned
                else "The times have no zone, and those that the model was fitted to have one: pass --timezone with "
                "the logger's, such as --timezone Europe/Berlin."
            )
        if kind == "seconds" and isinstance(times, pd.TimedeltaIndex):
            times = times.total_seconds()
        elif kind == "seconds" and zoned:  # seconds since 1970, which the reader takes for dates
            stamps = pd.DatetimeIndex(times).as_unit("ns").asi8
            times = pd.Index(stamps // 10**9 + stamps % 10**9 / 1e9)  # each to the last digit
        return X.set_index(times) if self.model.time is None else X.assign(**{str(self.model.time): times})


def _say_flags(model: DynamicBiasRegressor, flags: pd.Series[Any], corrected: pd.Series[Any]) -> None:
    """Say how many rows were refused or flagged."""
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
            ". washout: the log lacks the time before them; the model remembers about "
            f"{span_text(model.washout_)}. Begin the log earlier"
        )
    if flag == "outside fitted range":
        low, high = model.reading_.temperature_range
        return (
            f". outside fitted range: the model was fitted to temperatures of {low:.4g} to {high:.4g} "
            f"{model.reading_.temperature_unit}. Fit it to a wider temperature range"
        )
    return ""


def _followed(live: OnlineCorrector, options: argparse.Namespace) -> int:
    """Answer every line at once, on standard output."""
    if options.out is not None:
        raise RecordError("Line by line, results go to standard output: write thermocorr correct ... > FILE.")
    columns, model = Columns.of(live.model, options), live.model
    if columns.how.given().keys() - {"reading", "run", "time"}:
        raise RecordError(
            "Lines are read as the model's log was written. To read another format, give a whole file, without "
            "--follow."
        )
    kind = model.features_.history_.kind
    form = {"datetime": "iso", "datetime with time zone": "iso utc"}.get(kind, "seconds")
    clock = None if kind == "rows" else Clock([options.time or str(model.time or "time")], form)
    log = Growing(None if options.time else model.form_, columns.needed, clock)
    flags, notes, begun = Counter[str](), 0, False
    with _opened(options.log) as source:
        for piece in _pieces(source, options.follow, options.log):
            rows, said = log.feed(piece)
            for note in said[: max(0, SHOWN - notes)]:
                _complain(note)
            notes += len(said)
            if not begun and (header := log.header()) is not None:
                results = live.update_many(*columns.as_fitted(header, options.log))
                _answer(header, results, header=True)
                begun = True
            if rows is None:
                continue
            X, y = columns.as_fitted(rows, options.log)
            results = live.update_many(X, y)
            _answer(rows, results, header=False)
            flags.update(results["flag"][results["corrected"].isna()])
    log.end()
    if log.cut and log.lines:
        _complain("the last line is left out: it has no line end, and may have been cut while it was written")
    if not log.lines:
        raise RecordError("The log is empty: a header line with the columns' names is needed, with a line end.")
    if notes > SHOWN:
        _complain(f"{notes - SHOWN} further notes are not shown")
    if flags:
        _complain(
            f"{sum(flags.values())} rows got no result: {', '.join(f'{n} {why}' for why, n in flags.most_common())}"
        )
    return int(notes > 0 or any("time" in flag for flag in flags))


def _answer(rows: pd.DataFrame, results: pd.DataFrame, header: bool) -> None:
    write_csv(sys.stdout.buffer, rows, results, header)
    sys.stdout.buffer.flush()


def _opened(log: str) -> BinaryIO:
    """Standard input or the file."""
    return os.fdopen(os.dup(sys.stdin.fileno()), "rb") if log == "-" else existing_file(log).open("rb")


def _pieces(source: Any, follow: bool, name: str) -> Iterator[bytes]:
    """A log's pieces as they come."""
    while True:
        piece = source.read1(1 << 16)
        if piece:
            yield piece
        elif not follow or name == "-":
            return
        else:
            if os.fstat(source.fileno()).st_size < source.tell() or not Path(name).exists():
                raise RecordError(f"{name} was cut or replaced. Start the command again.")
            time.sleep(0.1)
