"""Several steps: something switches the reading to and fro, or shifts it again and again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..records import Record
from .grids import time_quantiles
from .protocol import SINCE_START, Effect, EffectInfo
from .signals import Signals
from .time import Step


class SeveralSteps(Effect):
    """Jumps that stay, each with a height of its own: 0 before a moment, 1 from then on.

    Parameters
    ----------
    times : sequence of float, time span or date
        The moments, see `Step`.
    removed_by_correct : bool, default False
        Whether `correct` takes the steps away, see `Drift`.

    Raises
    ------
    ValueError
        By `learn`, for what is no time, or a date where the record has none.
    """

    kind = "several_steps"
    of_time_alone = True
    tried = False
    learned = {"seconds_": "numbers", "moments_": "texts"}
    info = EffectInfo(
        physics="Something switches: a loose contact, a relay, a control loop with two states, or somebody who moves "
        "or touches the instrument again and again. Or the runs of a log are at levels of their own "
        "(run_offset='each').",
        bench_check="Log what switches in the room and in the instrument; tap contacts and cables; see whether the "
        "jumps go to and fro between the same levels.",
        formula="step[t] = 0 before t, 1 from t on, one for each moment",
        parameters={"times": SINCE_START},
        example={"times": ("1 h", "3 h", "4 h")},
        place=3.35,
    )
    _parameter_constraints = {"times": ["array-like"], "removed_by_correct": ["boolean"]}

    def __init__(self, times: Sequence[Any] = (), removed_by_correct: bool = False):
        self.times = times
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Steps at even thirds of the rows. Others are put together from steps that were found one by one."""
        times = time_quantiles(record, (1 / 3, 2 / 3))
        return [cls([float(time) for time in times])] if 0 < times[0] < times[1] else []

    def learn(self, record: Record) -> None:
        """Convert the moments to seconds since the record began, and to dates where there are dates."""
        self._validate_params()
        steps = [Step(time) for time in self.moments(record)]
        for step in steps:
            step.learn(record)
        self.seconds_ = [step.seconds_ for step in steps]
        self.moments_ = [step.moment_ for step in steps]

    def moments(self, record: Record) -> list[Any]:
        """The moments, before they are seconds."""
        return list(self.times)

    def names(self) -> list[str]:
        """``step[2024-03-05 00:00:00]``, ..."""
        return [f"step[{moment}]" for moment in self.moments_]

    def signals(self, x: Signals) -> Sequence[Any]:
        """0 before, 1 from each moment on."""
        return [x.where(x.seconds >= seconds, 1.0, 0.0) for seconds in self.seconds_]

    def label(self) -> str:
        """``several steps: 3``."""
        return f"several steps: {len(self.times)}"
