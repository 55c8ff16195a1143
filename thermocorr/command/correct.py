"""`thermocorr correct`: a log through a fitted model, whole or line by line while it grows."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from ..files import AppendedFile, OutputError, Outputs, write_file
from ..files.codec import ModelFileError, counted, fields, parse, read_bytes, text
from ..files.model_file import load
from ..files.writer import Position
from ..live.corrector import OnlineCorrector
from ..records import RecordError, RecordWarning
from ..records.errors import printable, times_word
from ..records.files import CUT, csv_text, fields_of
from .lines import Lines, TableLines, open_lines
from .loading import OneColumn, add_table_options, how_to_read, number_or_span
from .log_rows import LogRow, LogRows
from .stopping import Stopped, StopSignal


@dataclass(frozen=True)
class Saved:
    """Content of a state file."""

    live: OnlineCorrector
    rows: int
    """Rows that it has seen."""
    lines: int
    """Lines of the log that it has read."""
    out: Position | None
    """Where the file of results stood."""
    source: Position | None
    """Where the log stood."""


def read_state(path: str, model: Any) -> Saved:
    """Read the state saved for this model; ModelFileError for anything else."""
    try:
        node = fields(parse(read_bytes(path)), "$", ("stream", "rows", "lines", "out", "source"))
        out, source = (_position(node[key], f"$.{key}") for key in ("out", "source"))
        rows, lines = counted(node["rows"], "$.rows"), counted(node["lines"], "$.lines")
        return Saved(OnlineCorrector.from_state(model, node["stream"]), rows, lines, out, source)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error} Remove the file to start afresh.") from None
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {error.strerror}. Remove it to start afresh.") from None


def _position(node: Any, where: str) -> Position | None:
    if node is None:
        return None
    node = fields(node, where, ("length", "digest"))
    return Position(counted(node["length"], f"{where}.length"), text(node["digest"], f"{where}.digest"))


class Results:
    """Base: rows are written; `keep` makes what was written so far last, and the state with it.

    A state is saved only with the rows that it has seen: whatever ends the process, the next one finds in the file of
    results what the state does not know yet, and goes on behind it.
    """

    def __init__(self, rows: LogRows, options: argparse.Namespace, inputs: list[str], lines: Lines):
        self.rows, self.options, self.inputs, self.lines = rows, options, inputs, lines
        self._first_new = True
        self._to_skip = self.skipped = 0

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def write(self, rows: bytes) -> None:
        """Write whole rows."""
        raise NotImplementedError

    def _commit(self) -> Position | None:
        """Make the rows so far last."""
        raise NotImplementedError

    def keep(self) -> None:
        """Make the rows so far last, and save the state."""
        out = self._commit()
        if not self.options.state:
            return
        source, rows = self.lines.position(), self.rows
        node = {
            "stream": rows.live.state(),
            "rows": rows.done,
            "lines": rows.number,
            "out": None if out is None else out._asdict(),
            "source": None if source is None else source._asdict(),
        }
        inputs = [*self.inputs, *([self.options.out] if self.options.out else [])]
        write_file(self.options.state, json.dumps(node) + "\n", inputs=inputs, force=self.options.force)

    def finish(self, stopped: bool) -> str:
        """Make all rows last; returns what was kept, in words."""
        self.keep()
        if self.skipped:
            said = f"{times_word(self.skipped, 'line')} {'was' if self.skipped == 1 else 'were'} corrected before"
            print(f"thermocorr: {said}, by the saved state", file=sys.stderr)
        return "state saved" if self.options.state else "no state saved (--state FILE keeps one to go on from)"

    def resume(self, saved: Saved) -> bool:
        """Go on where the state was saved; returns whether the log is at that place again."""
        self.rows.done = saved.rows
        if self.lines.skip_to(saved.source):
            self.rows.number, self.skipped, self._first_new = saved.lines, saved.rows, False
            return True
        if self.options.log != "-":
            self._to_skip = saved.rows
        return False

    def seen(self, sample: LogRow) -> bool:
        """True if the state from which this run goes on knows a row: another file may begin with such ones."""
        if not self._first_new:
            return False
        if sample.stamp is None:
            self._first_new = self.skipped + 1 < self._to_skip
            known = self.skipped < self._to_skip
        else:
            known = self._first_new = self.rows.live.has_seen(sample.stamp, sample.run)
        self.skipped += known
        return known


class Printed(Results):
    """Rows go to standard output."""

    def write(self, rows: bytes) -> None:
        """Write whole rows; at once where the log is followed."""
        sys.stdout.buffer.write(rows)
        if self.options.follow:
            sys.stdout.buffer.flush()

    def _commit(self) -> None:
        sys.stdout.buffer.flush()


class Drafted(Results):
    """A whole log's results: the file takes its place when all are there."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._outputs = Outputs(self.inputs, self.options.force)
        self._file = self._outputs.open(self.options.out)

    def __exit__(self, *_: object) -> None:
        self._outputs.discard()

    def write(self, rows: bytes) -> None:
        """Write whole rows to the draft."""
        try:
            self._file.write(rows)
        except BrokenPipeError:
            raise
        except OSError as error:
            raise OutputError(f"{self.options.out} cannot be written: {error.strerror}. It is unchanged.") from None

    def _commit(self) -> None:
        pass

    def finish(self, stopped: bool) -> str:
        """Let the file take its place, unless the log was not read to its end."""
        if stopped:
            return f"nothing was written to {self.options.out}"
        self._outputs.commit()
        return f"{self.options.out} is written"


class WrittenRows:
    """Rows of a file of results, as long as a log repeats them one after the other.

    `path` (path). `width` (int): Columns of the log, which stand before the results.
    """

    def __init__(self, path: str, width: int):
        self._path, self._width = path, width
        self._ahead: Iterator[list[str]] | None = None
        self.count = 0
        """Rows that have been looked at: all of the file's, once a row was searched in vain."""

    def repeated(self, fields: list[str], anywhere: bool) -> bool:
        """True if a row is the next one, in every character; the first row may stand `anywhere`, or at the start."""
        if self._ahead is not None:
            return next(self._ahead, None) == fields
        self._ahead = self._rows()
        return any(row == fields for row in (self._ahead if anywhere else islice(self._ahead, 1)))

    def _rows(self) -> Iterator[list[str]]:
        with open(self._path, "rb") as file:
            next(file, None)
            for line in file:
                self.count += 1
                yield fields_of(line)[: self._width]


class Appended(Results):
    """Rows go to a file that can be watched, and taken up again with the state."""

    file: AppendedFile
    _known: WrittenRows | None = None
    _before = 0
    """Rows that the corrector had seen before this run."""

    def seen(self, sample: LogRow) -> bool:
        """True if a row at the beginning stands in the file: a log may come again, from its start or any row on.

        A row that differs is a new one, whatever its time says: the log's time may be damaged. Only where the file does
        not hold all rows that the state has seen, the time alone tells.
        """
        if not self._first_new or self._known is None:
            return super().seen(sample)
        if self._known.repeated(sample.fields, anywhere=sample.stamp is not None):
            self.skipped += 1
            return True
        complete, self._known = self._known.count >= self._before, None
        if self.skipped or (complete and sample.stamp is not None):
            self._first_new = False
        return super().seen(sample)

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def begin(self, header: bytes, saved: Saved | None) -> None:
        """Open the file, or take it up where the state was saved, with the rows that came behind.

        A pipe or a device begins anew: it holds no rows that could come twice.
        """
        options = self.options
        at_place = saved is not None and self.resume(saved)
        if saved is None or not os.path.isfile(options.out) or (saved.out is None and options.force):
            others = [options.state] if options.state else []
            self.file = AppendedFile.new(options.out, [*self.inputs, *others], options.force, header)
            return
        if saved.out is None:
            raise OutputError(
                f"{options.out} is there already, and the state in {options.state} was saved without it: rows could "
                "come twice. Name another file, or overwrite it with --force."
            )
        self.file = AppendedFile.resumed(options.out, saved.out)
        try:
            self._take_up(header, saved.out.length, at_place)
        except BaseException:
            self.file.close()
            raise

    def _take_up(self, header: bytes, length: int, at_place: bool) -> None:
        out = self.options.out
        with open(out, "rb") as file:
            if file.readline() != header:
                raise OutputError(
                    f"{out} has other columns than the results of this log. Name another file for the rows to come."
                )
        if at_place:
            self.file.cut(length)
            return
        assert self.rows.header is not None
        width = len(self.rows.header)
        self.rows.replay([fields_of(row)[:width] for row in self.file.rows_behind(length)])
        self._known, self._before = WrittenRows(out, len(self.rows.header)), self.rows.done

    def write(self, rows: bytes) -> None:
        """Write whole rows."""
        self.file.write(rows)

    def _commit(self) -> Position | None:
        return self.file.commit()


def open_results(
    rows: LogRows, header: bytes, options: argparse.Namespace, inputs: list[str], saved: Saved | None, lines: Lines
) -> Results:
    """Open the output that the options ask for; its header is written, or was before."""
    if options.out is not None and not options.follow and not options.state:
        drafted = Drafted(rows, options, inputs, lines)
        drafted.write(header)
        return drafted
    if options.out is None:
        printed = Printed(rows, options, inputs, lines)
        if saved is not None:
            printed.resume(saved)
        printed.write(header)
        return printed
    appended = Appended(rows, options, inputs, lines)
    appended.begin(header, saved)
    appended.keep()
    return appended


STATE_EVERY = 10.0
"""Time between savings of the state [s]."""
BLOCK = 8192
"""Rows that are corrected together."""


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
    parser.add_argument(
        "--follow", action="store_true", help="go on as the log grows; write and flush what came at once"
    )
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
        untimed = model.features_.history_.kind == "rows"
        times = "" if untimed else options.time or model.time  # "": no column is looked at for times
        idle = options.idle if options.follow else None
        how = how_to_read(options, (*live.columns, *model.thermometers_, model.reading_.name, model.run))
        lines = open_lines(options.log, options.follow, idle, stop, how, times, getattr(model, "_log_form", {}))
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
    if isinstance(lines, TableLines) and lines.said:
        _complain(f"read as: {', '.join(lines.said)}")
    if rows.time_unit and not isinstance(lines, TableLines):
        _complain(f"read as: times in {rows.time_unit}")
    with open_results(rows, csv_text([names]), options, inputs, saved, lines) as results:
        _corrected(rows, stream, lines, results)
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


def _corrected(rows: LogRows, stream: Iterator[bytes | None], lines: Lines, results: Results) -> None:
    """Block by block; what is there is written as soon as nothing more is, or a while after it came."""
    samples: list[LogRow] = []
    saved = written = time.monotonic()
    patience = 0.1 if results.options.follow else STATE_EVERY

    def correct() -> None:
        if samples:
            shown = rows.many(samples)
            results.write(csv_text([*sample.fields, *cells] for sample, cells in zip(samples, shown, strict=True)))
            samples.clear()

    for line in stream:
        if line is not None and lines.restarted:
            lines.restarted = False
            correct()
            rows.begin(line, new_file=True)
            continue
        sample = None if line is None else rows.read(line)
        if sample is not None and not results.seen(sample):
            samples.append(sample)
        now = time.monotonic()
        if line is None or len(samples) == BLOCK or now - written > patience:
            correct()
            written = now
        if now - saved > STATE_EVERY:
            correct()
            results.keep()
            saved = now
    correct()


def _complain(text: str) -> None:
    print(f"thermocorr: {printable(text)}", file=sys.stderr)
