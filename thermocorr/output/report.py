"""The report: one HTML page, no script, pictures of the displays."""

from __future__ import annotations

import platform
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup

from .._version import __version__
from ..effects.thermal import column_text
from ..equations.statistics import Moments
from ..model import DynamicBiasRegressor, VariantComparison
from ..model.tables import VERDICTS
from ..records.errors import quoted
from ..records.numbers import Scale, quantity_texts, scale_of, span_text, unit_text
from .answer import Answer
from .axes import Display
from .curves import Curves
from .diagnosis_displays import ErrorsDisplay, SuspectsDisplay, WhereDisplay
from .html import asset, decibels, number, percent, rendered
from .model_displays import ContributionsDisplay
from .residual_displays import AllanDisplay, ResidualsDisplay, added_noise_shown
from .style import css
from .words import HELPS, each_row, parameters_text, said_of_rest, share_of_samples
from .writer import write_file

FLAGS = {
    "washout": "after a start of unknown state: the lags have not forgotten it",
    "outside fitted range": "temperature outside the fitted range: the model extrapolates",
    "no reading": "no reading",
    "no temperature": "no temperature, or a column that the model needs is missing",
    "jump": "an input moved faster than it ever did: the value before stands in its place",
    "doubtful input": "what stood still or jumped, here or before, may move the bias beyond the noise",
    "behind gap": "nobody recorded the temperature for a while, and what it may have done then exceeds the noise",
    "sentinel": "a code for no value",
    "spike": "an isolated spike",
    "other unit": "the temperature looks like kelvin where °C was fitted, or the other way round",
}
LISTED = 200
"""Coefficients listed, and lines of the formula: a record of many segments has decays for each."""
FEWEST_DIGITS, MOST_DIGITS = 6, 15
"""Digits of a coefficient."""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
"""Nothing runs in the page, and nothing is loaded."""
NO_PICTURES = "The pictures of this page need the package matplotlib: pip install matplotlib."


def write_report(
    path: str | PathLike[str],
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    diagnosis: Any = None,
    refinement: Any = None,
    comparison: VariantComparison | None = None,
    unjudged: str = "",
    source: str = "",
    command: str = "",
    force: bool = False,
) -> Path:
    """Write a self-contained HTML page of a few MB.

    Parameters
    ----------
    path : path
        File to write.
    model : DynamicBiasRegressor
        Fitted; the one that is kept.
    X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        The record. It is read block by block.
    diagnosis, refinement, comparison : optional
        What `diagnose`, `refine` and `compare_variants` returned for this record.
    unjudged : str
        Why there is no diagnosis.
    source, command : str
        Name of the data's file, and the command that made the page; shown at its end.
    force : bool, default False
        Overwrite a file that is there already.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        An OSError and a RecordError: the file cannot be written, or must not be.
    """
    answer = Answer.of(
        X,
        y,
        diagnosis=diagnosis,
        refinement=refinement,
        comparison=comparison,
        unjudged=unjudged,
        source=source,
        command=command,
    )
    return write_file(path, report_text(model, X, y, answer), force=force)


def report_text(model: DynamicBiasRegressor, X: Any, y: Any, answer: Answer) -> str:
    """The page of `write_report`; `model` is the kept one."""
    found, facts = answer.last, Facts.of(model, X, y)
    allan = AllanDisplay.from_estimator(model, X, y)
    below = [facts.temperature]
    if found is not None and found.suspects:
        columns = getattr(X, "columns", ())
        below += [name for name in found.suspects[0].effect.inputs() if name in columns and name not in below]
    contributions = ContributionsDisplay.from_estimator(model, X)
    scale = scale_of([] if found is None else (found.residual_rms, found.noise_floor), model.reading_.unit)
    coefficients = model.coef_table()
    uncertainties = _uncertainties(model)
    follows = picture(ResidualsDisplay.from_estimator(model, X, y, found, uncertainty=True, columns=below), 480)
    return rendered(
        "report",
        policy=POLICY,
        styles=Markup(css() + asset("report.css")),
        title=f"Thermal bias of {model.reading_.name}",
        leads=[*filter(None, [answer.sentence(), facts.left_behind(model), added_noise_shown(allan, model, X)])],
        lacking="" if follows else NO_PICTURES,
        facts=facts,
        answer=answer,
        bars=_errors(answer, model),
        found=found,
        calm=found is not None and VERDICTS[found.verdict].calm,
        said="" if found is None else said_of(found),
        left=[] if found is None else said_of_rest(found, scale),
        scale=scale,
        follows=follows,
        where=None if found is None else _where(found, X),
        suspects=[] if found is None else _suspects(found, facts),
        suspected="" if found is None else picture(SuspectsDisplay.from_diagnosis(found)),
        cure=None if found is None else _cure(found),
        thermometers=[(column_text(name), taus.tolist()) for name, taus in model.thermometers_.items()],
        contributions=picture(contributions),
        shares=list(contributions.rms.items()),
        moves=scale_of(contributions.rms, model.reading_.unit),
        uncertainties=uncertainties,
        unsure=scale_of([value for _, value in uncertainties], model.reading_.unit),
        equation=_shortened(model.equation()),
        n_coefficients=len(coefficients),
        coefficients=[
            (row, scale_of([row.coefficient], row.unit), digits_down_to(row.standard_error, row.coefficient))
            for row in each_row(coefficients[:LISTED])
        ],
        code=repr(model),
        noise=picture(allan),
        steps=None if answer.refinement is None else _steps(answer.refinement),
        variants=None if answer.comparison is None else _variants(answer.comparison),
        versions=versions(),
    )


def picture(display: Display, height: float | None = None) -> Markup:
    """A display in a page, twice with a `height` [pixels]."""
    try:
        if height is None:
            return Markup(display.to_svg())
        both = display.to_svg(), display.to_svg(360, height)
        return Markup('<div class="wide">{}</div><div class="narrow">{}</div>').format(*map(Markup, both))
    except ImportError:  # the page says so
        return Markup("")


def said_of(found: Any) -> str:
    """Sentence on the verdict."""
    helps = found.best is not None and found.suspects[0].standing == "helps"
    return HELPS if helps else VERDICTS[found.verdict].sentence


def _errors(answer: Answer, model: DynamicBiasRegressor) -> Markup | str:
    """Error of each correction as bars."""
    floor, advice = None if answer.last is None else answer.last.noise_floor, answer.advised
    errors, chosen = pd.Series(answer.errors(), dtype=float), "" if advice is None else advice.variant
    if answer.steps is not None:
        errors = answer.steps.set_index("step")["error"]
        chosen = errors.index[-1]
    bars = ErrorsDisplay(errors, model.reading_.unit, floor, chosen or str(next(iter(errors.index), "")))
    if advice is None and answer.steps is None and answer.refinement is not None:
        bars = ErrorsDisplay.from_refinement(answer.refinement)
    if bars.errors.notna().sum() == 0:
        return ""
    return picture(bars, 96 * bars.grid()["size"][1])


def _where(found: Any, X: Any) -> dict[str, Any]:
    """The worst place, a picture, and all places."""
    rows = list(each_row(found.where))
    return {
        "worst": rows[0] if rows and rows[0].share > 0 else None,
        "samples": share_of_samples(rows[0]) if rows else 0.0,
        "rows": rows,
        "scale": scale_of(found.where["rms"], found.unit),
        "picture": picture(WhereDisplay.from_diagnosis(found, X)),
    }


def _suspects(found: Any, facts: Facts) -> list[tuple[Any, str]]:
    """Suspects with their parameters in words."""
    return [(suspect, parameters_text(suspect.effect, facts.start, facts.degrees)) for suspect in found.suspects]


def _cure(found: Any) -> dict[str, Any]:
    """The effect to add, and measurements to confirm it."""
    rivals = () if found.best is None else (found.best, *found.suspects[0].confusable_with)
    checks = {effect.kind: effect for effect in reversed(rivals) if effect.info is not None}
    return {"code": "" if found.best is None else repr(found.best), "checks": list(reversed(checks.values()))}


def _shortened(equation: str) -> str:
    lines = equation.split("\n")
    return "\n".join(lines if len(lines) <= LISTED else [*lines[:LISTED], "    + ... (whole: model.equation())"])


def digits_down_to(error: float, value: float) -> int:
    """Digits of a value, down to its error's second."""
    if not (0 < error < np.inf and 0 < abs(value) < np.inf):
        return FEWEST_DIGITS
    return int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(error)) + 2, FEWEST_DIGITS, MOST_DIGITS))


def _steps(refinement: Any) -> dict[str, Any]:
    """The error, step by step."""
    table = refinement.steps
    scale = scale_of(table[["held_out_rms", "later_rms", "rms"]], refinement.diagnoses[0].unit)
    return {"rows": list(each_row(table)), "scale": scale}


def _variants(comparison: VariantComparison) -> dict[str, Any]:
    """Variants on the fitted record, then on unseen data."""
    names, scale = comparison.formatted().columns, comparison.scale()
    figures = comparison.frame().iloc[:, : len(names)]  # without those of the noise, which have other units
    tables = []
    for chosen in (slice(0, len(names) // 2), slice(len(names) // 2, None)):
        part = figures[figures.columns[chosen]].dropna(how="all")
        rows = [
            (name, [_figure(column, value, scale) for column, value in row.items()]) for name, row in part.iterrows()
        ]
        tables.append((names[chosen], rows))
    return {"tables": tables, "caption": comparison.caption(unit_text(scale.unit))}


def _figure(column: Any, value: float, scale: Scale) -> str:
    if np.isnan(value):
        return ""
    return decibels(value) if str(column).endswith("_db") else number(value, scale=scale)


class Facts(NamedTuple):
    """What was measured, and what is odd about it."""

    temperature: str
    degrees: str
    """Unit of the temperature."""
    start: float | None
    """Seconds since 1970 of the first row; None for a record without dates."""
    sentence: str
    remarks: list[str]
    segments: list[tuple[str, str, str, int]]
    """First stretches: run, first time, last time, rows."""
    n_segments: int
    corrected: Moments
    readings: Moments

    @classmethod
    def of(cls, model: DynamicBiasRegressor, X: Any, y: Any) -> Facts:
        """Gather them in one pass through the record."""
        curves = Curves(model, X, y)
        record, line, reading = curves.record, curves.timeline, model.reading_
        flags: dict[str, int] = {}
        corrected, readings = Moments(), Moments()
        for part in curves.parts():
            corrected = corrected.merged(Moments.of(part.corrected))
            readings = readings.merged(Moments.of(part.measured))
        for _, _, flagged in model._evaluated_blocks(X, y):
            for name, count in flagged.counts().items():
                flags[name] = flags.get(name, 0) + count
        count = record.n_used - sum(flags.get(why, 0) for why in ("no reading", "sentinel", "spike"))

        def label(k: int) -> str:
            return record.times.label(record.row(k))

        ends = [label(record.segments[0].start), label(record.segments[-1].stop - 1)]
        many = "" if len(record.segments) == 1 else f", in {len(record.segments)} stretches"
        when = f"{' to '.join(ends)}{'' if line.zone is None else ' UTC'}, every {span_text(record.usual_step())}"
        return cls(
            temperature=curves.temperature_name,
            degrees=reading.temperature_unit,
            start=line.zero if line.dates else None,
            sentence=f"{count:,} readings of {reading.name}, {'at unknown times' if line.samples else when}{many}.",
            remarks=[*dict.fromkeys((*model.notes_, *record.notes)), *_remarks(model, record, flags, curves)],
            segments=[
                ("" if run is None else str(run), label(start), label(stop - 1), stop - start)
                for start, stop, run in record.segments[:20]
            ],
            n_segments=len(record.segments),
            corrected=corrected,
            readings=readings,
        )

    def left_behind(self, model: DynamicBiasRegressor) -> str:
        """Warning where the corrected mean lies outside all readings."""
        corrected, readings = self.corrected, self.readings
        low, high = model.reading_.temperature_range
        inside = low <= model.reference_temperature_ <= high
        if not corrected.n or readings.low <= corrected.mean <= readings.high or not inside:
            return ""
        mean, lowest, highest = quantity_texts((corrected.mean, readings.low, readings.high), model.reading_.unit, 6)
        return (
            f"The corrected readings have a mean of {mean}, and the readings lie between {lowest} and {highest}: what "
            "was taken away is no bias of this instrument alone. See in the model below which effect makes it, and "
            "whether the temperature left the fitted range."
        )


def _remarks(model: DynamicBiasRegressor, record: Any, flags: dict[str, int], curves: Curves) -> list[str]:
    """What the user may want to know of the data."""
    remarks = [
        f"{count:,} rows flagged “{flag}”: {FLAGS.get(flag, flag)}." for flag, count in sorted(flags.items()) if flag
    ]
    outside = record.n_rows - record.n_used
    if outside:
        remarks.append(f"{outside:,} rows lie in no stretch: their temperature, or a needed column, is missing.")
    if not model.reading_.unit_named:
        name = curves.temperature_name
        remarks.append(
            f"The data name no unit of {quoted(name)}: {unit_text(model.reading_.temperature_unit)} is assumed, as its "
            f"values suggest. If that is wrong, name it, as in {quoted(name + ' [°F]')}."
        )
    return remarks


def _uncertainties(model: Any) -> list[tuple[str, float]]:
    """Typical uncertainty of a corrected reading, by source."""
    if not model._knows_noise:
        return []
    joint = model._joint_errors()
    unpredicted = joint.noise.unpredicted(model.features_.history_.usual_step)
    parts = {
        "noise that its past does not predict": unpredicted,
        "noise that its past predicts": max(joint.noise.variance - unpredicted, 0.0),
        "the bias": joint.usual,
    }
    whole = ("one corrected reading", float(np.sqrt(sum(parts.values()))))
    return [whole, *((name, float(np.sqrt(variance))) for name, variance in parts.items())]


def versions() -> list[tuple[str, str]]:
    """Versions of what computed the page."""
    others = [(name, version(name)) for name in ("numpy", "scipy", "scikit-learn", "pandas")]
    return [("thermocorr", __version__), *others, ("Python", platform.python_version())]


class Page:
    """Results that show as a page, or in a notebook."""

    def _answer(self, **known: Any) -> Answer:
        raise NotImplementedError

    def to_html(self, *, source: str = "", command: str = "") -> str:
        """One self-contained HTML page."""
        answer = self._answer(source=source, command=command)
        if answer.last.record is None:
            raise ValueError(f"This {type(self).__name__.lower()} holds no record to draw. Make it anew, from X and y.")
        model, X, y = answer.last.record
        return report_text(model, X, y, answer)

    def save_html(self, path: str | PathLike[str], *, source: str = "", command: str = "", force: bool = False) -> None:
        """Write `to_html` to a file; OutputError for an existing one."""
        write_file(path, self.to_html(source=source, command=command), force=force)


class DiagnosisPage(Page):
    """Page of a `Diagnosis`."""

    def _answer(self, **known: Any) -> Answer:
        return Answer(diagnosis=self, **known)

    def _repr_html_(self: Any) -> str:
        calm, floor = VERDICTS[self.verdict].calm, scale_of((self.residual_rms, self.noise_floor), self.unit)
        worst = [row for row in each_row(self.where.head(3)) if row.share > 0]
        places = [(row, percent(row.share), percent(share_of_samples(row))) for row in worst]
        suspects = [] if calm else self.suspects[:3]
        return rendered(
            "brief", found=self, said=said_of(self), scale=floor, places=places, suspects=suspects, steps=None
        )


class RefinementPage(Page):
    """Page of a `Refinement`: its last model's."""

    def _answer(self, **known: Any) -> Answer:
        return Answer(refinement=self, **known)

    def _repr_html_(self: Any) -> str:
        return rendered("brief", found=None, steps=_steps(self))
