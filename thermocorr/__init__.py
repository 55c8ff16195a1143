"""Thermal bias of precise instruments: learn it from a log, remove it, and find what is still missing."""

from .estimators import (
    DiffusiveFeatures,
    DynamicBiasRegressor,
    MergedRidge,
    TimeConstantSearch,
    VariantComparison,
    compare_variants,
    held_out_residuals,
)
from .judgement import (
    AllanDisplay,
    ContributionsDisplay,
    Diagnosis,
    Refinement,
    RefinementDisplay,
    ResidualLoopDisplay,
    ResidualsDisplay,
    SpectrumDisplay,
    StepResponseDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
    diagnose,
    refine,
)
from .records import ParquetLog, RecordError, RecordWarning

__version__ = "0.1.0"
__all__ = [
    "AllanDisplay",
    "ContributionsDisplay",
    "Diagnosis",
    "DiffusiveFeatures",
    "DynamicBiasRegressor",
    "MergedRidge",
    "ParquetLog",
    "RecordError",
    "RecordWarning",
    "Refinement",
    "RefinementDisplay",
    "ResidualLoopDisplay",
    "ResidualsDisplay",
    "SpectrumDisplay",
    "StepResponseDisplay",
    "SuspectsDisplay",
    "TimeConstantSearch",
    "VariantComparison",
    "VariantsDisplay",
    "WhereDisplay",
    "compare_variants",
    "diagnose",
    "held_out_residuals",
    "refine",
]
