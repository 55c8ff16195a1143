"""Two slow changes at once that hide one another: an ageing that a drift opposes.

What they add up to is a fraction of either, and either alone says as little as noise that wanders as slowly. Together
they leave nothing of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .levels import PAIRS
from .likelihood import Comparison
from .pool import Explanation


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two explanations together, by their numbers in a comparison."""

    first: int
    """The plainer one."""
    second: int
    gain: float
    """Log likelihood that they gain together."""


def pairs(judged: Comparison, explanations: Sequence[Explanation], which: Sequence[int]) -> tuple[list[Pair], int]:
    """The likeliest pairs of different kinds among some explanations, best first, and the number of all pairs."""
    every: list[tuple[int, int]] = []
    for i, j in combinations(sorted(which, key=lambda i: explanations[i].n_tuned), 2):
        if explanations[i].key != explanations[j].key:
            every.append((i, j))
    if not every:
        return [], 0
    gains = judged.of_pairs(every).screen(judged.base.theta)
    near = [every[k] for k in np.argsort(-gains)[:PAIRS].tolist()]
    fits = judged.of_pairs(near).refit(range(len(near)))
    found = [
        Pair(first=i, second=j, gain=fit.level - judged.base.level) for (i, j), fit in zip(near, fits, strict=True)
    ]
    return sorted(found, key=lambda pair: -pair.gain), len(every)
