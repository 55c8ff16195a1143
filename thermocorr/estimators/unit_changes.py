"""A temperature whose unit changes within the fitted record: it jumps to what it would be in another one, and stays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..records import Record
from ..records.errors import quoted

ROWS = 5
"""Rows before and after a jump whose medians tell whether it stays."""
CHUNK = 1 << 16
"""Rows that are looked at together."""
CLOSE = 2.0
"""So far beside what it would be in another unit a temperature may jump [K]."""
LEAST_JUMP = 10.0
"""Smaller jumps tell no unit: -40 degC are -40 degF."""
MANY = 100
"""A record with more jumps than this is no quiet temperature, and is not asked."""


class _Change(NamedTuple):
    factor: float
    offset: float
    said: str
    back: str


_CHANGES = (
    _Change(1.0, 273.15, "kelvin", "degC"),
    _Change(1.0, -273.15, "degC", "kelvin"),
    _Change(1.8, 32.0, "degF", "degC"),
    _Change(1 / 1.8, -32.0 / 1.8, "degC", "degF"),
)


def unit_changes(record: Record) -> list[str]:
    """A sentence on the first row from which the temperature is in another unit than before; none where it is not.

    Kelvin are told by the jump alone. A real jump may look like one from degC to degF: it is one of a record that
    jumps there and back at most, inside a segment.
    """
    range_ = record.moments(record.temperature_name)
    if 1.8 * range_.low + 32.0 > range_.high + CLOSE and range_.high - range_.low < 273.15 - CLOSE:
        return []  # no temperature is in the record in two units
    jumps = []
    for jump in _jumps(record):
        jumps.append(jump)
        if len(jumps) > MANY:
            return []
    for place, before, after, within in jumps:
        others = sum(abs(b - a) > abs(after - before) / 2 for _, a, b, _ in jumps)
        for change in _CHANGES:
            sure = change.factor == 1.0 or (within and others <= 2)
            if sure and abs(change.factor * before + change.offset - after) < CLOSE:
                row = record.row(place)
                return [
                    f"The temperature {quoted(record.temperature_name)} jumps from {before:.6g} to {after:.6g} at row "
                    f"{row} ({record.times.label(row)}), and stays there: that looks like {change.said} where "
                    f"{change.back} was recorded before. If it is so, convert the rows on one side to the unit of the "
                    "other, and fit again."
                ]
    return []


def _stays(values: np.ndarray, k: int) -> bool:
    """Whether a jump at row `k` is from the temperatures of some rows before to those of some rows behind."""
    half = abs(values[k] - values[k - 1]) / 2
    before, after = np.median(values[max(k - ROWS, 0) : k]), np.median(values[k : k + ROWS])
    return bool(abs(before - values[k - 1]) < half and abs(after - values[k]) < half)


def _jumps(record: Record) -> Iterator[tuple[int, float, float, bool]]:
    """Large jumps that stay: place in time order, temperature before and there, and whether it is within a segment."""
    column = record.columns[record.temperature_name]
    tail: np.ndarray = np.zeros(0)
    for segment in record.segments:
        within = False
        for low in range(segment.start, segment.stop, CHUNK):
            high = min(low + CHUNK + ROWS, segment.stop)  # the rows behind the chunk tell whether a jump stays
            places = record.kept_places(low, high)
            values = np.concatenate((tail, np.asarray(column[record.kept(low, high)], float)))
            last = len(tail) + int(np.searchsorted(places, low + CHUNK))
            for k in (np.flatnonzero(np.abs(np.diff(values[:last])) > LEAST_JUMP) + 1).tolist():
                if k >= len(tail) and _stays(values, k):
                    yield int(places[k - len(tail)]), float(values[k - 1]), float(values[k]), within or k > len(tail)
            tail, within = values[max(last - ROWS, 0) : last], True
