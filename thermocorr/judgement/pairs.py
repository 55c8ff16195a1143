"""Two explanations at once that hide one another: an ageing that a drift opposes, two products with one column.

What they add up to is a fraction of either, and either alone says as little as noise. Together they leave nothing of
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .levels import OF_PRODUCTS, PAIRS
from .likelihood import Comparison
from .pool import Explanation


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two explanations together, by their numbers in a comparison."""

    first: int
    """The plainer one."""
    second: int
    gain: float
    """Log likelihood that they gain together, divided by how unevenly the evidence of products lies."""


def may_hide(explanation: Explanation) -> bool:
    """Whether an explanation may be hidden by another one: a slow change, or a product with a recorded column."""
    effect = explanation.effect
    return effect.of_time_alone or (effect.is_product and explanation.key[1] is not None)


def pairs(judged: Comparison, explanations: Sequence[Explanation], which: Sequence[int]) -> tuple[list[Pair], int]:
    """The likeliest pairs of kinds with the same column, or none, best first, and the number of all pairs."""
    every: list[tuple[int, int]] = []
    for i, j in combinations(sorted(which, key=lambda i: explanations[i].n_tuned), 2):
        one, other = explanations[i].key, explanations[j].key
        if one != other and one[1] == other[1]:
            every.append((i, j))
    if not every:
        return [], 0
    gains = judged.of_pairs(every).screen(judged.base.theta)
    near = [every[k] for k in np.argsort(-gains)[:PAIRS].tolist()]
    together = judged.of_pairs(near, rows=True)
    found = []
    for k, fit in enumerate(together.refit(range(len(near)))):
        i, j = near[k]
        uneven = 0.0 if explanations[i].effect.of_time_alone else together.scatter(k, fit.theta) / OF_PRODUCTS
        found.append(Pair(first=i, second=j, gain=(fit.level - judged.base.level) / max(1.0, uneven)))
    return sorted(found, key=lambda pair: -pair.gain), len(every)
