"""Adding an effect to a model, and what held-out blocks of time say of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..effects.wrap import as_effects
from ..estimators.holdout import held_out_residuals, rms, time_blocks
from ..estimators.later import later_rms
from ..estimators.regressor import DynamicBiasRegressor
from ..records.thinned import ThinnedLog
from .levels import GAIN, HELPS, SAME, SUPERFLUOUS

N_BLOCKS = 5
"""Blocks of time that are held out."""


@dataclass(frozen=True)
class Errors:
    """Rms errors of a model on data that it was not learned from, offset included, in the unit of y."""

    held_out: float
    """On blocks of time, each under a model fitted without it."""
    later: float
    """On blocks of the later half, each foretold from everything before it; NaN for short records."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, X: Any, y: Any) -> Errors:
        """Errors of a fitted model on its record."""
        return cls(held_out_rms(model, X, y), float(np.hypot(later_rms(model, X, y), _unseen(X))))

    def better_than(self, other: Errors) -> bool:
        """Whether one error falls by more than the other rises; held-out blocks decide where later ones cannot."""
        held_out, later = _ratio(self.held_out, other.held_out), _ratio(self.later, other.later)
        if not abs(np.log(later)) > np.log(SAME):  # a step in the last block; or the record is too short
            return held_out <= HELPS
        return held_out * later <= HELPS**2

    def worth(self, effect: Effect, named: bool, other: Errors) -> bool:
        """Whether a model with one effect more is to be kept.

        What diagnosis does not name must lower both errors clearly. What depends on time alone promises nothing for
        later data: it must not raise either.
        """
        held_out, later = _ratio(self.held_out, other.held_out), _ratio(self.later, other.later)
        if not named:
            return max(held_out, later) <= 10 ** (-GAIN / 20)
        return self.better_than(other) and not (effect.of_time_alone and max(held_out, later) > SAME)

    def least(self, other: Errors) -> Errors:
        """The lesser of each."""
        return Errors(min(self.held_out, other.held_out), min(self.later, other.later))

    def __str__(self) -> str:
        return f"{self.held_out:.4g} held out, {self.later:.4g} on later blocks"

    def as_good_as(self, other: Errors) -> bool:
        """Whether a simpler model is to be preferred."""
        return self.held_out <= SUPERFLUOUS * other.held_out and not self.later > SUPERFLUOUS * other.later


def _ratio(now: float, before: float) -> float:
    return now / before if before else 1.0  # an exact record


def held_out_rms(model: DynamicBiasRegressor, X: Any, y: Any) -> float:
    """Rms residual of blocks of time, each under a model fitted without it, offset included."""
    return float(held_out_blocks(model, X, y)[-1])


def held_out_blocks(model: DynamicBiasRegressor, X: Any, y: Any) -> np.ndarray:
    """Rms residual of each held-out block, then of all blocks together; NaN for a block without readings."""
    residual = held_out_residuals(model, X, y, n_blocks=N_BLOCKS)
    parts = [residual[block] for block in time_blocks(len(residual), N_BLOCKS)]
    return np.array([np.hypot(rms(part), _unseen(X)) for part in (*parts, residual)])


def _unseen(X: Any) -> float:
    """Rms of what averages do not show, and any model leaves."""
    return float(np.sqrt(X.record.unseen)) if isinstance(X, ThinnedLog) else 0.0


def with_missing(model: DynamicBiasRegressor, effect: Effect) -> DynamicBiasRegressor:
    """An unfitted copy with one effect more; a missing lag of the temperature or of a column joins those there are."""
    extended: DynamicBiasRegressor = clone(model)
    if effect.kind == "thermal_lag" and len(model.time_constants_):
        taus = np.unique([*model.time_constants_.tolist(), *np.asarray(effect.time_constants, float).tolist()])
        extended.set_params(time_constants=taus.tolist())
        return extended
    own = [other for _, other in as_effects(model.effects)]
    for i, other in enumerate(own):
        if isinstance(effect, LaggedCovariate) and isinstance(other, LaggedCovariate) and _same_column(effect, other):
            times = sorted({*seconds_array(other.time_constants), *seconds_array(effect.time_constants)})
            longer = clone(other).set_params(time_constants=[float(tau) for tau in times])
            extended.set_params(effects=[clone(e) for e in (*own[:i], longer, *own[i + 1 :])])
            return extended
    return model.with_effect(effect)


def _same_column(one: LaggedCovariate, other: LaggedCovariate) -> bool:
    return (one.column, one.power, one.hold) == (other.column, other.power, other.hold)
