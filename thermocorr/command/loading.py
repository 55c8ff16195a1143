"""Options for tables, times and columns."""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import pandas as pd

from ..model import DynamicBiasRegressor
from ..output.results import result_columns
from ..readers import RUN, Options, guess, is_counter, read_logs
from ..records import RecordError
from ..records.errors import listing, quoted, warn
from ..records.times import seconds_of
from ..records.units import DEGREES, unit_of


def number_or_span(text: str) -> float | str:
    """Seconds as a number; anything else as given."""
    try:
        return float(text)
    except ValueError:
        return text


class OneColumn(argparse.Action):
    """An option that names one column, once."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Take the name; ArgumentError for a second."""
        before = getattr(namespace, self.dest)
        if before is not None and before != values:
            raise argparse.ArgumentError(
                self, f"one column, not {before!r} and {values!r}. Run the command once for each, or leave one out."
            )
        setattr(namespace, self.dest, values)


def add_table_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how a log's file is written."""
    group = parser.add_argument_group("the log's file (recognised from its content unless set)")
    group.add_argument("--sep", metavar="CHAR", help="between columns: , ; tab | blanks")
    group.add_argument("--decimal", metavar="CHAR", help="decimal sign: . or ,")
    group.add_argument(
        "--names", metavar="LIST", help="names of all columns, where there is no header or a short one: time,T,R"
    )
    group.add_argument(
        "--time-format",
        metavar="FORMAT",
        help="as for strptime ('%%d/%%m/%%Y %%H:%%M:%%S'), or excel, matlab, mjd, jd, labview, unix, 'unix ms', "
        "'unix us', 'unix ns', hhmm, seconds",
    )
    group.add_argument("--timezone", metavar="ZONE", help="of local times, such as Europe/Berlin; they become UTC")
    group.add_argument(
        "--na", metavar="WORD", action="append", help="a word or number that means no value; may be repeated"
    )
    group.add_argument(
        "--skip-bad-rows",
        action="store_true",
        help="skip damaged lines, keep the first row of each time, sort by time; all is reported",
    )


def add_column_options(parser: argparse.ArgumentParser) -> None:
    """Add what the columns of a whole log are."""
    columns = parser.add_argument_group("columns of the log (found by their names, units and values unless set)")
    columns.add_argument(
        "--temperature",
        metavar="COLUMN",
        action="append",
        help="ambient temperature; repeat for each further thermometer, such as a case's",
    )
    columns.add_argument("--reading", metavar="COLUMN", action=OneColumn, help="what the instrument shows")
    columns.add_argument(
        "--reference",
        metavar="COLUMN",
        action=OneColumn,
        help="a better instrument of the same quantity: the model learns the difference from it, U0 included",
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


def how_to_read(options: argparse.Namespace) -> Options:
    """Options on the log's file."""
    named = [options.reading, *(options.temperature or ())]
    named += [getattr(options, role, None) for role in ("run", "reference")]
    return Options(
        sep=options.sep,
        decimal=options.decimal,
        names=tuple(name.strip() for name in options.names.split(",")) if options.names else (),
        na=tuple(options.na or ()),
        skip_bad_rows=options.skip_bad_rows,
        time=options.time,
        time_format=options.time_format,
        timezone=options.timezone,
        reading=options.reading,
        run=getattr(options, "run", None),
        others=tuple(dict.fromkeys(name for name in named if name)),
    )


class Loaded(NamedTuple):
    """A log, and an unfitted model for it."""

    log: pd.DataFrame
    """Indexed by its times, or by a range."""
    model: DynamicBiasRegressor
    reading: str
    """The column of the readings."""
    understood: tuple[str, ...] = ()
    """How its file was read."""
    results: tuple[str, ...] = ()
    """Columns of an earlier result in the log, and those that count its rows: no suspects."""

    def columns(self) -> tuple[pd.DataFrame, pd.Series[Any]]:
        """X and y."""
        also = self.model.temperature if isinstance(self.model.temperature, list) else [self.model.temperature]
        own = [] if self.reading in also else [self.reading]  # a thermometer that heats itself is both
        return self.log.drop(columns=[*own, *self.results]), self.log[self.reading]


def load_log(options: argparse.Namespace) -> Loaded:
    """The log that the options name; without one, the built-in record."""
    time_constants = parse_time_constants(options.time_constants)
    if not options.log:
        if any((options.reading, options.reference, options.temperature, options.time, options.run)):
            raise RecordError("Columns are named but no log is given. Put the log's file name after 'analyze'.")
        from ..datasets import load_voltage_reference  # simulators: half a second of imports for a record

        log = load_voltage_reference(hidden="moisture")
        return Loaded(log, DynamicBiasRegressor("temperature", time_constants, max_gap=options.max_gap), "voltage")
    if options.time is not None and options.sampling_period is not None:
        raise RecordError("Give --time or --sampling-period, not both.")
    log = read_logs(options.log, how_to_read(options))
    timed = not isinstance(log.index, pd.RangeIndex)
    if timed and options.sampling_period is not None:
        timed = bool(log.index.is_monotonic_increasing and log.index.is_unique)
        warn(
            "The data have times of their own: --sampling-period is not used."
            if timed
            else "The times do not go forward from row to row: rows are taken as --sampling-period apart."
        )
        log = log if timed else log.reset_index(drop=True)
    for role in ("temperature", "reading", "reference", "run"):
        named = getattr(options, role)
        for name in [named] if isinstance(named, str) else named or ():
            if name not in log.columns and not (role == "run" and len(options.log) > 1 and name == RUN):
                raise RecordError(f"There is no column {quoted(name)} for --{role}; there are {listing(log.columns)}.")
    given = {role: getattr(options, role) for role in ("reading", "reference", "run")}
    found = guess(log, **given, temperature=(options.temperature or [None])[0])
    found.ask(list(log.columns), timed or options.sampling_period is not None)
    assert found.temperature is not None and found.reading is not None
    reading, thermometers = found.reading, options.temperature or [found.temperature]
    if reading in thermometers and options.reference is None:
        raise RecordError(
            f"--reading and --temperature both name {reading!r}. The reading is what the instrument shows. If it "
            "is a thermometer that is to be compared with a better one, name that with --reference."
        )
    for name in thermometers:
        if (unit := unit_of(name, log)) and unit not in DEGREES:
            warn(f"The unit of {quoted(name)} is {unit}, no temperature. Is it the right column?")
    model = DynamicBiasRegressor(
        thermometers if len(thermometers) > 1 else thermometers[0],
        time_constants,
        run=found.run if found.run in log.columns else None,
        sampling_period=None if timed else options.sampling_period,
        max_gap=options.max_gap,
        reference=options.reference,
    )
    named = {reading, *thermometers, found.run, options.reference}
    counters = [str(name) for name in log.columns if name not in named and is_counter(log[name])]
    results = [name for name in result_columns(log.columns) if name not in named]
    if results:
        warn(f"{', '.join(map(quoted, results))} are from an earlier result: rewritten, and no suspects.")
    if counters:
        warn(f"{', '.join(map(quoted, counters))} counts the rows: no suspect.")
    said = (*log.attrs["notes"], *([found.sentence()] if found.why else []))
    return Loaded(log, model, reading, said, (*results, *counters))


def check_time_constants(options: argparse.Namespace) -> None:
    """Refuse time constants that are none before any work is done."""
    taus = parse_time_constants(options.time_constants)
    for tau in taus if isinstance(taus, list) else ():
        seconds_of(tau, "time_constants")
    if taus == []:
        raise RecordError("--time-constants names none. Say how many to choose, auto, or a list: 60,15min,2h.")


def parse_time_constants(text: str) -> Any:
    """``6``, ``auto``, or a list: ``60,15min,2h``."""
    if text == "auto":
        return "auto"
    if text.isdigit():
        return int(text)
    return [number_or_span(part.strip()) for part in text.split(",") if part.strip()]
