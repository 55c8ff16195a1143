"""A diagnosis or a refinement in short, for notebooks: no script, colours that suit a light and a dark ground."""

from __future__ import annotations

from markupsafe import Markup

from ..estimators.verdicts import VERDICTS
from ..pictures.protocols import DiagnosisLike, RefinementLike
from ..pictures.words import each_row, effect_text, share_of_samples
from ..records.quantities import scale_of
from .chapters import steps_scale
from .charts import still
from .html import decibels, failing_text, number, percent, probability, rendered

SHOWN = 3
"""Places and suspects listed."""


def brief_diagnosis(found: DiagnosisLike) -> str:
    """Verdict, residual, first places and suspects."""
    calm = VERDICTS[found.verdict].calm
    worst = each_row(found.where.head(SHOWN))
    places = [(failing_text(row), percent(row.share), percent(share_of_samples(row))) for row in worst if row.share > 0]
    suspects = [
        (effect_text(row.effect), percent(row.share), decibels(row.gain_db), probability(row.p_value))
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


def brief_refinement(refinement: RefinementLike) -> str:
    """The steps, and the last residual."""
    last, scale = refinement.diagnoses[-1], steps_scale(refinement)
    rows = [
        (
            f"{row.step} {row.effect or 'as given'}",
            number(row.held_out_rms, scale=scale),
            number(row.later_rms, scale=scale),
            number(row.rms, scale=scale),
            decibels(row.db) if row.step else "",
            row.verdict,
        )
        for row in each_row(refinement.steps)
    ]
    return rendered("brief_refinement", rows=rows, scale=scale, drawn=_residual(last))


def _residual(found: DiagnosisLike) -> Markup:
    """The residual over time, empty where a diagnosis holds no data."""
    if found.data is None:
        return Markup("")
    return still(found.data.traces.columns["residual"], 2 * found.noise_floor)
