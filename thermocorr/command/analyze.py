"""`thermocorr analyze`: from a log to the table, the corrected log and the fitted model."""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..displays.residual_displays import added_noise
from ..displays.words import aspect_text, each_row, further_text, interval_text
from ..equations import MovingAverage, reduction_db
from ..estimators import DynamicBiasRegressor, VariantComparison, compare_variants
from ..estimators.advice import SIMPLER
from ..estimators.progress import Progress, has_bars, reporting
from ..files import Outputs
from ..files.result_files import write_corrected, write_model
from ..judgement import Diagnosis, Refinement, diagnose, refine
from ..pages import Answer
from ..pages.report import report_text
from ..records import RecordError, RecordWarning
from ..records.errors import noted, printable
from ..records.numbers import number_text, scale_of, span_text
from ..records.units import unit_of
from .loading import (
    Loaded,
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
    model.add_argument(
        "--average", type=int, metavar="N", help="write the mean of the last N corrected readings too, as `smoothed`"
    )
    model.add_argument("--window", type=int, default=25, metavar="N", help="samples of the moving average (default 25)")
    model.add_argument(
        "--blocks", type=int, default=5, metavar="N", help="blocks of time for held-out figures (default 5)"
    )
    add_learning_options(parser)
    parser.add_argument("--refine", action="store_true", help="add missing effects, one by one, while the error falls")
    parser.add_argument(
        "--deployable", action="store_true", help="with --refine: only effects that run sample by sample, live or in C"
    )
    parser.add_argument("--out", metavar="FOLDER", help="where to write corrected.csv and the fitted model")
    parser.add_argument(
        "--report",
        metavar="FILE",
        nargs="?",
        const="",
        help="write everything as one HTML page (default: report.html, in the folder of --out)",
    )
    parser.add_argument("--verbose", action="store_true", help="print every figure, not the answer alone")
    parser.add_argument("--json", action="store_true", help="print the answer as JSON, and nothing else")
    parser.add_argument("--force", action="store_true", help="overwrite files that thermocorr did not write")
    parser.add_argument("--quiet", action="store_true", help="no progress on standard error")


def run(options: argparse.Namespace, say: Callable[[str], None], progress: Callable[[str], None]) -> None:
    """Do it: `say` prints results, `progress` shows what is being done."""
    check_numbers(options)
    shown: Progress = None
    if not options.quiet and sys.stderr.isatty():
        shown = True if has_bars() else progress
    with Outputs(options.log, options.force) as outputs:
        _run(options, say, shown, outputs)


def _run(options: argparse.Namespace, say: Callable[[str], None], progress: Progress, outputs: Outputs) -> None:
    folder = None if options.out is None else Path(options.out)
    report = None if options.report is None else Path(options.report or (folder or Path()) / "report.html")
    # Files in the folder of --out
    for path in [
        *([] if folder is None else [folder / name for name in ("corrected.csv", "model.json", "model.txt")]),
        *([] if report is None else [report]),
    ]:
        outputs.claim(path)
    with noted() as notes:
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
    average = None if options.average is None else MovingAverage(options.average)
    asked = (options.variant or "").replace("-", " ")
    begun, judged = _best_judged([asked] if asked else comparison.starts, comparison, X, y, options, progress)
    answer = Answer.of(
        X,
        y,
        diagnosis=judged.diagnosis,
        refinement=judged.refinement,
        comparison=comparison,
        asked=asked,
        begun=begun,
        unjudged=judged.reason,
        source=", ".join(options.log) or "the built-in voltage reference with a hidden effect",
        command=options.as_written,
        notes=(*dict.fromkeys(notes), *_read_as(loaded, comparison)),
    )
    best = _chosen(answer, comparison, judged)
    answer = replace(answer, notes=tuple(filter(None, (added_noise(best, X, y), *answer.notes))))
    files: list[str] = []
    if folder is not None and answer.choice != "none":
        evaluated, more = _evaluated(best, X, read)
        if average is not None:
            evaluated["smoothed"] = average.many(evaluated["corrected"].to_numpy(float))
        answer = replace(answer, notes=(*answer.notes, *more))
        files.append(str(write_corrected(outputs, folder, loaded.written, evaluated, loaded.has_index)))
        best._log_form = loaded.form or {}
        files += map(str, write_model(outputs, folder, best, (X, y)))
    if report is not None:
        files.append(str(report))
        outputs.write(report, report_text(best, X, y, answer))
    outputs.commit()
    answer = replace(answer, files=tuple(files))
    if options.json:
        say(json.dumps(answer.to_dict(), indent=1, allow_nan=False))
        return
    say(str(answer))
    if folder is not None and answer.choice == "none":
        say("No correction is written, as none is advised. To write one all the same: --variant dynamic-linear")
    if options.verbose:
        say(_everything(answer, judged, best))


def _read_as(loaded: Loaded, comparison: VariantComparison) -> list[str]:
    """Say how the log was read."""
    model = next(iter(comparison.models.values()))
    thermometers, unit = model.thermometers_, model.reading_.temperature_unit
    named = f"temperature{'s' * (len(thermometers) > 1)} {', '.join(map(repr, thermometers))}"
    against = "" if model.reference is None else f" less {model.reference!r}"
    by_size = "" if unit_of(next(iter(thermometers)), loaded.log) else " by their size"
    return [
        f"{model.reading_.n_readings} readings of {loaded.reading!r}{against}, {named} ({unit}{by_size}), a row every "
        f"{span_text(model.features_.history_.usual_step)}",
        *([f"Read as: {', '.join(loaded.understood)}."] if loaded.understood else []),
    ]


def _chosen(answer: Answer, comparison: VariantComparison, judged: Judged) -> DynamicBiasRegressor:
    """The model of the answer; where no correction is advised, the one that was judged."""
    if answer.refined and judged.refinement is not None:
        return judged.refinement.model_
    return comparison.models[answer.asked or answer.begun]


def _everything(answer: Answer, judged: Judged, best: DynamicBiasRegressor) -> str:
    """Further text that the answer leaves out."""
    said = ["", *(f"Data: {note}" for note in answer.notes), str(answer.comparison)]
    said.append(str(answer.comparison.advice if answer.asked and answer.comparison else answer.advised))
    for name, taus in best.thermometers_.items():
        of_which = f", {name}" if len(best.thermometers_) > 1 else ""
        said.append(f"Time constants{of_which}: {', '.join(map(span_text, taus)) or 'none'}")
    return "\n\n".join([*said, judged.said])


def _evaluated(model: DynamicBiasRegressor, X: pd.DataFrame, y: pd.Series) -> tuple[pd.DataFrame, list[str]]:
    """`evaluate` with uncertainties, and its warnings."""
    with noted() as notes:
        evaluated = model.evaluate(X, y, return_std=True)
    return evaluated, notes


class Judged(NamedTuple):
    """Results of the judgement."""

    said: str
    diagnosis: Diagnosis | None = None
    refinement: Refinement | None = None
    reason: str = ""
    """Why there is no diagnosis."""


def _best_judged(
    starts: Sequence[str],
    comparison: VariantComparison,
    X: pd.DataFrame,
    y: pd.Series,
    options: argparse.Namespace,
    progress: Progress,
) -> tuple[str, Judged]:
    """The first of some variants with its judgement; a refinement of a later one that is better by `SIMPLER`."""
    best, judged = starts[0], _judge(comparison.models[starts[0]], X, y, options, progress)
    for name in starts[1:] if options.refine else ():
        other = _judge(comparison.models[name], X, y, options, progress)
        if judged.refinement is None or other.refinement is None:
            continue
        now, before = (found.steps["later_rms"].iloc[-1] for found in (other.refinement, judged.refinement))
        if reduction_db(now, before) <= -SIMPLER:
            best, judged = name, other
    return best, judged


def _judge(
    model: DynamicBiasRegressor, X: pd.DataFrame, y: pd.Series, options: argparse.Namespace, progress: Progress
) -> Judged:
    """Diagnose the model; with --refine, add the missing effects."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordWarning)
            if not options.refine:
                with reporting(progress) as show:
                    show("looking for what is missing")
                    found = diagnose(model, X, y)
                return Judged(f"{found}\n\n{places(found)}", found)
            refinement = refine(model, X, y, deployable=options.deployable, progress=progress)
    except RecordError as error:
        return Judged(f"Not judged: {error}", reason=f"Not judged: {error}")
    first = refinement.diagnoses[0]
    before = f"Before {further_text(refinement)} was added:\n\n" if further_text(refinement) else ""
    said = (
        f"{before}{first}\n\n{places(first)}\n\n"
        "The error, step by step (later: stretches predicted from everything before, in dB\n"
        f"against step 0, negative is good; held out: blocks of time that the fit did not see):\n\n{refinement}\n"
    )
    return Judged(said, first, refinement)


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
