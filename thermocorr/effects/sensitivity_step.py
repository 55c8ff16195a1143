"""Another law from a date on: offset and sensitivity change together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import clone

from ..records import Record
from .grids import longest_segment, time_quantiles
from .moments import MOMENT, moment_text, shown, since_start
from .protocol import Effect, EffectInfo
from .signals import Signals
from .thermal import column_text

_TIMES = 12


class SensitivityStep(Effect):
    """Another static law from a moment on: an offset, and a sensitivity to temperature, both 0 before it.

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
    of_time_alone = True
    learned = {
        "seconds_": "number",
        "moment_": "text",
        "reference_temperature_": "number",
        "temperature_name_": "column",
    }
    info = EffectInfo(
        physics="The instrument was repaired, readjusted, reloaded or damaged: from then on it has another law, offset "
        "and sensitivity to temperature alike.",
        bench_check="Look in the laboratory's log book at that moment; measure the temperature coefficient anew and "
        "compare it with that of the time before.",
        formula="change[t] = 0 before t, 1 from t on; change[t]*temperature = the same times (T less its mean)",
        parameters={"time": "s"},
        example={"time": "2 days"},
        place=3.4,
    )
    _parameter_constraints = {"time": MOMENT, "removed_by_correct": ["boolean"]}

    def __init__(self, time: Any, removed_by_correct: bool = True):
        self.time = time
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Times that part the record's rows into even shares; a diagnosis looks at every row besides."""
        shares = np.linspace(0.0, 1.0, _TIMES + 2)[1:-1]
        return [cls(time) for time in sorted({float(t) for t in time_quantiles(record, shares) if t > 0})]

    def nearby(self, record: Record, share: float = 0.25) -> list[Effect]:
        """Moments `share` of a fiftieth of the record away."""
        moment, reach = since_start(self.time, record), share * longest_segment(record) / 50
        return [clone(self).set_params(time=moment + side * reach) for side in (-1, 1)]

    def learn(self, record: Record) -> None:
        """Convert the moment to seconds since the record began, and to a date where there are dates; fix T0."""
        self._validate_params()
        self.seconds_ = since_start(self.time, record, effect="SensitivityStep")
        self.moment_ = moment_text(self.seconds_, record)
        self.reference_temperature_ = record.moments(record.temperature_name).mean
        self.temperature_name_ = record.temperature_name

    def names(self) -> list[str]:
        """``change[2024-03-05 00:00:00]``, ``change[2024-03-05 00:00:00]*temperature``."""
        name = f"change[{self.moment_}]"
        return [name, f"{name}*{column_text(self.temperature_name_)}"]

    def units(self) -> list[str]:
        """None, and K."""
        return ["", "K"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """0 before; 1 and T - T0 from the moment on."""
        later = x.seconds >= self.seconds_
        return [x.where(later, 1.0, 0.0), x.where(later, x.T - self.reference_temperature_, 0.0)]

    def label(self) -> str:
        """``sensitivity step: 2024-03-05 00:00:00``."""
        return f"sensitivity step: {getattr(self, 'moment_', shown(self.time))}"
