"""Small overview figures, made of the displays."""

from __future__ import annotations

from typing import Any

from ..records.numbers import quantity_texts
from .axes import pyplot
from .places import WhereDisplay
from .protocols import DiagnosisLike, RefinementLike
from .steps import RefinementDisplay
from .suspects import SuspectsDisplay


def plot_diagnosis(diagnosis: DiagnosisLike, X: Any = None) -> Any:
    """Draw suspects above, places of failure below; returns the figure. `X`, the record, tells units of columns."""
    figure = pyplot().figure(figsize=(9.5, 8.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 1.2))
    SuspectsDisplay.from_diagnosis(diagnosis).plot(upper)
    WhereDisplay.from_diagnosis(diagnosis, X).plot(lower)
    residual, floor = quantity_texts((diagnosis.residual_rms, diagnosis.noise_floor), diagnosis.unit)
    figure.suptitle(
        f"Residual {residual}, noise floor {floor}: "
        f"{diagnosis.explainable:.0%} of the residual variance could still be explained",
        fontsize=11,
    )
    return figure


def plot_refinement(refinement: RefinementLike) -> Any:
    """Draw the steps above, what is suspected after the last one below; returns the figure."""
    figure = pyplot().figure(figsize=(9.5, 8.0), layout="constrained")
    upper, lower = figure.subplots(2, 1)
    RefinementDisplay.from_refinement(refinement).plot(upper)
    SuspectsDisplay.from_diagnosis(refinement.diagnoses[-1]).plot(lower)
    return figure
