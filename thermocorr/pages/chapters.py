"""The chapters after the diagnosis: refinement, variants, formula, data quality, versions."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from ..estimators.variants import VariantComparison
from ..pictures.protocols import RefinementLike
from ..pictures.words import MINUS, each_row
from ..records.errors import quoted
from ..records.quantities import Scale, scale_of
from .data import PageData
from .html import Section, number, rendered, section, unit_text

LISTED = 200
"""Coefficients listed, and lines of the formula: a record of many segments has decays for each."""
OPEN_ROWS = 20
"""A table of coefficients of more rows is folded at first."""
FEWEST_DIGITS, MOST_DIGITS = 6, 15
"""Digits of a coefficient."""
FLAGS = {
    "washout": "after a start of unknown state: the lags have not forgotten it",
    "outside fitted range": "temperature outside the fitted range: the model extrapolates",
    "no reading": "no reading",
    "no temperature": "no temperature, or a column that the model needs is missing",
    "filled": "a missing cell is filled: the reading is corrected by an estimate",
    "thermometer lost": "a thermometer was lost for long, and what its estimate may be wrong by exceeds the noise",
    "behind gap": "nobody recorded the temperature for a while, and what it may have done then exceeds the noise",
    "sentinel": "a code for no value",
    "spike": "an isolated spike",
    "other unit": "the temperature looks like kelvin where degC was fitted, or the other way round",
}


def steps(refinement: RefinementLike, title: str, figures: Markup) -> Section:
    """The error, step by step."""
    rows = list(each_row(refinement.steps))
    return section(
        "steps",
        title,
        rows=rows,
        in_short=in_short(refinement),
        largest=float(np.nanmax(refinement.steps["held_out_rms"])),
        floor=refinement.diagnoses[-1].noise_floor,
        scale=steps_scale(refinement),
        figures=figures,
    )


def in_short(refinement: RefinementLike) -> Markup:
    """What refinement achieved, in a sentence."""
    table, unit = refinement.steps, refinement.diagnoses[0].unit
    scale = steps_scale(refinement)
    return rendered("in_short", first=table.iloc[0], last=table.iloc[-1], unit=unit, scale=scale)


def steps_scale(refinement: RefinementLike) -> Scale:
    """The unit for the errors of all steps."""
    return scale_of(refinement.steps[["held_out_rms", "later_rms", "rms"]], refinement.diagnoses[0].unit)


def variants(comparison: VariantComparison, title: str) -> Section:
    """Static and dynamic, linear and nonlinear: on the fitted record, then on data that the fits did not see."""
    figures, names, scale = comparison.frame(), comparison.formatted().columns, comparison.scale()
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
        open=count <= OPEN_ROWS,
        figures=figures,
    )


def digits_down_to(error: float, value: float) -> int:
    """Digits of a value, down to the second one of its error; six at least, and no more than a number has."""
    if not (0 < error < np.inf and 0 < abs(value) < np.inf):
        return FEWEST_DIGITS
    return int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(error)) + 2, FEWEST_DIGITS, MOST_DIGITS))


def quality(data: PageData, title: str) -> Section:
    """What is odd about the data."""
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
    """How the page came about."""
    return section("versions", title, versions=list(data.versions), command=command, source=source)
