"""Pictures: each answers one question at a glance. `frame()` has the numbers, `plot()` draws (extra "plot")."""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from .axes import Display
from .diagnosis_displays import (
    ErrorsDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
    plot_diagnosis,
    plot_refinement,
)
from .model_displays import ContributionsDisplay, SpectrumDisplay, StepResponseDisplay
from .residual_displays import AgainstDisplay, AllanDisplay, ResidualsDisplay

__all__ = [
    "AgainstDisplay",
    "AllanDisplay",
    "ContributionsDisplay",
    "ErrorsDisplay",
    "ResidualsDisplay",
    "SpectrumDisplay",
    "StepResponseDisplay",
    "SuspectsDisplay",
    "VariantsDisplay",
    "WhereDisplay",
    "plot_diagnosis",
    "plot_refinement",
]

for _file in iter_modules(__path__):
    import_module(f".{_file.name}", __name__)
_OTHERS = {one.__name__: one for one in Display.__subclasses__() if one.__module__.startswith(f"{__name__}.")}
__all__ += sorted(_OTHERS.keys() - set(__all__))  # a picture is public once its class is here


def __getattr__(name: str) -> Any:
    if name in _OTHERS:
        return _OTHERS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
