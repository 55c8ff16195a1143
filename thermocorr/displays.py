"""Pictures: `frame()` has the numbers, `plot()` draws (extra "plot")."""

from .output.diagnosis_displays import (
    ErrorsDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
    plot_diagnosis,
    plot_refinement,
)
from .output.model_displays import ContributionsDisplay, SpectrumDisplay, StepResponseDisplay
from .output.residual_displays import AgainstDisplay, AllanDisplay, ResidualsDisplay

__all__ = [
    "AgainstDisplay", "AllanDisplay", "ContributionsDisplay", "ErrorsDisplay", "ResidualsDisplay", "SpectrumDisplay",
    "StepResponseDisplay", "SuspectsDisplay", "VariantsDisplay", "WhereDisplay", "plot_diagnosis", "plot_refinement",
]  # fmt: skip
