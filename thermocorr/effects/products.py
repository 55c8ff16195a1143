"""Products of lags, and of a lag with T, eq. (21)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from numbers import Integral
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Options

from ..records import Record
from .grids import time_grid
from .protocol import TEMPERATURE, Effect, EffectInfo, time_text
from .signals import Signals
from .thermal import HOLD, REFERENCE, column_text, lag_text, reference_of, seconds_array


class LagProducts(Effect):
    """Products Psi_j Psi_k of eq. (21), and of three lags.

    Parameters
    ----------
    time_constants, hold, initial_state, reference_temperature : see `ThermalLag`
    temperature_products : bool, default False
        Add (T - T0) Psi_j: the device follows later, or feels more, where it is warm; of the third order also
        (T - T0)^2 Psi_j and (T - T0) Psi_j Psi_k.
    order : {2, 3}
        3 adds the products Psi_j Psi_k Psi_l.
    """

    kind = "lag_products"
    is_product = True
    learned = {"time_constants_": "times", "reference_temperature_": "temperature", "temperature_name_": "column"}
    info = EffectInfo(
        physics="Heat flow inside the device bends the reading, or the device follows faster where it is warm: the "
        "dynamic law is not linear.",
        bench_check="Step the temperature up and down by the same amount, and by twice as much: the transients are not "
        "mirror images, and not twice as large.",
        formula="lag[a]*lag[b] = product of two lag differences; temperature*lag[a] = (T - T0) times one",
        parameters={"time_constants": "s", "reference_temperature": TEMPERATURE},
        tuned=("time_constants",),
        place=1.3,
    )
    _parameter_constraints = {
        "hold": HOLD,
        "reference_temperature": REFERENCE,
        "temperature_products": ["boolean"],
        "order": [Options(Integral, {2, 3})],
    }

    def __init__(
        self,
        time_constants: Sequence[Any] = (),
        hold: str = "first_order",
        reference_temperature: float | str = "mean",
        temperature_products: bool = False,
        order: int = 2,
    ):
        self.time_constants = time_constants
        self.hold = hold
        self.reference_temperature = reference_temperature
        self.temperature_products = temperature_products
        self.order = order

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """One lag squared and times T; then two lags."""
        times = time_grid(record, 2.0, 0.05)
        single: list[Effect] = [cls([tau], temperature_products=True) for tau in times]
        return single + [cls([a, b], temperature_products=True) for a, b in zip(times[:-3], times[3:], strict=True)]

    def learn(self, record: Record) -> None:
        """Convert time constants to seconds; fix T0."""
        self._validate_params()
        self.time_constants_ = seconds_array(self.time_constants)
        self.reference_temperature_ = reference_of(self.reference_temperature, record)
        self.temperature_name_ = record.temperature_name

    def names(self) -> list[str]:
        """``lag[60 s]*lag[900 s]``, ..., ``temperature*lag[60 s]``, ..."""
        lag = [f"lag[{time_text(tau)}]" for tau in self.time_constants_]
        T = column_text(self.temperature_name_)
        pairs = ["*".join(pair) for pair in combinations_with_replacement(lag, 2)]
        names = pairs + [f"{T}*{name}" for name in lag if self.temperature_products]
        if self.order == 3:
            names += ["*".join(three) for three in combinations_with_replacement(lag, 3)]
            if self.temperature_products:
                names += [f"{T}*{pair}" for pair in pairs] + [f"{T}^2*{name}" for name in lag]
        return names

    def explained(self, temperature: str) -> str:
        """Explanation of a lag difference: the names are products of these."""
        return lag_text(temperature)

    def units(self) -> list[str]:
        """K^2, and K^3 for products of three."""
        J = len(self.time_constants_)
        second = J * (J + 1) // 2 + (J if self.temperature_products else 0)
        return ["K^2"] * second + ["K^3"] * (self.n_columns() - second)

    def signals(self, x: Signals) -> Sequence[Any]:
        """Products of lag differences and T - T0 [K^2], [K^3]."""
        Psi = x.lag(x.T, self.time_constants_, self.hold)
        pairs = [one * other for one, other in combinations_with_replacement(Psi, 2)]  # eq. (21)
        deviation = x.T - self.reference_temperature_
        products = pairs + [deviation * d for d in Psi if self.temperature_products]  # eq. (21)
        if self.order == 3:
            products += [a * b * c for a, b, c in combinations_with_replacement(Psi, 3)]  # eq. (20)
            if self.temperature_products:
                products += [deviation * pair for pair in pairs] + [deviation * deviation * d for d in Psi]
        return products


class CoarseProducts(LagProducts):
    """Products of a few lags spread over the record."""

    def __init__(self, count: int = 5):
        super().__init__(temperature_products=True)
        self.count = count

    def learn(self, record: Record) -> None:
        """Spread the lags from four steps to a thirtieth of a segment."""
        step, span = record.usual_step(), record.longest_read()
        self.time_constants = np.geomspace(4 * step, max(span / 30, 8 * step), self.count).tolist()
        super().learn(record)
