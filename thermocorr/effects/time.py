"""Effects of time alone: drift, ageing, steps.

Time counts from the first row of the fitted record and runs on through its continuation. Drift and ageing are centred
on the fitted rows, so that U0 stays the reading of the record's middle; the coefficients do not depend on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import clone

from ..records import Record, seconds_of
from .grids import MOMENT, mean_seconds, moment_text, shown, since_start, time_grid, time_quantiles
from .protocol import SINCE_START, Effect, EffectInfo, time_text
from .signals import BlockSignals, Signals
from .thermal import column_text

DAY = 86_400.0
"""Seconds of a day: drifts are quoted per day."""
_STEP_TIMES = 48


class Drift(Effect):
    """Linear ageing: time [d], less its mean over the fitted rows.

    Parameters
    ----------
    removed_by_correct : bool, default False
        Whether `correct` takes the drift away. By default it stays: a change with time alone can be the very thing to
        be measured, such as the drift of a standard, and nothing in a record tells the two apart.
    """

    kind = "drift"
    unit = "d"
    of_time_alone = True
    learned = {"centre_": "number"}
    info = EffectInfo(
        physics="The instrument or the standard ages at a steady rate.",
        bench_check="Compare with a second standard of known history at the beginning and at the end, at the same "
        "temperature: the difference has grown by the rate times the time between.",
        formula="drift = time since the fitted record began [d], less its mean",
        place=3.0,
    )
    _parameter_constraints = {"removed_by_correct": ["boolean"]}

    def __init__(self, removed_by_correct: bool = False):
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """A single one: no parameter has to be tried."""
        return [cls()]

    def learn(self, record: Record) -> None:
        """Fix the centre [s]."""
        self._validate_params()
        self.centre_ = mean_seconds(record)

    def names(self) -> list[str]:
        """``drift``."""
        return ["drift"]

    def means(self) -> dict[str, float]:
        """Mean of the time."""
        return {"time [d]": self.centre_ / DAY}

    def signals(self, x: Signals) -> Sequence[Any]:
        """Time since the centre of the fitted record [d]."""
        return [(x.seconds - self.centre_) / DAY]


class LogAgeing(Effect):
    """Settling: log(1 + t/t0), less its mean.

    This is the law by which MIL-PRF-55310 extrapolates the ageing of crystal oscillators, A ln(B t + 1), t0 = 1/B.
    Rows before the fitted record have t = 0.

    Parameters
    ----------
    onset : float or time span, default 86400
        t0 [s]: before it the ageing looks linear, after it logarithmic.
    removed_by_correct : bool, default False
        Whether `correct` takes the ageing away, see `Drift`.

    Raises
    ------
    ValueError
        By `learn`, for an onset that is not a positive time.
    """

    kind = "log_ageing"
    of_time_alone = True
    learned = {"onset_": "positive", "mean_": "number"}
    info = EffectInfo(
        physics="Stress relaxes and adhesives creep at ever slower rates after assembly, transport or switching on.",
        bench_check="Disturb the instrument again (transport, power cycle, a large temperature excursion): the same "
        "fast-then-slow change starts anew.",
        formula="log ageing[t0] = log(1 + t/t0) with t since the fitted record began, less its mean",
        parameters={"onset": "s"},
        tuned=("onset",),
        place=3.1,
    )
    _parameter_constraints = {"removed_by_correct": ["boolean"]}

    def __init__(self, onset: Any = DAY, removed_by_correct: bool = False):
        self.onset = onset
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Onsets from ten steps to half of the longest segment."""
        return [cls(t0) for t0 in time_grid(record, 10.0, 0.5, 3.0)]

    def learn(self, record: Record) -> None:
        """Convert the onset to seconds; fix the mean."""
        self._validate_params()
        self.onset_ = seconds_of(self.onset, "onset")
        logarithms = (self._logarithm(BlockSignals(block, None)) for block in record.blocks())
        self.mean_ = sum(float(part.sum()) for part in logarithms) / record.n_used

    def _logarithm(self, x: Signals) -> Any:
        return x.log1p(x.maximum(x.seconds, 0.0) / self.onset_)

    def names(self) -> list[str]:
        """``log ageing[86400 s]``."""
        return [f"log ageing[{time_text(self.onset_)}]"]

    def means(self) -> dict[str, float]:
        """Mean of the logarithm."""
        return {f"log(1 + t/{time_text(self.onset_)})": self.mean_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """log(1 + t/t0) less its mean."""
        return [self._logarithm(x) - self.mean_]


class SensitivityDrift(Effect):
    """Ageing temperature coefficient: t (T - T0) [K d], centred.

    The static coefficient keeps its meaning: it is that of the middle of the fitted record.
    """

    kind = "sensitivity_drift"
    unit = "K d"
    is_product = True
    learned = {"centre_": "number", "reference_temperature_": "temperature", "temperature_name_": "column"}
    info = EffectInfo(
        physics="The temperature coefficient itself changes with time, as glue, solder or a compensation ages.",
        bench_check="Measure the temperature coefficient by the same temperature cycle before and after: it differs.",
        formula="drift*temperature = (time [d] less its mean) * (T less its mean)",
        place=3.2,
    )

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """A single one: no parameter has to be tried."""
        return [cls()]

    def learn(self, record: Record) -> None:
        """Fix the centres of time [s] and temperature."""
        self.centre_ = mean_seconds(record)
        self.reference_temperature_ = record.moments(record.temperature_name).mean
        self.temperature_name_ = record.temperature_name

    def names(self) -> list[str]:
        """``drift*temperature``."""
        return [f"drift*{column_text(self.temperature_name_)}"]

    def means(self) -> dict[str, float]:
        """Means of the time and of the temperature."""
        of_temperature = {column_text(self.temperature_name_): self.reference_temperature_}
        return {"time [d]": self.centre_ / DAY, **of_temperature}

    def signals(self, x: Signals) -> Sequence[Any]:
        """Time times temperature [K d]."""
        return [(x.seconds - self.centre_) / DAY * (x.T - self.reference_temperature_)]


class Step(Effect):
    """A jump that stays: 0 before a moment, then 1.

    Parameters
    ----------
    time : float, time span or date
        The moment: seconds (or a span such as "3 days") since the fitted record began, or a date where the record has
        dates. The column is constant, and does nothing, if it lies outside the fitted record.
    removed_by_correct : bool, default False
        Whether `correct` takes the step away, see `Drift`. Pass True for a change of the instrument (a replaced part,
        another range).

    Raises
    ------
    ValueError
        By `learn`, for what is no time, or a date where the record has none.
    """

    kind = "step"
    of_time_alone = True
    learned = {"seconds_": "number", "moment_": "text"}
    info = EffectInfo(
        physics="A shock, a change of range or a replaced part moved the reading once and for all.",
        bench_check="Look in the laboratory's log book at that moment; repeat the suspected action and see the reading "
        "jump at constant temperature.",
        formula="step[t] = 0 before t, 1 from t on",
        parameters={"time": SINCE_START},
        place=3.3,
    )
    _parameter_constraints = {"time": MOMENT, "removed_by_correct": ["boolean"]}

    def __init__(self, time: Any, removed_by_correct: bool = False):
        self.time = time
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """The starts of segments, and quantiles of time."""
        starts = [record.times.between(record.stamp(s.start), record.first_stamp()) for s in record.segments[1:]]
        shares = np.linspace(0.0, 1.0, _STEP_TIMES + 2)[1:-1]
        times = {float(t) for t in (*starts, *time_quantiles(record, shares)) if t > 0}
        return [cls(t) for t in sorted(times)]

    def nearby(self, record: Record, share: float = 0.25) -> list[Effect]:
        """Moments `share` of the way to the next candidate."""
        moment, reach = since_start(self.time, record), share * record.longest_read() / (_STEP_TIMES + 1)
        return [clone(self).set_params(time=moment + side * reach) for side in (-1, 1)]

    def learn(self, record: Record) -> None:
        """Convert the moment to seconds and a date."""
        self._validate_params()
        self.seconds_ = since_start(self.time, record, effect=type(self).__name__)
        self.moment_ = moment_text(self.seconds_, record)

    def names(self) -> list[str]:
        """``step[86400 s]`` or ``step[2024-03-05 00:00:00]``."""
        return [f"step[{self.moment_}]"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """0 before, 1 from the moment on."""
        return [x.where(x.seconds >= self.seconds_, 1.0, 0.0)]

    def label(self) -> str:
        """``step: 2024-03-05 00:00:00``."""
        return f"{self.kind.replace('_', ' ')}: {getattr(self, 'moment_', shown(self.time))}"
