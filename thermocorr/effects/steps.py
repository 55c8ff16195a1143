"""Effects with a date: steps, new sensitivities, events, disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import clone

from ..records import Record, RecordError
from ..records.errors import quoted
from .grids import MOMENT, moment_text, shown, since_start, time_quantiles
from .protocol import SINCE_START, Effect, EffectInfo
from .signals import Signals
from .thermal import column_text
from .time import Step

MOST = 1000
"""Events, of which each has a level of its own."""


class SeveralSteps(Effect):
    """Jumps that stay, each with its own height.

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
        "or touches the instrument again and again.",
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
        """Steps at thirds of the rows."""
        times = time_quantiles(record, (1 / 3, 2 / 3))
        return [cls([float(time) for time in times])] if 0 < times[0] < times[1] else []

    def learn(self, record: Record) -> None:
        """Convert moments to seconds since the start, and dates."""
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


class SensitivityStep(Step):
    """Another static law from a moment on.

    The static coefficients keep their meaning: they are those of the law before the moment. `Step` is the same without
    a change of the sensitivity, `SensitivityDrift` a sensitivity that changes slowly.

    Parameters
    ----------
    time : float, time span or date
        The moment, see `Step`.
    removed_by_correct : bool, default True
        Whether `correct` takes the change away. It does by default, unlike a `Step`: what is measured has no
        sensitivity to the instrument's temperature, so that the instrument itself has changed.

    Raises
    ------
    ValueError
        By `learn`, for what is no time, or a date where the record has none.
    """

    kind = "sensitivity_step"
    learned = {**Step.learned, "reference_temperature_": "temperature", "temperature_name_": "column"}
    info = EffectInfo(
        physics="The instrument was repaired, readjusted, reloaded or damaged: from then on it has another law, offset "
        "and sensitivity to temperature alike.",
        bench_check="Look in the laboratory's log book at that moment; measure the temperature coefficient anew and "
        "compare it with that of the time before.",
        formula="change[t] = 0 before t, 1 from t on; change[t]*temperature = the same times (T less its mean)",
        parameters={"time": SINCE_START},
        example={"time": "2 days"},
        place=3.4,
    )

    def __init__(self, time: Any, removed_by_correct: bool = True):
        super().__init__(time, removed_by_correct)

    def learn(self, record: Record) -> None:
        """Convert the moment to seconds and a date; fix T0."""
        super().learn(record)
        self.reference_temperature_ = record.moments(record.temperature_name).mean
        self.temperature_name_ = record.temperature_name

    def names(self) -> list[str]:
        """``change[2024-03-05 00:00:00]``, ``change[2024-03-05 00:00:00]*temperature``."""
        name = f"change[{self.moment_}]"
        return [name, f"{name}*{column_text(self.temperature_name_)}"]

    def units(self) -> list[str]:
        """None, and K."""
        return ["", "K"]

    def means(self) -> dict[str, float]:
        """Mean of the temperature."""
        return {column_text(self.temperature_name_): self.reference_temperature_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """0 before; 1 and T - T0 from the moment on."""
        later = x.seconds >= self.seconds_
        return [x.where(later, 1.0, 0.0), x.where(later, x.T - self.reference_temperature_, 0.0)]


class Events(SeveralSteps):
    """Steps of the measurand, which `correct` keeps.

    The lags go on through an event: the device does not know of it.

    Parameters
    ----------
    times : sequence of float, time span or date
        The moments, see `Step`.
    column : str or int, optional
        A recorded column that is 1 in the row where an event happens and 0 elsewhere; ones that follow one another are
        one event. It is read where the model is fitted; later rows need it too.
    removed_by_correct : bool, default False
        Whether `correct` takes the levels away.

    Raises
    ------
    RecordError
        By `learn`, for a column that holds anything but 0 and 1, and for more than 1000 events.

    Examples
    --------
    A load cell that was loaded in row 400: the corrected reading keeps the load.

    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.datasets import make_record
    >>> from thermocorr.effects import Events
    >>> record = make_record(4000, seed=1)
    >>> loaded = record["reading"] + 5.0 * (record.index >= record.index[400])
    >>> model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], effects=[Events([record.index[400]])])
    >>> corrected = model.fit(record[["temperature"]], loaded).correct(record[["temperature"]], loaded)
    >>> bool(abs(corrected[400:].mean() - corrected[:400].mean() - 5.0) < 0.05)
    True
    """

    kind = "events"
    learned = SeveralSteps.learned
    info = EffectInfo(
        physics="Somebody or something stepped what is measured: a load was put on, a reference was exchanged.",
        bench_check="Look in the laboratory's log book at these moments; at constant temperature the reading stays at "
        "its new level.",
        formula="step[t] = 0 before t, 1 from t on, one for each event",
        parameters={"times": SINCE_START},
        example={"times": ("2 h", "3 h")},
        place=3.36,
    )

    def __init__(self, times: Sequence[Any] = (), column: Any = None, removed_by_correct: bool = False):
        super().__init__(times, removed_by_correct)
        self.column = column

    def inputs(self) -> list[Any]:
        """The column of events."""
        return [] if self.column is None else [self.column]

    def moments(self, record: Record) -> list[Any]:
        """The moments given, and those that the column has."""
        found = list(self.times)
        if self.column is not None:
            found += self._marked(record)
        if len(found) > MOST:
            raise RecordError(
                f"There are {len(found)} events, and {MOST} are the most. A column that goes to and fro is no list of "
                "events: take it as Covariate."
            )
        return found

    def _marked(self, record: Record) -> list[float]:
        """Moments at which the column becomes 1 [s]."""
        if record.order is not None:
            raise RecordError(
                f"The column of events {quoted(self.column)} stands in runs that overlap in time, and an event would "
                "step them all. Fit a model for each run."
            )
        rows = slice(record.segments[0].start, record.segments[-1].stop)
        marks = np.asarray(record.columns[self.column][rows], float)
        blank, seconds = np.isnan(marks), record.times.seconds(rows, record.first_stamp())
        wrong = ~(blank | np.isin(marks, (0.0, 1.0)))
        if wrong.any() or blank.sum() > len(marks) / 2:
            row = int(np.argmax(wrong if wrong.any() else blank))
            shown = "a blank" if blank[row] else f"{marks[row]:.6g}"
            raise RecordError(
                f"The column of events {quoted(self.column)} must hold 0 and 1 in every row. Got {shown} at "
                f"{seconds[row]:.6g} s since the record began."
            )
        known = np.where(blank, 0.0, marks)
        begins = np.flatnonzero((known == 1.0) & (np.concatenate(([0.0], known[:-1])) == 0.0))
        return [float(moment) for moment in seconds[begins] if moment > 0]

    def label(self) -> str:
        """``events: 3``."""
        return f"events: {len(getattr(self, 'seconds_', self.times))}"


_STARTS = (0.2, 0.4, 0.6, 0.8)


class Disturbance(Effect):
    """A constant error from `start` to `end`.

    The stretch's level no longer bends any other coefficient. Readings that are worthless altogether, not merely off,
    are better left out of the fit: ``y.loc[start:end] = numpy.nan``.

    Parameters
    ----------
    start, end : float, time span or date
        The stretch, `end` itself not in it, written as in `Step`.
    removed_by_correct : bool, default True
        Whether `correct` puts the readings of the stretch right. It does by default: a shift that goes away as it came
        is no property of a standard. What was measured might have moved to and fro, though: then pass False.

    Raises
    ------
    ValueError
        By `learn`, for what is no time, a date where the record has none, and an end that is not after the start.
    """

    kind = "disturbance"
    of_time_alone = True
    learned = {"seconds_": "numbers", "moments_": "texts"}
    info = EffectInfo(
        physics="Something disturbed the instrument for a while: a visitor, a draught, a load, a radio, a contact that "
        "came loose and was put right.",
        bench_check="Look in the laboratory's log book at that stretch; repeat what was done then and see the reading "
        "move and come back at constant temperature.",
        formula="disturbance[a, b] = 1 from a to b, else 0",
        parameters={"start": SINCE_START, "end": SINCE_START},
        example={"start": "2 days", "end": "51 h"},
        place=3.36,
    )
    _parameter_constraints = {"start": MOMENT, "end": MOMENT, "removed_by_correct": ["boolean"]}

    def __init__(self, start: Any, end: Any, removed_by_correct: bool = True):
        self.start = start
        self.end = end
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Four stretches of a fiftieth of the rows."""
        starts = time_quantiles(record, _STARTS)
        # Each candidate lasts for 2 % of the rows.
        ends = time_quantiles(record, [share + 0.02 for share in _STARTS])
        return [cls(float(a), float(b)) for a, b in zip(starts, ends, strict=True) if 0 < a < b]

    def nearby(self, record: Record, share: float = 0.25) -> list[Effect]:
        """Either end moved by `share` of the length."""
        start, end = self._ends(record)
        reach = min(share, 0.5) * (end - start)
        moved = [("start", start - reach), ("start", start + reach), ("end", end - reach), ("end", end + reach)]
        return [clone(self).set_params(**{name: moment}) for name, moment in moved]

    def _ends(self, record: Record) -> list[float]:
        return [since_start(getattr(self, name), record, name, "Disturbance") for name in ("start", "end")]

    def learn(self, record: Record) -> None:
        """Convert both ends to seconds and dates."""
        self._validate_params()
        self.seconds_ = self._ends(record)
        if not self.seconds_[0] < self.seconds_[1]:
            raise ValueError(
                f"The 'end' parameter of Disturbance must lie after its start, {self.start!r}. Got {self.end!r} "
                "instead."
            )
        self.moments_ = [moment_text(seconds, record) for seconds in self.seconds_]

    def names(self) -> list[str]:
        """``disturbance[2024-03-05 00:00:00, 2024-03-05 02:00:00]``."""
        return [f"disturbance[{', '.join(self.moments_)}]"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """1 in the stretch, else 0."""
        start, end = self.seconds_
        return [x.where(x.seconds >= start, 1.0, 0.0) - x.where(x.seconds >= end, 1.0, 0.0)]

    def label(self) -> str:
        """``disturbance: 2024-03-05 00:00:00 to 2024-03-05 02:00:00``."""
        start, end = getattr(self, "moments_", (shown(self.start), shown(self.end)))
        return f"disturbance: {start} to {end}"
