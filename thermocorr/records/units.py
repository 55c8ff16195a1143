"""Units of columns: from the data's own notes, or from the ends of column names."""

from __future__ import annotations

from typing import Any

_SUFFIXES = {
    "degC": "degC", "degF": "degF", "K": "K", "C": "degC", "ohm": "ohm", "kohm": "kohm", "V": "V", "mV": "mV",
    "uV": "uV", "nV": "nV", "A": "A", "mA": "mA", "uA": "uA", "ppm": "ppm", "ppb": "ppb", "pct": "%", "percent": "%",
    "hPa": "hPa", "Pa": "Pa", "kPa": "kPa", "mbar": "mbar", "Hz": "Hz", "kHz": "kHz", "MHz": "MHz", "m": "m",
    "mm": "mm", "um": "um", "cm": "cm", "kg": "kg", "g": "g", "mg": "mg", "N": "N", "W": "W", "mW": "mW",
    "urad": "urad", "mrad": "mrad", "rad": "rad", "deg": "deg", "ustrain": "ustrain", "s": "s", "A2": "A^2",
    "m3m3": "m3/m3",
}  # fmt: skip


def difference_unit(unit: str) -> str:
    """Unit of a difference of temperatures in `unit`: K, but degF for degF."""
    return "degF" if unit == "degF" else "K"


def unit_of(name: object, data: Any) -> str:
    """Unit of a column: ``data.attrs["units"][name]``, else the end of its name ("oven_temp_degC"), else ""."""
    noted = getattr(data, "attrs", {}).get("units", {})
    if isinstance(noted, dict) and name in noted:
        return str(noted[name])
    text = str(name)
    return _SUFFIXES.get(text.rsplit("_", 1)[-1], "") if "_" in text else ""
