"""The chapters after the diagnosis: refinement, variants, formula, data quality, versions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..estimators.variants import VariantComparison
from ..pictures.protocols import RefinementLike
from ..pictures.timeline import time_text
from ..pictures.words import MINUS, each_row
from .data import PageData
from .html import DASH, Safe, Section, bar, decibels, join, number, table, tag, unit_text, with_unit
from .sections import section

LISTED = 200
"""Coefficients listed, and lines of the formula: a record of many segments has decays for each."""
OPEN_ROWS = 20
"""A table of coefficients of more rows is folded at first."""
FLAGS = {
    "washout": "after a start of unknown state: the lags have not forgotten it",
    "outside fitted range": "temperature outside the fitted range: the model extrapolates",
    "no reading": "no reading",
    "no temperature": "no temperature",
}


def steps(refinement: RefinementLike, title: str, *figures: Any) -> Section:
    """The error, step by step."""
    frame = refinement.steps
    unit = refinement.diagnoses[0].unit
    sentence: Any = (
        "Nothing was added: no effect that was tried lowers the error on held-out blocks and on later ones together."
    )
    if len(frame) > 1:
        sentence = join(
            (
                "Held out are blocks of time that the fit did not see; later ones are foretold from all before. ",
                in_short(refinement),
            )
        )
    largest = float(np.nanmax(frame["held_out_rms"]))
    floor = refinement.diagnoses[-1].noise_floor
    rows = [
        (
            str(row.step),
            row.effect or "the model as it was given",
            number(row.held_out_rms),
            bar(row.held_out_rms / largest, floor / largest),
            number(row.later_rms),
            number(row.rms),
            decibels(row.db) if row.step else "",
            row.verdict,
        )
        for row in each_row(frame)
    ]
    head = (
        "step",
        "added",
        with_unit("held-out rms", unit),
        "mark: noise floor",
        with_unit("later rms", unit),
        with_unit("rms of the fit", unit),
        "held out",
        "verdict",
    )
    return section("steps", title, tag("p", sentence), table(head, rows, "llrlrrrl", "steps"), *figures)


def in_short(refinement: RefinementLike) -> Safe:
    """What refinement achieved, in a sentence."""
    first, last = refinement.steps.iloc[0], refinement.steps.iloc[-1]
    unit = refinement.diagnoses[0].unit
    return join(
        (
            "Refinement takes the held-out error from ",
            number(first.held_out_rms, unit),
            " to ",
            number(last.held_out_rms, unit),
            " (",
            decibels(last.db),
            "), the verdict from ",
            tag("strong", first.verdict),
            " to ",
            tag("strong", last.verdict),
            ".",
        )
    )


def variants(comparison: VariantComparison, title: str) -> Section:
    """Static and dynamic, linear and nonlinear: on the fitted record, then on data that the fits did not see."""
    figures, names = comparison.frame(), comparison.formatted().columns
    middle = len(names) // 2
    tables = []
    for chosen in (slice(0, middle), slice(middle, None)):
        rows = [
            (name, *(_variant_cell(column, figures.loc[name, column]) for column in figures.columns[chosen]))
            for name in figures.index[figures.iloc[:, chosen].notna().any(axis=1)]
        ]
        tables.append(table(("variant", *names[chosen]), rows, "l" + "r" * (len(rows[0]) - 1), "variants"))
    return section(
        "variants",
        title,
        tag("p", _variants_sentence(figures)),
        *tables,
        tag("p", comparison.caption(), class_="fine"),
    )


def _variant_cell(column: str, value: float) -> str:
    if np.isnan(value):
        return ""
    return number(value, shown=f"{value:.1f}".replace("-", MINUS) if column.endswith("_db") else None)


def _variants_sentence(figures: pd.DataFrame) -> Any:
    """Static against dynamic in one sentence."""
    held = figures["held_out_reduction_db"].dropna()
    if "static nonlinear" not in held or "dynamic nonlinear" not in held:
        return "Reductions of the error; negative is good."
    words = []
    for name in ("static nonlinear", "dynamic nonlinear"):
        sense = "lowers" if held[name] < 0 else "raises"
        words.append((f"{sense} the error by ", number(held[name], shown=f"{abs(held[name]):.1f} dB")))
    static, dynamic = words
    return join(
        ("On blocks of time that the fit did not see, a static law ", *static, "; the dynamic one ", *dynamic, ".")
    )


def formula(data: PageData, title: str, *figures: Any) -> Section:
    """The model's formula and coefficients."""
    rows = [
        (
            name,
            row.effect,
            number(row.coefficient, digits=6),
            number(row.standard_error, digits=3),
            unit_text(row.unit),
        )
        for name, row in zip(data.coefficients.index[:LISTED], each_row(data.coefficients[:LISTED]), strict=True)
    ]
    count, lines = len(data.coefficients), data.equation.split("\n")
    summary = f"{count} coefficients" + (f", the first {LISTED} of them" if count > LISTED else "")
    shown = lines if len(lines) <= LISTED else [*lines[:LISTED], "    + ... (whole: model.equation())"]
    head = ("column", "effect", "coefficient", "standard error", "unit")
    taus = ", ".join(time_text(tau) for tau in data.time_constants)
    lead = f"Its lags have the time constants {taus}." if taus else "It has no lags."
    return section(
        "model",
        title,
        tag("p", lead, " Standard errors stay true for residuals that are correlated in time."),
        tag("p", "What moves the reading, by this model: the rms of each effect's contribution about its mean."),
        table(
            ("effect", with_unit("rms", data.unit), ""),
            [(name, number(value), bar(value / max(data.shares.max(), 1e-300))) for name, value in data.shares.items()],
            "lrl",
        ),
        *figures,
        tag("pre", tag("code", "\n".join(shown)), class_="tall", tabindex=0),
        tag(
            "details",
            tag("summary", summary),
            table(head, rows, "llrrl", "coefficients"),
            open="open" if len(rows) <= OPEN_ROWS else None,
        ),
        tag("details", tag("summary", "The estimator as code"), tag("pre", tag("code", data.model), class_="tall")),
    )


def quality(data: PageData, title: str) -> Section:
    """What is odd about the data."""
    items: list[Any] = [tag("li", note) for note in data.notes]
    for flag, count in sorted(data.traces.flags.items()):
        if flag:
            items.append(tag("li", f"{count:,} rows flagged “{flag}”: {FLAGS.get(flag, flag)}."))
    outside = data.n_rows - data.traces.n_rows
    if outside:
        items.append(
            tag("li", f"{outside:,} rows lie in no stretch: their temperature, or a needed column, is missing.")
        )
    parts: list[Any] = [tag("p", data.record_sentence())]
    parts.append(tag("ul", *items) if items else tag("p", "Nothing odd was found in the data."))
    if data.n_segments > 1:
        shown = len(data.segments)
        rows = [
            (str(i), run or DASH, first, last, f"{n:,}") for i, (run, first, last, n) in enumerate(data.segments, 1)
        ]
        parts.append(
            tag(
                "details",
                tag(
                    "summary",
                    f"{data.n_segments} stretches" + (f", the first {shown}" if shown < data.n_segments else ""),
                ),
                table(("", "run", "from", "to", "rows"), rows, "llllr"),
            )
        )
    return section("quality", title, *parts)


def provenance(data: PageData, title: str, command: str, source: str) -> Section:
    """How the page came about."""
    rows: list[Sequence[Any]] = list(data.versions)
    parts: list[Any] = []
    if source:
        parts.append(tag("p", "Data: ", tag("code", source)))
    if command:
        parts += [tag("p", "The command that made this page:"), tag("pre", tag("code", command), class_="wrap")]
    return section("versions", title, *parts, table(("package", "version"), rows, "ll"))
