"""Adding an effect to a model, and what held-out blocks of time say of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import Drift, Hinge, LaggedCovariate, LogAgeing, ThermalLag
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..effects.wrap import as_effects
from ..estimators.holdout import held_out_residuals, later_rms, rms, time_blocks
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.screening import believed_readings
from ..estimators.thermometers import Thermometers
from ..records.history import ThinnedLog
from ..records.numbers import quantity_texts
from .levels import FURTHER_HELP, HELD_OUT_BLOCKS, HELPS, MOSTLY, SAME


@dataclass(frozen=True)
class Errors:
    """Rms errors of a model on data that it was not learned from, offset included, in the unit of y."""

    held_out: float
    """On blocks of time, each under a model fitted without it."""
    later: float
    """On blocks of the later half, each foretold from everything before it; NaN for short records."""
    each: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False, compare=False)
    """On each block of either kind."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, X: Any, y: Any) -> Errors:
        """Errors of a fitted model on its record."""
        *held_out, held_out_all = held_out_blocks(model, X, y)
        *later, later_all = np.hypot(later_rms(model, X, y), _unseen(X))
        return cls(float(held_out_all), float(later_all), np.array([*held_out, *later]))

    def better_than(self, other: Errors) -> bool:
        """Whether one error falls by more than the other rises; held-out blocks decide where later ones cannot."""
        held_out, later = _ratio(self.held_out, other.held_out), _ratio(self.later, other.later)
        if not abs(np.log(later)) > np.log(SAME):  # a step in the last block; or the record is too short
            return held_out <= HELPS
        return held_out * later <= HELPS**2

    def ratio(self, other: Errors) -> float:
        """Geometric mean of both errors over those of another model; of the held-out one alone where none is later."""
        held_out, later = _ratio(self.held_out, other.held_out), _ratio(self.later, other.later)
        return float(np.sqrt(held_out * later)) if np.isfinite(later) else held_out

    def falls_mostly(self, other: Errors) -> bool:
        """Whether the error falls in many more blocks than it rises in: the overall error may be that of one block."""
        falls, rises = (self.each * SAME < other.each).sum(), (self.each > SAME * other.each).sum()
        return bool(falls >= MOSTLY * rises)

    def worth(self, effect: Effect, other: Errors, proven: bool = False, absorbed: bool = False) -> bool:
        """Whether a model with one effect more is to be kept.

        It must be of use in most blocks. What depends on time alone promises nothing for later data: it must not raise
        either error, and lower them by more than what two equal models may differ by. A proven drift or ageing must
        lower the later one by more than it raises the other: the first block, held out, is told backwards. Another
        proven effect, no product, may be of use in few blocks where neither error rises and both together fall; what
        the model's slow lags have absorbed of it has lowered them before, so they need not fall.
        """
        worse = max(_ratio(self.held_out, other.held_out), _ratio(self.later, other.later))
        if proven and isinstance(effect, Drift | LogAgeing) and self.later * SAME < other.later:
            return self.ratio(other) <= 1
        told = proven and not (effect.of_time_alone or effect.is_product)
        if told and not worse > SAME and (absorbed or self.ratio(other) <= FURTHER_HELP):
            return True
        if not (self.better_than(other) and self.falls_mostly(other)):
            return False
        return not effect.of_time_alone or (not worse > SAME and self.ratio(other) * SAME <= 1)

    def text(self, unit: str, before: Errors) -> str:
        """Say the two errors beside those before, in one unit that suits them."""
        numbers = (self.held_out, before.held_out, self.later, before.later)
        now, then, later_now, later_then = quantity_texts(numbers, unit, 4)
        return f"{now} after {then} held out, {later_now} after {later_then} on later blocks"


Extended = tuple[DynamicBiasRegressor, Errors, Effect]
"""A model with one effect more, its errors, and this effect."""


def _ratio(now: float, before: float) -> float:
    return now / before if before else 1.0  # an exact record


def held_out_blocks(model: DynamicBiasRegressor, X: Any, y: Any) -> np.ndarray:
    """Rms residual of each held-out block, then of all blocks together; NaN for a block without readings."""
    residual = held_out_residuals(model, X, y, n_blocks=HELD_OUT_BLOCKS)
    parts = [residual[block] for block in time_blocks(believed_readings(model, X, y), HELD_OUT_BLOCKS)]
    return np.array([np.hypot(rms(part), _unseen(X)) for part in (*parts, residual)])


def _unseen(X: Any) -> float:
    """Rms of what averages do not show, and any model leaves."""
    return float(np.sqrt(X.record.unseen)) if isinstance(X, ThinnedLog) else 0.0


def with_missing(model: DynamicBiasRegressor, effect: Effect) -> DynamicBiasRegressor:
    """An unfitted copy with one effect more; a missing lag of temperature, a column or a knee joins those there are.

    Products of lags are those of the model: what is better or worse is so for the effect.
    """
    extended: DynamicBiasRegressor = model.settled()
    if isinstance(effect, ThermalLag) and len(model.time_constants_):
        return extended.set_params(**_with_times(model, None, effect.time_constants))
    if (
        isinstance(effect, LaggedCovariate)
        and effect.power == 1
        and effect.column in Thermometers.of(model.temperature).further
    ):
        return extended.set_params(**_with_times(model, effect.column, effect.time_constants))
    own = [other for _, other in as_effects(model.effects)]
    for i, other in enumerate(own):
        if isinstance(effect, Hinge | LaggedCovariate) and same_but_for_lags(effect, other):
            times = sorted({*seconds_array(other.time_constants), *seconds_array(effect.time_constants)})
            longer = clone(other).set_params(time_constants=[float(tau) for tau in times])
            extended.set_params(effects=[clone(e) for e in (*own[:i], longer, *own[i + 1 :])])
            return extended
    return extended.with_effect(effect)


def _with_times(model: DynamicBiasRegressor, thermometer: Any, more: Any) -> dict[str, Any]:
    """What a fitted model has chosen, and some more time constants of one thermometer: of the first for None."""
    found = dict(model.thermometers_)
    name = next(iter(found)) if thermometer is None else thermometer
    found[name] = np.unique([*found[name], *seconds_array(more)])
    times = {each: taus.tolist() for each, taus in found.items()}
    return {**model.chosen(), "time_constants": times if len(times) > 1 else times[name]}


def same_but_for_lags(one: Effect, other: Effect) -> bool:
    """Whether two effects that may have lags of their own, knees or columns, differ in these at most."""
    params = [{k: v for k, v in e.get_params(deep=False).items() if k != "time_constants"} for e in (one, other)]
    return type(one) is type(other) and params[0] == params[1]
