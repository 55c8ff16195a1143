"""`thermocorr correct`: a CSV log through a fitted model, whole or line by line while it grows."""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from ..records import RecordError
from ..records.errors import listing
from .codec import ModelFileError, fields, integer, parse
from .files import TIME_NAMES, new_names
from .model_file import load, replace_file
from .online import Corrected, OnlineCorrector

RESULTS = ("corrected", "bias", "flag")
MISSING = ("", "nan", "NaN", "NA", "null", "None")
"""What stands in a log where there is no number."""
POLL = 0.1
"""Time between looks at a file that does not grow [s]."""
STATE_EVERY = 10.0
"""Time between savings of the state while a log is followed [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `thermocorr correct`."""
    parser.add_argument("log", nargs="?", default="-", help="CSV file with a header line; - or nothing: standard input")
    parser.add_argument(
        "--model", required=True, metavar="FILE", help="model.json, as `thermocorr analyze --out` writes"
    )
    parser.add_argument("--follow", action="store_true", help="go on as the log grows; write and flush line by line")
    parser.add_argument("--out", metavar="FILE", help="where to write (default: standard output)")
    parser.add_argument("--state", metavar="FILE", help="save the state there at the end, and go on from it next time")
    parser.add_argument("--idle", type=float, metavar="SECONDS", help="with --follow: end after so long without a line")
    columns = parser.add_argument_group("columns of the log (default: those of the model)")
    columns.add_argument("--temperature", metavar="COLUMN", help="ambient temperature")
    columns.add_argument("--reading", metavar="COLUMN", help="what the instrument shows")
    columns.add_argument("--time", metavar="COLUMN", help="dates (ISO 8601) or seconds")
    more = parser.add_argument_group("beside the corrected reading")
    more.add_argument("--average", type=int, metavar="N", help="its mean over the last N samples, as `smoothed`")
    more.add_argument("--track", metavar="SPAN", help="a slowly tracked U0, as `reference`: time constant, such as 2h")


def run(options: argparse.Namespace, say: Callable[[str], None], progress: Callable[[str], None]) -> None:
    """Filter the log: results to standard output or --out, complaints about lines to standard error."""
    model = load(options.model)
    track = _number_or_text(options.track)
    live, done, restored = OnlineCorrector(model, average=options.average, track=track), 0, False
    if options.state and Path(options.state).exists():
        live, done = read_state(options.state, model)
        restored = True
    lines = _lines(options)
    append = restored and options.out is not None and Path(options.out).exists()
    main_thread = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, _interrupt) if main_thread else None
    output: TextIO = sys.stdout
    try:
        if options.out is not None:
            output = open(options.out, "a" if append else "w", encoding="utf-8", newline="")  # noqa: SIM115
        rows = LogFilter(live, options, done, restored)
        _pump(rows, lines, output, options, header=not (append and Path(options.out).stat().st_size))
    except OSError as error:
        if isinstance(error, BrokenPipeError):  # the reader has gone: `thermocorr correct ... | head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return
        raise RecordError(f"{error.filename or 'The output'}: {error.strerror}.") from None
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)
        if output is not sys.stdout:
            output.close()


def _pump(rows: LogFilter, lines: Iterator[bytes | None], output: TextIO, options: Any, header: bool) -> None:
    """Lines in, lines out; None from `lines` means that there is nothing new at the moment."""
    writer = csv.writer(output, lineterminator="\n")
    saved = time.monotonic()

    def keep() -> None:
        output.flush()
        if options.state:
            write_state(options.state, rows.live, rows.done)

    try:
        for line in lines:
            if line is not None:
                result = rows.filtered(line)
                if result is not None and (header or not rows.is_header):
                    writer.writerow(result)
                    if options.follow:
                        output.flush()
            if options.follow and time.monotonic() - saved > STATE_EVERY:
                keep()
                saved = time.monotonic()
        if rows.header is None:
            raise RecordError("The log is empty: a header line with the columns' names is needed, then the samples.")
    finally:
        keep()
        rows.conclude()


class LogFilter:
    """Lines of a CSV log with the results behind them."""

    def __init__(self, live: OnlineCorrector, options: argparse.Namespace, done: int, restored: bool):
        self.live, self.options, self.done = live, options, done
        self.header: list[str] | None = None
        self.is_header = False
        """Whether the line before was the header."""
        self.number = 0
        self._bad = 0
        self._skipped = 0
        self._repeated = restored  # rows that the state has seen may come again
        self._to_skip = done if restored and live.model.features_.history_.kind == "rows" else 0
        if options.log == "-":
            self._to_skip = 0

    def filtered(self, line: bytes) -> list[str] | None:
        """The line's fields and the results; None for a line that is left out."""
        self.number += 1
        self.is_header = False
        try:
            text = line.decode("utf-8-sig" if self.number == 1 else "utf-8").rstrip("\r\n")
            if not text.strip():
                return None
            row = next(csv.reader([text], strict=True))
            if self.header is None:
                self.header, self.is_header = row, True
                return [*row, *self._find_columns(row)]
            if row == self.header:  # a log that was begun anew
                return None
            return self._corrected(row)
        except (ValueError, TypeError, csv.Error) as error:
            if self.is_header:
                raise
            if self.header is None:
                raise RecordError(f"The header, line {self.number}, cannot be read as CSV: {error}.") from None
            self._bad += 1
            print(f"thermocorr: line {self.number} is left out: {' '.join(str(error).split())}", file=sys.stderr)
            return None

    def _find_columns(self, header: list[str]) -> list[str]:
        """Where the columns stand; returns the names of the results."""
        live, options = self.live, self.options
        model, history = live.model, live.model.features_.history_

        def place(name: Any, option: str) -> int:
            if name not in header:
                hint = f" Name it with --{option}." if option else ""
                raise RecordError(f"The log has no column {name!r}; it has {listing(header)}.{hint}")
            return header.index(name)

        self._temperature = place(options.temperature or history.record.temperature_name, "temperature")
        self._reading = place(options.reading or model.reading_.name, "reading")
        self._time = None
        if history.kind != "rows":
            name = options.time or model.time or next((n for n in TIME_NAMES if n in header), "time")
            self._time = place(name, "time")
        self._others = {name: place(column, "") for column, name in zip(live._inputs, live._given, strict=True)}
        self._run = None if model.run is None else place(model.run, "")
        self._extra = [*RESULTS, *(["smoothed"] if live.average else []), *(["reference"] if live.track else [])]
        return new_names(self._extra, header)

    def _corrected(self, row: list[str]) -> list[str] | None:
        assert self.header is not None
        if len(row) != len(self.header):
            raise ValueError(f"it has {len(row)} fields where the header has {len(self.header)}")
        stamp: Any = None if self._time is None else row[self._time].strip()
        if self.live._clock.kind == "seconds":
            stamp = _number(stamp, "the time")
        T, U = _number(row[self._temperature], "the temperature"), _number(row[self._reading], "the reading")
        columns: dict[str, Any] = {name: _number(row[at], name) for name, at in self._others.items()}
        if self._run is not None:
            columns[self.live.model.run] = _label(row[self._run], self.live)
        if self._to_skip:
            self._to_skip -= 1
            self._skipped += 1
            return None
        result = self.live.update(stamp, T, U, **columns)
        if self._repeated:
            if result.flag in ("stale time", "backward time"):
                self._skipped += 1
                return None
            self._repeated = False
        self.done += 1
        return [*row, *self._shown(result)]

    def _shown(self, result: Corrected) -> list[str]:
        values = {**result._asdict(), "flag": result.flag}
        return [value if isinstance(value := values[name], str) else _digits(value) for name in self._extra]

    def conclude(self) -> None:
        """Say what was left out."""
        if self._skipped:
            print(f"thermocorr: {self._skipped} lines were corrected before, by the saved state", file=sys.stderr)
        if self._bad:
            print(f"thermocorr: {self._bad} of {self.number} lines left out", file=sys.stderr)


def _digits(value: float) -> str:
    """All the digits that tell a number from others; nothing for NaN."""
    return "" if math.isnan(value) else repr(value)


def _number(text: str, what: str) -> float:
    text = text.strip()
    if text in MISSING:
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{what} is {text[:60]!r}, no number") from None


def _label(text: str, live: OnlineCorrector) -> Any:
    """A run's label as the fitted record had it: pandas reads labels that are all numbers as numbers."""
    runs = [segment.run for segment in live.model.features_.history_.record.segments]
    if all(isinstance(run, int | float) for run in runs):
        try:
            return float(text)
        except ValueError:
            return text
    return text


def _number_or_text(text: str | None) -> Any:
    try:
        return None if text is None else float(text)
    except ValueError:
        return text


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


# ----------------------------------------------------------------------------------------------------------- lines in


def _lines(options: argparse.Namespace) -> Iterator[bytes | None]:
    if options.log == "-":
        return iter(sys.stdin.buffer.readline, b"")
    path = Path(options.log)
    if not path.is_file():
        raise RecordError(f"There is no file {path}. Check its name and the folder you are in ({Path.cwd()}).")
    return follow(path, options.idle) if options.follow else _whole(path)


def _whole(path: Path) -> Iterator[bytes | None]:
    with path.open("rb") as file:
        yield from file


def follow(path: Path, idle: float | None = None) -> Iterator[bytes | None]:
    """Whole lines of a file as they are written; None where there is nothing new.

    A file that is cut or replaced (a log that rotates) is read from its beginning again.

    Parameters
    ----------
    path : Path
    idle : float, optional
        End after so long without a new line [s]; never by default.
    """
    file: BinaryIO = path.open("rb")
    rest, last = b"", time.monotonic()
    try:
        while True:
            piece = file.readline()
            if piece:
                rest += piece
                if rest.endswith(b"\n"):
                    yield rest
                    rest = b""
                last = time.monotonic()
                continue
            yield None
            if idle is not None and time.monotonic() - last > idle:
                if rest:
                    yield rest
                return
            time.sleep(POLL)
            if _replaced(file, path):
                file.close()
                file, rest = path.open("rb"), b""
    finally:
        file.close()


def _replaced(file: BinaryIO, path: Path) -> bool:
    try:
        now, opened = path.stat(), os.fstat(file.fileno())
    except FileNotFoundError:  # being replaced: look again later
        return False
    return now.st_ino != opened.st_ino or now.st_size < file.tell()


# ------------------------------------------------------------------------------------------------------------- state


def read_state(path: str, model: Any) -> tuple[OnlineCorrector, int]:
    """The corrector that a state file describes, and how many rows it has seen."""
    try:
        node = fields(parse(Path(path).read_bytes()), "$", ("stream", "rows"))
        return OnlineCorrector.from_state(model, node["stream"]), integer(node["rows"], "$.rows", 0)
    except (ModelFileError, OSError) as error:
        raise ModelFileError(f"{path}: {error} Remove the file to start afresh.") from None


def write_state(path: str, live: OnlineCorrector, rows: int) -> None:
    """Replace the state file as a whole."""
    replace_file(Path(path), json.dumps({"stream": live.state(), "rows": rows}) + "\n")
