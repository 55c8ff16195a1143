"""What a fit cannot determine, in sentences."""

from __future__ import annotations

from typing import Any

from ..equations import RidgeSolution
from ..records import Record
from .cancellation import cancelling
from .flat import flat_columns
from .prior import LawPrior, check_like
from .time_constants.resolution import unresolved


def doubts_of(model: Any, record: Record, solution: RidgeSolution, prior: LawPrior | None) -> list[str]:
    """What the user of a fitted model should know.

    Parameters
    ----------
    model : DynamicBiasRegressor
    record : Record
        What it was fitted to.
    solution : RidgeSolution
    prior : LawPrior, optional
        What other devices told of this one.
    """
    said = [model.run_levels_.note] if model.run_levels_.note else []
    if prior is not None:
        mean = record.moments(record.temperature_name).mean
        return [*said, *filter(None, [check_like(prior, mean, model.residual_std_)])]
    effects, taus = model.features_.effect_list(), model.time_constants_
    if model.search_ is None and len(taus):
        said += unresolved(taus, record, solution, model.degree, model.residual_std_)
    return [*said, *flat_columns(record, effects), *cancelling(effects, solution, model.reading_)]
