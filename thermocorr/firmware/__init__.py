"""Export of a fitted model to C99 for microcontrollers, or to any `Language`."""

from .export import export_c
from .finished import FirmwareExport

__all__ = ["FirmwareExport", "export_c"]
