"""Effects of how fast the temperature moves and of when it arrives: rate and transport delay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..records import Record, seconds_of
from ..records.numbers import span_text
from .grids import time_grid
from .protocol import Effect, EffectInfo, time_text
from .signals import Signals


class Rate(Effect):
    """Rate of change dT/dt [K/s]: gradients and thermo-electric voltages that settle faster than the sampling.

    Without smoothing it is the difference to the sample before, over the time between them: 0 where a segment begins.
    Differences amplify the noise of the thermometer. With a `time_constant` the rate is seen through one lag, which
    is exact and costs nothing: d(lagged)/dt = (T - lagged)/tau, eq. (17), so the column is ``-lag[tau] / tau``. For
    long time constants that is the same cause as `ThermalLag`.

    Parameters
    ----------
    time_constant : float or time span, optional
        Smooth the rate with this lag [s]; None takes the plain difference.

    Raises
    ------
    ValueError
        By `learn`, for a time constant that is not a positive time.
    """

    kind = "rate"
    unit = "K/s"
    thermal_rank = 3
    learned = {"time_constant_": "positive or None"}
    info = EffectInfo(
        physics="Gradients inside the instrument, and the thermo-electric voltages they make, follow the rate of "
        "change of the temperature.",
        bench_check="Ramp the temperature up and down at two known rates: the reading is off by an amount that is "
        "proportional to the rate and changes sign with it, and the offset is gone on the plateau.",
        formula="rate = (T - T of the sample before) / (time between them)",
        parameters={"time_constant": "s"},
        tuned=("time_constant",),
        place=1.4,
    )

    def __init__(self, time_constant: Any = None):
        self.time_constant = time_constant

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """The plain rate, and smoothed ones up to ten steps: beyond that it is a thermal lag by another name."""
        step = record.usual_step()
        return [cls(), *(cls(tau) for tau in time_grid(record, 2.5, 1.0, 2.0, limit=10.0 * step))]

    def learn(self, record: Record) -> None:
        """Convert the time constant to seconds."""
        self.time_constant_ = None if self.time_constant is None else seconds_of(self.time_constant, "time_constant")

    def names(self) -> list[str]:
        """``rate`` or ``rate[120 s]``."""
        return ["rate" if self.time_constant_ is None else f"rate[{time_text(self.time_constant_)}]"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """Rate [K/s]."""
        tau = self.time_constant_
        if tau is None:
            return [x.change_rate(x.T)]
        return [x.lag(x.T, [tau])[0] / -tau]  # eq. (17): d(lagged)/dt


class Delay(Effect):
    """Transport delay: T(t - d) - T(t) [K], the temperature of a while ago less that of now.

    T is a straight line between samples; before a segment began it was that of the first sample.

    Parameters
    ----------
    delay : float or time span
        d [s].

    Raises
    ------
    ValueError
        By `learn`, for a delay that is not a positive time.
    """

    kind = "delay"
    unit = "K"
    thermal_rank = 2
    learned = {"delay_": "positive"}
    info = EffectInfo(
        physics="Air, water or a heat front takes a fixed time from the thermometer to the device; what a thermometer "
        "hides that is slow by a few samples can look like it.",
        bench_check="Step the temperature at the thermometer: the reading stays where it is for the delay, and only "
        "then moves, at once; move the thermometer next to the device and the delay is gone.",
        formula="delay[d] = T(t - d) - T(t)",
        parameters={"delay": "s"},
        tuned=("delay",),
        example={"delay": 1200.0},
        place=1.5,
    )

    def __init__(self, delay: Any):
        self.delay = delay

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Delays from two steps (one step is the rate by another name) to a hundredth of the longest segment."""
        return [cls(d) for d in time_grid(record, 2.0, 0.01, 1.5)]

    def learn(self, record: Record) -> None:
        """Convert the delay to seconds."""
        self.delay_ = seconds_of(self.delay, "delay")

    def names(self) -> list[str]:
        """``delay[600 s]``."""
        return [f"delay[{time_text(self.delay_)}]"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """Delayed temperature less the present one [K]."""
        return [x.delayed(x.T, self.delay_) - x.T]

    def label(self) -> str:
        """``delay: 600 s``."""
        return f"delay: {time_text(seconds_of(self.delay, 'delay'))}"

    def title(self) -> str:
        """``delay: 10 min``."""
        return f"delay: {span_text(seconds_of(self.delay, 'delay'))}"
