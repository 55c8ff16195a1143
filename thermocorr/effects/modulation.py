"""A sensitivity that follows late: one quantity times another one of a while ago."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..records import Record
from ..records.numbers import span_text
from .grids import time_grid
from .protocol import Effect, EffectInfo, suspects, time_text
from .signals import Signals
from .thermal import column_text, column_unit, seconds_array


class LaggedModulation(Effect):
    """A fast quantity times a slow one that acts late: (fast - its mean) (lagged slow - its mean).

    `Interaction` is the same without a lag, and `LagProducts` has the products of the temperature with its own lags.

    Parameters
    ----------
    fast : str, int or None, default None
        Column whose influence on the reading changes; None for the temperature.
    slow : str, int or None, default None
        Column that changes it, late; None for the temperature.
    time_constant : float or time span, default "6 h"
        How late [s].

    Raises
    ------
    ValueError
        By `learn`, for a time constant that is not a positive time, and where neither column is named.
    """

    kind = "lagged_modulation"
    is_product = True
    learned = {"time_constant_": "positive", "temperature_name_": "column", "means_": "numbers"}
    info = EffectInfo(
        physics="The sensitivity to one quantity depends on another one that acts late: moisture that is taken up "
        "changes the temperature coefficient, the inner temperature changes the influence of the supply.",
        bench_check="Step the slow quantity and measure the sensitivity to the fast one at once and much later: it "
        "creeps to its new value with the stated time constant.",
        formula="fast*slow[tau] = (fast less its mean) (lagged slow less the mean of slow), where "
        "tau d(lagged)/dt = slow - lagged",
        parameters={"time_constant": "s"},
        tuned=("time_constant",),
        example={"slow": "humidity", "time_constant": 21_600.0},
        place=2.3,
    )

    def __init__(self, fast: Any = None, slow: Any = None, time_constant: Any = "6 h"):
        self.fast = fast
        self.slow = slow
        self.time_constant = time_constant

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """The temperature by each suspect column late, and each by the temperature late.

        Time constants go from 20 steps (shorter ones are `Interaction` by another name) to a tenth of the longest
        segment.
        """
        times = time_grid(record, 20.0, 0.1, 5.0)
        pairs = [pair for name in suspects(record, columns) for pair in ((None, name), (name, None))]
        return [cls(fast, slow, tau) for fast, slow in pairs for tau in times]

    def inputs(self) -> list[Any]:
        """The columns besides the temperature."""
        return list(dict.fromkeys(name for name in (self.fast, self.slow) if name is not None))

    def learn(self, record: Record) -> None:
        """Fix both means; convert the time constant to seconds."""
        if not self.inputs():
            raise ValueError(
                "LaggedModulation needs a column as 'fast' or 'slow'. For products of the temperature with its own "
                "lags take LagProducts(..., temperature_products=True)."
            )
        self.time_constant_ = float(seconds_array([self.time_constant])[0])
        self.temperature_name_ = record.temperature_name
        self.means_ = [float(record.moments(self._name(given)).mean) for given in (self.fast, self.slow)]

    def _name(self, given: Any) -> Any:
        return self.temperature_name_ if given is None else given

    def names(self) -> list[str]:
        """``temperature*humidity[21600 s]``."""
        fast, slow = (column_text(self._name(given)) for given in (self.fast, self.slow))
        return [f"{fast}*{slow}[{time_text(self.time_constant_)}]"]

    def units(self) -> list[str]:
        """K for the temperature, times the column's unit where its name tells it, else "unit"."""
        return [" ".join("K" if given is None else column_unit(given) for given in (self.fast, self.slow)).strip()]

    def means(self) -> dict[str, float]:
        """Means of both quantities."""
        names = (column_text(self._name(given)) for given in (self.fast, self.slow))
        return dict(zip(names, self.means_, strict=True))

    def signals(self, x: Signals) -> Sequence[Any]:
        """Product of the fast quantity and the lagged slow one, both less their means."""
        fast, slow = (x.T if given is None else x[given] for given in (self.fast, self.slow))
        late = slow + x.lag(slow, [self.time_constant_])[0]  # eq. (19): lagged = slow + its difference
        return [(fast - self.means_[0]) * (late - self.means_[1])]

    def label(self) -> str:
        """``lagged modulation: temperature by humidity, 21600 s late``."""
        return self._named(time_text)

    def title(self) -> str:
        """``lagged modulation: temperature by humidity, 6 h late``."""
        return self._named(span_text)

    def _named(self, said: Callable[[float], str]) -> str:
        fast, slow = ("temperature" if given is None else str(given) for given in (self.fast, self.slow))
        return f"lagged modulation: {fast} by {slow}, {said(float(seconds_array([self.time_constant])[0]))} late"
