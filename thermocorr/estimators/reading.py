"""What the fitted reading and temperature looked like: names, units, ranges, and what is odd about them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..records import Record, RecordError, RecordWarning
from ..records.units import unit_of


@dataclass(frozen=True)
class Reading:
    """Names, units and ranges of what was fitted."""

    name: str
    unit: str
    temperature_unit: str
    n_readings: int
    mean: float
    std: float
    temperature_range: tuple[float, float]

    @classmethod
    def of(cls, X: Any, y: Any, record: Record) -> Reading:
        """Look once through readings and temperatures, block by block."""
        name = getattr(y, "name", None)
        if isinstance(y, pd.DataFrame):
            name = y.columns[0]
        unit = unit_of(name, y) or unit_of(name, X) if name is not None else ""
        readings, temperatures = record.reading_moments(), record.moments(record.temperature_name)
        if readings.n == 0:
            raise RecordError(
                f"All {record.n_rows} readings are missing (NaN). Check the name of the reading's column and the file."
            )
        return cls(
            "reading" if name is None else str(name),
            unit,
            unit_of(record.temperature_name, X) or "K",
            readings.n,
            readings.mean,
            readings.std,
            (temperatures.low, temperatures.high),
        )


def check_plausible(record: Record, reading: Reading) -> None:
    """Refuse a temperature that never changes; warn about one that cannot be a temperature, or a stuck reading."""
    low, high = reading.temperature_range
    if reading.n_readings > 1 and low == high:
        raise RecordError(
            f"The temperature never changes: it is {low:.6g} in all {record.n_used} rows. Nothing can be learned about "
            f"its effect. Is {record.temperature_name!r} the right column?"
        )
    if low < -460.0 or high > 5000.0:
        warnings.warn(
            f"The temperature {record.temperature_name!r} runs from {low:.6g} to {high:.6g}: that is neither degC, K "
            "nor degF. The fit is valid, but coefficients are per unit of that column. Is it the right one?",
            RecordWarning,
            stacklevel=3,
        )
    if reading.n_readings > 1 and reading.std == 0:
        warnings.warn(
            f"The reading never changes: it is {reading.mean:.10g} in all {reading.n_readings} rows. Is it the right "
            "column, and was the instrument running?",
            RecordWarning,
            stacklevel=3,
        )


def check_range(fitted: Reading, record: Record) -> None:
    """Refuse a temperature in another unit than the fitted one."""
    low, high = fitted.temperature_range
    first = record.segments[0]
    rows = record.rows(first.start, min(first.stop, first.start + (1 << 16)))
    median = float(np.median(record.columns[record.temperature_name][rows]))
    span = high - low
    for offset, said in ((273.15, "kelvin where degC was fitted"), (-273.15, "degC where kelvin was fitted")):
        if abs(median - offset - (low + high) / 2) < span + 20.0 and not low - span <= median <= high + span:
            raise RecordError(
                f"The temperature is about {median:.6g} here and was {low:.6g} to {high:.6g} in the fitted record: "
                f"that looks like {said}. Convert {record.temperature_name!r} first."
            )
