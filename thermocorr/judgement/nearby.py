"""Parameters of an explanation, moved to where it explains most: those between the points of a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .anywhere import lasting
from .levels import NO_MORE
from .likelihood import Comparison
from .pool import Explanation, Pool


def moved(pool: Pool, beside: Comparison, explanation: Explanation, shares: Sequence[float]) -> Explanation | None:
    """An explanation with its parameters moved to where it gains most, by each of `shares`; None where nowhere more.

    `beside` is the base that it stands beside; what else is tried there is forgotten. See `Effect.nearby`.
    """
    beside.explanations = []
    beside.add([each.columns for each in pool.with_columns([explanation])])
    theta = beside.refit([0])[0].theta
    most, best = beside.screen(theta)[0], explanation
    for share in shares:
        near = pool.of(best.effect.nearby(pool.record, share))
        near = [each for each in near if lasting(pool, each.effect)]
        if not near:
            break
        beside.explanations = []
        beside.add([each.columns for each in near])
        gains = beside.screen(theta)
        if gains.max() > most + NO_MORE:
            first = int(np.argmax(gains > gains.max() - NO_MORE))
            most, best = gains[first], near[first]
    return None if best is explanation else best
