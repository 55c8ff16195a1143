"""A fitted model as C99, for a microcontroller."""

from .export import FirmwareExport, export_c

__all__ = ["FirmwareExport", "export_c"]
