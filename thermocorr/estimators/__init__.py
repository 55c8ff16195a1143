"""Floor 3: estimators in scikit-learn's manner."""

from .features import DiffusiveFeatures
from .regressor import DynamicBiasRegressor
from .ridge import MergedRidge

__all__ = ["DiffusiveFeatures", "DynamicBiasRegressor", "MergedRidge"]
