"""Adding an effect to a model, and what held-out blocks of time say of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..effects.wrap import as_effects
from ..estimators.holdout import held_out_residuals, rms, time_blocks
from ..estimators.regressor import DynamicBiasRegressor
from ..records.thinned import ThinnedLog

N_BLOCKS = 5
"""Blocks of time that are held out."""


def held_out_rms(model: DynamicBiasRegressor, X: Any, y: Any) -> float:
    """Rms residual of blocks of time, each under a model fitted without it, offset included."""
    return float(held_out_blocks(model, X, y)[-1])


def held_out_blocks(model: DynamicBiasRegressor, X: Any, y: Any) -> np.ndarray:
    """Rms residual of each held-out block, then of all blocks together; NaN for a block without readings."""
    residual = held_out_residuals(model, X, y, n_blocks=N_BLOCKS)
    parts = [residual[block] for block in time_blocks(len(residual), N_BLOCKS)]
    unseen = X.record.unseen if isinstance(X, ThinnedLog) else 0.0  # what averages do not show is left by any model
    return np.array([np.hypot(rms(part), np.sqrt(unseen)) for part in (*parts, residual)])


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
