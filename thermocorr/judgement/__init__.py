"""Floor 4: judgement: what is missing in a model, where it fails, its refinement, and pictures of all that."""

from .diagnosis import Diagnosis, diagnose
from .displays import (
    AllanDisplay,
    ContributionsDisplay,
    RefinementDisplay,
    ResidualLoopDisplay,
    ResidualsDisplay,
    SpectrumDisplay,
    StepResponseDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
)
from .refinement import Refinement, refine

__all__ = [
    "AllanDisplay",
    "ContributionsDisplay",
    "Diagnosis",
    "Refinement",
    "RefinementDisplay",
    "ResidualLoopDisplay",
    "ResidualsDisplay",
    "SpectrumDisplay",
    "StepResponseDisplay",
    "SuspectsDisplay",
    "VariantsDisplay",
    "WhereDisplay",
    "diagnose",
    "refine",
]
