"""`thermocorr correct`: a log through a fitted model, whole or line by line while it grows."""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from ..files import Outputs
from ..files.model_file import load
from ..live.corrector import OnlineCorrector
from ..records import RecordError, RecordWarning
from ..records.errors import printable
from ..records.files import CUT
from .lines import Lines, TableLines, open_lines
from .loading import OneColumn, add_table_options, how_to_read, number_or_span
from .log_rows import LogRow, LogRows, csv_text
from .results import Results, Saved, open_results, read_state
from .stopping import Stopped, StopSignal

STATE_EVERY = 10.0
"""Time between savings of the state [s]."""
BLOCK = 8192
"""Rows of a whole log that are corrected together."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `thermocorr correct`."""
    parser.add_argument(
        "log",
        nargs="?",
        default="-",
        help="CSV, text, spreadsheet, Parquet or Feather; - or nothing: plain CSV from standard input",
    )
    add_table_options(parser)
    parser.add_argument(
        "--model", required=True, metavar="FILE", help="model.json, as `thermocorr analyze --out` writes"
    )
    parser.add_argument("--follow", action="store_true", help="go on as the log grows; write and flush line by line")
    parser.add_argument("--out", metavar="FILE", help="where to write (default: standard output)")
    parser.add_argument(
        "--state", metavar="FILE", help="save the state there, and go on from it next time, --out included"
    )
    parser.add_argument("--idle", type=float, metavar="SECONDS", help="with --follow: end after so long without a line")
    parser.add_argument("--force", action="store_true", help="overwrite files that thermocorr did not write")
    columns = parser.add_argument_group("columns of the log (default: those of the model)")
    columns.add_argument(
        "--temperature",
        metavar="COLUMN",
        action="append",
        help="ambient temperature; for a model of several thermometers once more for each, in its order",
    )
    columns.add_argument("--reading", metavar="COLUMN", action=OneColumn, help="what the instrument shows")
    columns.add_argument("--time", metavar="COLUMN", action=OneColumn, help="dates (ISO 8601) or seconds")
    more = parser.add_argument_group("beside the corrected reading")
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
    """Filter the log: results to standard output or --out, complaints about lines to standard error.

    Returns 1 where lines were left out or refused for their time, else 0.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", RecordWarning)
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    model = load(options.model)
    live = OnlineCorrector(model, average=options.average, track=options.track, uncertainty=options.uncertainty)
    saved = None
    if options.state and Path(options.state).exists():
        saved = read_state(options.state, model)
        live = saved.live
    inputs = [options.model, *([] if options.log == "-" else [options.log])]
    claims = Outputs(inputs, options.force)
    for path in (options.state, options.out):
        if path is not None:
            claims.claim(path)
    with StopSignal() as stop:
        times = options.time or model.time
        idle = options.idle if options.follow else None
        how = how_to_read(options, (*live.columns, *model.thermometers_, model.reading_.name, model.run))
        lines = open_lines(options.log, options.follow, idle, stop, how, times)
        if isinstance(lines, TableLines) and lines.said:
            _complain(f"read as: {', '.join(lines.said)}")
        try:
            name = lines.time_name if isinstance(lines, TableLines) else None
            rows = LogRows(live, options, _complain, time_name=name, place=lines.place, units=lines.units())
            _pump(rows, lines, options, inputs, saved, stop)
        finally:
            lines.close()
    return 1 if rows.damaged else 0


def _pump(
    rows: LogRows, lines: Lines, options: argparse.Namespace, inputs: list[str], saved: Saved | None, stop: StopSignal
) -> None:
    """Lines in, rows out, until the lines end or a signal comes."""
    stream = iter(lines)
    first = next((line for line in stream if line is not None), None)
    if first is None:
        if stop.number is not None:
            raise Stopped(stop.number, "stopped before the first line; nothing was written")
        raise RecordError("The log is empty: a header line with the columns' names is needed, then the samples.")
    names = rows.begin(first)
    rows.says_unix = not isinstance(lines, TableLines)
    if rows.time_unit and not isinstance(lines, TableLines):
        _complain(f"read as: times in {rows.time_unit}")
    with open_results(rows, csv_text([names]), options, inputs, saved, lines) as results:
        if options.follow:
            _follow(rows, stream, lines, results)
        else:
            _whole(rows, stream, results)
        kept = results.finish(bool(stop))
    if lines.rest:
        rows.number += 1
        rows.leave_out(CUT)
    whole = options.out is not None and not options.follow and stop.number is None
    for summary in (rows.summary(), rows.trust.summary() if whole else ""):
        if summary:
            _complain(summary)
    if stop.number is not None:
        raise Stopped(stop.number, f"stopped after row {rows.done}, {kept}")


def _follow(rows: LogRows, stream: Iterator[bytes | None], lines: Lines, results: Results) -> None:
    """Row by row, each written before the next is read."""
    saved = time.monotonic()
    for line in stream:
        if line is not None:
            if lines.restarted:
                lines.restarted = False
                rows.begin(line, new_file=True)
                continue
            sample = rows.read(line)
            if sample is not None and not results.seen(sample):
                results.write(csv_text([[*sample.fields, *rows.one(sample)]]))
        if time.monotonic() - saved > STATE_EVERY:
            results.keep()
            saved = time.monotonic()


def _whole(rows: LogRows, stream: Iterator[bytes | None], results: Results) -> None:
    """Block by block, with the digits that `analyze` writes."""
    samples: list[LogRow] = []
    saved = time.monotonic()

    def correct() -> None:
        if samples:
            shown = rows.many(samples)
            results.write(csv_text([*sample.fields, *cells] for sample, cells in zip(samples, shown, strict=True)))
            samples.clear()

    for line in stream:
        sample = None if line is None else rows.read(line)
        if sample is not None and not results.seen(sample):
            samples.append(sample)
        if len(samples) == BLOCK or time.monotonic() - saved > STATE_EVERY:
            correct()
            if time.monotonic() - saved > STATE_EVERY:
                results.keep()
                saved = time.monotonic()
    correct()


def _complain(text: str) -> None:
    print(f"thermocorr: {printable(text)}", file=sys.stderr)
