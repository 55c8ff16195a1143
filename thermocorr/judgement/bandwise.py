"""Sums over bands of frequency of cross products of columns, and least squares from these."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import lapack


def weighted(weights: np.ndarray, products: np.ndarray) -> np.ndarray:
    """Sum over the bands of cross products, shape (bands, ...), each with its weight."""
    return np.asarray(weights @ products.reshape(len(products), -1)).reshape(products.shape[1:])


def forms(products: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """``left @ products[g] @ right`` in each band."""
    return np.asarray(products.reshape(len(products), -1) @ np.outer(left, right).ravel())


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
