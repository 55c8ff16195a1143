"""Pictures: each answers one question at a glance. `frame()` has the numbers, `plot()` draws (extra "plot")."""

from ._overview import plot_diagnosis, plot_refinement
from .allan import AllanDisplay
from .contributions import ContributionsDisplay
from .refinement import RefinementDisplay
from .residual_loop import ResidualLoopDisplay
from .residuals import ResidualsDisplay
from .spectrum import SpectrumDisplay
from .step_response import StepResponseDisplay
from .suspects import SuspectsDisplay
from .variants import VariantsDisplay
from .where import WhereDisplay

__all__ = [
    "AllanDisplay",
    "ContributionsDisplay",
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
