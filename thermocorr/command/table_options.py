"""Options of every command that reads a log: what the file does not tell of itself."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any

from ..foreign import HowToRead
from .spans import number_or_span


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
        help="as for strptime ('%%d/%%m/%%Y %%H:%%M:%%S'), or excel, labview, unix, 'unix ms', 'unix us', 'unix ns', "
        "seconds",
    )
    group.add_argument("--timezone", metavar="ZONE", help="of local times, such as Europe/Berlin; they become UTC")
    group.add_argument("--sheet", metavar="NAME", help="of a spreadsheet")
    group.add_argument("--sort", action="store_true", help="sort the rows by time")


def add_column_options(parser: argparse.ArgumentParser) -> None:
    """Add what the columns of a whole log are, and what to do with several files."""
    parser.add_argument(
        "--join",
        action="store_true",
        help="join several files by their times; without it, files that follow on one another are one log, and others "
        "are runs (with --run file in any case)",
    )
    columns = parser.add_argument_group("columns of the log")
    columns.add_argument(
        "--temperature",
        metavar="COLUMN",
        action="append",
        help="ambient temperature (default: temperature); once more for each further thermometer, such as a case's",
    )
    columns.add_argument("--reading", metavar="COLUMN", action=OneColumn, help="what the instrument shows")
    columns.add_argument(
        "--time",
        metavar="COLUMN",
        action=OneColumn,
        help="dates (ISO 8601) or seconds (default: time, timestamp, ...)",
    )
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
        "--run-offset",
        choices=("auto", "each", "same"),
        default="auto",
        help="whether each run has a level of its own, which stays (default auto: where levels are far apart)",
    )
    group.add_argument(
        "--fill",
        metavar="COLUMN=RULE",
        action="append",
        help="what to do where a cell is missing: estimate (a thermometer from the others) or end (the segment); "
        "room=estimate:1h does so for an hour at most",
    )


def how_to_read(options: argparse.Namespace, no_times: Iterable[object] = ()) -> HowToRead:
    """What the user said of the log's file; further columns that are something else than the times may be given."""
    named = [options.reading, *(options.temperature or ())]
    named += [getattr(options, role, None) for role in ("run", "events")]
    named += [rule.rpartition("=")[0] for rule in getattr(options, "fill", None) or ()]
    return HowToRead(
        separator=options.sep,
        decimal=options.decimal,
        encoding=options.encoding,
        time_format=options.time_format,
        timezone=options.timezone,
        sheet=options.sheet,
        sort=options.sort,
        reading=options.reading,
        no_times=tuple(dict.fromkeys(str(name) for name in (*named, *no_times) if name)),
    )
