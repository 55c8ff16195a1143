"""Write a fitted model as C99 source for a microcontroller: header, source and a self-test with reference values."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from ..firmware.export import export_c
from ..records.errors import noted
from ..records.history import History
from ..records.numbers import span_text, span_texts
from .loading import number_or_span


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--model", required=True, metavar="FILE", help="the fitted model's file")
    parser.add_argument(
        "--out", default="firmware", metavar="PATH", help="folder, or a path such as out/bridge.c (default: firmware)"
    )
    parser.add_argument("--name", help="prefix of all names in C (default: thermal_bias, or the stem of --out)")
    parser.add_argument("--double", action="store_true", help="double precision instead of single")
    parser.add_argument(
        "--sampling-period",
        default="fitted",
        metavar="SPAN",
        type=number_or_span,
        help="time between samples: seconds, a span such as 15s, 'fitted' for the log's usual step (default), or "
        "'variable' where each update is told its step",
    )
    parser.add_argument("--force", action="store_true", help="overwrite files that thermocorr did not write")


def run(options: argparse.Namespace, say: Callable[[str], Any], progress: Callable[[str], Any]) -> None:
    """Load the model, write the files, print what they cost on the device."""
    from ..files.model_file import load

    progress(f"Loading {options.model}")
    model = load(options.model)
    with noted() as notes:
        export = export_c(
            model,
            options.out,
            "double" if options.double else "float",
            sampling_period=options.sampling_period,
            name=options.name,
            force=options.force,
            inputs=[options.model],
        )
    say(str(export))
    for note in notes:
        say(f"Note: {note}")
    if options.sampling_period == "fitted" and (note := _steps_vary(model.features_.history_)):
        say(f"Note: {note}")


def _steps_vary(history: History) -> str:
    """Sentence on the step that is used where the log's steps vary; empty for others."""
    varying = history.varying_steps()
    if varying is None:
        return ""
    low, high = span_texts(varying)
    return (
        f"The steps of the fitted log vary: nine of ten are {low} to {high}. The program takes one sample every "
        f"{span_text(history.usual_step)}, the usual step. Where the device's steps vary too, export with "
        "--sampling-period variable."
    )
