"""Floor 2: effects, the physical causes that move a reading."""

from .covariates import Covariate, LaggedCovariate
from .protocol import Effect
from .thermal import InitialTransient, LagProducts, StaticPolynomial, ThermalLag
from .wrap import TransformerEffect

__all__ = [
    "Covariate",
    "Effect",
    "InitialTransient",
    "LagProducts",
    "LaggedCovariate",
    "StaticPolynomial",
    "ThermalLag",
    "TransformerEffect",
]
