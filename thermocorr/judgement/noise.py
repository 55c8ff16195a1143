"""Autoregressive noise: its model, and the filter that makes it white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

MAX_ORDER = 12


@dataclass(frozen=True)
class NoiseModel:
    """Noise e with ``e[k] = sum_i phi[i] e[k - 1 - i] + innovation``."""

    phi: np.ndarray
    """Shape (order,)."""
    innovation_variance: float
    variance: float

    @property
    def colour(self) -> float:
        """Variance over innovation variance: 1 for white noise, what the past explains beyond."""
        return self.variance / self.innovation_variance

    def whitened(self, columns: np.ndarray, segment: np.ndarray) -> np.ndarray:
        """Columns, shape (n, p), without what the noise model foresees; the first rows of a segment are left out."""
        order = len(self.phi)
        result = columns[order:].copy()
        for i, share in enumerate(self.phi):
            result -= share * columns[order - 1 - i : len(columns) - 1 - i]
        return np.asarray(result[segment[order:] == segment[: len(segment) - order]])


def noise_model(residual: np.ndarray, segment: np.ndarray, max_order: int = MAX_ORDER) -> NoiseModel:
    """Yule-Walker fit with the order that minimises BIC (Brockwell & Davis 1991, section 8.1, 9.3).

    Parameters
    ----------
    residual : array of shape (n,)
        Evenly spaced inside a segment.
    segment : array of shape (n,)
        Rows of different segments are independent.
    """
    residual = residual - residual.mean()
    n = len(residual)
    max_order = min(max_order, n // 20)
    covariance = np.array(
        [
            np.sum((residual[lag:] * residual[: n - lag])[segment[lag:] == segment[: n - lag]]) / n
            for lag in range(max_order + 1)
        ]
    )
    best: tuple[float, np.ndarray, float] = (n * np.log(covariance[0]), np.zeros(0), covariance[0])
    for order in range(1, max_order + 1):
        phi = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
        variance = float(covariance[0] - phi @ covariance[1 : order + 1])
        if variance <= 0:
            break
        criterion = n * np.log(variance) + order * np.log(n)
        if criterion < best[0]:
            best = (criterion, phi, variance)
    return NoiseModel(best[1], float(best[2]), float(covariance[0]))
