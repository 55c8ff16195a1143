"""Effects: physical causes that move a reading."""

from typing import Any

from .catalogue import CATALOGUE
from .covariates import (
    Covariate,
    Interaction,
    LaggedCovariate,
    LaggedModulation,
    QuadraticCovariate,
    SaturatingCovariate,
)
from .hinge import Hinge
from .hysteresis import Hysteresis
from .periodic import Periodic
from .products import LagProducts
from .protocol import Effect, EffectInfo
from .rates import Delay, Lead, Rate
from .signals import Signals
from .steps import Disturbance, Events, SensitivityStep, SeveralSteps
from .thermal import StaticPolynomial, ThermalLag
from .time import Drift, LogAgeing, SensitivityDrift, Step
from .transient import InitialTransient
from .wrap import TransformerEffect

__all__ = [
    "CATALOGUE",
    "Covariate",
    "Delay",
    "Disturbance",
    "Drift",
    "Effect",
    "EffectInfo",
    "Events",
    "Hinge",
    "Hysteresis",
    "InitialTransient",
    "Interaction",
    "LagProducts",
    "LaggedCovariate",
    "LaggedModulation",
    "Lead",
    "LogAgeing",
    "Periodic",
    "QuadraticCovariate",
    "Rate",
    "SaturatingCovariate",
    "SensitivityDrift",
    "SensitivityStep",
    "SeveralSteps",
    "Signals",
    "StaticPolynomial",
    "Step",
    "ThermalLag",
    "TransformerEffect",
]

_OTHERS = {effect.__name__: effect for effect in CATALOGUE.values() if effect.__name__ not in __all__}
__all__ += sorted(_OTHERS)  # a kind is public once its file is here


def __getattr__(name: str) -> Any:
    if name in _OTHERS:
        return _OTHERS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
