"""Options of the commands for tables, times and columns, and the log that they load."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import pandas as pd

from ..effects.grids import since_start
from ..effects.steps import Events
from ..estimators import DynamicBiasRegressor
from ..estimators.reading import masked_readings
from ..files.result_files import result_columns
from ..foreign import RUN, ForeignTable, HowToRead, guess, read_logs, with_times
from ..foreign.roles import is_counter
from ..records import RecordError, read_record
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
    group.add_argument("--encoding", metavar="NAME", help="such as utf-8, utf-16, latin-1")
    group.add_argument(
        "--time-format",
        metavar="FORMAT",
        help="as for strptime ('%%d/%%m/%%Y %%H:%%M:%%S'), or excel, matlab, mjd, jd, labview, unix, 'unix ms', "
        "'unix us', 'unix ns', hhmm, seconds",
    )
    group.add_argument("--timezone", metavar="ZONE", help="of local times, such as Europe/Berlin; they become UTC")
    group.add_argument("--sheet", metavar="NAME", help="of a spreadsheet")
    group.add_argument("--sort", action="store_true", help="sort the rows by time")
    group.add_argument("--names", metavar="LIST", help="of the columns where there is no header: time,room,dmm")
    group.add_argument(
        "--na", metavar="WORD", action="append", help="a word or number for no value; once more for each further one"
    )
    group.add_argument("--skip-bad-rows", action="store_true", help="pass over lines that are no rows; they are named")
    group.add_argument("--drop-duplicates", action="store_true", help="keep the first of rows with the same time")


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


def add_model_options(parser: argparse.ArgumentParser, title: str) -> Any:
    """Add what a model is made of; returns the group, for more of them."""
    group = parser.add_argument_group(title)
    group.add_argument(
        "--time-constants",
        metavar="N|auto|LIST",
        default="auto",
        help="auto (default), how many to choose for each thermometer (6 in the paper), or a list: 60,15min,2h",
    )
    group.add_argument("--degree", type=int, default=2, metavar="N", help="degree of the static law (default 2)")
    group.add_argument(
        "--no-screen", action="store_true", help="keep readings and temperatures that look like spikes and sentinels"
    )
    return group


def add_learning_options(parser: argparse.ArgumentParser) -> None:
    """Add what is not to be learned from, or not to be removed."""
    group = parser.add_argument_group("what is learned from (dates, or seconds or spans since the record began)")
    group.add_argument(
        "--mask",
        metavar="START..END",
        action="append",
        help="leave out the readings of a stretch: somebody was at work; once more for each further one",
    )
    group.add_argument(
        "--event",
        metavar="MOMENT",
        action="append",
        help="what is measured was stepped then: the step is no error, and stays; once more for each further one",
    )
    group.add_argument("--events", metavar="COLUMN", help="a column that is 1 where that happened, else 0")
    group.add_argument(
        "--fill",
        metavar="COLUMN=RULE",
        action="append",
        help="what to do where a cell is missing: estimate (a thermometer from the others) or end (the segment); "
        "room=estimate:1h does so for an hour at most",
    )


def how_to_read(options: argparse.Namespace, no_times: Iterable[object] = ()) -> HowToRead:
    """Options on the log's file; `columns` that are no times may be given."""
    named = [options.reading, *(options.temperature or ())]
    named += [getattr(options, role, None) for role in ("run", "events", "reference")]
    named += [rule.rpartition("=")[0] for rule in getattr(options, "fill", None) or ()]
    return HowToRead(
        separator=options.sep,
        decimal=options.decimal,
        encoding=options.encoding,
        time_format=options.time_format,
        timezone=options.timezone,
        sheet=options.sheet,
        sort=options.sort,
        names=tuple(name.strip() for name in (options.names or "").split(",") if name.strip()),
        missing=tuple(options.na or ()),
        skip_bad_rows=options.skip_bad_rows,
        drop_duplicates=options.drop_duplicates,
        reading=options.reading,
        run=getattr(options, "run", None),
        no_times=tuple(dict.fromkeys(str(name) for name in (*named, *no_times) if name)),
    )


RANGES = (("degree", 0, 9), ("blocks", 2, 0), ("window", 1, 0), ("average", 1, 0))
"""Options that are whole numbers, with their least value and their greatest, 0 for none."""


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
    form: dict[str, str] | None = None
    """How its file is written, see `ForeignTable.form`."""
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
    learned: dict[str, Any] = {"screen": not options.no_screen, "effects": _events(options)}
    time_constants = parse_time_constants(options.time_constants)
    if not options.log:
        if any((options.reading, options.reference, options.temperature, options.time, options.run)):
            raise RecordError("Columns are named but no log is given. Put the log's file name after 'analyze'.")
        from ..datasets import load_voltage_reference  # simulators: half a second of imports for a record

        log = load_voltage_reference(hidden="moisture")
        learned |= {"fill": fill_rules(options.fill, log.columns), "max_gap": options.max_gap}
        model = DynamicBiasRegressor("temperature", time_constants, options.degree, **learned)
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
    if options.events is not None:
        require_column(log.columns, options.events, "events")
    layout: dict[str, Any] = {
        "time": time,
        "run": run,
        "sampling_period": None if timed else options.sampling_period,
        "max_gap": options.max_gap,
        "fill": fill_rules(options.fill, log.columns),
        "reference": options.reference,
    }
    temperature = thermometers if len(thermometers) > 1 else thermometers[0]
    model = DynamicBiasRegressor(temperature, time_constants, options.degree, **layout, **learned)
    named = {reading, *thermometers, time, run, options.reference, options.events, *(layout["fill"] or ())}
    if found.why:
        table = table.with_said(table.frame, found.sentence())
    counters = [str(name) for name in log.columns if name not in named and is_counter(log[name])]
    results = tuple(name for name in result_columns(table.frame.columns) if name not in named)
    if results:
        warn(f"{', '.join(map(quoted, results))} are of an earlier result: written again, and no suspects.")
    if counters:
        warn(f"{', '.join(map(quoted, counters))} counts the rows: no suspect.")
    results = (*results, *counters)
    return Loaded(table.frame, table.as_it_came(), stamped, model, reading, table.said, table.form, results)


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


def check_numbers(options: argparse.Namespace) -> None:
    """Refuse options out of their range before any work is done."""
    for name, low, high in RANGES:
        value = getattr(options, name, None)
        if value is not None and not low <= value <= (high or value):
            within = f"{low} to {high}" if high else f"{low} at least"
            raise RecordError(f"The '{name}' parameter must be {within}. Got --{name} {value}.")
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


def fill_rules(given: Sequence[str] | None, columns: Any) -> dict[str, Any] | None:
    """``room=end`` and ``room=estimate:1h`` as the model takes them; RecordError for what is neither."""
    rules: dict[str, Any] = {}
    for text in given or ():
        name, mark, said = text.rpartition("=")
        if not mark or not said:
            raise RecordError(f"--fill takes COLUMN=RULE, such as room=end or room=estimate:1h. Got {text!r}.")
        rule, _, longest = said.partition(":")
        rules[require_column(columns, name, "fill")] = (rule, number_or_span(longest)) if longest else rule
    return rules or None


def readings_to_learn(loaded: Loaded, X: pd.DataFrame, y: Any, given: Sequence[str] | None) -> Any:
    """The readings without those of the stretches ``START..END`` that are not to be learned from."""
    stretches = []
    for text in given or ():
        start, mark, end = (part.strip() for part in text.partition(".."))
        if not (mark and start and end):
            raise RecordError(
                "--mask takes START..END: dates such as 2024-03-05T09:20..2024-03-05T12:40, or seconds or spans since "
                f"the record began. Got {text!r}."
            )
        stretches.append((number_or_span(start), number_or_span(end)))
    layout = loaded.model._unfitted_features(()).layout()
    return masked_readings(X, y, layout, stretches) if stretches else y


def note_events_outside(loaded: Loaded, X: pd.DataFrame, given: Sequence[str] | None) -> None:
    """Warn of events that lie outside of the record: they change nothing."""
    if not given:
        return
    record = read_record(X, loaded.model._unfitted_features(()).layout(), quiet=True)
    seconds = record.times.seconds(slice(0, record.n_rows), record.first_stamp())
    for moment in given:
        if not seconds.min() < since_start(number_or_span(moment), record, "event", "analyze") <= seconds.max():
            warn(f"--event {moment} is not within the record: it is not used.")


def _events(options: argparse.Namespace) -> list[Events]:
    moments = [number_or_span(moment) for moment in options.event or ()]
    return [Events(moments, options.events)] if moments or options.events is not None else []
