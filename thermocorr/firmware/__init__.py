"""Export of a fitted model to C99 for microcontrollers, or to any `Language`."""

from .costs import FirmwareExport
from .export import export_c

__all__ = ["FirmwareExport", "export_c"]
