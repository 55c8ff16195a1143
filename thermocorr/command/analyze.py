"""`thermocorr analyze`: from a log to the table, the corrected log and the fitted model."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..estimators import DynamicBiasRegressor, compare_variants
from ..estimators.progress import Progress, has_bars, told
from ..files import Outputs
from ..files.result_files import write_corrected, write_model
from ..judgement import Diagnosis, Refinement, diagnose, refine
from ..pages import Findings
from ..pages.report import report_text
from ..pictures.residual_displays import added_noise
from ..pictures.words import aspect_text, each_row, further_text, interval_text, kept_sentence
from ..records import RecordError, RecordWarning
from ..records.errors import printable
from ..records.numbers import number_text, scale_of, span_text
from ..records.units import unit_of
from .loading import (
    add_column_options,
    add_learning_options,
    add_model_options,
    add_table_options,
    check_numbers,
    load_log,
    note_events_outside,
    readings_to_learn,
)

VARIANTS = ("static-linear", "static-nonlinear", "dynamic-linear", "dynamic-nonlinear")
"""Corrections to choose from, as options have them."""
RESULTS = ("corrected.csv", "model.json", "model.txt")
"""Files in the folder of --out."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `thermocorr analyze`."""
    parser.add_argument(
        "log",
        nargs="*",
        help="CSV, text, spreadsheet, Parquet, Feather; without one, a built-in voltage reference with a hidden effect",
    )
    add_table_options(parser)
    add_column_options(parser)
    model = add_model_options(parser, "model")
    model.add_argument(
        "--products",
        nargs="?",
        type=int,
        choices=(0, 2, 3),
        const=2,
        metavar="0|2|3",
        help="add the products of two lags, eq. (21), or of three too; 0: none (default: of two, where they clearly "
        "lower the error on later data)",
    )
    model.add_argument(
        "--variant",
        choices=VARIANTS,
        metavar="NAME",
        help=f"use this correction, and not the one that is advised: {', '.join(VARIANTS)}",
    )
    model.add_argument("--window", type=int, default=25, metavar="N", help="samples of the moving average (default 25)")
    model.add_argument(
        "--blocks", type=int, default=5, metavar="N", help="blocks of time for held-out figures (default 5)"
    )
    add_learning_options(parser)
    parser.add_argument("--refine", action="store_true", help="add missing effects, one by one, while the error falls")
    parser.add_argument("--out", metavar="FOLDER", help="where to write corrected.csv and the fitted model")
    parser.add_argument(
        "--report",
        metavar="FILE",
        nargs="?",
        const="",
        help="write everything as one HTML page (default: report.html, in the folder of --out)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite files that thermocorr did not write")
    parser.add_argument("--quiet", action="store_true", help="no progress on standard error")


def run(options: argparse.Namespace, say: Callable[[str], None], progress: Callable[[str], None]) -> None:
    """Do it: `say` prints results, `progress` shows what is being done."""
    check_numbers(options)
    shown: Progress = None if options.quiet else True if has_bars() and sys.stderr.isatty() else progress
    with Outputs(options.log, options.force) as outputs:
        _run(options, say, shown, outputs)


def _run(options: argparse.Namespace, say: Callable[[str], None], progress: Progress, outputs: Outputs) -> None:
    folder = None if options.out is None else Path(options.out)
    report = None if options.report is None else Path(options.report or (folder or Path()) / "report.html")
    for path in [
        *([] if folder is None else [folder / name for name in RESULTS]),
        *([] if report is None else [report]),
    ]:
        outputs.claim(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        loaded = load_log(options)
        X, read = loaded.columns()
        y = readings_to_learn(loaded, X, read, options.mask)
        note_events_outside(loaded, X, options.event)
        comparison = compare_variants(
            X,
            y,
            model=loaded.model,
            degree=options.degree,
            products="auto" if options.products is None else options.products or False,
            window=options.window,
            n_blocks=options.blocks,
            progress=progress,
        )
    advice, advised = comparison.advice, comparison.advice.sentence()
    best = comparison.best_ or list(comparison.models.values())[-1]
    if options.variant is not None:
        best = comparison.models[options.variant.replace("-", " ")]
    judged = _judge(best, X, y, options, progress)
    used = "" if judged.refinement is None else kept_sentence(judged.refinement, advice)
    if advice.choice == "none" and options.variant is None and not used:
        folder = None
    say(f"{used}\n\n(Before that: {advised})\n" if used else f"{advised}\n")
    if loaded.understood:
        say(f"Read as: {', '.join(loaded.understood)}.\n")
    thermometers, unit = best.thermometers_, best.reading_.temperature_unit
    named = f"temperature{'s' * (len(thermometers) > 1)} {', '.join(map(repr, thermometers))}"
    by_size = "" if unit_of(next(iter(thermometers)), loaded.log) else " by their size"
    say(
        f"{best.reading_.n_readings} readings of {loaded.reading!r}, {named} ({unit}{by_size}), a row every "
        f"{span_text(best.features_.history_.usual_step)}\n"
    )
    for note in dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, RecordWarning)):
        say(f"Note: {note}\n")
    say(f"{comparison}\n\n{comparison.advice}\n")
    for name, taus in thermometers.items():
        of_which = f", {name}" if len(thermometers) > 1 else ""
        say(f"Time constants{of_which}: {', '.join(map(span_text, taus)) or 'none'}\n")
    say(judged.said)
    best = judged.model
    noise = added_noise(best, X, y)
    if noise:
        say(f"{noise}\n")
    if folder is not None:
        written = [
            write_corrected(outputs, folder, loaded.written, _evaluated(best, X, read, say), loaded.has_index),
            *write_model(outputs, folder, best, (X, y)),
        ]
    if report is not None:
        findings = Findings(
            diagnosis=judged.diagnosis,
            refinement=judged.refinement,
            comparison=comparison,
            unjudged=judged.reason,
            source=", ".join(options.log) or "the built-in voltage reference with a hidden effect",
            command=options.as_written,
        )
        outputs.write(report, report_text(best, X, y, findings))
    outputs.commit()
    if folder is not None:
        say(f"Written: {', '.join(str(path) for path in written)}")
    elif options.out is not None:
        say("Nothing is written: no correction is advised. To write one all the same: --variant dynamic-linear")
    if report is not None:
        say(f"Report: {report}")


def _evaluated(model: DynamicBiasRegressor, X: pd.DataFrame, y: pd.Series, say: Callable[[str], None]) -> pd.DataFrame:
    """`evaluate` with uncertainties, its warnings among what is said."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        evaluated = model.evaluate(X, y, return_std=True)
    for warning in caught:
        say(f"Note: {warning.message}\n")
    return evaluated


class Judged(NamedTuple):
    """The model to keep, and what was found."""

    model: DynamicBiasRegressor
    said: str
    """What is told of it."""
    diagnosis: Diagnosis | None = None
    refinement: Refinement | None = None
    reason: str = ""
    """Why there is no diagnosis."""


def _judge(
    model: DynamicBiasRegressor, X: pd.DataFrame, y: pd.Series, options: argparse.Namespace, progress: Progress
) -> Judged:
    """Where the model fails and what is missing; with --refine, add it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordWarning)
            if not options.refine:
                with told(progress) as show:
                    show("looking for what is missing")
                    found = diagnose(model, X, y)
                more = "\n\nAdd --refine to add what is missing and watch the error fall."
                return Judged(model, f"{found}\n\n{places(found)}{more if found.best is not None else ''}", found)
            refinement = refine(model, X, y, progress=progress)
    except RecordError as error:
        return Judged(model, f"Not judged: {error}", reason=f"Not judged: {error}")
    first = refinement.diagnoses[0]
    before = f"Before {further_text(refinement)} was added:\n\n" if further_text(refinement) else ""
    said = (
        f"{before}{first}\n\n{places(first)}\n\n"
        "The error, step by step (later: stretches predicted from everything before, in dB\n"
        f"against step 0, negative is good; held out: blocks of time that the fit did not see):\n\n{refinement}\n"
    )
    return Judged(refinement.model_, said, first, refinement)


def places(found: Diagnosis) -> str:
    """The five worst places of a diagnosis as text."""
    if not len(found.where):
        return "No place where it fails more than elsewhere."
    worst = found.where.head(5)
    scale = scale_of(worst["rms"], printable(found.unit))
    rows = [
        (aspect_text(row), interval_text(row), row.n, scale.factor * row.rms, f"{row.share:.0%}")
        for row in each_row(worst)
    ]
    rms = f"rms [{scale.unit}]" if scale.unit else "rms"
    frame = pd.DataFrame(rows, columns=["fails most in", "range", "n", rms, "share"])
    return frame.to_string(index=False, float_format=number_text)
