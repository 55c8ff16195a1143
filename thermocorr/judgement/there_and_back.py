"""Two steps that undo one another, found one after the other: one disturbance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..effects import Disturbance, Step
from .choice import Cause
from .family import Family
from .levels import LEVEL, LONGEST_STRETCH, MANY_CAUSES
from .pool import Explanation, Pool


def there_and_back(pool: Pool, family: Family, found: Sequence[Cause]) -> list[Cause]:
    """The causes; a disturbance in the place of two steps, of which one is superfluous beside it.

    The first step was found while something else was missing, and may have taken part of that upon itself. What lasts
    longer than any disturbance that is looked for stays two steps; so does everything where many causes were found,
    some of which stand for one another.
    """
    causes = list(found)
    if Disturbance.kind not in family.anywhere or len(causes) > MANY_CAUSES:
        return causes
    steps = sorted((c for c in causes if c.tried.explanation.effect.kind == Step.kind), key=_moment)
    for first, second in sorted(pairwise(steps), key=lambda pair: _moment(pair[1]) - _moment(pair[0])):
        here = [any(c is one for c in causes) for one in (first, second)]
        if all(here) and (stretch := _enough(pool, family, first, second)) is not None:
            number = family.add([stretch])[0]
            together = replace(first.tried, explanation=stretch, number=number)
            share = min(first.share + second.share, 1.0)
            one = replace(first, tried=together, alike=(), share=share)
            causes = [one if c is first else c for c in causes if c is not second]
    return causes


def _enough(pool: Pool, family: Family, first: Cause, second: Cause) -> Explanation | None:
    """The stretch between two steps, where it is enough; the first of them is it, in the comparison, from then on."""
    start, end = _moment(first), _moment(second)
    seconds = pool.data.seconds
    if np.count_nonzero((seconds >= start) & (seconds < end)) > LONGEST_STRETCH * len(seconds):
        return None
    stretch = pool.of([Disturbance(start, end)])[0]
    beside = family.judged.copy()
    beside.explanations = []
    if not beside.moves(first.adopted, stretch.columns, -family.price(second.tried.number)):
        return None
    gain = beside.base.level - beside.without([second.adopted]).base.level
    if family.p_value(gain, second.tried.number, second.adopted) <= LEVEL:
        return None
    family.judged.moves(first.adopted, stretch.columns, -family.price(second.tried.number))
    return stretch


def _moment(cause: Cause) -> float:
    """When a step begins, since the record began [s]."""
    effect = cause.tried.explanation.effect
    assert isinstance(effect, Step)
    return float(effect.seconds_)
