"""Freezing point: the one temperature at which a knee is expected before anything was measured.

What freezes late, such as soil, hides its knee from the likelihood: products of lags, waves of months, or a knee some
kelvin beside it, tell the record better. Data that were not learned from decide.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..effects import Hinge
from ..effects.grids import temperature_quantiles, time_grid
from ..estimators.regressor import DynamicBiasRegressor
from .adding import Errors, Extended, with_missing
from .refinement_levels import CLEARLY_LESS, ON_EITHER_SIDE
from .tuning import at_freezing, effects_of, freezing


def freezing_point(model: DynamicBiasRegressor) -> float | None:
    """Freezing point in the unit of a fitted model's temperature; None where no knee can be found there.

    That is so where the record hardly crosses it, where the unit is not known, and where the model has such a knee.
    """
    zero = freezing(model)
    low, high = temperature_quantiles(model.features_.history_.record, (ON_EITHER_SIDE, 1 - ON_EITHER_SIDE))
    known = any(at_freezing(model, effect) for effect in effects_of(model))
    return zero if low < zero < high and not known else None


def with_knee_at_freezing(
    model: DynamicBiasRegressor, X: Any, y: Any, before: Errors, least: Errors, say: Callable[[str], None]
) -> Extended | None:
    """The model with a knee at freezing point, at once or late, its errors, and the knee; None where it has none.

    It is kept as other effects are, where its errors are also clearly less than `least`, and it clearly explains more:
    the errors of a few blocks fall by chance where noise wanders, as a random telegraph's did by 11 %.
    """
    zero = freezing_point(model)
    if zero is None:
        return None
    say("trying a knee at freezing point")
    best, ratio = None, CLEARLY_LESS
    for late in ((), *((tau,) for tau in time_grid(model.features_.history_.record, 5.0, 0.1))):
        knee = Hinge(zero, time_constants=late)
        longer = with_missing(model, knee).fit(X, y)
        if longer.residual_std_ > CLEARLY_LESS * model.residual_std_:
            continue
        errors = Errors.of(longer, X, y)
        if errors.ratio(least) <= ratio and errors.worth(knee, before):
            best, ratio = (longer, errors, [knee]), errors.ratio(least)
    return best
