"""`thermocorr propose`: the measurement that decides between causes, or a first calibration."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

from ..judgement import calibration_profile, diagnose, propose
from ..judgement.propose import HOURLY
from ..output.writer import Outputs
from ..records.errors import RecordError
from .loading import add_column_options, add_table_options, add_time_constants, check_time_constants, load_log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "log", nargs="*", help="the log, as for analyze; without one, the profile of a first calibration within --drive"
    )
    add_table_options(parser)
    add_column_options(parser)
    add_time_constants(parser)
    parser.add_argument(
        "--drive",
        nargs=3,
        action="append",
        metavar=("COLUMN", "LOW", "HIGH"),
        help="a column that can be driven, and between what; may be repeated (default: the temperature and the columns "
        "of the rivals, within what the log shows)",
    )
    parser.add_argument("--hours", type=float, default=24.0, help="length of the new measurement (default: 24)")
    parser.add_argument(
        "--fastest",
        nargs=2,
        action="append",
        metavar=("COLUMN", "RATE"),
        help="fastest change of a driven column, in its unit per hour (default: 6 K/h for a temperature)",
    )
    parser.add_argument("--out", default="profile.csv", metavar="FILE", help="the best profile (default: profile.csv)")
    parser.add_argument("--json", action="store_true", help="print the proposal as JSON, and nothing else")
    parser.add_argument("--force", action="store_true", help="overwrite what is there already")


def run(options: argparse.Namespace, say: Callable[[str], Any], progress: Callable[[str], Any]) -> None:
    """Diagnose the log, propose, write the profile."""
    check_time_constants(options)
    limits = {name: (_number(low, "--drive"), _number(high, "--drive")) for name, low, high in options.drive or ()}
    fastest = {name: _number(rate, "--fastest") for name, rate in options.fastest or ()}
    if not options.log:
        _first_calibration(options, limits, fastest, say)
        return
    with Outputs(options.log, options.force) as outputs:
        outputs.claim(options.out)
        loaded = load_log(options)
        X, y = loaded.columns()
        if sys.stderr.isatty():
            progress("looking for what is missing")
        model = loaded.model.fit(X, y)
        found = diagnose(model, X, y)
        if not found.causes or not found.causes[0].confusable_with:
            raise RecordError(
                f"There is nothing to decide: the verdict is {found.verdict!r}. thermocorr analyze says more."
            )
        proposal = propose(model, found, X, y, limits=limits or None, hours=options.hours, fastest=fastest)
        profile = proposal.profile
        if profile is not None:
            outputs.write(options.out, profile.to_csv())
        outputs.commit()
    if options.json:
        say(json.dumps(proposal.to_dict(), indent=1, allow_nan=False))
        return
    say(f"{proposal}\n{'Nothing to drive, nothing written.' if profile is None else f'Written: {options.out}'}")


def _first_calibration(
    options: argparse.Namespace,
    limits: dict[str, tuple[float, float]],
    fastest: dict[str, float],
    say: Callable[[str], Any],
) -> None:
    """Write the profile of an instrument of which nothing is known."""
    if len(limits) != 1 or fastest.keys() - limits.keys():
        raise RecordError(
            "Without a log, one --drive gives the temperature's name and its limits, for a first calibration: "
            "thermocorr propose --drive temperature 21 25. With a log, the measurement decides between causes."
        )
    (name, (low, high)), *_ = limits.items()
    profile = calibration_profile(low, high, hours=options.hours, fastest=fastest.get(name, HOURLY)).rename(name)
    with Outputs([], options.force) as outputs:
        outputs.claim(options.out)
        outputs.write(options.out, profile.to_csv())
        outputs.commit()
    if options.json:
        rows = {"hours": options.hours, "column": name, "seconds": profile.index.tolist(), "values": profile.tolist()}
        say(json.dumps(rows, allow_nan=False))
        return
    say(
        f"First calibration: {name} in long and short steps between {low:g} and {high:g}, for {options.hours:g} h.\n"
        f"Let the instrument settle at {(low + high) / 2:g} before. Limits should be the range of use and 1 K on each "
        f"side: wider ones mislead.\nWritten: {options.out}"
    )


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RecordError(f"{option} takes numbers behind the column's name. Got {text!r} instead.") from None
