"""Floor 2: effects, the physical causes that move a reading."""

from .catalogue import CATALOGUE
from .covariates import Covariate, Interaction, LaggedCovariate
from .disturbance import Disturbance
from .events import Events
from .hinge import Hinge
from .hysteresis import Hysteresis
from .lead import Lead
from .modulation import LaggedModulation
from .periodic import Periodic
from .products import LagProducts
from .protocol import Effect, EffectInfo
from .rates import Delay, Rate
from .sensitivity_step import SensitivityStep
from .several_steps import SeveralSteps
from .signals import Signals
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
    "Rate",
    "SensitivityDrift",
    "SensitivityStep",
    "SeveralSteps",
    "Signals",
    "StaticPolynomial",
    "Step",
    "ThermalLag",
    "TransformerEffect",
]

for _effect in CATALOGUE.values():  # a kind is public once its file is here
    globals()[_effect.__name__] = _effect
    __all__ += [] if _effect.__name__ in __all__ else [_effect.__name__]
