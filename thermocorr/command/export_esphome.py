"""Write a fitted model as a package for ESPHome: C99 source, and the YAML that calls it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from ..firmware.esphome import Compensation, export_esphome, temperature_compensation
from ..foreign import read_log, time_of, with_times
from ..records import Layout, RecordError, read_record
from ..records.errors import noted
from .loading import add_table_options, how_to_read


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("log", nargs="?", help="the log, for the numbers of a SEN5x or SEN6x: a model with a reference")
    parser.add_argument("--model", required=True, metavar="FILE", help="the fitted model's file")
    parser.add_argument("--out", default="esphome", metavar="FOLDER", help="where to write (default: esphome)")
    parser.add_argument("--name", help="prefix of all names (default: thermal_bias)")
    parser.add_argument("--force", action="store_true", help="overwrite files that thermocorr did not write")
    add_table_options(parser)
    parser.set_defaults(reading=None, temperature=None)


def run(options: argparse.Namespace, say: Callable[[str], Any], progress: Callable[[str], Any]) -> None:
    """Load the model, write the files."""
    from ..files.model_file import load

    model = load(options.model)
    compensation = None if options.log is None else _compensation(model, options)
    with noted() as notes:
        inputs = [options.model, *([] if options.log is None else [options.log])]
        export = export_esphome(
            model, options.out, name=options.name, compensation=compensation, force=options.force, inputs=inputs
        )
    say(str(export))
    for note in notes:
        say(f"Note: {note}")


def _compensation(model: Any, options: argparse.Namespace) -> Compensation:
    """The sensor's own numbers, fitted to a log."""
    if model.reference is None:
        raise RecordError("The model has no reference: analyse the log with --reference, the better thermometer.")
    if "degF" in (model.reading_.unit, model.reading_.temperature_unit):
        raise RecordError("A SEN5x or SEN6x corrects itself in degC: leave the log out, or convert it before analyze.")
    how = how_to_read(options)
    table = read_log(options.log, how)
    time = model.time or time_of(table.frame, how.no_times)
    frame = with_times(table, time, how).frame
    lost = [name for name in (model.reading_.name, model.reference) if name not in frame.columns]
    if lost:
        raise RecordError(f"{options.log} has no column {lost[0]!r}, which the model was fitted to.")
    record = read_record(frame, Layout(model.reading_.name, time), needed=[model.reference], quiet=True)
    seconds = record.times.seconds(slice(0, record.n_rows), record.first_stamp())
    return temperature_compensation(frame[model.reading_.name], frame[model.reference], seconds)
