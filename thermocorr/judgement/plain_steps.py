"""Steps that are told more plainly once the other causes are known: a stretch there and back, a step and no other law.

The first cause was found while others were still missing, and may have taken part of them upon itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..effects import Disturbance, SensitivityStep, Step
from .choice import Cause, Tried
from .family import Family
from .levels import LEVEL, LONGEST_STRETCH, MANY_CAUSES, TIE
from .pool import Explanation, Pool


def with_plain_steps(pool: Pool, family: Family, found: Sequence[Cause]) -> list[Cause]:
    """The causes; a disturbance in the place of two steps that undo one another, a step where no other law is needed.

    Where many causes were found, some of which stand for one another, they stay as they are.
    """
    if len(found) > MANY_CAUSES:
        return list(found)
    return _there_and_back(pool, family, [_without_law(pool, family, cause) for cause in found])


def _without_law(pool: Pool, family: Family, cause: Cause) -> Cause:
    """A step where the cause is another law that gains no more than one column does by chance; or the cause.

    The law that is left may be what is there, where it is nearly as likely.
    """
    effect = cause.tried.explanation.effect
    if not isinstance(effect, SensitivityStep) or Step.kind not in family.anywhere:
        return cause
    step, least, before = pool.of([Step(effect.time)])[0], family.price_of_columns(1), family.judged.base.level
    if not family.judged.moves(cause.adopted, step.columns, -least):
        return cause
    lost = before - family.judged.base.level
    return _told_as(family, cause, step, cause.share, *([cause.tried] if lost > least - TIE else []))


def _there_and_back(pool: Pool, family: Family, found: Sequence[Cause]) -> list[Cause]:
    """The causes; a disturbance in the place of two steps, of which one is superfluous beside it.

    What lasts longer than any disturbance that is looked for stays two steps.
    """
    causes = list(found)
    if Disturbance.kind not in family.anywhere:
        return causes
    steps = sorted((c for c in causes if c.tried.explanation.effect.kind == Step.kind), key=_moment)
    for first, second in sorted(pairwise(steps), key=lambda pair: _moment(pair[1]) - _moment(pair[0])):
        here = [any(c is one for c in causes) for one in (first, second)]
        if all(here) and (stretch := _stretch_between(pool, family, first, second)) is not None:
            one = _told_as(family, first, stretch, first.share + second.share)
            causes = [one if c is first else c for c in causes if c is not second]
    return causes


def _stretch_between(pool: Pool, family: Family, first: Cause, second: Cause) -> Explanation | None:
    """The stretch between two steps, which then stands for the first in the comparison; None where it is not enough."""
    start, end = _moment(first), _moment(second)
    seconds = pool.data.seconds
    if np.count_nonzero((seconds >= start) & (seconds < end)) > LONGEST_STRETCH * len(seconds):
        return None
    stretch = pool.of([Disturbance(start, end)])[0]
    beside = family.judged.copy()
    beside.explanations = []
    if not beside.moves(first.adopted, stretch.columns, -family.price_of_columns(1)):
        return None
    gain = beside.base.level - beside.without([second.adopted]).base.level
    if family.p_value(gain, second.tried.number, second.adopted) <= LEVEL:
        return None
    family.judged.moves(first.adopted, stretch.columns, -family.price_of_columns(1))
    return stretch


def _told_as(family: Family, cause: Cause, explanation: Explanation, share: float, *more: Tried) -> Cause:
    """A cause by another explanation, which stands in its place in the comparison; it may be `more`, too."""
    number = family.add([explanation])[0]
    alike = tuple(t for t in (*more, *cause.alike) if t.key != explanation.key)
    tried = replace(cause.tried, explanation=explanation, number=number)
    return replace(cause, tried=tried, alike=alike, share=min(share, 1.0))


def _moment(cause: Cause) -> float:
    """When a step begins, since the record began [s]."""
    effect = cause.tried.explanation.effect
    assert isinstance(effect, Step)
    return float(effect.seconds_)
