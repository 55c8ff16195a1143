"""Parameters of an explanation, moved to where it explains most: those between the points of a grid."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from .choice import WAVE, Cause
from .dated import MANY, lasting
from .family import Family
from .levels import BESIDE_OTHERS, FINER, LEFT_OVER, LEVEL, MANY_CAUSES, NO_MORE, SHARES
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


def moved_for_another(
    pool: Pool, family: Family, found: list[Cause], refused: Collection[Key], done: set[tuple[int, int]]
) -> tuple[int, Cause] | None:
    """Move a cause in `found` to parameters beside which something else is proven; its place, and what it was, or None.

    Each cause was tuned before the next one was known, and may have taken part of it upon itself: what the two gain
    together, over what stands, decides. What was `refused` is proven already, and no cause. `done` as in `move_again`;
    where many causes were found, none is moved.
    """
    judged = family.judged
    for k, cause in enumerate(found if len(found) <= MANY_CAUSES else ()):
        now = cause.tried.explanation
        if cause.tried.key in (WAVE, *MANY) or now.in_model or not now.n_tuned or (k, len(found)) in done:
            continue
        done.add((k, len(found)))
        for i in _proven_beside(pool, family, cause, refused):
            beside = judged.without([cause.adopted])
            beside.add([each.columns for each in pool.with_columns([family.tried[i]])])
            beside.adopt(0)
            there = moved(pool, beside, now, (*SHARES, *FINER))
            if there is None:
                continue
            beside.explanations = []
            beside.add([there.columns])
            gain = beside.refit([0])[0].level - judged.base.level
            if _proven(family, gain, i) and judged.moves(cause.adopted, there.columns, -gain):
                found[k] = replace(cause, tried=replace(cause.tried, explanation=there))
                return k, cause
    return None


def _proven_beside(pool: Pool, family: Family, cause: Cause, refused: Collection[Key]) -> list[int]:
    """What would be proven if a cause had whatever parameters, near those it has: the best of a few kinds.

    Slow ones are hidden in noise that wanders, so they are sought under white noise, too, as in a first look.
    """
    judged, alive = family.judged, family.alive()
    effect = cause.tried.explanation.effect
    sides: dict[tuple[object, ...], Explanation] = {}  # one of either side of each parameter
    for each in pool.of(effect.nearby(pool.record)):
        sides.setdefault(_changed(effect, each.effect), each)
    if not sides:  # an effect of the user's own
        return []
    judged.add([np.column_stack([each.columns for each in sides.values()])])
    free = judged.of([len(judged.explanations) - 1, *alive])
    judged.explanations.pop()
    if not free.width(0):  # the base has them all: no other parameters would leave anything else
        return []
    free.adopt(0)
    best: dict[int, None] = {}
    for gains in free.screen_twice():
        scores = {i: gain - family.price(i) for i, gain in zip(alive, gains[1:], strict=True)}
        of_each = {family.tried[i].key: i for i in sorted(scores, key=scores.__getitem__)}
        able = [i for key, i in of_each.items() if key != cause.tried.key and key not in refused]
        best |= dict.fromkeys(sorted(able, key=lambda i: -scores[i])[:BESIDE_OTHERS])
    level, place = free.base.level, {i: k for k, i in enumerate(alive, start=1)}
    fits = free.refit([place[i] for i in best])
    gained = {i: fit.level - level for i, fit in zip(best, fits, strict=True)}
    return sorted((i for i in best if _proven(family, gained[i], i)), key=lambda i: -gained[i])


def _changed(effect: Effect, other: Effect) -> tuple[object, ...]:
    """Which parameters, and which of the time constants, two effects of one kind do not share."""
    changed: list[object] = []
    for name, value in effect.get_params(deep=False).items():
        there = getattr(other, name)
        if name == "time_constants":  # neighbours have seconds, where there may be text
            pairs = zip_longest(seconds_array(value).tolist(), seconds_array(there).tolist())
            changed += [(name, i) for i, (one, two) in enumerate(pairs) if one != two]
        elif repr(value) != repr(there):
            changed.append(name)
    return tuple(changed)


def _proven(family: Family, gain: float, i: int) -> bool:
    return gain > family.price(i) and family.p_value(gain, i) <= LEVEL
