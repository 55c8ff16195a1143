"""Triangular factors by cross products in coordinates in which the columns are nearly orthogonal.

Cross products of the columns themselves square their condition number, so that neighbouring time constants lose every
digit; Householder reflections do not, and pass over the rows many times. Here the columns are first multiplied by the
inverse of the triangle R of what was seen before, as in Cholesky QR done twice (Yamamoto et al. 2015, ETNA 44, 306):
``Z = rows R^-1`` is nearly orthogonal where the rows are like those before, and ``Z'Z = B`` is as good as it gets:
``R' B R`` are the cross products. Where rows show a direction which R hardly knows, some are swept in by reflections.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from .leastsquares import swept_in

Floats = NDArray[np.float64]
LARGEST = 1e8
"""Largest mean square, relative to all rows before, of a direction in rows that are not swept in by reflections."""
GROWN = 1e3
"""Growth of the cross products from which R is brought up to date."""
_UNSEEN = 1e150
"""One over the diagonal of R where a column was next to nothing so far: if it is no longer, its cross products are too
large."""


class Crossed(NamedTuple):
    """What some rows add to the cross products of all, in the coordinates of a triangle."""

    triangle: Floats
    """R, shape (q, q)."""
    product: Floats | None
    """B, upper triangle, shape (q, q): the cross products of the rows are ``R' B R``; None: they are ``R' R``."""

    def factor(self) -> Floats:
        """A matrix F with ``F' F`` equal to the cross products of the rows, shape (at most q, q)."""
        if self.product is None:
            return self.triangle
        met = np.flatnonzero(self.product.diagonal() > 0.0)
        product = self.product[np.ix_(met, met)]
        upper, failed = lapack.dpotrf(product, lower=0, clean=1)
        if failed:  # the rows say nothing about some direction
            values, vectors = np.linalg.eigh(product, UPLO="U")
            upper = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        return np.asarray(upper @ self.triangle[met], np.float64)


class Preconditioned:
    """Cross products of rows of q columns, stretch by stretch, in the coordinates of the rows before.

    Parameters
    ----------
    n_columns : int
        q.
    """

    def __init__(self, n_columns: int) -> None:
        self._triangle: Floats = np.zeros((n_columns, n_columns), order="F")
        self._grown: Floats = np.eye(n_columns)
        self._pending = False
        self._parts: dict[int, tuple[Floats, Floats]] = {}
        self.knows_nothing = True
        """Whether no row has been taken in since some column was new."""

    def begin(self, n_new: int, n_old: int) -> None:
        """Replace the first `n_old` columns by `n_new` others, which nobody has seen so far."""
        kept = self._up_to_date()[n_old:, n_old:]
        triangle = np.zeros((n_new + len(kept),) * 2, order="F")
        triangle[n_new:, n_new:] = kept
        self._count_from(triangle)
        self.knows_nothing = True

    def take(self, first: int, crossed: Callable[[Floats, Floats, float], Floats]) -> list[Crossed]:
        """Take parts of rows in by their cross products; an empty list, and nothing is taken, where these will not do.

        Parameters
        ----------
        first : int
            How many of the first columns are zero in all rows.
        crossed : callable
            Given R of the other columns, one over its diagonal and `LARGEST`, upper triangles of B, shape (parts,
            q - first, q - first); it may stop where a diagonal element becomes larger, for nothing is taken then.
        """
        if self.knows_nothing:
            return []
        triangle, inverse = self._part(first)
        products = crossed(triangle, inverse, LARGEST)
        if not np.einsum("pii->pi", products).max() <= LARGEST:  # or NaN
            return []
        self._grown[first:, first:] += products.sum(axis=0)
        self._pending = True
        if self._grown.diagonal().max() > GROWN:
            self._count_from(self._up_to_date())
        return [Crossed(triangle, product) for product in products]

    def reflect(self, first: int, rows: Floats) -> Crossed:
        """Take in any rows by reflections: shape (n, q - first), Fortran order, overwritten."""
        own = swept_in(np.zeros((len(self._triangle) - first,) * 2, order="F"), rows)
        triangle = self._up_to_date()
        triangle[first:, first:] = swept_in(triangle[first:, first:], own.copy(order="F"))
        self._count_from(triangle)
        self.knows_nothing = False
        return Crossed(own, None)

    def _part(self, first: int) -> tuple[Floats, Floats]:
        """R without its first columns, and one over its diagonal."""
        if first not in self._parts:
            triangle = np.array(self._triangle[first:, first:], order="C")
            diagonal = triangle.diagonal()
            inverse = np.full(len(diagonal), _UNSEEN)
            np.divide(1.0, diagonal, out=inverse, where=np.abs(diagonal) > 1 / _UNSEEN)
            self._parts[first] = triangle, inverse
        return self._parts[first]

    def _count_from(self, triangle: Floats) -> None:
        self._triangle, self._grown, self._parts, self._pending = triangle, np.eye(len(triangle)), {}, False

    def _up_to_date(self) -> Floats:
        """R of all rows so far."""
        if not self._pending:
            return self._triangle
        upper = lapack.dpotrf(self._grown, lower=0, clean=1)[0]
        return np.asfortranarray(np.triu(upper @ self._triangle))
