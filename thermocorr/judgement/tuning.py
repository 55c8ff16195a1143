"""Parameters of a model's effects, moved to where its residual is least."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from sklearn.base import clone

from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..estimators.regressor import DynamicBiasRegressor
from .refinement_levels import LOWER


def effects_of(model: DynamicBiasRegressor) -> list[Effect]:
    """A model's further effects."""
    return [effect for _, effect in as_effects(model.effects)]


def fitted_with(model: DynamicBiasRegressor, effects: Iterable[Effect], X: Any, y: Any) -> DynamicBiasRegressor:
    """A fitted copy of a model with other further effects."""
    copy: DynamicBiasRegressor = clone(model).set_params(effects=[clone(effect) for effect in effects])
    return copy.fit(X, y)


def held_fast(model: DynamicBiasRegressor) -> DynamicBiasRegressor:
    """An unfitted copy of a fitted model that has the same time constants and penalty, whatever it is fitted to."""
    copy: DynamicBiasRegressor = clone(model)
    return copy.set_params(**model.chosen(), alpha=model.alpha_)


def tuned(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    shares: Sequence[float],
    which: Sequence[int],
    *,
    moves: int = 1,
) -> DynamicBiasRegressor:
    """A fitted model with parameters of some effects moved to the least residual, time constants of the lags held.

    Each effect of `which` is moved at most `moves` times by each of `shares`, see `Effect.nearby`. The model itself
    where its residual falls by nothing.
    """
    effects, start = effects_of(model), model.residual_std_
    best = held_fast(model).fit(X, y)
    record, least = best.features_.history_.record, best.residual_std_
    for share in shares:
        for _ in range(moves):
            before = least
            for i in which:
                for near in effects[i].nearby(record, share):
                    tried = [*effects[:i], near, *effects[i + 1 :]]
                    other = fitted_with(best, tried, X, y)
                    if other.residual_std_ < least * LOWER:
                        best, least, effects = other, other.residual_std_, tried
            if least == before:
                break
    return best if least < start * LOWER else model
