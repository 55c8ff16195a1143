"""Checks: identifiability, fitted ranges, units."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..effects import StaticPolynomial
from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..equations import RidgeSolution
from ..records import Record, RecordError
from ..records.errors import quoted, warn
from ..records.units import ENOUGH, first_median, other_units, unit_of, unit_told_by, units_differ
from .reading import Reading, flat_columns
from .search import unresolved

FURTHEST_REACH = 1000.0
"""Reach of the contributions, in standard deviations of the readings, at which a fit counts as cancelling.

One part in a thousand of one column then moves the corrected reading by as much as the readings have ever moved.
Measured: 1.2 where time constants are searched for the built-in voltage reference and for simulated devices (5 with 400
rows), 2 to 10 for the measured records of `benchmarks/real_records.py`, 95 for the worst of the 1443 fits of the test
suite but two (one is made to cancel, one lags a clock, which is a constant). Eight time constants given by hand without
a penalty reach 400 on measured records, 2900 where the longest lasts longer than the record. On a record of 18 s, two
harmonics of 10 min reach 1e6, of 3 h 1e11 to 1e13; one harmonic of 1 h 3e3 to 2e4, of a day 2e6 to 1e7.
With half of it one harmonic of half an hour cancels there too (700 to 6e3); twice of it changes none of these.
"""


def cancelling(effects: Sequence[Effect], solution: RidgeSolution, reading: Reading) -> list[str]:
    """Sentence on contributions that cancel, if they do.

    Each contribution counts with its rms over the fitted rows. Powers of T - T0 count with their standard deviation:
    how far T0 stands from the record is the user's choice.

    `effects` (sequence of Effect): Learned; their columns in the order of those of `solution`. `solution`
    (RidgeSolution). `reading` (Reading): Of the fitted record.
    """
    of_choice = [isinstance(effect, StaticPolynomial) for effect in effects for _ in range(effect.n_columns())]
    means = np.where(of_choice, 0.0, solution.mean)
    sizes = np.abs(solution.coef) * np.hypot(solution.scale, means)
    reach = float(sizes.sum())
    if not reach > FURTHEST_REACH * reading.std:
        return []
    names = [name for effect in effects for name in effect.names()]
    return [
        f"The contributions of the model's columns cancel: they reach {reach:.3g} and leave {reading.std:.3g}. The "
        f"largest is that of {names[int(sizes.argmax())]!r}. The record does not determine these columns: "
        "corrected readings can be wrong by any amount, forecasts more so. Leave that effect out, record for longer "
        "(some periods, some time constants), fit fewer time constants, or set a ridge penalty with alpha."
    ]


def doubts_of(model: Any, record: Record, solution: RidgeSolution) -> list[str]:
    """Warnings for the user of a fitted model.

    `model` (DynamicBiasRegressor). `record` (Record): What it was fitted to. `solution` (RidgeSolution).
    """
    said = [model._run_levels.note] if model._run_levels.note else []
    if model.degree_ < model.degree:
        low, high = model.degree_ + 1, model.degree
        powers = f"(T - T0)^{low}" if low == high else f"(T - T0)^{low} to (T - T0)^{high}"
        said.append(
            f"The temperatures lie at too few levels to determine {powers} in the static law: left out. Rows between "
            "them are flagged. Record at more levels, or ramp through them."
        )
    effects, taus = model.features_.effect_list(), model.time_constants_
    said += one_way(record, model.thermometers_)
    if model.search_ is None and len(taus):
        said += unresolved(taus, record, solution, model.degree_, model.residual_std_)
    return [*said, *flat_columns(record, effects), *cancelling(effects, solution, model.reading_)]


MARGIN = 3.0
"""Standard deviations of the residual by which an effect's share may leave its range."""

ONE_WAY = 0.1
"""Share of the way that a thermometer may go back and still run one way."""


def learned_ranges(model: Any) -> np.ndarray:
    """Range of each effect's share, `MARGIN` wider, shape (n_effects, 2).

    Infinite for effects of time alone, for those that `correct` keeps, and for the static law, whose temperatures have
    a range of their own.
    """
    effects = model.features_.effect_list()
    found = np.array([[np.inf, -np.inf]] * len(effects))
    record = model.features_.history_.record
    for _, parts in model._weighed(walk(effects, record, starts=own_starts(record))):
        found[:, 0] = np.fmin(found[:, 0], np.fmin.reduce(parts, axis=0))
        found[:, 1] = np.fmax(found[:, 1], np.fmax.reduce(parts, axis=0))
    free = [e.of_time_alone or isinstance(e, StaticPolynomial) or not e.removed_by_correct for e in effects]
    found[free] = -np.inf, np.inf
    return np.asarray(found + MARGIN * model.residual_std_ * np.array([-1.0, 1.0]))


def one_way(record: Record, thermometers: Iterable[Any]) -> list[str]:
    """Sentence on thermometers that move one way only."""
    said = []
    for name in thermometers:
        fall = rise = 0.0
        high, low, known = -np.inf, np.inf, record.moments(name)
        for block in record.blocks():
            values = block[name]
            highs, lows = np.maximum.accumulate(values), np.minimum.accumulate(values)
            fall = max(fall, float(np.max(np.maximum(highs, high) - values)))
            rise = max(rise, float(np.max(values - np.minimum(lows, low))))
            high, low = max(high, float(highs[-1])), min(low, float(lows[-1]))
            if min(fall, rise) > ONE_WAY * (known.high - known.low):  # neither way is longer than the range
                break
        if min(fall, rise) <= ONE_WAY * max(fall, rise):
            shown, missing = ("rises", "falling") if fall < rise else ("falls", "rising")
            said.append(
                f'{quoted(name)} only {shown} in the record: {missing} is not covered, and flagged "outside fitted '
                'range" where it matters.'
            )
    return said


@dataclass(frozen=True)
class UnitGuard:
    """Units of a fitted model's reading and thermometers.

    `fitted` (Reading). `ranges` (mapping): Lowest and highest fitted temperature of each thermometer, the ambient one
    first. All methods raise RecordError for another unit, and warn where the values make one likely.
    """

    fitted: Reading
    ranges: Mapping[Any, tuple[float, float]]

    @classmethod
    def of(cls, model: Any) -> UnitGuard:
        """Guard of a fitted `DynamicBiasRegressor`."""
        return cls(model.reading_, {name: model.features_.history_.ranges[name] for name in model.thermometers_})

    def check_readings(self, y: Any, X: Any) -> None:
        """Compare the unit of readings with the fitted one."""
        name = y.columns[0] if isinstance(y, pd.DataFrame) and y.shape[1] == 1 else getattr(y, "name", None)
        if name is not None:
            self.check_reading(str(name), unit_of(name, y) or unit_of(name, X))

    def check_reading(self, name: str, unit: str | None = None) -> None:
        """Compare the unit of a column of readings."""
        _check_unit("reading", name, self.fitted.name, unit, self.fitted.unit)

    def check_record(self, record: Record, X: Any) -> None:
        """Compare the units of a record's thermometers."""
        for thermometer in self.ranges:
            self.check_temperature(thermometer, unit_of(thermometer, X), first_median(record, thermometer))

    def check_values(self, thermometer: Any, values: np.ndarray, X: Any) -> None:
        """Compare a block of a stream by its units alone."""
        known = values[np.isfinite(values)]
        median = float(np.median(known)) if len(known) >= ENOUGH else None
        self.check_temperature(thermometer, unit_of(thermometer, X), median)

    def check_temperature(
        self, thermometer: Any, unit: str = "", median: float | None = None, column: str | None = None
    ) -> None:
        """Compare a thermometer's stated unit, and its median.

        `column` (str, optional): What it is called, where that is another name than in the fitted record.
        """
        called = str(thermometer) if column is None else column
        if thermometer == next(iter(self.ranges)):
            _check_ambient(self.fitted, called, str(thermometer), unit, median)
        elif column is not None:
            _check_unit("temperature", column, str(thermometer), unit or None)
        if median is not None:
            _check_median(median, called, *self.ranges[thermometer])


AMBIENT = (-40.0, 50.0)
"""Ambient temperatures [degC]."""
_IN_DEGC: dict[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "degC": (lambda value: value, lambda value: value),
    "degF": (lambda value: (value - 32.0) / 1.8, lambda value: 1.8 * value + 32.0),
    "K": (lambda value: value - 273.15, lambda value: value + 273.15),
}
"""Unit -> to degC, and from degC."""


def _check_ambient(fitted: Reading, name: str, fitted_name: str, unit: str, median: float | None) -> None:
    """Refuse a temperature in another stated unit.

    Where the fitted record named no unit, the values tell: fitted ones that are no ambient temperatures in the unit
    that they were taken for, but are in the stated one, and among which these are as they stand, have the stated unit,
    and a RecordWarning says what was taken wrong. Where values do not tell, nothing is assumed. The unit that they were
    taken for is refused only where the fitted ones are ambient temperatures in degF alone: others are merely colder.

    `fitted` (Reading). `name`, `fitted_name` (str): The column, and the fitted one. `unit` (str): What the data
    state; "" where they state none, which is refused by nothing. `median` (float, optional): Of several temperatures;
    None where too few have come, and only stated units can be compared. Raises RecordError where the units differ,
    and where nobody can tell.
    """
    if fitted.unit_named:
        _check_unit("temperature", name, fitted_name, unit, fitted.temperature_unit)
        return
    if unit not in _IN_DEGC or median is None or np.isnan(median):
        return
    taken, (low, high) = fitted.temperature_unit, fitted.temperature_range
    as_it_is, converted = _near(median, low, high), _near(_from(unit, taken, median), low, high)
    begin = (
        f"The temperature {quoted(name)} is in {unit}, about {median:.4g}. The record that the model was fitted to "
        f"names no unit of {quoted(fitted_name)}: {low:.4g} to {high:.4g} were taken as {taken}"
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
            f"{begin}, and by the values they are. Convert this column to {taken}, or correct its unit if it is wrong."
        )
    raise RecordError(f"{begin}, and the values do not tell if that is right. To fix it, {refit}.")


def _is_ambient(low: float, high: float) -> bool:
    return AMBIENT[0] <= low and high <= AMBIENT[1]


def _near(value: float, low: float, high: float) -> bool:
    # A temperature beyond the fitted range by 10 degrees, or by as much as the range is wide, may be in the same unit.
    reach = max(10.0, high - low)
    return low - reach <= value <= high + reach


def _from(unit: str, other: str, value: float) -> float:
    """A temperature in one unit, in another."""
    return _IN_DEGC[other][1](_IN_DEGC[unit][0](value))


def _check_unit(role: str, name: str, fitted: str, unit: str | None = None, fitted_unit: str | None = None) -> None:
    """Refuse a column in another written unit.

    Units that nobody gives are those of the names.
    """
    unit = unit_of(name, None) if unit is None else unit
    fitted_unit = unit_of(fitted, None) if fitted_unit is None else fitted_unit
    if units_differ(name, unit, fitted, fitted_unit):
        in_header = unit_of(name, None) == unit
        mended = (
            "rename it if its header is wrong" if in_header else "correct the unit that the file gives if it is wrong"
        )
        raise RecordError(
            f"The {role} {quoted(name)} is in {unit}, and the model was fitted to {quoted(fitted)} in {fitted_unit}. "
            f"Convert the column to {fitted_unit}, or {mended}."
        )


def _check_median(median: float, thermometer: Any, low: float, high: float) -> None:
    """Refuse a median in another unit; warn of likely degF."""
    span = high - low
    if said := unit_told_by(median, other_units(low, high)):
        raise RecordError(
            f"The temperature is about {median:.6g} here and was {low:.6g} to {high:.6g} in the fitted record: "
            f"that looks like {said}. Convert {quoted(thermometer)} first."
        )
    # A temperature that would be among the fitted ones in degF, and is so far beyond them as it stands, may be in degF.
    if low <= (median - 32.0) / 1.8 <= high and median > high + span + 10.0:
        warn(
            f"The temperature is about {median:.4g} here and was {low:.4g} to {high:.4g} in the fitted record: if "
            f"{quoted(thermometer)} is in degF, convert it first."
        )
