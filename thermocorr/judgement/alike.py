"""Which explanations a record cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

from .choice import Tried
from .levels import ALIKE
from .likelihood import Comparison


def says_the_same(judged: Comparison, best: Tried, rivals: Sequence[Tried]) -> list[Tried]:
    """Rivals of other kinds that could make most of what the best one makes of the reading."""
    return [t for t in rivals if t.key != best.key and judged.overlap(best.number, t.number) > ALIKE]
