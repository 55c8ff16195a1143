"""A diagnosis or a refinement in short, for notebooks: no script, colours that suit a light and a dark ground."""

from __future__ import annotations

from typing import Any

from ..pictures.protocols import DiagnosisLike, RefinementLike
from ..pictures.words import each_row, effect_text, place_text
from .charts import still
from .html import Safe, decibels, join, number, percent, probability, tag, with_unit
from .sections import VERDICTS

SHOWN = 3
"""Places and suspects listed."""
_CELL = "padding:.15em .8em .15em 0;border:0;background:none;vertical-align:baseline;color:inherit"


def brief_diagnosis(found: DiagnosisLike) -> str:
    """Verdict, residual, first places and suspects."""
    parts = [
        tag("div", tag("strong", found.verdict), ". ", VERDICTS.get(found.verdict, "")),
        tag(
            "div",
            "Residual ",
            number(found.residual_rms, found.unit),
            ", noise floor ",
            number(found.noise_floor, found.unit),
            ": ",
            percent(found.explainable),
            " of the residual's variance could still be explained.",
        ),
    ]
    parts += _over_time(found, "Residual")
    if found.verdict != "nothing missing":
        rows: list[tuple[Any, ...]] = [
            (place_text(row), percent(row.share), percent(row.share / row.lift))
            for row in each_row(found.where.head(SHOWN))
        ]
        parts.append(_table(("fails most", "of the error", "of the samples"), rows))
        rows = [
            (effect_text(row.effect), percent(row.share), decibels(row.gain_db), probability(row.p_value))
            for row in found.suspects[:SHOWN]
        ]
        parts.append(_table(("suspect", "explains", "held-out gain", "error probability"), rows))
    if found.best is not None and found.best.info is not None:
        parts.append(tag("div", "On the bench: ", found.best.info.bench_check))
    return _box(parts)


def brief_refinement(refinement: RefinementLike) -> str:
    """The steps, and the last residual."""
    last = refinement.diagnoses[-1]
    rows = [
        (
            f"{row.step} {row.effect or 'as given'}",
            number(row.held_out_rms),
            number(row.later_rms),
            number(row.rms),
            decibels(row.db) if row.step else "",
            row.verdict,
        )
        for row in each_row(refinement.steps)
    ]
    errors = [with_unit(name, last.unit) for name in ("held-out rms", "later rms", "rms of the fit")]
    head = ("step", *errors, "held out", "verdict")
    return _box([_table(head, rows), *_over_time(last, "Residual of the last model")])


def _over_time(found: DiagnosisLike, name: str) -> list[Safe]:
    if found.data is None:
        return []
    return [
        tag("div", f"{name} over time; dashed: twice the noise floor.", style="opacity:.75;margin-top:.5em"),
        still(found.data.traces.columns["residual"], 2 * found.noise_floor),
    ]


def _table(head: tuple[Any, ...], rows: list[tuple[Any, ...]]) -> Safe:
    if not rows:
        return Safe("")
    sides = ["left", *["right"] * (len(head) - 1)]
    lines = [
        tag("tr", *(tag(kind, cell, style=f"{_CELL};text-align:{s}") for cell, s in zip(line, sides, strict=True)))
        for kind, line in (("th", head), *(("td", row) for row in rows))
    ]
    return tag(
        "table", *lines, style="border-collapse:collapse;margin:.5em 0;background:none;color:inherit;font-size:inherit"
    )


def _box(parts: list[Any]) -> str:
    return str(tag("div", join(parts), class_="thermocorr", style="color:inherit;max-width:52em;overflow-x:auto"))
