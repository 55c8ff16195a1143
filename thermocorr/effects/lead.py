"""A reading that leads its thermometer, and a thermometer's noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..equations import lag_differences
from ..records import Block, Record, seconds_of
from ..records.numbers import span_text
from .grids import time_grid
from .protocol import Effect, EffectInfo, time_text
from .thermal import seconds_array


def rows_until(block: Block, ahead: float) -> Any:
    """Rows of a block and of what follows it in its segment, until at least `ahead` seconds beyond its last row."""
    record, until, stop = block.record, block.elapsed[-1] + ahead, block.stop
    last = record.segments[block.segment].stop
    while stop < last and not _reaches(block, record.kept(block.stop, stop), until):
        stop = min(stop + max(64, (stop - block.start) // 4), last)
    return record.kept(block.start, stop)


def _reaches(block: Block, rows: Any, until: float) -> bool:
    """True if the last of some rows is late enough; none are not."""
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
    """The reading runs ahead of the thermometer: T(t + d) - T(t) [K], the temperature of later less that of now.

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
        """Leads from one step to a hundredth of the longest segment, without lags and with three from fast to slow."""
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
        """Temperature of later less that of now, and its lags [K]; looks beyond the block, to its segment's end."""
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
