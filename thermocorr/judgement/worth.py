"""What explanations are worth on data that their coefficients were not learned from.

The record is cut into pieces of equal numbers of rows. Later stretches are foretold from all that came before them, and
blocks from all the rest, by a ridge beside the same base. Everything follows from the cross products of the pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from .levels import AHEAD, BLOCK, FIRST, PIECES, RIDGE, VARIES

LATER = tuple((range(stop), range(stop, stop + AHEAD)) for stop in range(FIRST, PIECES, AHEAD))
"""Pieces to learn from, and later pieces to be foretold."""
BLOCKS = tuple(
    ([j for j in range(PIECES) if not i <= j < i + BLOCK], range(i, i + BLOCK)) for i in range(0, PIECES, BLOCK)
)
"""Pieces to learn from, and blocks that are held out."""


@dataclass(frozen=True, kw_only=True)
class Worth:
    """Fall of the squared error [dB]; positive is good."""

    later: float
    """Fall on later stretches."""
    blocks: float
    """Fall on blocks of time held out."""

    @property
    def both(self) -> float:
        """The lesser of the falls on later stretches and on held-out blocks."""
        return min(self.later, self.blocks)

    @property
    def mean(self) -> float:
        """The mean of the falls on later stretches and on held-out blocks."""
        return (self.later + self.blocks) / 2


class HeldOut:
    """A base, and what columns beside it are worth.

    `readings` (array of shape (n, records)): The reading, or many drawn ones. `base` (array of shape (n, p)): Column
    0 is the constant.
    """

    def __init__(self, readings: np.ndarray, base: np.ndarray):
        self.readings, self.base = readings, base
        self.edges = np.linspace(0, len(base), PIECES + 1).astype(int)
        products = Products(
            base=self._in_pieces(base, base),
            reading=self._in_pieces(base, readings),
            squares=np.stack([np.sum(readings[a:b] ** 2, axis=0) for a, b in pairwise(self.edges)]),
        )
        self.folds = [[PieceFold(products, *fold) for fold in folds] for folds in (LATER, BLOCKS)]
        self.before = [sum(fold.error for fold in folds) for folds in self.folds]

    def _in_pieces(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Cross products in each piece."""
        return np.stack([one[a:b].T @ other[a:b] for a, b in pairwise(self.edges)])

    def with_columns(self, columns: np.ndarray) -> HeldOut:
        """Take more columns into the base."""
        return HeldOut(self.readings, np.column_stack((self.base, columns)))

    def worth(self, explanations: Sequence[np.ndarray]) -> list[Worth]:
        """What each explanation, shape (n, k), is worth for the first of the readings."""
        later, blocks = self.falls(explanations)
        return [Worth(later=float(a), blocks=float(b)) for a, b in zip(later[:, 0], blocks[:, 0], strict=True)]

    def falls(self, explanations: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Fall of the squared error [dB] on later stretches and on blocks, each of shape (explanations, records)."""
        result = np.zeros((2, len(explanations), self.readings.shape[1]))
        for width in {columns.shape[1] for columns in explanations}:
            which = [i for i, columns in enumerate(explanations) if columns.shape[1] == width]
            together = np.column_stack([explanations[i] for i in which])
            each = together.reshape(len(together), len(which), width).transpose(1, 0, 2)
            products = Products(
                base=self._in_pieces(self.base, together),
                reading=self._in_pieces(together, self.readings),
                squares=np.stack([each[:, a:b].swapaxes(1, 2) @ each[:, a:b] for a, b in pairwise(self.edges)]),
            )
            for kind, folds in enumerate(self.folds):
                after = sum(fold.error_with(products) for fold in folds)
                result[kind, which] = 10 * np.log10(self.before[kind] / np.maximum(after, 1e-300))
        return result[0], result[1]


class Products(NamedTuple):
    """Cross products of some columns in each piece."""

    base: np.ndarray
    """Cross products with the columns of the base."""
    reading: np.ndarray
    """Cross products with the readings."""
    squares: np.ndarray
    """Squares of the readings, if the columns are the base; else products of the columns of each explanation."""

    def over(self, pieces: Sequence[int]) -> Products:
        """Sums over some pieces."""
        return Products(*(part[list(pieces)].sum(axis=0) for part in self))


class PieceFold:
    """A ridge of the readings on the base, learned from some pieces and tested on others, by cross products alone.

    Columns are scaled to unit variance where they are learned, and lose their means there.
    """

    def __init__(self, products: Products, learn: Sequence[int], test: Sequence[int]):
        self.learn, self.test = learn, test
        self.learned, self.tested = products.over(learn), products.over(test)
        A = self.learned.base
        self.constant = A[0] / A[0, 0]  # what each column has of the constant
        centred = A - np.outer(A[0], self.constant)
        self.scale = _scale(np.diag(centred)[1:], np.diag(A)[1:])
        normed = centred[1:, 1:] * self.scale[:, None] * self.scale + RIDGE * np.eye(len(A) - 1)
        self.half = np.linalg.cholesky(normed)
        self.coef = self._coefficients(self.learned.reading)
        """Coefficients of the base, shape (p, records)."""
        self.missed = self.tested.reading - self.tested.base @ self.coef
        """Moments of the base with what it misses of the tested readings."""
        self.error = self.tested.squares - np.sum(self.coef * (self.tested.reading + self.missed), axis=0)

    def _coefficients(self, moments: np.ndarray) -> np.ndarray:
        """Coefficients of the base for columns with these learned moments, shape (p, columns)."""
        centred = moments[1:] - np.outer(self.constant[1:], moments[0])
        inner = self.scale[:, None] * cho_solve((self.half, True), self.scale[:, None] * centred)
        return np.vstack(((moments[0] - self.learned.base[0, 1:] @ inner) / self.learned.base[0, 0], inner))

    def error_with(self, products: Products) -> np.ndarray:
        """Squared error with an explanation beside the base, shape (explanations, records)."""
        learned, tested = products.over(self.learn), products.over(self.test)
        count, width = learned.squares.shape[:2]
        made = self._coefficients(learned.base)  # of the explanation by the base
        size = np.diagonal(learned.squares, axis1=1, axis2=2).ravel()
        variance = size - learned.base[0] ** 2 / self.learned.base[0, 0]
        scale = _scale(variance, size)
        own = learned.squares - _each(learned.base, made, count)
        own = own * _each(scale[None], scale[None], count)
        own[:, range(width), range(width)] += RIDGE
        moment = learned.reading - made.T @ self.learned.reading
        coef = np.linalg.solve(own, (scale[:, None] * moment).reshape(count, width, -1))
        coef *= scale.reshape(count, width, 1)
        missed = tested.reading - tested.base.T @ self.coef - made.T @ self.missed
        beside = tested.base - self.tested.base @ made
        squares = tested.squares - _each(tested.base, made, count) - _each(made, beside, count)
        moments = 2 * missed.reshape(coef.shape) - squares @ coef
        return np.asarray(self.error - np.sum(coef * moments, axis=1))


def _scale(variance: np.ndarray, square: np.ndarray) -> np.ndarray:
    """One over the standard deviation of columns; 0 for those that hardly vary where they are learned."""
    alive = variance > VARIES * np.maximum(square, 1e-300)
    return np.where(alive, 1 / np.sqrt(np.where(alive, variance, 1.0)), 0.0)


def _each(one: np.ndarray, other: np.ndarray, count: int) -> np.ndarray:
    """Products of the columns of each explanation, of which there are `count` side by side."""
    one, other = (part.reshape(len(part), count, -1).transpose(1, 0, 2) for part in (one, other))
    return np.asarray(one.swapaxes(1, 2) @ other)
