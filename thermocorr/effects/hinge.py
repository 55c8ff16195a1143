"""Hinges: a law that changes at one temperature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.utils._param_validation import Interval, StrOptions

from ..records import Record
from ..records.numbers import span_text
from .grids import temperature_quantiles, time_grid
from .protocol import TEMPERATURE, Effect, EffectInfo, time_text
from .signals import Signals
from .thermal import seconds_array


class Hinge(Effect):
    """max(T - knee, 0) or min(T - knee, 0) [K], and its lags.

    The column is that less its value at the reference temperature T0, so that U0 stays the reading at T0.

    Given a model that holds T, one side says as much as the other, since they add up to T - knee; given one that
    holds the lags of T the same is true of the lagged sides.

    Parameters
    ----------
    knee : float
        In the unit of the temperature.
    side : {"above", "below"}, default "above"
        Where the column moves; on the other side it stays the same.
    time_constants : sequence, default ()
        [s], or spans such as "15 min": lag differences of that column, eq. (19) with it in place of T, for a part of
        the device (or of the ground) that follows late and only there.
    hold : {"first_order", "zero_order"}, default "first_order"
        See `ThermalLag`.

    Raises
    ------
    ValueError
        By `learn`, for a parameter outside its range.
    """

    kind = "hinge"
    unit = "K"
    learned = {"time_constants_": "times", "reference_temperature_": "temperature"}
    info = EffectInfo(
        physics="Freezing, condensation, a clamp that opens or a sensor that saturates changes the law at one "
        "temperature.",
        bench_check="Ramp slowly through the knee: the slope of the reading changes there, in both directions, and "
        "nowhere else.",
        formula="max(T-knee) = T - knee above the knee and 0 below; min(T-knee) the other way round; with lags as T",
        parameters={"knee": TEMPERATURE, "time_constants": "s"},
        tuned=("time_constants",),
        place=4.1,
    )
    _parameter_constraints = {
        "knee": [Interval(Real, None, None, closed="neither")],
        "side": [StrOptions({"above", "below"})],
        "hold": [StrOptions({"first_order", "zero_order"})],
    }

    def __init__(self, knee: float, side: str = "above", time_constants: Sequence[Any] = (), hold: str = "first_order"):
        self.knee = knee
        self.side = side
        self.time_constants = time_constants
        self.hold = hold

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Knees from 5 % to 95 % of the temperatures, then lagged ones."""
        quantiles = temperature_quantiles(record, np.linspace(0.05, 0.95, 13))
        even = np.linspace(quantiles[0], quantiles[-1], 16)  # where a chamber dwells, quantiles leave wide gaps
        zero = {0.0} if quantiles[0] < 0 < quantiles[-1] else set()
        static = {float(f"{knee:.4g}") for knee in (*quantiles, *even)} | zero
        lagged = {float(f"{knee:.4g}") for knee in (*quantiles[::2], *even[::3])} | zero
        lags = time_grid(record, 5.0, 0.1, 4.0)
        first: list[Effect] = [cls(knee) for knee in sorted(static)]
        return first + [cls(knee, "above", [tau]) for knee in sorted(lagged) for tau in lags]

    def nearby(self, record: Record, share: float = 0.25) -> list[Effect]:
        """Knees moved by `share` of a tenth of the range, scaled lags.

        As among the candidates, a twentieth of the temperatures stays on either side: of fewer the law is not known.
        """
        low, high = temperature_quantiles(record, (0.05, 0.95))
        away = share * (high - low) / 10
        moved = [max(self.knee - away, min(low, self.knee)), min(self.knee + away, max(high, self.knee))]
        knees = [clone(self).set_params(knee=float(knee)) for knee in moved if knee != self.knee]
        return knees + super().nearby(record, share)

    def learn(self, record: Record) -> None:
        """Check parameters; learn T0 and the lags."""
        self._validate_params()
        self.time_constants_ = seconds_array(self.time_constants)
        self.reference_temperature_ = record.moments(record.temperature_name).mean

    def refer_to(self, temperature: float) -> None:
        """Take the T0 of the model."""
        self.reference_temperature_ = temperature

    def _at_rest(self) -> float:
        """The hinge at T0 [K]."""
        return float((max if self.side == "above" else min)(self.reference_temperature_ - self.knee, 0.0))

    def names(self) -> list[str]:
        """``max(T-0)``, ``max(T-0) lag[3600 s]``, ..."""
        name = f"{'max' if self.side == 'above' else 'min'}(T{-float(self.knee):+.6g})"
        return [name, *(f"{name} lag[{time_text(tau)}]" for tau in self.time_constants_)]

    def terms(self) -> list[str]:
        """``max(T-22)`` less its value at T0: ``(max(T-22) - 1)``, ..."""
        first, *lags = self.names()
        at_rest = self._at_rest()
        return [f"({first} {'-' if at_rest > 0 else '+'} {abs(at_rest):.10g})" if at_rest else first, *lags]

    def signals(self, x: Signals) -> Sequence[Any]:
        """The hinge less its value at T0, and its lags [K]."""
        clip = x.maximum if self.side == "above" else x.minimum
        hinge = clip(x.T - self.knee, 0.0)
        lags = x.lag(hinge, self.time_constants_, self.hold) if len(self.time_constants_) else ()
        return [hinge - self._at_rest(), *lags]

    def label(self) -> str:
        """``hinge: above 0``, ``hinge: above 0, lag 3600 s``."""
        return self._named(time_text)

    def title(self) -> str:
        """``hinge: above 0, lag 1 h``."""
        return self._named(span_text)

    def _named(self, said: Callable[[float], str]) -> str:
        times = [said(tau) for tau in seconds_array(self.time_constants)]
        return f"hinge: {self.side} {self.knee:.6g}" + (f", lag {', '.join(times)}" if times else "")
