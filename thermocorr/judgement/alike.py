"""Which explanations a record cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

from .choice import Tried
from .levels import ALIKE, HALF, TIE
from .likelihood import Comparison


def says_the_same(judged: Comparison, best: Tried, rivals: Sequence[Tried]) -> list[Tried]:
    """Rivals of other kinds that could make most of what the best one makes of the reading."""
    return [t for t in rivals if t.key != best.key and judged.overlap(best.number, t.number) > ALIKE]


def superfluous(judged: Comparison, best: Tried, same: Sequence[Tried], rivals: Sequence[Tried]) -> list[Tried]:
    """Rivals as likely as the best one, of another kind, of whose gain it leaves less than half.

    They say something else of the reading, and yet one of the two is enough.
    """
    known = {best.key, *(t.key for t in same)}
    asked = [t for t in rivals if t.key not in known and t.score >= best.score - TIE]
    if not asked or not best.score > 0:
        return []
    beside = judged.gained_beside(best.number, [t.number for t in asked])
    alone = judged.screen(judged.base.theta, [t.number for t in asked])
    return [t for t, left, own in zip(asked, beside, alone, strict=True) if left < HALF * own]
