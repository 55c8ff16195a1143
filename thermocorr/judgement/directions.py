"""Directions that columns span: all but rounding, or those in which a law of the usual size would show."""

from __future__ import annotations

import numpy as np

from .levels import ROUNDED, VISIBLE


def orthonormal(columns: np.ndarray, tolerance: float = ROUNDED) -> np.ndarray:
    """Orthonormal basis of columns of very different size, shape (n, k); directions below the tolerance are dropped."""
    directions, size = _directions(columns)
    return directions[:, size > tolerance]


def visible(columns: np.ndarray, reading: np.ndarray) -> np.ndarray:
    """Orthonormal basis of a base, constant first, without directions in which no plausible law can be seen.

    Lags that are close together differ by little, and their differences by less. Such directions take what another
    cause makes upon themselves, a delay most of all, with coefficients that are thousands of times those of the law.
    """
    directions, size = _directions(columns)
    known = directions[:, size > ROUNDED]
    rest = reading - known @ (known.T @ reading)
    noise = float(np.sqrt(np.mean(np.diff(rest) ** 2) / 2))
    constant = columns[:, 0] / (float(np.linalg.norm(columns[:, 0])) or 1.0)  # starts of all runs may hold it
    law = float(np.linalg.norm(reading - constant * (constant @ reading)))
    return directions[:, size > max(ROUNDED, VISIBLE * noise / law if law > 0 else 0.0)]


def _directions(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of columns scaled to unit length, and their sizes over the largest."""
    norms = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return np.asarray(left), singular / singular[:1].max(initial=1e-300)
