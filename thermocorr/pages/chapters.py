"""Chapters of a page and their sections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup

from ..displays.words import MINUS, each_row, effect_text, left_sentences, share_of_samples, small_sentence
from ..effects.protocol import SINCE_START, TEMPERATURE, TEMPERATURE_DIFFERENCE
from ..estimators.tables import VERDICTS
from ..estimators.variants import VariantComparison
from ..records.errors import quoted
from ..records.numbers import Scale, scale_of, span_text, unit_text
from ..records.units import difference_unit
from .answer import Answer
from .charts import still
from .data import PageData
from .figures import placed
from .html import Section, decibels, failing_text, number, percent, plain, probability, rendered, section, with_signs

SHOWN = 3
"""Places and suspects listed."""


def brief_diagnosis(found: Any) -> str:
    """Verdict, residual, first places and suspects."""
    calm = VERDICTS[found.verdict].calm
    worst = each_row(found.where.head(SHOWN))
    places = [(failing_text(row), percent(row.share), percent(share_of_samples(row))) for row in worst if row.share > 0]
    suspects = [
        (effect_text(row.effect), percent(row.share), decibels(row.later_db), probability(row.p_value))
        for row in found.suspects[:SHOWN]
    ]
    return rendered(
        "brief_diagnosis",
        found=found,
        scale=scale_of((found.residual_rms, found.noise_floor), found.unit),
        said=VERDICTS[found.verdict].sentence,
        drawn=_residual(found),
        places=[] if calm else places,
        suspects=[] if calm else suspects,
    )


def brief_refinement(refinement: Any) -> str:
    """The steps, and the last residual."""
    last, scale = refinement.diagnoses[-1], steps_scale(refinement)
    rows = [
        (
            f"{row.step} {row.effect or 'as given'}",
            number(row.later_rms, scale=scale),
            number(row.held_out_rms, scale=scale),
            number(row.rms, scale=scale),
            decibels(row.db) if row.step else "",
            row.verdict,
        )
        for row in each_row(refinement.steps)
    ]
    return rendered("brief_refinement", rows=rows, scale=scale, drawn=_residual(last))


def _residual(found: Any) -> Markup:
    """The residual over time, empty where a diagnosis holds no data."""
    if found.data is None:
        return Markup("")
    return still(found.data.traces.columns["residual"], 2 * found.noise_floor)


HELPS = "One effect lowers the error on data that it was not learned from; that it is the cause is not proven."


def which(answer: Answer, title: str) -> Section:
    """The corrections, each with its error on later data as a bar, and what was or is missing."""
    advice = answer.advised
    errors = {} if advice is None or advice.table.empty else advice.table["all"].to_dict()
    shown = answer.advised.variant if answer.advised is not None else ""
    return section(
        "which",
        title,
        rows=[(name, size, bool(shown) and name == shown) for name, size in errors.items()],
        largest=max(errors.values(), default=1.0) or 1.0,
        scale=answer.scale(),
        causes=answer.causes,
    )


def anything(found: Any, title: str, figures: Markup) -> Section:
    """The residual against the noise floor."""
    named = "" if found.best is None else effect_text(found.best)
    helps = bool(named) and found.suspects[0].standing == "helps"
    scale = scale_of((found.residual_rms, found.noise_floor), found.unit)
    return section(
        "anything",
        title,
        found=found,
        named=named,
        calm=VERDICTS[found.verdict].calm,
        said=HELPS if helps else VERDICTS[found.verdict].sentence,
        left=with_signs(" ".join(left_sentences(found.left, scale, found.verdict))),
        scale=scale,
        largest=max(found.residual_rms, found.noise_floor) or 1.0,
        figures=figures,
    )


class WherePlace(NamedTuple):
    """A row of `Diagnosis.where` with what its bar and its button need."""

    row: Any
    scale: float
    """Share of the error that fills the bar."""
    stretch: tuple[float, float] | None
    """Where it stands on the axis of time; None for what is no single stretch of it."""


def where(found: Any, title: str, data: PageData, figures: Markup) -> Section:
    """Section on where the model fails; the worst place in words."""
    table, calm = found.where, VERDICTS[found.verdict].calm
    # Places of failure in the first table; the rest is folded
    shown = 0 if calm else 8
    longest = float(max(table["share"].max(), 1e-300)) if len(table) else 1.0
    rows = [
        WherePlace(row, longest, placed(data, row.low, row.high) if row.aspect == "time" else None)
        for row in each_row(table)
    ]
    return section(
        "where",
        title,
        worst=rows[0].row if rows else None,
        calm=calm,
        shown=rows[:shown],
        folded=rows[shown:],
        scale=scale_of(table["rms"], found.unit),
        figures=figures,
    )


def what(found: Any, title: str, data: PageData) -> Section:
    """The causes, what lowers the error on later data most first, and the other suspects as they are ranked."""
    return section(
        "what",
        title,
        suspects=[(suspect, parameters_text(suspect.effect, data)) for suspect in found.suspects],
        physics=by_kind([suspect.effect for suspect in (found.causes or found.suspects)[:3]]),
        calm=VERDICTS[found.verdict].calm,
        unexplained=VERDICTS[found.verdict].unknown,
        small=small_sentence(found),
        level=f"{found.level:g}",
    )


def cure(found: Any, title: str) -> Section:
    """The effect ready to be added, and the measurement that would confirm it or part rivals."""
    rivals = () if found.best is None else (found.best, *(found.suspects[0].confusable_with if found.suspects else ()))
    return section(
        "cure",
        title,
        code="" if found.best is None else repr(found.best),
        checks=by_kind(rivals),
        calm=VERDICTS[found.verdict].calm,
    )


class Scales(NamedTuple):
    """Scales for the parameters of effects."""

    start: float | None
    """Seconds since 1970 of the first row; None for a record without dates."""
    temperature_unit: str


def parameters_text(effect: Any, data: PageData | Scales, said: Callable[[str], str] = unit_text) -> str:
    """Parameters that have a unit, in words; moments of a record with dates as dates. `said` writes a unit."""
    parts = []
    for name, unit in (effect.info.parameters if effect.info is not None else {}).items():
        value = getattr(effect, name)
        several = value if isinstance(value, list | tuple | np.ndarray) else [value]
        try:
            numbers = [float(item) for item in several]
        except (TypeError, ValueError):
            continue
        if not numbers:
            continue
        if unit == SINCE_START and data.start is not None:
            shown = [str(pd.Timestamp(data.start + number, unit="s").round("s")) for number in numbers]
        elif unit in ("s", SINCE_START):
            shown = [span_text(number) for number in numbers]
        else:
            degrees = {
                TEMPERATURE: data.temperature_unit,
                TEMPERATURE_DIFFERENCE: difference_unit(data.temperature_unit),
            }
            unit = said(degrees.get(unit, unit))
            shown = [f"{plain(v, 3)} {unit}" for v in numbers]
        parts.append(f"{name.replace('_', ' ').removesuffix('s' if len(several) == 1 else '')} {', '.join(shown)}")
    return "; ".join(parts)


def by_kind(effects: Sequence[Any]) -> list[Any]:
    """The first effect of each kind that says what it is."""
    said: dict[str, Any] = {}
    for effect in effects:
        if effect.info is not None:
            said.setdefault(effect.kind, effect)
    return list(said.values())


LISTED = 200
"""Coefficients listed, and lines of the formula: a record of many segments has decays for each."""
FEWEST_DIGITS, MOST_DIGITS = 6, 15
"""Digits of a coefficient."""
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
    "other unit": "the temperature looks like kelvin where degC was fitted, or the other way round",
}


def steps(refinement: Any, title: str, figures: Markup) -> Section:
    """The error, step by step."""
    rows = list(each_row(refinement.steps))
    return section(
        "steps",
        title,
        rows=rows,
        in_short=in_short(refinement),
        largest=float(np.nanmax(refinement.steps["later_rms"])),
        floor=refinement.diagnoses[-1].noise_floor,
        scale=steps_scale(refinement),
        figures=figures,
    )


def in_short(refinement: Any) -> Markup:
    """Sentence on what refinement achieved."""
    table, unit = refinement.steps, refinement.diagnoses[0].unit
    scale = steps_scale(refinement)
    return rendered("in_short", first=table.iloc[0], last=table.iloc[-1], unit=unit, scale=scale)


def steps_scale(refinement: Any) -> Scale:
    """The unit for the errors of all steps."""
    return scale_of(refinement.steps[["held_out_rms", "later_rms", "rms"]], refinement.diagnoses[0].unit)


def variants(comparison: VariantComparison, title: str) -> Section:
    """Static and dynamic, linear and nonlinear: on the fitted record, then on data that the fits did not see."""
    names, scale = comparison.formatted().columns, comparison.scale()
    figures = comparison.frame().iloc[:, : len(names)]  # without those of the noise, which have other units
    middle = len(names) // 2
    tables = []
    for chosen in (slice(0, middle), slice(middle, None)):
        rows = [
            (name, [_variant_cell(column, figures.loc[name, column], scale) for column in figures.columns[chosen]])
            for name in figures.index[figures.iloc[:, chosen].notna().any(axis=1)]
        ]
        tables.append((("variant", *names[chosen]), rows))
    both = figures.reindex(["static nonlinear", "dynamic nonlinear"])[["held_out_rms", "held_out_reduction_db"]]
    return section(
        "variants",
        title,
        left=both["held_out_rms"].tolist() if both["held_out_rms"].notna().all() else [],
        lowered=both["held_out_reduction_db"].tolist() if np.isfinite(both["held_out_reduction_db"]).all() else [],
        scale=scale,
        unit=comparison.unit,
        tables=tables,
        caption=comparison.caption(unit_text(scale.unit)),
    )


def _variant_cell(column: str, value: float, scale: Scale) -> str:
    if np.isnan(value):
        return ""
    if column.endswith("_db"):
        return number(value, shown=f"{value:.1f}".replace("-", MINUS))
    return number(value, scale=scale)


def formula(data: PageData, title: str, figures: Markup) -> Section:
    """The model's formula and coefficients."""
    count, lines = len(data.coefficients), data.equation.split("\n")
    shown = lines if len(lines) <= LISTED else [*lines[:LISTED], "    + ... (whole: model.equation())"]
    # A table of coefficients of more rows is folded at first
    return section(
        "model",
        title,
        data=data,
        lags=[(name, taus) for name, taus in data.thermometers if taus],
        largest=max(data.shares.max(), 1e-300),
        moves=scale_of(data.shares, data.unit),
        unsure=scale_of([value for _, value in data.uncertainties], data.unit),
        equation="\n".join(shown),
        summary=f"{count} coefficients" + (f", the first {LISTED} of them" if count > LISTED else ""),
        coefficients=[
            (row, scale_of([row.coefficient], row.unit), digits_down_to(row.standard_error, row.coefficient))
            for row in each_row(data.coefficients[:LISTED])
        ],
        open=count <= 20,
        figures=figures,
    )


def digits_down_to(error: float, value: float) -> int:
    """Digits of a value, down to the second one of its error; six at least, and no more than a number has."""
    if not (0 < error < np.inf and 0 < abs(value) < np.inf):
        return FEWEST_DIGITS
    return int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(error)) + 2, FEWEST_DIGITS, MOST_DIGITS))


def quality(data: PageData, title: str) -> Section:
    """Section on problems of the data."""
    remarks: list[Any] = list(data.notes)
    for flag, count in sorted(data.traces.flags.items()):
        if flag:
            remarks.append(f"{count:,} rows flagged “{flag}”: {FLAGS.get(flag, flag)}.")
    outside = data.n_rows - data.traces.n_rows
    if outside:
        remarks.append(f"{outside:,} rows lie in no stretch: their temperature, or a needed column, is missing.")
    assumed = (
        ""
        if data.unit_named
        else (
            f"The data name no unit of {quoted(data.temperature)}: its values were taken for "
            f"{unit_text(data.temperature_unit)} by their size. If that is wrong, name it, as in "
            f"{quoted(data.temperature + ' [°F]')}."
        )
    )
    return section("quality", title, data=data, remarks=remarks, assumed=assumed)


def provenance(data: PageData, title: str, command: str, source: str) -> Section:
    """Section on the data, the command and the versions."""
    return section("versions", title, versions=list(data.versions), command=command, source=source)
