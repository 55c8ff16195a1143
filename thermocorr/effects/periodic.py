"""Unrecorded periodic causes: harmonics of a period."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

from sklearn.utils._param_validation import Interval

from ..records import Record, seconds_of
from ..records.numbers import span_text
from .protocol import Effect, EffectInfo, time_text
from .signals import Signals

_USUAL_PERIODS = {3_600.0: 3, 44_714.16: 1, 86_400.0: 2, 604_800.0: 4}
"""Periods [s] that instruments meet, with the harmonics to try: an hour, the lunar tide, a day, a week."""


class Periodic(Effect):
    """Harmonics of a period: sin and cos of 2 pi h t/period, h = 1..harmonics.

    Their phase counts from absolute time (UTC for dates with a zone), so that a later record continues it.

    Parameters
    ----------
    period : float or time span, default 86400
        [s].
    harmonics : int, default 2
        How many multiples of the fundamental frequency.
    removed_by_correct : bool, default True
        Whether `correct` takes it away. Pass False where the period is what is measured, such as a tide.

    Raises
    ------
    ValueError
        By `learn`, for a period that is not a positive time, or fewer than one harmonic.
    """

    kind = "periodic"
    of_time_alone = True
    learned = {"period_": "positive"}
    info = EffectInfo(
        physics="Sun, air conditioning, mains load or tides act with a fixed period and were not recorded.",
        bench_check="Log the suspected cause too (light, mains voltage, the fan's switch), or move the instrument "
        "where it is absent: the wave is gone.",
        formula="sin[p], cos[p] = sin and cos of 2 pi t/p with t in absolute time",
        parameters={"period": "s"},
        tuned=("period",),
        place=4.2,
    )
    _parameter_constraints = {
        "harmonics": [Interval(Integral, 1, 10_000, closed="both")],
        "removed_by_correct": ["boolean"],
    }

    def __init__(self, period: Any = 86_400.0, harmonics: int = 2, removed_by_correct: bool = True):
        self.period = period
        self.harmonics = harmonics
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """An hour, the lunar tide, a day and a week.

        Other periods come from the spectrum of a residual.
        """
        shortest, longest = 10.0 * record.usual_step(), record.longest_read() / 3.0
        return [cls(period, h) for period, h in _USUAL_PERIODS.items() if shortest <= period <= longest]

    def learn(self, record: Record) -> None:
        """Convert the period to seconds."""
        self._validate_params()
        self.period_ = seconds_of(self.period, "period")

    def names(self) -> list[str]:
        """``sin[86400 s]``, ``cos[86400 s]``, ``sin[43200 s]``, ..."""
        periods = [time_text(self.period_ / h) for h in range(1, self.harmonics + 1)]
        return [f"{wave}[{period}]" for period in periods for wave in ("sin", "cos")]

    def signals(self, x: Signals) -> Sequence[Any]:
        """Harmonics; the higher ones by the addition theorem."""
        sine, cosine = x.wave(self.period_)
        waves = [sine, cosine]
        for _ in range(1, self.harmonics):
            s, c = waves[-2:]
            waves += [s * cosine + c * sine, c * cosine - s * sine]
        return waves

    def label(self) -> str:
        """``periodic: 86400 s``."""
        return f"periodic: {time_text(seconds_of(self.period, 'period'))}"

    def title(self) -> str:
        """``periodic: 1 d``."""
        return f"periodic: {span_text(seconds_of(self.period, 'period'))}"
