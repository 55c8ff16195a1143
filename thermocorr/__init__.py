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
from .outside.codec import ModelFileError
from .outside.model_file import load_model, save_model
from .outside.online import OnlineCorrector
from .records import ParquetLog, RecordError, RecordWarning

__version__ = "0.1.0"
__all__ = [
    "Diagnosis",
    "DiffusiveFeatures",
    "DynamicBiasRegressor",
    "MergedRidge",
    "ModelFileError",
    "OnlineCorrector",
    "ParquetLog",
    "RecordError",
    "RecordWarning",
    "Refinement",
    "TimeConstantSearch",
    "VariantComparison",
    "compare_variants",
    "diagnose",
    "held_out_residuals",
    "load_model",
    "refine",
    "save_model",
]
