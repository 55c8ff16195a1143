"""Learn and remove the thermal bias of precise instruments.

Pictures are in `thermocorr.displays`, checks on data that a model has not seen in `thermocorr.validation`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from . import workbench
    from .judgement import calibration_profile, diagnose, propose, refine
    from .live import OnlineCorrector
    from .model import (
        DiffusiveFeatures,
        DynamicBiasRegressor,
        Sensor,
        Thermometer,
        TimeConstantSearch,
        compare_variants,
    )
    from .output.codec import ModelFileError
    from .output.model_file import load_model, save_model
    from .readers import read_log
    from .records import RecordError, RecordWarning

_ROOMS = {
    "model": (
        "DiffusiveFeatures", "DynamicBiasRegressor", "Sensor", "Thermometer", "TimeConstantSearch", "compare_variants",
    ),
    "output.codec": ("ModelFileError",),
    "output.model_file": ("load_model", "save_model"),
    "judgement": ("calibration_profile", "diagnose", "propose", "refine"),
    "live": ("OnlineCorrector",),
    "readers": ("read_log",),
    "records": ("RecordError", "RecordWarning"),
}  # fmt: skip
"""Room -> public names in it, which are loaded when they are first asked for."""
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}
__all__ = [
    "DiffusiveFeatures", "DynamicBiasRegressor", "ModelFileError", "OnlineCorrector", "RecordError",
    "RecordWarning", "Sensor", "Thermometer", "TimeConstantSearch", "__version__", "calibration_profile",
    "compare_variants", "diagnose", "load_model", "propose", "read_log", "refine", "save_model", "workbench",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in ("displays", "validation", "workbench"):
        return import_module(f".{name}", __name__)
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{_ROOM_OF[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "displays", "validation"})
