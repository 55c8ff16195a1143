"""What the fitted reading and temperature looked like: names, units, ranges, and what is odd about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..records import Record, RecordError
from ..records.errors import quoted, times_word, warn
from ..records.other_units import first_median, other_units, unit_told_by
from ..records.units import unit_of, units_differ
from .flat import flat_text, is_flat, resolved

USUAL_STDS = 10.0
"""A corrected reading so many standard deviations from the mean of the fitted readings is no surprise."""


KELVIN_FROM = 150.0
"""Temperatures of no unit that are all above it are taken for kelvin, others for degC."""
FAHRENHEIT_BEYOND = 10.0
"""Temperatures so far beyond the fitted ones, that are among them if they are degF, may be so [K]."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Names, units and ranges of what was fitted."""

    name: str
    unit: str
    temperature_unit: str
    n_readings: int
    mean: float
    std: float
    temperature_range: tuple[float, float]
    unit_named: bool = True
    """Whether the record names the unit of its temperature; else its values were taken for degC or K by their size."""

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
        degrees = unit_of(record.temperature_name, X)
        return cls(
            name="reading" if name is None else str(name),
            unit=unit,
            temperature_unit=degrees or unit_by_size(temperatures.low),
            n_readings=readings.n,
            mean=readings.mean,
            std=readings.std,
            temperature_range=(temperatures.low, temperatures.high),
            unit_named=bool(degrees),
        )

    def widened(self, temperatures: tuple[float, float]) -> Reading:
        """Names and ranges with a range of temperatures that takes in another one."""
        (low, high), (lowest, highest) = self.temperature_range, temperatures
        return replace(self, temperature_range=(min(low, lowest), max(high, highest)))


def unit_by_size(low: float) -> str:
    """The unit that temperatures of no named unit, of which `low` is the least, are taken for."""
    return "K" if low > KELVIN_FROM else "degC"


def check_plausible(record: Record, reading: Reading, known_before: bool = False) -> None:
    """Refuse a temperature that never changes; warn about one that cannot be a temperature, or a stuck reading.

    Where its effect is known before, it need not change.
    """
    low, high = reading.temperature_range
    if reading.n_readings > 1 and is_flat(low, high) and not known_before:
        raise RecordError(
            f"The temperature never changes{flat_text(low, high, record.n_used)}. Nothing can be learned about its "
            f"effect. Is {quoted(record.temperature_name)} the right column?"
        )
    if low < -460.0 or high > 5000.0:
        warn(
            f"The temperature {quoted(record.temperature_name)} runs from {low:.6g} to {high:.6g}: that is neither "
            "degC, K nor degF. The fit is valid, but coefficients are per unit of that column. Is it the right one?"
        )
    if reading.n_readings > 1 and reading.std == 0:
        warn(
            f"The reading never changes: it is {reading.mean:.10g} in all {reading.n_readings} rows. Is it the right "
            "column, and was the instrument running?"
        )


def check_reading_unit(fitted: Reading, y: Any, X: Any) -> None:
    """Refuse readings whose name says another unit than that of the fitted ones."""
    name = y.columns[0] if isinstance(y, pd.DataFrame) and y.shape[1] == 1 else getattr(y, "name", None)
    if name is not None:
        check_unit("reading", str(name), fitted.name, unit_of(name, y) or unit_of(name, X), fitted.unit)


def check_unit(role: str, name: str, fitted: str, unit: str | None = None, fitted_unit: str | None = None) -> None:
    """Refuse a column in another unit than the fitted column has, where both units are written.

    Parameters
    ----------
    role : str
        What the column is: "reading", "temperature".
    name, fitted : str
        Names of the column and of the fitted one.
    unit, fitted_unit : str, optional
        Their units, "" where nobody knows; those in their names by default.

    Raises
    ------
    RecordError
        Where the units differ.
    """
    unit = unit_of(name, None) if unit is None else unit
    fitted_unit = unit_of(fitted, None) if fitted_unit is None else fitted_unit
    if units_differ(name, unit, fitted, fitted_unit):
        in_header = unit_of(name, None) == unit
        mended = "rename it if its header is wrong" if in_header else "mend the unit that the file gives if it is wrong"
        raise RecordError(
            f"The {role} {quoted(name)} is in {unit}, and the model was fitted to {quoted(fitted)} in {fitted_unit}. "
            f"Convert the column to {fitted_unit}, or {mended}."
        )


def check_range(record: Record, thermometer: Any, low: float, high: float) -> None:
    """Refuse a temperature in another unit than the fitted one, which had this range."""
    check_median(first_median(record, thermometer), thermometer, low, high)


def check_median(median: float, thermometer: Any, low: float, high: float) -> None:
    """Refuse a temperature, the median of several rows, in another unit than the fitted one; warn of likely degF."""
    span = high - low
    if said := unit_told_by(median, other_units(low, high)):
        raise RecordError(
            f"The temperature is about {median:.6g} here and was {low:.6g} to {high:.6g} in the fitted record: "
            f"that looks like {said}. Convert {quoted(thermometer)} first."
        )
    if low <= (median - 32.0) / 1.8 <= high and median > high + span + FAHRENHEIT_BEYOND:
        warn(
            f"The temperature is about {median:.4g} here and was {low:.4g} to {high:.4g} in the fitted record: if "
            f"{quoted(thermometer)} is in degF, convert it first."
        )


def check_corrected(fitted: Reading, corrected: np.ndarray, given: Any, expected: tuple[float, ...] = ()) -> None:
    """Warn about corrected readings that leave all readings far behind.

    Readings are those given, and the fitted ones (mean +- 10 standard deviations); far is more than the width of that
    range beyond it. Where nothing is far, this is two looks at the corrected readings.

    Parameters
    ----------
    fitted : Reading
    corrected : array of shape (n_rows,)
        NaN where there is none.
    given : array-like of shape (n_rows,)
        Readings before the correction.
    expected : tuple of float
        Levels that corrected readings may have for a reason of their own.
    """
    usual = USUAL_STDS * fitted.std
    levels = (fitted.mean - usual, fitted.mean + usual, *expected)
    ends = np.fmin.reduce(corrected, initial=np.inf), np.fmax.reduce(corrected, initial=-np.inf)
    if not _far(levels, *ends):
        return
    readings = np.asarray(given[:], float)
    levels = (*levels, np.fmin.reduce(readings, initial=np.inf), np.fmax.reduce(readings, initial=-np.inf))
    levels = tuple(level for level in levels if np.isfinite(level))
    if not _far(levels, *ends):
        return
    low, high = min(levels), max(levels)
    beyond = np.maximum(low - corrected, corrected - high)
    rows = np.flatnonzero(beyond > _width(low, high))
    worst = int(np.nanargmax(beyond))
    warn(
        f"The corrected reading leaves the readings far behind in {times_word(len(rows), 'row')} of {len(corrected)}, "
        f"the first is row {rows[0]}: it comes to {corrected[worst]:.10g} in row {worst}, and the readings, those "
        f"given and those fitted, lie between {low:.10g} and {high:.10g}. What was taken away there is no bias of this "
        "instrument: see with contributions(X) which effect makes it, and with flags(X) whether the temperature is "
        "outside the fitted range."
    )


def _far(levels: tuple[float, ...], low: float, high: float) -> bool:
    """Whether values between two limits lie further from every level than the levels lie from one another."""
    width = _width(min(levels), max(levels))
    return low < min(levels) - width or high > max(levels) + width


def _width(low: float, high: float) -> float:
    """Width of a range; for a single number, the step to which it can be resolved."""
    return max(high - low, resolved(low, high))
