"""Exact propagation in time of first-order modes, for a driver that is linear between samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def modal_differences(rates: Array, steps: Array, changes: Array, start: Array) -> Array:
    """Propagate every mode exactly over steps in which the air temperature changes linearly.

    Parameters
    ----------
    rates : ndarray of shape (m,)
        Rates of the modes [1/s].
    steps : ndarray of shape (n,)
        Lengths of the steps [s].
    changes : ndarray of shape (n,)
        Change of the air temperature over each step [K].
    start : ndarray of shape (m,)
        Mode minus air temperature before the first step [K].

    Returns
    -------
    differences : ndarray of shape (n, m)
        `differences[k, j]` is mode j minus air temperature after step k [K].
    """
    regular = steps.size > 0 and np.ptp(steps) <= 1e-12 * steps[0]
    exponent = np.outer(steps[:1] if regular else steps, rates)
    gain = -np.expm1(-exponent) / exponent  # first-order hold: (1 - exp(-x)) / x
    return scan(np.exp(-exponent), -gain * changes[:, None], start)


def scan(decay: Array, increment: Array, start: Array) -> Array:
    """Solve d[k] = decay[k] d[k-1] + increment[k] in about 2 sqrt(n) vectorised steps instead of n.

    Rows are dealt into blocks; all blocks run side by side from zero, then the true starts are passed on.
    """
    n, m = increment.shape
    length = max(1, int(np.sqrt(n)))
    blocks = -(-n // length)
    values = np.zeros((blocks * length, m))
    values[:n] = increment
    values = values.reshape(blocks, length, m)
    factors = np.ones((blocks * length, m))
    factors[:n] = decay
    factors = factors.reshape(blocks, length, m)
    for k in range(1, length):
        values[:, k] += factors[:, k] * values[:, k - 1]
        factors[:, k] *= factors[:, k - 1]  # from here on the product since the block's start
    state = np.asarray(start, dtype=float)
    for block in range(blocks):
        values[block] += factors[block] * state
        state = values[block, -1]
    return np.asarray(values.reshape(-1, m)[:n])
