"""Rates, delays and leads of the temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..equations import lag_differences
from ..records import Block, Record, seconds_of
from ..records.numbers import span_text
from .grids import time_grid
from .protocol import Effect, EffectInfo, time_text
from .signals import Signals
from .thermal import seconds_array


class Rate(Effect):
    """Rate of change dT/dt [K/s]: gradients, thermo-electric voltages.

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
        """The plain rate, and rates smoothed up to ten steps."""
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
    """Transport delay: T(t - d) - T(t) [K].

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
        """Delays from two steps to a hundredth of a segment."""
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


def rows_until(block: Block, ahead: float) -> Any:
    """A block's rows and those up to `ahead` seconds behind it."""
    record, until, stop = block.record, block.elapsed[-1] + ahead, block.stop
    last = record.segments[block.segment].stop
    while stop < last and not _reaches(block, record.kept(block.stop, stop), until):
        stop = min(stop + max(64, (stop - block.start) // 4), last)
    return record.kept(block.start, stop)


def _reaches(block: Block, rows: Any, until: float) -> bool:
    """True if the last of some rows is late enough."""
    some = rows.stop > rows.start if isinstance(rows, slice) else len(rows) > 0
    return some and elapsed(block, last_of(rows))[0] >= until


def last_of(rows: Any) -> Any:
    """The last of some rows, as rows."""
    return slice(rows.stop - 1, rows.stop) if isinstance(rows, slice) else rows[-1:]


def elapsed(block: Block, rows: Any) -> np.ndarray:
    """Seconds of rows since the segment of a block began."""
    return np.asarray(block.record.times.seconds(rows, block.segment_zero))


def temperatures(block: Block, rows: Any) -> np.ndarray:
    """Temperatures of rows of a block's record."""
    return np.asarray(block.record.columns[block.record.temperature_name][rows], float)


class Lead(Effect):
    """Reading ahead of its thermometer: T(t + d) - T(t) [K].

    The opposite of a `Delay`. T is a straight line between samples; after the last sample of a segment it stays as it
    was, so the last d seconds of what is transformed at once count as if the temperature stood still.

    A stream does not know what comes later, so there is no live correction with it and no C code; both refuse it. There
    are two ways out. Shift the column (on even steps ``X["temperature"].shift(-k)`` with k steps of lead), fit without
    this effect, and hold each reading back by the lead before it meets its temperature: corrections come late by the
    lead. Or, for a lead of a few steps, take `Rate`, its first-order form: T(t + d) - T(t) is nearly d dT/dt.

    Parameters
    ----------
    lead : float or time span
        d [s].
    time_constants : sequence, default ()
        The lead's own lags: where the device lags behind its air, its lags run ahead of the thermometer too.

    Raises
    ------
    ValueError
        By `learn`, for a lead that is not a positive time.
    """

    kind = "lead"
    unit = "K"
    thermal_rank = 5
    foresees = True
    instead = (
        "Hold each reading back until its temperature has come (shift the column, then fit without the effect), or "
        "take Rate() in its place."
    )
    learned = {"lead_": "positive", "time_constants_": "times"}
    info = EffectInfo(
        physics="The reading runs ahead of the thermometer: the thermometer is slow, sits deeper or farther from the "
        "air than the instrument, or the two clocks disagree; a lead of a few rows also where the room swings between "
        "rows (a thermostat), which a straight line from row to row does not show.",
        bench_check="Set both clocks by one; put a quick thermometer next to the recorded one and step the "
        "temperature: the reading moves with the quick one, before the recorded one does. Log the temperature five "
        "times as often: what too few rows made is gone.",
        formula="lead[d] = T(t + d) - T(t); lead[d] lag[tau] = a lag difference of it",
        parameters={"lead": "s", "time_constants": "s"},
        tuned=("lead",),
        example={"lead": 300.0},
        place=1.6,
    )

    def __init__(self, lead: Any, time_constants: Sequence[Any] = ()):
        self.lead = lead
        self.time_constants = time_constants

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Leads up to a hundredth of a segment, some with lags."""
        plain, lagged = (time_grid(record, 1.0, 0.01, ratio) for ratio in (2.5, 1.7))
        lags = time_grid(record, 4.0, 0.05, 6.0)[:3]
        return [*(cls(d) for d in plain), *(cls(d, lags) for d in lagged if lags)]

    def learn(self, record: Record) -> None:
        """Convert the lead and time constants to seconds."""
        self.lead_ = seconds_of(self.lead, "lead")
        self.time_constants_ = seconds_array(self.time_constants)

    def names(self) -> list[str]:
        """``lead[40 s]``, ``lead[40 s] lag[900 s]``, ..."""
        name = f"lead[{time_text(self.lead_)}]"
        return [name, *(f"{name} lag[{time_text(tau)}]" for tau in self.time_constants_)]

    def memory(self) -> float:
        """The longest time constant [s]."""
        return float(max(self.time_constants_, default=0.0))

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """T(t + d) - T(t) and its lags [K]."""
        rows = rows_until(block, self.lead_)
        T = temperatures(block, rows)
        ahead = np.interp(block.elapsed + self.lead_, elapsed(block, rows), T) - block.temperature
        if not len(self.time_constants_):
            return ahead, None
        lagged, state = lag_differences(ahead, block.steps, self.time_constants_, state)  # eq. (19)
        return np.column_stack((ahead, lagged)), state

    def label(self) -> str:
        """``lead: 40 s``."""
        return f"lead: {time_text(seconds_of(self.lead, 'lead'))}"

    def title(self) -> str:
        """``lead: 40 s``."""
        return f"lead: {span_text(seconds_of(self.lead, 'lead'))}"
