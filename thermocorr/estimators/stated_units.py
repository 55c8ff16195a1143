"""Temperatures whose unit is stated, for a model that was fitted to some of which it was or was not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..records import Record, RecordError
from ..records.errors import quoted, warn
from ..records.other_units import ENOUGH, first_median
from ..records.units import unit_of
from .reading import Reading, check_median, check_unit

NEAR = 10.0
"""So far beyond the fitted range, and by as much as that is wide, a temperature may be one of the same unit."""
AMBIENT = (-40.0, 50.0)
"""Ambient temperatures [degC]."""
_IN_DEGC: dict[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "degC": (lambda value: value, lambda value: value),
    "degF": (lambda value: (value - 32.0) / 1.8, lambda value: 1.8 * value + 32.0),
    "K": (lambda value: value - 273.15, lambda value: value + 273.15),
}
"""Unit -> to degC, and from degC."""


def check_record(fitted: Reading, X: Any, record: Record) -> None:
    """Refuse the temperature of a record in another unit than the fitted one: by their units, and by their values.

    Parameters
    ----------
    fitted : Reading
    X : DataFrame, array or Record
        What the record was read from, which may name units (``X.attrs["units"]``).
    record : Record
    """
    name, median = record.temperature_name, first_median(record, record.temperature_name)
    check_temperature(fitted, str(name), str(name), unit_of(name, X), median)
    check_median(median, name, *fitted.temperature_range)


def check_block(fitted: Reading, X: Any, temperatures: np.ndarray, name: Any) -> None:
    """`check_record` of a block of a stream; a few rows tell nothing by their values, for they may be damaged ones."""
    known = temperatures[np.isfinite(temperatures)]
    median = float(np.median(known)) if len(known) >= ENOUGH else None
    check_temperature(fitted, str(name), str(name), unit_of(name, X), median)
    if median is not None:
        check_median(median, name, *fitted.temperature_range)


def check_temperature(fitted: Reading, name: str, fitted_name: str, unit: str, median: float | None) -> None:
    """Refuse a temperature whose stated unit is not that of the fitted one.

    Where the fitted record named no unit, the values tell: fitted ones that are no ambient temperatures in the unit
    that they were taken for, but are in the stated one, and among which these are as they stand, have the stated unit,
    and a RecordWarning says what was taken wrong. Where values do not tell, nothing is assumed. The unit that they were
    taken for is refused only where the fitted ones are ambient temperatures in degF alone: others are merely colder.

    Parameters
    ----------
    fitted : Reading
    name, fitted_name : str
        The column, and the fitted one.
    unit : str
        What the data state; "" where they state none, which is refused by nothing.
    median : float, optional
        Of several temperatures; None where too few have come, and only stated units can be compared.

    Raises
    ------
    RecordError
        Where the units differ, and where nobody can tell.
    """
    if fitted.unit_named:
        check_unit("temperature", name, fitted_name, unit, fitted.temperature_unit)
        return
    if unit not in _IN_DEGC or median is None or np.isnan(median):
        return
    taken, (low, high) = fitted.temperature_unit, fitted.temperature_range
    as_it_is, converted = _near(median, low, high), _near(_from(unit, taken, median), low, high)
    begin = (
        f"The temperature {quoted(name)} is in {unit}, about {median:.4g}. The record that the model was fitted to "
        f"names no unit of {quoted(fitted_name)}: {low:.4g} to {high:.4g} were taken for {taken}"
    )
    refit = f"fit again with the unit in the column's name, as in {fitted_name + ' [°F]'!r}, or in X.attrs['units']"
    ambient = {one: _is_ambient(_from(one, "degC", low), _from(one, "degC", high)) for one in (taken, unit, "degF")}
    if unit == taken:
        in_degf = _near(_from(unit, "degF", median), low, high)
        if in_degf and not as_it_is and ambient["degF"] and not ambient[taken]:
            raise RecordError(f"{begin}, and look like degF. Convert this column to degF, or {refit}.")
        return
    if as_it_is and not converted and ambient[unit] and not ambient[taken]:
        warn(
            f"{begin}. By their values they are {unit} too, and are used so; what the model says per degree of {taken} "
            f"is per degree of {unit}. To have that right, {refit}."
        )
        return
    if converted and not as_it_is:
        raise RecordError(
            f"{begin}, and by the values they are. Convert this column to {taken}, or mend its unit if it is wrong."
        )
    raise RecordError(f"{begin}, and the values do not tell whether they are. To say it, {refit}.")


def _is_ambient(low: float, high: float) -> bool:
    return AMBIENT[0] <= low and high <= AMBIENT[1]


def _near(value: float, low: float, high: float) -> bool:
    reach = max(NEAR, high - low)
    return low - reach <= value <= high + reach


def _from(unit: str, other: str, value: float) -> float:
    """A temperature in one unit, in another."""
    return _IN_DEGC[other][1](_IN_DEGC[unit][0](value))
