"""Range of each effect's share of the bias in the fitted record: beyond it, a later row is extrapolated.

A record that only heats never showed what the lags do on cooling, and one between 40 and 50 % of humidity does not say
what 90 % do. Every column has its range; what counts is what an effect makes of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..effects import StaticPolynomial
from ..effects.stream import own_starts, walk
from ..records import Record
from ..records.errors import quoted

MARGIN = 3.0
"""Standard deviations of the residual by which an effect's share may leave its range."""

ONE_WAY = 0.1
"""Share of the way that a thermometer may go back and still run one way."""


def learned_ranges(model: Any) -> np.ndarray:
    """Least and greatest share of each effect of a fitted model, `MARGIN` wider, shape (n_effects, 2).

    Infinite for effects of time alone, for those that `correct` keeps, and for the static law, whose temperatures have
    a range of their own.
    """
    effects = model.features_.effect_list()
    found = np.array([[np.inf, -np.inf]] * len(effects))
    record = model.features_.history_.record
    for _, parts in model._weighed(walk(effects, record, starts=own_starts(record))):
        found[:, 0] = np.fmin(found[:, 0], np.fmin.reduce(parts, axis=0))
        found[:, 1] = np.fmax(found[:, 1], np.fmax.reduce(parts, axis=0))
    free = [e.of_time_alone or isinstance(e, StaticPolynomial) or not e.removed_by_correct for e in effects]
    found[free] = -np.inf, np.inf
    return np.asarray(found + MARGIN * model.residual_std_ * np.array([-1.0, 1.0]))


def one_way(record: Record, thermometers: Iterable[Any]) -> list[str]:
    """A sentence on each thermometer that only rises in a record, or only falls."""
    said = []
    for name in thermometers:
        fall = rise = 0.0
        high, low, known = -np.inf, np.inf, record.moments(name)
        for block in record.blocks():
            values = block[name]
            highs, lows = np.maximum.accumulate(values), np.minimum.accumulate(values)
            fall = max(fall, float(np.max(np.maximum(highs, high) - values)))
            rise = max(rise, float(np.max(values - np.minimum(lows, low))))
            high, low = max(high, float(highs[-1])), min(low, float(lows[-1]))
            if min(fall, rise) > ONE_WAY * (known.high - known.low):  # neither way is longer than the range
                break
        if min(fall, rise) <= ONE_WAY * max(fall, rise):
            shown, missing = ("rises", "falling") if fall < rise else ("falls", "rising")
            said.append(
                f'{quoted(name)} only {shown} in the record: {missing} is not covered, and flagged "outside fitted '
                'range" where it matters.'
            )
    return said
