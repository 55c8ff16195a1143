"""Another law from a date on: offset and sensitivity change together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..records import Record
from .protocol import SINCE_START, EffectInfo
from .signals import Signals
from .thermal import column_text
from .time import Step


class SensitivityStep(Step):
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
        """Convert the moment to seconds since the record began, and to a date where there are dates; fix T0."""
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
