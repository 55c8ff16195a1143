"""Warnings on identifiability: constant columns, cancelling ones, time constants too close to each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..effects import StaticPolynomial
from ..effects.protocol import Effect
from ..equations import RidgeSolution
from ..records import Record
from .coverage import flat_columns
from .learned_ranges import one_way
from .reading import Reading
from .time_constants.search import unresolved

FURTHEST_REACH = 1000.0
"""Reach of the contributions, in standard deviations of the readings, from which a fit is told to cancel.

One part in a thousand of one column then moves the corrected reading by as much as the readings have ever moved.
Measured: 1.2 where time constants are searched for the built-in voltage reference and for simulated devices (5 with 400
rows), 2 to 10 for the measured records of `benchmarks/real_records.py`, 95 for the worst of the 1443 fits of the test
suite but two (one is made to cancel, one lags a clock, which is a constant). Eight time constants given by hand without
a penalty reach 400 on measured records, 2900 where the longest lasts longer than the record. On a record of 18 s, two
harmonics of 10 min reach 1e6, of 3 h 1e11 to 1e13; one harmonic of 1 h 3e3 to 2e4, of a day 2e6 to 1e7.
With half of it one harmonic of half an hour is told there too (700 to 6e3); twice of it changes none of these.
"""


def cancelling(effects: Sequence[Effect], solution: RidgeSolution, reading: Reading) -> list[str]:
    """A sentence on a fit whose contributions cancel far beyond the spread of the readings; none where all is well.

    Each contribution counts with its rms over the fitted rows. Powers of T - T0 count with their standard deviation:
    how far T0 stands from the record is the user's choice.

    `effects` (sequence of Effect): Learned; their columns in the order of those of `solution`. `solution`
    (RidgeSolution). `reading` (Reading): Of the fitted record.
    """
    of_choice = [isinstance(effect, StaticPolynomial) for effect in effects for _ in range(effect.n_columns())]
    means = np.where(of_choice, 0.0, solution.mean)
    sizes = np.abs(solution.coef) * np.hypot(solution.scale, means)
    reach = float(sizes.sum())
    if not reach > FURTHEST_REACH * reading.std:
        return []
    names = [name for effect in effects for name in effect.names()]
    return [
        f"The contributions of the model's columns cancel: they reach {reach:.3g} and leave {reading.std:.3g}. The "
        f"largest is that of {names[int(sizes.argmax())]!r}. The record does not determine these columns: "
        "corrected readings can be wrong by any amount, forecasts more so. Leave that effect out, record for longer "
        "(some periods, some time constants), fit fewer time constants, or set a ridge penalty with alpha."
    ]


def doubts_of(model: Any, record: Record, solution: RidgeSolution) -> list[str]:
    """Warnings for the user of a fitted model.

    `model` (DynamicBiasRegressor). `record` (Record): What it was fitted to. `solution` (RidgeSolution).
    """
    said = [model._run_levels.note] if model._run_levels.note else []
    if model.degree_ < model.degree:
        low, high = model.degree_ + 1, model.degree
        powers = f"(T - T0)^{low}" if low == high else f"(T - T0)^{low} to (T - T0)^{high}"
        said.append(
            f"The temperatures lie at too few levels to determine {powers} in the static law: left out. Rows between "
            "them are flagged. Record at more levels, or ramp through them."
        )
    effects, taus = model.features_.effect_list(), model.time_constants_
    said += one_way(record, model.thermometers_)
    if model.search_ is None and len(taus):
        said += unresolved(taus, record, solution, model.degree_, model.residual_std_)
    return [*said, *flat_columns(record, effects), *cancelling(effects, solution, model.reading_)]
