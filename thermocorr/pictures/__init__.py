"""Pictures: each answers one question at a glance. `frame()` has the numbers, `plot()` draws (extra "plot")."""

from .allan_deviation import AllanDisplay
from .budget_shares import BudgetDisplay
from .comparison import VariantsDisplay
from .contributions import ContributionsDisplay, InnerTemperaturesDisplay
from .residual_loop import ResidualLoopDisplay
from .residuals import ResidualsDisplay
from .step_response import StepResponseDisplay
from .suspects import RefinementDisplay, SuspectsDisplay, WhereDisplay, plot_diagnosis, plot_refinement
from .time_constant_spectrum import SpectrumDisplay

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
