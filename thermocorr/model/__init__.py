"""Estimators: features, regressor, search, comparison."""

from .advice import Advice
from .budget import Budget, Uncertainty
from .features import DiffusiveFeatures
from .fitting import MergedRidge
from .out_of_sample import held_out_residuals
from .regressor import DynamicBiasRegressor
from .thermometers import Thermometer, thermometer_errors
from .time_constant_search import TimeConstantSearch
from .uncertainty import Sensor
from .variants import VariantComparison, compare_variants

__all__ = [
    "Advice",
    "Budget",
    "DiffusiveFeatures",
    "DynamicBiasRegressor",
    "MergedRidge",
    "Sensor",
    "Thermometer",
    "TimeConstantSearch",
    "Uncertainty",
    "VariantComparison",
    "compare_variants",
    "held_out_residuals",
    "thermometer_errors",
]
