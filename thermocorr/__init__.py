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
from .judgement import Diagnosis, Refinement, diagnose, refine
from .records import ParquetLog, RecordError, RecordWarning

__version__ = "0.1.0"
__all__ = [
    "Diagnosis",
    "DiffusiveFeatures",
    "DynamicBiasRegressor",
    "MergedRidge",
    "ParquetLog",
    "RecordError",
    "RecordWarning",
    "Refinement",
    "TimeConstantSearch",
    "VariantComparison",
    "compare_variants",
    "diagnose",
    "held_out_residuals",
    "refine",
]
