"""Held-out errors of many sets of columns, from two triangles.

A fold is a triangle R of what is learned and one of what is tested. Free columns (1, the static law) stand in every
set: they are eliminated once. Then every column is a short vector of some fifty numbers on either side, and a set is
solved by modified Gram-Schmidt with the reading as last column, which is as accurate as Householder's QR (Bjoerck 1967,
BIT 7, 1). Each elimination is applied to the test side too: what is left of the test reading is the test residual, no
coefficient is ever formed and no sum of squares is a difference of large numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from .leastsquares import Floats, TriangularFactor, triangle

Integers = NDArray[np.intp]

_DEPENDENT = 1e-24
"""A column whose square falls below this share in the elimination depends on those before it."""


@dataclass(frozen=True)
class Fold:
    """One fold after elimination of the free columns."""

    learned: Floats
    """Shape (p + 2, m): columns of unit length on the side that is learned."""
    tested: Floats
    """Shape (p + 2, m'): the same combinations of the test rows' columns."""
    n_tested: int

    @property
    def n_columns(self) -> int:
        """p, the columns to choose from; -1 stands for zero."""
        return len(self.learned) - 2


def fold_of(
    learned: TriangularFactor, tested: TriangularFactor, n_free: int, alpha: float = 0.0, dead: Sequence[int] = ()
) -> Fold:
    """Eliminate the free columns and set up one fold.

    `learned`, `tested` (TriangularFactor): Factors of ``[free | candidates | reading]`` over the rows to learn from
    and to test on. `n_free` (int): Columns in every set, the 1 first; alpha acts on them too, except on the 1 (as in
    `solve_ridge`). `alpha` (float): Ridge penalty on coefficients times their columns' standard deviation over the
    learned rows, eq. (13). `dead` (sequence of int): Columns that this fold must not use.
    """
    r = learned.r.copy()
    r[:, list(dead)] = 0.0
    if alpha > 0:
        scale = np.linalg.norm(r[1:, 1:-1], axis=0) / np.sqrt(max(learned.n_rows, 1))
        penalty = np.zeros((len(scale), r.shape[1]))
        penalty[:, 1:-1] = np.diag(np.sqrt(alpha) * scale)
        r = triangle(np.vstack((r, penalty)))
    free = solve_free(r, n_free, r[:n_free, n_free:])
    inner = r[n_free:, n_free:]
    outer = tested.r[:, n_free:] - tested.r[:, :n_free] @ free
    norms = np.linalg.norm(inner[:, :-1], axis=0)
    alive = norms > 1e-13 * np.linalg.norm(r[:, n_free:-1], axis=0)
    scales = np.append(np.where(alive, 1.0 / np.where(alive, norms, 1.0), 0.0), 1.0)
    zero = np.zeros((1, len(inner))), np.zeros((1, len(outer)))
    return Fold(np.vstack(((inner * scales).T, zero[0])), np.vstack(((outer * scales).T, zero[1])), tested.n_rows)


def solve_free(r: Floats, n_free: int, right: Floats) -> Floats:
    """Minimum-norm coefficients of the free columns.

    The 1 comes first: a column that is constant in what is learned, as the step of a run not seen, gets none.
    """
    top = r[:n_free, :n_free]
    norms = np.linalg.norm(top, axis=0)
    if (np.abs(np.diag(top)) > 1e-13 * norms).all():
        return np.asarray(solve_triangular(top, right))
    scales = np.where(norms[1:] > 0, norms[1:], 1.0)
    others = np.linalg.lstsq(top[1:, 1:] / scales, right[1:], rcond=1e-13)[0] / scales[:, None]
    return np.vstack(((right[:1] - top[:1, 1:] @ others) / (top[0, 0] or 1.0), others))


def set_errors(folds: Sequence[Fold], sets: Integers) -> Floats:
    """Mean squared test error of every set in every fold.

    `folds` (sequence of Fold). `sets` (int array of shape (n_sets, k)): Columns of each set; -1 fills up. Returns
    array of shape (n_sets, n_folds).
    """
    squares = np.empty((len(folds), len(sets)))
    for fold, out in zip(folds, squares, strict=True):
        _squares_in_batches(fold.learned, fold.tested, sets, out)
        out /= fold.n_tested
    return squares.T


def _squares_in_batches(learned: Floats, tested: Floats, sets: Integers, out: Floats) -> None:
    """Squared test error of each set, many sets at once."""
    m, both = learned.shape[1], np.vstack((learned.T, tested.T))
    # As many numbers are worked on at a time as stay in the cache.
    size = max(1, (1 << 17) // ((sets.shape[1] + 1) * len(both)))
    for start in range(0, len(sets), size):
        columns = np.vstack((sets[start : start + size].T, np.full(len(sets[start : start + size]), -2)))
        x = both[:, columns]  # shape (m + m', k + 1, sets)
        for j in range(sets.shape[1]):  # take column j out of the later ones, and the same combination on the test side
            square = np.einsum("mb,mb->b", x[:m, j], x[:m, j])
            inverse = np.where(square > _DEPENDENT, 1.0 / np.where(square > _DEPENDENT, square, 1.0), 0.0)
            x[:, j + 1 :] -= x[:, j, None] * (np.einsum("mb,mkb->kb", x[:m, j], x[:m, j + 1 :]) * inverse)
        out[start : start + size] = np.einsum("mb,mb->b", x[m:, -1], x[m:, -1])
