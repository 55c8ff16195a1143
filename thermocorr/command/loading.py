"""Options of the commands for tables, times and columns, and the log that they load."""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import pandas as pd

from ..estimators import DynamicBiasRegressor
from ..files.result_files import result_columns
from ..foreign import RUN, ForeignTable, HowToRead, guess, read_logs, with_times
from ..foreign.roles import is_counter
from ..records import RecordError
from ..records.errors import quoted, warn
from ..records.files import require_column
from ..records.times import dates_once, seconds_of
from ..records.types import kind_of
from ..records.units import DEGREES, unit_of


def number_or_span(text: str) -> float | str:
    """Seconds as a number; a span such as 15s, or a word, as it stands."""
    try:
        return float(text)
    except ValueError:
        return text


class OneColumn(argparse.Action):
    """An option that names one column: named another time it is refused, where the last one would count."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Take the name; ArgumentError, which argparse tells the user, for a second one."""
        before = getattr(namespace, self.dest)
        if before is not None and before != values:
            raise argparse.ArgumentError(
                self, f"one column, not {before!r} and {values!r}. Run the command once for each, or leave one out."
            )
        setattr(namespace, self.dest, values)


def add_table_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how a log's file is written."""
    group = parser.add_argument_group("the log's file (understood from its content where nothing is said)")
    group.add_argument("--sep", metavar="CHAR", help="between columns: , ; tab | blanks")
    group.add_argument("--decimal", metavar="CHAR", help="decimal sign: . or ,")
    group.add_argument(
        "--time-format",
        metavar="FORMAT",
        help="as for strptime ('%%d/%%m/%%Y %%H:%%M:%%S'), or excel, matlab, mjd, jd, labview, unix, 'unix ms', "
        "'unix us', 'unix ns', hhmm, seconds",
    )
    group.add_argument("--timezone", metavar="ZONE", help="of local times, such as Europe/Berlin; they become UTC")
    group.add_argument(
        "--na", metavar="WORD", action="append", help="a word or number for no value; once more for each further one"
    )
    group.add_argument(
        "--skip-bad-rows",
        action="store_true",
        help="pass over lines that are no rows, keep the first of rows with one time, sort by time; all is said",
    )


def add_column_options(parser: argparse.ArgumentParser) -> None:
    """Add what the columns of a whole log are, and what to do with several files."""
    parser.add_argument(
        "--join",
        action="store_true",
        help="join several files by their times; without it, files that follow on one another are one log, and others "
        "are runs (with --run file in any case)",
    )
    columns = parser.add_argument_group(
        "columns of the log (told by their names, units and values where nothing is said)"
    )
    columns.add_argument(
        "--temperature",
        metavar="COLUMN",
        action="append",
        help="ambient temperature; once more for each further thermometer, such as a case's",
    )
    columns.add_argument("--reading", metavar="COLUMN", action=OneColumn, help="what the instrument shows")
    columns.add_argument(
        "--reference",
        metavar="COLUMN",
        action=OneColumn,
        help="a better instrument of the same quantity: how much the reading differs from it is learned, U0 included",
    )
    columns.add_argument("--time", metavar="COLUMN", action=OneColumn, help="dates or seconds")
    columns.add_argument("--run", metavar="COLUMN", action=OneColumn, help="labels of runs; each starts anew")
    columns.add_argument(
        "--sampling-period",
        metavar="SPAN",
        type=number_or_span,
        help="time between rows of a log without times, such as 15s",
    )
    columns.add_argument(
        "--max-gap", metavar="SPAN", type=number_or_span, help="a longer step starts a new segment, such as 10min"
    )


def add_time_constants(parser: Any) -> None:
    """Add how many time constants a model has, or which."""
    parser.add_argument(
        "--time-constants",
        metavar="N|auto|LIST",
        default="auto",
        help="auto (default), how many to choose for each thermometer (6 in the paper), or a list: 60,15min,2h",
    )


def how_to_read(options: argparse.Namespace) -> HowToRead:
    """Options on the log's file."""
    named = [options.reading, *(options.temperature or ())]
    named += [getattr(options, role, None) for role in ("run", "reference")]
    return HowToRead(
        separator=options.sep,
        decimal=options.decimal,
        time_format=options.time_format,
        timezone=options.timezone,
        sort=options.skip_bad_rows,
        missing=tuple(options.na or ()),
        skip_bad_rows=options.skip_bad_rows,
        drop_duplicates=options.skip_bad_rows,
        reading=options.reading,
        run=getattr(options, "run", None),
        no_times=tuple(dict.fromkeys(name for name in named if name)),
    )


class Loaded(NamedTuple):
    """A log, and an unfitted model for it."""

    log: pd.DataFrame
    written: pd.DataFrame
    """The log as it is written with results: its times as they came."""
    has_index: bool
    """True if its index is to be written with it."""
    model: DynamicBiasRegressor
    reading: str
    """The column of the readings."""
    understood: tuple[str, ...] = ()
    """How its file was read."""
    results: tuple[str, ...] = ()
    """Columns of an earlier result in the log, and those that count its rows: no suspects."""

    def columns(self) -> tuple[pd.DataFrame, pd.Series[Any]]:
        """X, with its dates parsed once, and y."""
        also = self.model.temperature if isinstance(self.model.temperature, list) else [self.model.temperature]
        own = [] if self.reading in also else [self.reading]  # a thermometer that heats itself is both
        X, y = self.log.drop(columns=[*own, *self.results]), self.log[self.reading]
        if self.model.time is not None:
            X[self.model.time] = dates_once(X[self.model.time])
        return X, y


def load_log(options: argparse.Namespace) -> Loaded:
    """The log that the options name; without one, the built-in record."""
    time_constants = parse_time_constants(options.time_constants)
    if not options.log:
        if any((options.reading, options.reference, options.temperature, options.time, options.run)):
            raise RecordError("Columns are named but no log is given. Put the log's file name after 'analyze'.")
        from ..datasets import load_voltage_reference  # simulators: half a second of imports for a record

        log = load_voltage_reference(hidden="moisture")
        model = DynamicBiasRegressor("temperature", time_constants, max_gap=options.max_gap)
        return Loaded(log, log, True, model, "voltage")
    how = how_to_read(options)
    table = read_logs(options.log, how, join=options.join, time=options.time, apart=options.run == RUN)
    log = table.frame
    for role in ("temperature", "reading", "reference", "time", "run"):
        named = getattr(options, role)
        for name in [named] if isinstance(named, str) else named or ():
            require_column(log.columns, name, role)
    stamped = isinstance(log.index, pd.DatetimeIndex | pd.TimedeltaIndex)
    given = {role: getattr(options, role) for role in ("reading", "reference", "time", "run")}
    given["temperature"] = (options.temperature or [None])[0]
    found = guess(log, **given, no_times=how.no_times)
    asked = [*(() if stamped or options.sampling_period is not None else ("time",)), "temperature", "reading"]
    found.ask(asked, list(log.columns))
    assert found.temperature is not None and found.reading is not None
    reading, thermometers = found.reading, options.temperature or [found.temperature]
    if reading in thermometers and options.reference is None:
        raise RecordError(
            f"--reading and --temperature both name {reading!r}. The reading is what the instrument shows. If it "
            "is a thermometer that is to be compared with a better one, name that with --reference."
        )
    of_files = RUN if len(options.log) > 1 and not options.join and RUN in log.columns else None
    run = options.run or of_files or found.run
    time = _time_column(options, table, how, None if stamped else found.time)
    timed = stamped or time is not None
    if timed and options.sampling_period is not None:
        warn("The data have times of their own: --sampling-period is not used.")
    for name in thermometers:
        if (unit := unit_of(name, log)) and unit not in DEGREES:
            warn(f"The unit of {quoted(name)} is {unit}, no temperature. Is it the right column?")
    if len(options.log) == 1:
        table = with_times(table, time, how)
    layout: dict[str, Any] = {
        "time": time,
        "run": run,
        "sampling_period": None if timed else options.sampling_period,
        "max_gap": options.max_gap,
        "reference": options.reference,
    }
    temperature = thermometers if len(thermometers) > 1 else thermometers[0]
    model = DynamicBiasRegressor(temperature, time_constants, **layout)
    named = {reading, *thermometers, time, run, options.reference}
    if found.why:
        table = table.with_said(table.frame, found.sentence())
    counters = [str(name) for name in log.columns if name not in named and is_counter(log[name])]
    results = tuple(name for name in result_columns(table.frame.columns) if name not in named)
    if results:
        warn(f"{', '.join(map(quoted, results))} are of an earlier result: written again, and no suspects.")
    if counters:
        warn(f"{', '.join(map(quoted, counters))} counts the rows: no suspect.")
    results = (*results, *counters)
    return Loaded(table.frame, table.as_it_came(), stamped, model, reading, table.said, results)


def _time_column(options: argparse.Namespace, table: ForeignTable, how: HowToRead, found: str | None) -> str | None:
    """The column of times that was found; None where the index has them, or the rows are --sampling-period apart."""
    if options.time is not None and options.sampling_period is not None:
        raise RecordError("Give --time or --sampling-period, not both.")
    if options.sampling_period is None or found is None or _goes_forward(table, found, how):
        return found
    warn(f"{quoted(found)} does not go forward from row to row: rows are taken as --sampling-period apart.")
    return None


def _goes_forward(table: ForeignTable, column: str, how: HowToRead) -> bool:
    """True if a column has times, each after the one before."""
    try:
        times = dates_once(with_times(table, column, how).frame[column])
    except RecordError:
        return False
    return kind_of(times) != "text" and bool(times.is_monotonic_increasing and times.is_unique)


def check_time_constants(options: argparse.Namespace) -> None:
    """Refuse time constants that are none before any work is done."""
    taus = parse_time_constants(options.time_constants)
    for tau in taus if isinstance(taus, list) else ():
        seconds_of(tau, "time_constants")
    if taus == []:
        raise RecordError("--time-constants names none. Say how many to choose, auto, or a list: 60,15min,2h.")


def parse_time_constants(text: str) -> Any:
    """``6`` is how many to choose, ``auto`` is auto, ``60,15min,2h`` is a list; ``3600s`` is a list of one."""
    if text == "auto":
        return "auto"
    if text.isdigit():
        return int(text)
    return [number_or_span(part.strip()) for part in text.split(",") if part.strip()]
