"""Temperatures that are usual ones in another unit than the fitted: kelvin for degC, degC for kelvin."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .record import Record

MARGIN = 20.0
"""So far beyond the fitted range, in the other unit, a temperature may still be one of it [K]."""
FIRST_ROWS = 1 << 16
"""Rows at most whose median tells the unit of a record."""
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
    """What is no temperature for a model that was fitted from `low` to `high`, but would be one in another unit.

    Degrees Fahrenheit are not told from degC by their size alone.

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
    """Which other unit a temperature looks like; "" for none."""
    return next((one.said for one in units if one.low < value < one.high), "")


def first_median(record: Record, thermometer: Any) -> float:
    """Median of a temperature over the first rows of a record, which tells its unit."""
    first = record.segments[0]
    rows = record.kept(first.start, min(first.stop, first.start + FIRST_ROWS))
    return float(np.nanmedian(record.columns[thermometer][rows]))
