"""Units of columns, by attribute or name."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np

from .numbers import prefix_and_unit
from .record import Record

_SUFFIXES = {
    "degC": "degC", "degF": "degF", "K": "K", "C": "degC", "ohm": "ohm", "kohm": "kohm", "V": "V", "mV": "mV",
    "Ohm": "ohm", "uV": "uV", "nV": "nV", "A": "A", "mA": "mA", "uA": "uA", "ppm": "ppm", "ppb": "ppb", "pct": "%",
    "percent": "%", "hPa": "hPa", "Pa": "Pa", "kPa": "kPa", "mbar": "mbar", "Hz": "Hz", "kHz": "kHz", "MHz": "MHz",
    "m": "m", "mm": "mm", "um": "um", "cm": "cm", "kg": "kg", "g": "g", "mg": "mg", "N": "N", "W": "W", "mW": "mW",
    "urad": "urad", "mrad": "mrad", "rad": "rad", "deg": "deg", "ustrain": "ustrain", "s": "s", "A2": "A^2",
    "m3m3": "m3/m3",
}  # fmt: skip
"""Ending of a name, behind an underscore -> unit."""
_ENDINGS = ("Hz", "ohm", "Ohm", "V", "A", "W", "Pa", "T", "Gal", "strain")
"""Units that may end a name with any of the prefixes that they take, besides those endings."""
_WRITTEN = {
    "°c": "degC", "℃": "degC", "deg c": "degC", "celsius": "degC", "c": "degC", "°f": "degF", "℉": "degF",
    "deg f": "degF", "fahrenheit": "degF", "f": "degF", "kelvin": "K", "°k": "K", "µv": "uV", "μv": "uV", "ω": "ohm",
    "ohms": "ohm", "kω": "kohm", "kohms": "kohm", "vdc": "V", "vac": "V", "volt": "V", "volts": "V", "adc": "A",
    "µa": "uA", "μa": "uA", "µm": "um", "μm": "um", "%": "%", "% rh": "%", "%rh": "%", "% r.h.": "%", "rh": "%",
    "minutes": "min", "hour": "h", "days": "d", "d": "d", "us": "us", "µs": "us", "ohm": "ohm",
    "sec": "s", "seconds": "s", "ms": "ms", "min": "min", "h": "h", "hours": "h", "bar": "bar", "mhz": "MHz",
}  # fmt: skip
"""How people and programs write units, in small letters, besides the values of `_SUFFIXES`."""
DEGREES = ("degC", "degF", "K")
"""Units of temperatures."""
TEMPERATURES = re.compile(
    r"(?<!at)temp|ambient|room|oven|^tair|case(?![a-z])|thermo"
    r"|lämpöt|teplot|hőm|темп|温度|気温|^amb|^ta(mb)?$|^t\d*$|^t[_ ]",
    re.IGNORECASE,
)
"""Names that temperatures go by."""
_SAME = {"mbar": "hPa"}
"""Units of the same size by other names."""
_KNOWN = {unit: unit for unit in _SUFFIXES.values()}
_BRACKETS = re.compile(r"(?P<name>.*?)\s*(?:[\[(<](?P<inside>[^\[\]()<>]+)[\])>]|\s/\s*(?P<behind>\S+))\s*")
_SIGN = re.compile(r"(?P<before>.*?)(?<!/)(?P<unit>°\s?[CFcf]|[℃℉])(?![a-z])(?P<behind>[^/]*)")
"""The sign of a degree anywhere in a name: "Temperature °C", "1:°C", "Temp, °F (sensor 7)"."""
_COMMA = re.compile(r"(?P<name>[^,]+),\s*(?P<unit>[^,()]+?)\s*(?:\(.*\))?")
"""A unit behind a comma, and what a logger says of itself behind it: "RH, % (LGR S/N: 1, SEN S/N: 2)"."""
_TIGHT = re.compile(r"(?P<name>[^/]*[^/\s])/(?P<behind>\S+)\s*")
"""A slash without blanks, as ISO 80000 writes T/°C: a unit is behind it only where the whole is none, such as km/h."""
_LOOKALIKES = str.maketrans({"\u2126": "\u03a9", "\u00ba": "\u00b0", "\u02da": "\u00b0"})
"""Signs of their own that look like the capital letter for ohm, and like the sign of a degree."""
_SIGNS = str.maketrans({"\u00b5": "u", "\u03bc": "u", "\u2126": "ohm", "\u03a9": "ohm"})
"""Signs as they are written here."""
_POWER = re.compile(r"(.*?[A-Za-z%])(\^?[23])?")
"""A unit, and its power."""
_UNDER = ("h", "min", "d")
"""What may stand in a quotient of units besides those that are known."""


def difference_unit(unit: str) -> str:
    """Unit of a difference of temperatures: K, or degF."""
    return "degF" if unit == "degF" else "K"


def units_differ(name: str, unit: str, other_name: str, other_unit: str) -> bool:
    """True if two columns' units contradict each other.

    A single letter at the end of a name may be no unit (``"dut_A"``, ``"dut_C"``): it is accepted where both would be
    units of the same quantity.

    Examples
    --------
    >>> units_differ("U [V]", "V", "U [mV]", "mV"), units_differ("T_C", "degC", "T_K", "K")
    (True, True)
    >>> units_differ("dut_A", "A", "dut_C", "degC"), units_differ("p [hPa]", "hPa", "p [mbar]", "mbar")
    (False, False)
    """
    one, other = _SAME.get(unit, unit), _SAME.get(other_unit, other_unit)
    if not one or not other or one == other:
        return False
    of_one_quantity = prefix_and_unit(one)[1] == prefix_and_unit(other)[1] or {one, other} <= set(DEGREES)
    return of_one_quantity or not (_ends_in_letter(name) or _ends_in_letter(other_name))


def _ends_in_letter(name: str) -> bool:
    return name[-2:-1] == "_"


def unit_of(name: object, data: Any) -> str:
    """Unit of a column: from ``attrs["units"]``, or its name."""
    noted = getattr(data, "attrs", {}).get("units", {})
    if isinstance(noted, dict) and name in noted:
        return str(noted[name])
    text = str(name)
    bare, _, end = text.rpartition("_" if "_" in text else " ")
    clear = "_" in text or len(end) > 1 or end in ("V", "%")  # "Phase A", "Sensor C" have no units
    if bare and clear and (unit := _SUFFIXES.get(end) or (_prefixed(end) if end.endswith(_ENDINGS) else "")):
        return unit
    if end == "F" and TEMPERATURES.search(text[:-2]):  # a capacitance else
        return "degF"
    return name_and_unit(text)[1]


def without_unit(name: str, unit: str) -> str:
    """A column's name without this unit at its end.

    Examples
    --------
    >>> without_unit("U [mV]", "mV"), without_unit("oven_degC", "degC"), without_unit("U [mV]", "V")
    ('U', 'oven', 'U [mV]')
    """
    if not unit or unit_of(name, None) != unit:
        return name
    bare = name_and_unit(name)[0]
    return re.split(r"[_ ](?=[^_ ]*$)", name)[0] if bare == name else bare


def unit_of_text(text: str) -> str:
    """The unit that a text is: ``"°C"`` is degC; else "".

    Examples
    --------
    >>> [unit_of_text(text) for text in ("mV", "kΩ", "mHz", "MHz", "µm/m", "reading")]
    ['mV', 'kohm', 'mHz', 'MHz', 'um/m', '']
    """
    bare = text.strip()
    exact = _KNOWN.get(bare) or _prefixed(bare) or _WRITTEN.get(bare.translate(_LOOKALIKES).lower(), "")
    return exact or _quotient(bare.translate(_SIGNS))


def _prefixed(text: str) -> str:
    """A unit with a prefix, case kept."""
    unit = text.translate(_SIGNS)
    unit = unit[:-3] + "ohm" if unit.endswith("Ohm") else unit
    return unit if prefix_and_unit(unit)[0] else ""


def _quotient(text: str) -> str:
    """A quotient of units: um/m, kg/m3, 1/K."""
    above, _, below = text.partition("/")
    parts = [_POWER.fullmatch(part) for part in (above, below)]
    known = [part is not None and (part[1] in (*_KNOWN, *_UNDER) or _prefixed(part[1]) != "") for part in parts]
    return text if known[1] and (known[0] or above == "1") else ""


def name_and_unit(text: str) -> tuple[str, str]:
    """A column's name, and the unit at its end.

    Examples
    --------
    >>> name_and_unit("Temp. [°C]"), name_and_unit("U/mV"), name_and_unit("reading (raw)")
    (('Temp.', 'degC'), ('U', 'mV'), ('reading (raw)', ''))
    """
    found = _BRACKETS.fullmatch(text)
    unit = unit_of_text(found["inside"] or found["behind"]) if found else ""
    if found and unit:
        return found["name"], unit
    tight = _TIGHT.fullmatch(text)
    unit = _behind_slash(text, tight["name"], tight["behind"]) if tight else ""
    if tight and unit:
        return tight["name"], unit
    behind = _COMMA.fullmatch(text)
    if behind and (unit := unit_of_text(behind["unit"])):
        return behind["name"], unit
    sign = _SIGN.fullmatch(text)
    return (f"{sign['before']}{sign['behind']}".strip(" :,"), unit_of_text(sign["unit"])) if sign else (text, "")


def _behind_slash(text: str, name: str, behind: str) -> str:
    """The unit behind a slash in a name; else ""."""
    unit = unit_of_text(behind)
    last = re.split(r"[\s_]+", name)[-1]
    in_two = unit_of_text(text) or (last != name and (unit_of_text(last) or last in _SUFFIXES))
    letter = len(behind) == 1 and behind.isascii() and behind.isupper() and behind not in _KNOWN
    return "" if in_two or letter else unit


MARGIN = 20.0
"""So far beyond the fitted range, in the other unit, a temperature may still be one of it [K]."""
ENOUGH = 5
"""Temperatures that tell their unit together: fewer may be damaged ones, which are flagged."""
_OFFSETS = ((273.15, "kelvin where degC was fitted"), (-273.15, "degC where kelvin was fitted"))


class OtherUnit(NamedTuple):
    """An open interval of temperatures that look like another unit."""

    low: float
    high: float
    said: str
    """Which unit: "kelvin where degC was fitted"."""


def other_units(low: float, high: float) -> tuple[OtherUnit, ...]:
    """Units in which absurd temperatures would be usual.

    Degrees Fahrenheit look like degC by their size.

    Examples
    --------
    >>> [(round(one.low, 2), round(one.high, 2), one.said) for one in other_units(20.0, 24.0)][0]
    (271.15, 319.15, 'kelvin where degC was fitted')
    """
    span = high - low
    found = []
    for offset, said in _OFFSETS:
        first, last = low - MARGIN + offset - span / 2, high + MARGIN + offset + span / 2
        found += [OtherUnit(first, min(last, low - span), said), OtherUnit(max(first, high + span), last, said)]
    return tuple(one for one in found if one.low < one.high)


def unit_told_by(value: float, units: tuple[OtherUnit, ...]) -> str:
    """Other unit that a temperature looks like; "" for none."""
    return next((one.said for one in units if one.low < value < one.high), "")


def first_median(record: Record, thermometer: Any) -> float:
    """Median of a temperature's first rows."""
    first = record.segments[0]
    # The median of the first 65 536 rows shows the unit of a record.
    rows = record.kept(first.start, min(first.stop, first.start + (1 << 16)))
    return float(np.nanmedian(record.columns[thermometer][rows]))
