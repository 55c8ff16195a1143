"""Effects that refinement has added: tuned, and worked out.

A diagnosis names a column or a knee with the one time constant that explains most beside lags of its own. Heat and
moisture come through bodies that have many: more lags are to the effect what they are to the temperature (eq. (19)
with its signal in place of T).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import Hinge, LaggedCovariate
from ..effects.grids import time_grid
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..effects.wrap import as_effects
from ..estimators.regressor import DynamicBiasRegressor
from .adding import Errors, same_but_for_lags
from .levels import CLEARLY_LESS, FURTHER_HELP, FURTHER_LAGS, LOWER, MOVES, NEXT_LAG, OTHER_TIMES, WIDELY


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
    model: DynamicBiasRegressor, X: Any, y: Any, shares: Sequence[float], which: Sequence[int], *, moves: int = 1
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


def worked_out(
    model: DynamicBiasRegressor, X: Any, y: Any, errors: Errors, added: Effect, say: Callable[[str], None]
) -> tuple[DynamicBiasRegressor, Errors, Effect]:
    """Work out an effect that a fitted model has got, as long as data that it was not learned from are better for it.

    `model` (DynamicBiasRegressor): Fitted. `X`, `y` (as for `DynamicBiasRegressor.fit`). `errors` (Errors): Of the
    model. `added` (Effect): What has no lags of its own stays as it is. `say` (callable): Called with a line of text
    before each step. Returns model, errors, added: those given where nothing is better.
    """
    place = next((i for i, effect in enumerate(effects_of(model)) if _is_of(effect, added)), None)
    if place is None:
        return model, errors, added
    moved = _moved(model, X, y, place)
    better = Errors.of(moved, X, y)
    if better.better_than(errors):
        model, errors = moved, better
    model, errors = _timed(model, X, y, place, errors, say)
    longer = _with_further_lags(model, X, y, place, say)
    if longer is not None and (better := Errors.of(longer, X, y)).better_than(errors):
        model, errors = longer, better
    return model, errors, effects_of(model)[place]


def _is_of(effect: Effect, added: Effect) -> bool:
    """Whether an effect of the model is the one that was added, and has lags of its own; it may have more of them."""
    if not isinstance(effect, Hinge | LaggedCovariate) or not same_but_for_lags(effect, added):
        return False
    times, least = seconds_array(effect.time_constants), seconds_array(added.time_constants)
    return set(least.tolist()) <= set(times.tolist())


def _moved(model: DynamicBiasRegressor, X: Any, y: Any, place: int) -> DynamicBiasRegressor:
    """The model with the parameters of one effect where it explains most, the lags of the temperature chosen anew."""
    return fitted_with(model, effects_of(tuned(model, X, y, WIDELY, [place], moves=MOVES)), X, y)


def _timed(
    model: DynamicBiasRegressor, X: Any, y: Any, place: int, errors: Errors, say: Callable[[str], None]
) -> tuple[DynamicBiasRegressor, Errors]:
    """The model, and its errors, with another time constant of one effect where both errors together are clearly less.

    How well the record is told says little of it: lags of the temperature make up for a wrong one, until it is another
    day. They are chosen anew for each. Where the errors are hardly larger than the residual there is nothing to gain.
    """
    effects, best = effects_of(model), CLEARLY_LESS
    times, residual = seconds_array(effects[place].time_constants), model.residual_std_
    if len(times) != 1 or errors.ratio(Errors(residual, residual)) * best <= 1:
        return model, errors
    say(f"trying other time constants of {effects[place].title()}")
    found = model, errors
    for tau in times[0] * np.array(OTHER_TIMES):
        other = clone(effects[place]).set_params(time_constants=[float(tau)])
        tried = fitted_with(model, [*effects[:place], other, *effects[place + 1 :]], X, y)
        there = Errors.of(tried, X, y)
        if there.ratio(errors) <= best:
            found, best = (tried, there), there.ratio(errors)
    return found


def _with_further_lags(
    model: DynamicBiasRegressor, X: Any, y: Any, place: int, say: Callable[[str], None]
) -> DynamicBiasRegressor | None:
    """The model whose effect follows with more lags, as long as each is worth it; None where no further one is.

    While they are compared, the time constants of the temperature are held: choosing them anew changes errors, too.
    """
    held = held_fast(model).fit(X, y)
    errors, added = Errors.of(held, X, y), effects_of(model)[place]
    longer = None
    while (tried := _with_the_next_lag(held, X, y, place)) is not None:
        say(f"adding a lag to {effects_of(held)[place].title()}")
        better = Errors.of(tried, X, y)
        if not (better.worth(added, errors) and better.ratio(errors) <= FURTHER_HELP):
            break
        held = longer = tried
        errors = better
    return None if longer is None else fitted_with(model, effects_of(longer), X, y)


def _with_the_next_lag(held: DynamicBiasRegressor, X: Any, y: Any, place: int) -> DynamicBiasRegressor | None:
    """The model whose effect follows with the one further lag that explains most, tuned; None where there is none."""
    effects = effects_of(held)
    times = seconds_array(effects[place].time_constants)
    if len(times) > FURTHER_LAGS:
        return None
    best, least = None, held.residual_std_ * LOWER
    for tau in time_grid(held.features_.history_.record, 2.0, 0.2, NEXT_LAG):
        if not len(times) or np.abs(np.log(times / tau)).min() > np.log(NEXT_LAG) / 2:
            longer = clone(effects[place]).set_params(time_constants=sorted({*times.tolist(), tau}))
            other = fitted_with(held, [*effects[:place], longer, *effects[place + 1 :]], X, y)
            if other.residual_std_ < least:
                best, least = other, other.residual_std_
    return None if best is None else tuned(best, X, y, WIDELY, [place], moves=MOVES)
