"""`thermocorr analyze`: from a log to a corrected one."""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..equations import reduction_db
from ..judgement import Diagnosis, Refinement, diagnose, refine
from ..model import DynamicBiasRegressor, VariantComparison, compare_variants
from ..model.advice import SIMPLER
from ..model.progress import Progress, has_bars, reporting
from ..output.answer import Answer
from ..output.report import report_text
from ..output.residual_displays import added_noise
from ..output.results import write_corrected, write_model
from ..output.writer import Outputs
from ..records import RecordError, RecordWarning
from ..records.errors import noted
from ..records.numbers import span_text, unit_text
from ..records.units import unit_of
from .loading import Loaded, add_column_options, add_table_options, add_time_constants, check_time_constants, load_log

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
    add_time_constants(parser)
    parser.add_argument(
        "--variant",
        choices=VARIANTS,
        metavar="NAME",
        help=f"use this correction instead of the advised one: {', '.join(VARIANTS)}",
    )
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
    parser.add_argument("--json", action="store_true", help="print the answer as JSON, and nothing else")
    parser.add_argument("--force", action="store_true", help="overwrite what is there already")


def run(options: argparse.Namespace, say: Callable[[str], None], progress: Callable[[str], None]) -> None:
    """Do it: `say` prints results, `progress` shows what is being done."""
    check_time_constants(options)
    shown: Progress = None
    if sys.stderr.isatty():
        shown = True if has_bars() else progress
    with Outputs(options.log, options.force) as outputs:
        _run(options, say, shown, outputs)


def _run(options: argparse.Namespace, say: Callable[[str], None], progress: Progress, outputs: Outputs) -> None:
    folder = None if options.out is None else Path(options.out)
    report = None if options.report is None else Path(options.report or (folder or Path()) / "report.html")
    # The files in the folder of --out:
    for path in [
        *([] if folder is None else [folder / name for name in ("corrected.csv", "model.json", "model.txt")]),
        *([] if report is None else [report]),
    ]:
        outputs.claim(path)
    with noted() as notes:
        loaded = load_log(options)
        X, y = loaded.columns()
        comparison = compare_variants(X, y, model=loaded.model, products=True, progress=progress)
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
    evaluated, more = None, list[str]()
    if folder is not None and answer.choice != "none":
        evaluated, more = _evaluated(best, X, y)
    if report is not None and find_spec("matplotlib") is None:
        more.append("the report has no pictures, for which matplotlib is needed: pip install matplotlib")
    answer = replace(answer, notes=(*answer.notes, *more))
    if report is not None:
        files.append(str(report))
        outputs.write(report, report_text(best, X, y, answer))
    if evaluated is not None and folder is not None:
        files.append(str(write_corrected(outputs, folder, loaded.log, evaluated)))
        files += map(str, write_model(outputs, folder, best))
    proposal = None if answer.last is None else answer.last.proposal
    profile = None if proposal is None else proposal.profile
    if folder is not None and profile is not None:
        files.append(str(folder / "profile.csv"))
        outputs.write(files[-1], profile.to_csv())
    outputs.commit()
    answer = replace(answer, files=tuple(files))
    if options.json:
        say(json.dumps(answer.to_dict(), indent=1, allow_nan=False))
        return
    say(str(answer))
    if folder is not None and answer.choice == "none":
        say("No correction is written, as none is advised. To write one all the same: --variant dynamic-linear")


def _read_as(loaded: Loaded, comparison: VariantComparison) -> list[str]:
    """Say how the log was read."""
    model = next(iter(comparison.models.values()))
    thermometers, unit = model.thermometers_, unit_text(model.reading_.temperature_unit)
    named = f"temperature{'s' * (len(thermometers) > 1)} {', '.join(map(repr, thermometers))}"
    against = "" if model.reference is None else f" less {model.reference!r}"
    by_size = "" if unit_of(next(iter(thermometers)), loaded.log) else ", as its values suggest"
    return [
        f"{model.reading_.n_readings} readings of {loaded.reading!r}{against}, {named} ({unit}{by_size}), a row every "
        f"{span_text(model.features_.history_.usual_step)}",
        *([f"Read as: {', '.join(loaded.understood)}."] if loaded.understood else []),
    ]


def _chosen(answer: Answer, comparison: VariantComparison, judged: Judged) -> DynamicBiasRegressor:
    """The answer's model, or the judged one."""
    if answer.refined and judged.refinement is not None:
        return judged.refinement.model_
    return comparison.models[answer.asked or answer.begun]


def _evaluated(model: DynamicBiasRegressor, X: pd.DataFrame, y: pd.Series) -> tuple[pd.DataFrame, list[str]]:
    """`evaluate` with uncertainties, and its warnings."""
    with noted() as notes:
        evaluated = model.evaluate(X, y, return_std=True)
    return evaluated, notes


class Judged(NamedTuple):
    """Results of the judgement."""

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
    """The best judged variant, simple ones first."""
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
                return Judged(found)
            refinement = refine(model, X, y, deployable=options.deployable, progress=progress)
    except RecordError as error:
        return Judged(reason=f"Not judged: {error}")
    return Judged(refinement.diagnoses[0], refinement)
