"""What the fitted reading and temperature looked like, as JSON and back."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..estimators.reading import Reading, unit_by_size
from .codec import fields, integer, items, number, text, unexpected

_READING = tuple(name for name in Reading.__dataclass_fields__ if name != "unit_named")


def pack_reading(reading: Reading) -> dict[str, Any]:
    """Names, units and ranges; a unit that the record did not name is none."""
    unit = reading.temperature_unit if reading.unit_named else ""
    node = {**asdict(reading), "temperature_unit": unit, "temperature_range": list(reading.temperature_range)}
    return {name: node[name] for name in _READING}


def unpack_reading(node: Any, where: str) -> Reading:
    """Names, units and ranges, checked."""
    node = fields(node, where, _READING)
    low, high = (
        number(value, f"{where}.temperature_range[{i}]")
        for i, value in enumerate(items(node["temperature_range"], f"{where}.temperature_range", 2))
    )
    if low > high:
        raise unexpected(f"{where}.temperature_range", f"{low} above {high}", "the lower one first")
    unit = text(node["temperature_unit"], f"{where}.temperature_unit")
    return Reading(
        name=text(node["name"], f"{where}.name"),
        unit=text(node["unit"], f"{where}.unit"),
        temperature_unit=unit or unit_by_size(low),
        unit_named=bool(unit),
        n_readings=integer(node["n_readings"], f"{where}.n_readings", 1),
        mean=number(node["mean"], f"{where}.mean"),
        std=number(node["std"], f"{where}.std", 0.0),
        temperature_range=(low, high),
    )
