"""Pictures: each answers one question at a glance. `frame()` has the numbers, `plot()` draws (extra "plot")."""

from .diagnosis_displays import (
    RefinementDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
    plot_diagnosis,
    plot_refinement,
)
from .model_displays import (
    BudgetDisplay,
    ContributionsDisplay,
    InnerTemperaturesDisplay,
    SpectrumDisplay,
    StepResponseDisplay,
)
from .residual_displays import AllanDisplay, ResidualLoopDisplay, ResidualsDisplay

__all__ = [
    "AllanDisplay",
    "BudgetDisplay",
    "ContributionsDisplay",
    "InnerTemperaturesDisplay",
    "RefinementDisplay",
    "ResidualLoopDisplay",
    "ResidualsDisplay",
    "SpectrumDisplay",
    "StepResponseDisplay",
    "SuspectsDisplay",
    "VariantsDisplay",
    "WhereDisplay",
    "plot_diagnosis",
    "plot_refinement",
]
