"""Parameters of an explanation, moved to where it explains most: those between the points of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .anywhere import MANY, lasting
from .choice import WAVE, Cause
from .levels import FINER, LEFT_OVER, MANY_CAUSES, NO_MORE, SHARES
from .likelihood import Comparison
from .pool import Explanation, Key, Pool


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


def move_again(
    pool: Pool, judged: Comparison, found: list[Cause], key: Key, gain: float, done: set[tuple[int, int]]
) -> bool:
    """Whether a further cause of a kind and column, with its gain, was what one in `found` had missed: it has moved.

    What its parameters miss, beside what was found since, looks like a further cause. Steps, disturbances and waves
    come by the dozen, and stay; so does everything where many causes were found, some of which stand for one another.
    `done` remembers which cause was tried beside how many: each only once.
    """
    before = list(found)
    if key == WAVE or key in MANY or len(found) > MANY_CAUSES:
        return False
    for k, cause in enumerate(before):
        now = cause.tried.explanation
        if cause.tried.key != key or now.in_model or (k, len(found)) in done:
            continue
        done.add((k, len(found)))
        there = moved(pool, judged.without([cause.adopted]), now, (*SHARES, *FINER))
        if there is not None and judged.moves(cause.adopted, there.columns, LEFT_OVER * gain):
            found[k] = replace(cause, tried=replace(cause.tried, explanation=there))
    return found != before
