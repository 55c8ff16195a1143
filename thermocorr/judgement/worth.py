"""What explanations are worth on data that their coefficients were not learned from.

The record is cut into pieces of equal numbers of rows. Later stretches are foretold from all that came before them, and
blocks from all the rest, by a ridge beside the same base. Everything follows from the cross products of the pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .levels import PIECES, RIDGE

LATER = tuple((range(stop), range(stop, stop + 3)) for stop in range(8, PIECES, 3))
"""Pieces to learn from, and later pieces to be foretold."""
BLOCKS = tuple(([j for j in range(PIECES) if not i <= j < i + 4], range(i, i + 4)) for i in range(0, PIECES, 4))
"""Pieces to learn from, and blocks that are held out."""


@dataclass(frozen=True, kw_only=True)
class Worth:
    """Fall of the squared error [dB]; positive is good."""

    later: float
    """On later stretches."""
    blocks: float
    """On blocks of time held out."""

    @property
    def both(self) -> float:
        """The lesser of the two."""
        return min(self.later, self.blocks)


class HeldOut:
    """A base, and what columns beside it are worth.

    Parameters
    ----------
    readings : array of shape (n, records)
        The reading, or many drawn ones.
    base : array of shape (n, p)
        Column 0 is the constant.
    """

    def __init__(self, readings: np.ndarray, base: np.ndarray):
        self.readings, self.base = readings, base
        self.edges = np.linspace(0, len(base), PIECES + 1).astype(int)
        self.QQ, self.Qy = self._products(base, base), self._products(base, readings)
        self.yy = np.stack([np.sum(readings[a:b] ** 2, axis=0) for a, b in self._spans()])
        none = np.zeros((1, PIECES, 0, 0))
        cross, moments = np.zeros((1, PIECES, base.shape[1], 0)), np.zeros((1, PIECES, 0, readings.shape[1]))
        self.before = self._left(cross, none, moments)

    def _spans(self) -> list[tuple[int, int]]:
        return list(zip(self.edges[:-1].tolist(), self.edges[1:].tolist(), strict=True))

    def _products(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Cross products in each piece."""
        return np.stack([one[a:b].T @ other[a:b] for a, b in self._spans()])

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
            cross = self._products(self.base, together).reshape(PIECES, -1, len(which), width).transpose(2, 0, 1, 3)
            moments = self._products(together, self.readings).reshape(PIECES, len(which), width, -1).swapaxes(0, 1)
            stacked = together.reshape(len(together), len(which), width).transpose(1, 0, 2)
            own = np.stack([stacked[:, a:b].swapaxes(1, 2) @ stacked[:, a:b] for a, b in self._spans()], axis=1)
            for kind, (before, after) in enumerate(zip(self.before, self._left(cross, own, moments), strict=True)):
                result[kind, which] = 10 * np.log10(before / np.maximum(after, 1e-300))
        return result[0], result[1]

    def _left(self, cross: np.ndarray, own: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared errors on later stretches and on blocks, of shape (explanations, records) each.

        Base and explanation have the products `cross` (explanations, pieces, p, k), the explanations among themselves
        `own` (.., k, k) and with the readings `moments` (.., k, records).
        """
        count = len(own)
        base = np.broadcast_to(self.QQ, (count, *self.QQ.shape))
        A = np.concatenate(
            (np.concatenate((base, cross), axis=3), np.concatenate((cross.swapaxes(2, 3), own), axis=3)), axis=2
        )
        b = np.concatenate((np.broadcast_to(self.Qy, (count, *self.Qy.shape)), moments), axis=2)

        def summed(folds: Sequence[tuple[Sequence[int], Sequence[int]]]) -> np.ndarray:
            result = np.zeros((count, self.readings.shape[1]))
            for learn, test in folds:
                learned, tested = (_Sums(*(x[:, list(rows)].sum(axis=1) for x in (A, b))) for rows in (learn, test))
                result += _foretold(learned, tested, self.yy[list(test)].sum(axis=0))
            return result

        return summed(LATER), summed(BLOCKS)


class _Sums(NamedTuple):
    A: np.ndarray
    b: np.ndarray


def _foretold(learned: _Sums, tested: _Sums, squares: np.ndarray) -> np.ndarray:
    """Squared error on tested rows of ridges learned from others, by cross products alone; the constant is first."""
    A, b = learned
    n = A[:, :1, :1]
    centred = (A - A[:, :, :1] * A[:, :1, :] / n)[:, 1:, 1:]
    moment = (b - A[:, :, :1] * b[:, :1, :] / n)[:, 1:]
    size = np.sqrt(np.maximum(np.diagonal(centred, axis1=1, axis2=2), 0.0))
    alive = size > 1e-6 * np.sqrt(np.maximum(np.diagonal(A, axis1=1, axis2=2)[:, 1:], 1e-300))
    scale = np.where(alive, 1 / np.where(alive, size, 1.0), 0.0)
    normed = centred * scale[:, :, None] * scale[:, None, :] + RIDGE * np.eye(size.shape[1])
    inner = np.linalg.solve(normed, moment * scale[:, :, None]) * scale[:, :, None]
    constant = (b[:, :1] - A[:, :1, 1:] @ inner) / n
    coef = np.concatenate((constant, inner), axis=1)
    return np.asarray(squares - 2 * np.sum(coef * tested.b, axis=1) + np.sum(coef * (tested.A @ coef), axis=1))
