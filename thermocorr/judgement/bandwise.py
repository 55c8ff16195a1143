"""Sums over bands of frequency of cross products of columns, and least squares from these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack, solve_triangular

from .levels import ALIVE


@dataclass(frozen=True, kw_only=True)
class ExplanationColumns:
    """Columns of one explanation, transformed, base of the start taken out, with their cross products in each band."""

    rows: np.ndarray
    """Shape (n, k)."""
    own: np.ndarray
    """Cross products with one another, shape (bands, k, k)."""
    base: np.ndarray
    """Cross products with the base, shape (bands, p, k)."""
    reading: np.ndarray
    """Cross products with the reading, shape (bands, k)."""


@dataclass(frozen=True, kw_only=True)
class BaseProducts:
    """Cross products in each band of the reading and a base of p columns."""

    zz: np.ndarray
    """The reading's sums of squares, shape (bands,)."""
    Qz: np.ndarray
    """The base's with the reading, shape (bands, p)."""
    QQ: np.ndarray
    """The base's with itself, shape (bands, p, p)."""

    def solved(self, W: np.ndarray, beside: Sequence[ExplanationColumns | None]) -> tuple[list[np.ndarray], np.ndarray]:
        """Least squares of the reading on the base with each of some explanations, each under its own weights.

        Parameters
        ----------
        W : array of shape (J, bands)
        beside : sequence of length J
            None is the base alone.

        Returns
        -------
        coefs : list of J arrays
            Of the base's columns and the explanation's.
        power : array of shape (bands, J)
            Sums of squares that they leave in each band.
        """
        p = self.Qz.shape[1]
        A, b = weighted(W, self.QQ), W @ self.Qz
        coefs = [solved(*_bordered(A[j], b[j], W[j], found)) for j, found in enumerate(beside)]
        base = np.stack([coef[:p] for coef in coefs])
        power = self.zz[:, None] - 2 * self.Qz @ base.T + forms(self.QQ, base, base)
        for j, found in enumerate(beside):
            if found is not None:
                more = coefs[j][None, p:]
                own = 2 * forms(found.base, base[j : j + 1], more) + forms(found.own, more, more)
                power[:, j] += own[:, 0] - 2 * found.reading @ more[0]
        return coefs, np.maximum(power, 1e-12 * self.zz[:, None])

    def half(self, weights: np.ndarray) -> np.ndarray:
        """Cholesky factor of the base's weighted products, weights of shape (bands,)."""
        A = weighted(weights, self.QQ)
        return np.linalg.cholesky(A + 1e-12 * np.trace(A) / len(A) * np.eye(len(A)))

    def taken(self, W: np.ndarray, founds: Sequence[ExplanationColumns]) -> tuple[np.ndarray, np.ndarray]:
        """Weighted sums of squares of the reading that explanations take away beside the base.

        Parameters
        ----------
        W : array of shape (J, bands)
        founds : sequence of length K > 0

        Returns
        -------
        taken : array of shape (J, K)
            0 where the base holds one of an explanation's columns.
        left : array of shape (J,)
            What the base alone leaves.
        """
        widths = np.array([found.own.shape[1] for found in founds])
        starts, single = np.cumsum(widths) - widths, np.flatnonzero(widths == 1)
        own = np.array([founds[i].own[:, 0, 0] for i in single.tolist()]).reshape(len(single), len(self.zz))
        together = weighted(W, np.concatenate([found.base for found in founds], axis=2))
        moments = W @ np.concatenate([found.reading for found in founds], axis=1)
        taken, left = np.zeros((len(W), len(founds))), np.empty(len(W))
        for j, weights in enumerate(W):
            half = self.half(weights)
            b = solve_triangular(half, weights @ self.Qz, lower=True)
            left[j] = weights @ self.zz - b @ b
            columns = solve_triangular(half, together[j], lower=True)
            moment = moments[j] - b @ columns
            full = own @ weights
            beside = full - squares_of(columns[:, starts[single]])
            alive = beside > ALIVE**2 * full
            taken[j, single[alive]] = moment[starts[single[alive]]] ** 2 / beside[alive]
            for i in np.flatnonzero(widths > 1).tolist():
                part = slice(starts[i], starts[i] + widths[i])
                full = weighted(weights, founds[i].own)
                beside = full - columns[:, part].T @ columns[:, part]
                if np.all(np.diag(beside) > ALIVE**2 * np.diag(full)):
                    taken[j, i] = moment[part] @ solved(beside, moment[part])
        return taken, left


def _bordered(
    A: np.ndarray, b: np.ndarray, weights: np.ndarray, found: ExplanationColumns | None
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of the base with an explanation's columns at their end."""
    if found is None:
        return A, b
    p, k = len(b), found.own.shape[1]
    both = np.empty((p + k, p + k))
    both[:p, :p], both[:p, p:], both[p:, p:] = A, weighted(weights, found.base), weighted(weights, found.own)
    both[p:, :p] = both[:p, p:].T
    return both, np.concatenate((b, weights @ found.reading))


def weighted(weights: np.ndarray, products: np.ndarray) -> np.ndarray:
    """Sum over the bands of cross products, shape (bands, ...), under weights of shape (..., bands)."""
    return np.asarray(weights @ products.reshape(len(products), -1)).reshape(*weights.shape[:-1], *products.shape[1:])


def forms(products: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """``left[j] @ products[g] @ right[j]`` in each band g, shape (bands, J)."""
    outer = left[:, :, None] * right[:, None, :]
    return np.asarray(products.reshape(len(products), -1) @ outer.reshape(len(outer), -1).T)


def side_by_side(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Columns of several arrays in one, each in one piece of memory (Fortran order)."""
    return np.concatenate([part.T for part in columns]).T


def squares_of(columns: np.ndarray) -> np.ndarray:
    """Sum of squares of each column."""
    return np.asarray(np.einsum("ij,ij->i", columns.T, columns.T))


def solved(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least squares from normal equations of columns of very different size; directions that are not there stay out."""
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    unit = A * scale[:, None] * scale
    half, failed = lapack.dpotrf(unit, lower=1)
    if not failed and np.diag(half).min() > 1e-4:
        return np.asarray(scale * lapack.dpotrs(half, scale * b, lower=1)[0])
    values, vectors = np.linalg.eigh(unit)
    kept = values > 1e-11 * values[-1]
    V = vectors[:, kept]
    return np.asarray(scale * (V @ ((V.T @ (scale * b)) / values[kept])))
