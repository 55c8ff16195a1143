"""Thermal bias of precise instruments: learn it from a log, remove it, and find what is still missing."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from .estimators import (
        Budget,
        DiffusiveFeatures,
        DynamicBiasRegressor,
        MergedRidge,
        Sensor,
        Thermometer,
        TimeConstantSearch,
        Uncertainty,
        VariantComparison,
        compare_variants,
        held_out_residuals,
    )
    from .estimators import thermometers as thermometer_errors
    from .files.codec import ModelFileError
    from .files.model_file import load_model, save_model
    from .interactive import workbench
    from .judgement import Diagnosis, Refinement, diagnose, refine
    from .live import OnlineCorrector
    from .pictures import (
        AllanDisplay,
        BudgetDisplay,
        ContributionsDisplay,
        InnerTemperaturesDisplay,
        RefinementDisplay,
        ResidualLoopDisplay,
        ResidualsDisplay,
        SpectrumDisplay,
        StepResponseDisplay,
        SuspectsDisplay,
        VariantsDisplay,
        WhereDisplay,
    )
    from .records import ParquetLog, RecordError, RecordWarning

_ROOMS = {
    "estimators": (
        "Budget", "DiffusiveFeatures", "DynamicBiasRegressor", "MergedRidge", "Sensor",
        "Thermometer", "TimeConstantSearch", "Uncertainty", "VariantComparison", "compare_variants",
        "held_out_residuals", "thermometer_errors",
    ),
    "files.codec": ("ModelFileError",),
    "files.model_file": ("load_model", "save_model"),
    "interactive": ("workbench",),
    "judgement": ("Diagnosis", "Refinement", "diagnose", "refine"),
    "live": ("OnlineCorrector",),
    "pictures": (
        "AllanDisplay", "BudgetDisplay", "ContributionsDisplay", "InnerTemperaturesDisplay",
        "RefinementDisplay", "ResidualLoopDisplay",
        "ResidualsDisplay", "SpectrumDisplay", "StepResponseDisplay", "SuspectsDisplay", "VariantsDisplay",
        "WhereDisplay",
    ),
    "records": ("ParquetLog", "RecordError", "RecordWarning"),
}  # fmt: skip
"""Room -> public names in it, which are loaded when they are first asked for."""
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}
__all__ = [
    "AllanDisplay",
    "Budget",
    "BudgetDisplay",
    "ContributionsDisplay",
    "Diagnosis",
    "DiffusiveFeatures",
    "DynamicBiasRegressor",
    "InnerTemperaturesDisplay",
    "MergedRidge",
    "ModelFileError",
    "OnlineCorrector",
    "ParquetLog",
    "RecordError",
    "RecordWarning",
    "Refinement",
    "RefinementDisplay",
    "ResidualLoopDisplay",
    "ResidualsDisplay",
    "Sensor",
    "SpectrumDisplay",
    "StepResponseDisplay",
    "SuspectsDisplay",
    "Thermometer",
    "TimeConstantSearch",
    "Uncertainty",
    "VariantComparison",
    "VariantsDisplay",
    "WhereDisplay",
    "__version__",
    "compare_variants",
    "diagnose",
    "held_out_residuals",
    "load_model",
    "refine",
    "save_model",
    "thermometer_errors",
    "workbench",
]


def __getattr__(name: str) -> Any:
    room = _ROOM_OF.get(name, "pictures" if name.endswith("Display") else None)
    if room is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{room}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
