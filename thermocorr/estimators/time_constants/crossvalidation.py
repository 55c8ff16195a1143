"""Cross-validation of sets of time constants from factors: every set, every fold, every ridge penalty."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import comb
from typing import Any

import numpy as np

from ...equations import TriangularFactor
from ...equations.subsets import Fold, all_set_errors, fold_of, set_errors
from .folds import Sides, TimeFolds
from .spectrum import GridLayout, grown

Set = tuple[int, ...]
KEPT = 200
"""Sets of each size whose errors are kept from an exhaustive search."""
NEGLIGIBLE = 5e-4
"""A time constant that lowers the loss by less than this share is not worth having."""


class CrossValidation:
    """Errors of sets of grid members, each computed once.

    `chunks` (list of TriangularFactor): Factors of the stretches that `folds` is made of. `folds` (TimeFolds).
    `layout` (GridLayout): Which column is what. `dead` (list of lists of int): ``dead[f]`` are columns that fold f
    must not use.
    """

    def __init__(
        self, chunks: Sequence[TriangularFactor], folds: TimeFolds, layout: GridLayout, dead: Sequence[Sequence[int]]
    ):
        self.chunks, self.folds, self.layout, self.dead = chunks, folds, layout, dead
        self.losses: dict[tuple[float, Set], np.ndarray] = {}
        """Root mean squared error in each fold of every (penalty, set) tried so far."""
        self._prepared: dict[float, list[Fold]] = {}
        width = max((len(layout.columns([i])) for i in range(len(layout.grid))), default=1)
        self.groups = np.full((len(layout.grid), width), -1)
        for i in range(len(layout.grid)):
            columns = layout.columns([i])
            self.groups[i, : len(columns)] = np.array(columns) - layout.n_free

    def score_sets(self, sets: Sequence[Set], alpha: float) -> np.ndarray:
        """Losses of sets, shape (n_sets, n_folds)."""
        self.try_sets(sets, alpha)
        return np.array([self.losses[alpha, members] for members in sets])

    def try_sets(self, sets: Sequence[Set], alpha: float) -> None:
        """Put the losses of sets into `losses`."""
        new: dict[int, list[Set]] = {}
        for members in sets:
            if (alpha, members) not in self.losses:
                new.setdefault(len(members), []).append(members)
        for count, group in new.items():
            columns = self.groups[np.array(group, np.intp).reshape(len(group), count)].reshape(len(group), -1)
            losses = np.sqrt(set_errors(self.prepared(alpha), columns))
            self.losses.update(((alpha, members), loss) for members, loss in zip(group, losses, strict=True))

    @cached_property
    def sides(self) -> list[Sides]:
        """What each fold learns from and tests on."""
        return self.folds.sides(self.chunks, self.layout.n_free)

    def prepared(self, alpha: float) -> list[Fold]:
        """The folds for one ridge penalty."""
        if alpha not in self._prepared:
            n_free = self.layout.n_free
            self._prepared[alpha] = [fold_of(s.learned, s.tested, n_free, alpha, self.dead[s.fold]) for s in self.sides]
        return self._prepared[alpha]

    def greedy(self, candidates: Sequence[int], max_count: int, alpha: float) -> list[Set]:
        """Best set found of each size: forward steps, each followed by exchanges."""

        def best(sets: set[Set]) -> tuple[Set, float]:
            ordered = sorted(sets)
            losses = self.score_sets(ordered, alpha).mean(axis=1)
            return ordered[int(losses.argmin())], float(losses.min())

        path: list[Set] = []
        for _ in range(1, min(max_count, len(candidates)) + 1):
            path.append(grown(path[-1] if path else (), candidates, best))
        return path

    def exhaustive(self, candidates: Sequence[int], max_count: int, alpha: float) -> list[Set]:
        """Best set of each size among all sets; the errors of the `KEPT` best of each are kept."""
        members = np.array(candidates)
        groups = self.groups[members]
        max_count = min(max_count, len(members))

        made: list[list[Any]] = [[] for _ in range(max_count)]
        errors: list[list[np.ndarray]] = [[] for _ in range(max_count)]
        for number, fold in enumerate(self.prepared(alpha)):
            found: list[list[np.ndarray]] = [[] for _ in range(max_count)]
            for sets, losses in all_set_errors(fold, groups, max_count):
                found[sets.shape[1] - 1].append(losses)
                if number == 0:
                    made[sets.shape[1] - 1].append(sets)
            for own, parts in zip(errors, found, strict=True):
                own.append(np.concatenate(parts))
        path: list[Set] = []
        for size, sets in enumerate(map(np.concatenate, made)):
            losses = np.sqrt(np.array(errors[size]).T)
            order = np.argsort(losses.mean(axis=1), kind="stable")[:KEPT]
            for i in order:
                self.losses[alpha, tuple(members[sets[i]].tolist())] = losses[i]
            path.append(tuple(members[sets[order[0]]].tolist()))
        return path


def count_sets(n_candidates: int, max_count: int) -> int:
    """Number of sets of 1 to `max_count` of `n_candidates`."""
    return sum(comb(n_candidates, k) for k in range(1, max_count + 1))


def no_worse(losses: np.ndarray, best: np.ndarray) -> bool:
    """Whether losses are above the best ones by no more than one standard error of the difference, or negligibly.

    The difference is taken fold by fold (Breiman et al. 1984, section 3.4.3, on paired folds): what all folds share
    says nothing about it.
    """
    difference = losses - best
    error = float(difference.std(ddof=1)) / np.sqrt(len(difference)) if len(difference) > 1 else 0.0
    return float(difference.mean()) <= max(error, NEGLIGIBLE * float(best.mean()))


def fewest(losses: Sequence[np.ndarray]) -> int:
    """Which of the best sets of growing size to take: the first that is no worse than the one with the least loss."""
    best = int(np.argmin([float(loss.mean()) for loss in losses]))
    return next(i for i, loss in enumerate(losses) if i == best or no_worse(loss, losses[best]))
