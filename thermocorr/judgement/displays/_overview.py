"""Small overview figures, made of the displays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._drawing import pyplot
from .refinement import RefinementDisplay
from .suspects import SuspectsDisplay
from .where import WhereDisplay

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..refinement import Refinement


def plot_diagnosis(diagnosis: Diagnosis, X: Any = None) -> Any:
    """Draw suspects above, places of failure below; returns the figure. `X`, the record, tells units of columns."""
    figure = pyplot().figure(figsize=(9.5, 8.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 1.2))
    SuspectsDisplay.from_diagnosis(diagnosis).plot(upper)
    WhereDisplay.from_diagnosis(diagnosis, X).plot(lower)
    unit = f" {diagnosis.unit}" if diagnosis.unit else ""
    figure.suptitle(
        f"Residual {diagnosis.residual_rms:.3g}{unit}, noise floor {diagnosis.noise_floor:.3g}{unit}: "
        f"{diagnosis.explainable:.0%} of the residual variance could still be explained",
        fontsize=11,
    )
    return figure


def plot_refinement(refinement: Refinement) -> Any:
    """Draw the steps above, what is suspected after the last one below; returns the figure."""
    figure = pyplot().figure(figsize=(9.5, 8.0), layout="constrained")
    upper, lower = figure.subplots(2, 1)
    RefinementDisplay.from_refinement(refinement).plot(upper)
    SuspectsDisplay.from_diagnosis(refinement.diagnoses[-1]).plot(lower)
    return figure
