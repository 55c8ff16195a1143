"""The paper's linear effects: static law, thermal lags, eqs. (3) (19)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from numbers import Integral, Real
from operator import mul
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions

from ..records import Record, seconds_of
from ..records.units import unit_of
from .grids import time_grid
from .protocol import TEMPERATURE, Effect, EffectInfo, time_text
from .signals import Signals

REFERENCE = [Interval(Real, None, None, closed="neither"), StrOptions({"mean"})]
"""What a reference temperature may be."""
HOLD = [StrOptions({"first_order", "zero_order"})]


PLAIN = frozenset({float, int, np.float64})
"""Types of numbers that are read as seconds at once: one by one, a thousand sets of time constants take long."""


def seconds_array(time_constants: Any) -> np.ndarray:
    """Time constants in seconds, increasing and distinct.

    Raises ValueError that names the first bad one.
    """
    if isinstance(time_constants, str) or np.ndim(time_constants) == 0:
        time_constants = [time_constants]
    plain = PLAIN.issuperset(map(type, time_constants))
    values = np.array(time_constants if plain else [], float)
    if not plain or not (np.isfinite(values) & (values > 0)).all():
        values = np.array([seconds_of(value, "time_constants") for value in time_constants], float)
    values = np.sort(values)
    if (np.diff(values) == 0).any():
        twice = values[1:][np.diff(values) == 0][0]
        raise ValueError(f"The 'time_constants' parameter must hold distinct times. Got {twice:.10g} s twice.")
    return values


def reference_of(given: float | str, record: Record) -> float:
    """T0 [K or degC]: a number, or the record's mean."""
    return record.moments(record.temperature_name).mean if given == "mean" else float(given)


def lag_text(temperature: str) -> str:
    """Meaning of ``lag[900 s]``, eqs. (17)-(19)."""
    return f"lag[tau] = lagged - {temperature}, where tau d(lagged)/dt = {temperature} - lagged"


class StaticPolynomial(Effect):
    """Static law: ``(T - T0)^i``, i = lowest_power..degree, eq. (3).

    Parameters
    ----------
    degree : int, default 2
        Highest power; 0 for no column.
    reference_temperature : float or "mean", default "mean"
        T0, in the unit of the temperature.
    lowest_power : int, default 1
        First power: 2 for the curvature alone, given a model that is linear already.
    """

    kind = "static_polynomial"
    learned = {"temperature_name_": "column", "reference_temperature_": "temperature"}
    info = EffectInfo(
        physics="The static law of the reading over temperature is curved.",
        bench_check="Hold the temperature at five or more levels until the reading has settled: the levels do not lie "
        "on the fitted curve.",
        formula="temperature^i = (T - T0)^i",
        parameters={"reference_temperature": TEMPERATURE},
        place=1.0,
    )
    _parameter_constraints = {
        "degree": [Interval(Integral, 0, 9, closed="both")],
        "reference_temperature": REFERENCE,
        "lowest_power": [Interval(Integral, 1, 9, closed="both")],
    }

    def __init__(self, degree: int = 2, reference_temperature: float | str = "mean", lowest_power: int = 1):
        self.degree = degree
        self.reference_temperature = reference_temperature
        self.lowest_power = lowest_power

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Curvature up to the second, third and fourth power."""
        return [cls(degree, lowest_power=2) for degree in (2, 3, 4)]

    def learn(self, record: Record) -> None:
        """Fix T0 [K or degC]."""
        self._validate_params()
        self.temperature_name_ = record.temperature_name
        self.reference_temperature_ = reference_of(self.reference_temperature, record)

    def powers(self) -> range:
        """Powers of T - T0, one for each column."""
        return range(self.lowest_power, self.degree + 1)

    def names(self) -> list[str]:
        """``temperature``, ``temperature^2``, ..."""
        return self._powers_of(column_text(self.temperature_name_))

    def terms(self) -> list[str]:
        """``(temperature - 23)``, ``(temperature - 23)^2``, ..."""
        return self._powers_of(f"({column_text(self.temperature_name_)} - {self.reference_temperature_:.6g})")

    def _powers_of(self, base: str) -> list[str]:
        return [base if i == 1 else f"{base}^{i}" for i in self.powers()]

    def explained(self, temperature: str) -> str:
        """Nothing: the equation writes the powers of T - T0 out."""
        return ""

    def units(self) -> list[str]:
        """K, K^2, ..."""
        return ["K" if i == 1 else f"K^{i}" for i in self.powers()]

    def signals(self, x: Signals) -> Sequence[Any]:
        """Powers of T - T0 [K^i]."""
        deviation = x.T - self.reference_temperature_
        powers = list(accumulate([deviation] * self.degree, mul))  # eq. (3)
        return powers[self.lowest_power - 1 :]


def column_unit(column: object) -> str:
    """Unit of a recorded column; "unit" where it is unknown.

    A state such as ``operator=Kim`` has none.
    """
    return "" if isinstance(column, str) and "=" in column else unit_of(column, None) or "unit"


def column_text(name: object) -> str:
    """A column in feature names: x0, x1, ... for arrays."""
    return f"x{name}" if isinstance(name, int | np.integer) else str(name)


class ThermalLag(Effect):
    """Lag differences Psi_j = lagged_j - T, eq. (19).

    Parameters
    ----------
    time_constants : sequence
        [s], or spans such as "15 min".
    hold : {"first_order", "zero_order"}
        Temperature between samples: a straight line or the earlier value.

    The device starts at rest with the first temperature; `InitialTransient` stands for any other start.
    As printed, eqs. (17) (25) have the steady state T/xi in K s, and (19) subtracts T in K: here ``xi psi``, the
    temperature that a body of time constant 1/xi has, takes its place. Linear fits span the same space in both forms.
    """

    kind = "thermal_lag"
    unit = "K"
    thermal_rank = 1
    learned = {"time_constants_": "times"}
    info = EffectInfo(
        physics="A part of the device follows the ambient temperature later (or earlier) than the model allows.",
        bench_check="Step the temperature and log the reading until it rests: fit the time constant of what is left.",
        formula="lag[tau] = lagged - T, where tau d(lagged)/dt = T - lagged",
        parameters={"time_constants": "s"},
        tuned=("time_constants",),
        example={"time_constants": [1200.0]},
        place=1.1,
    )
    _parameter_constraints = {"hold": HOLD}

    def __init__(self, time_constants: Sequence[Any] = (), hold: str = "first_order"):
        self.time_constants = time_constants
        self.hold = hold

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """One more lag, from half a step to a fifth of a segment."""
        return [cls([tau]) for tau in time_grid(record, 0.5, 0.2)]

    def learn(self, record: Record) -> None:
        """Convert time constants to seconds."""
        self._validate_params()
        self.time_constants_ = seconds_array(self.time_constants)

    def names(self) -> list[str]:
        """``lag[900 s]``, ..."""
        return [f"lag[{time_text(tau)}]" for tau in self.time_constants_]

    def explained(self, temperature: str) -> str:
        """Meaning of a lag difference of the temperature."""
        return lag_text(temperature)

    def memory(self) -> float:
        """The longest time constant [s]."""
        return float(self.time_constants_.max(initial=0.0))

    def signals(self, x: Signals) -> Sequence[Any]:
        """Lag differences [K]."""
        return x.lag(x.T, self.time_constants_, self.hold)  # eq. (19)
