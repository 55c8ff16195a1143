"""Two recursions, compiled by numba (extra "fast").

Set the environment variable THERMOCORR_COMPILED=0 to do without. Lags agree with the plain path to the last digit or
two, for a product and a sum may be rounded once, not twice: the processor waits half as long for each.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def play(low: Floats, high: Floats, position: float) -> Floats:
    """Play operator: the position pushed between ``low`` and ``high``."""
    run = compiled(_play)
    if run is None:
        followed = [0.0] * len(low)
        _play(low.tolist(), high.tolist(), position, followed)
        return np.array(followed)
    out = np.empty(len(low))
    run(low, high, position, out)
    return out


def follow(change: Floats, decay: Floats, gain: Floats, first: Floats, out: Floats) -> bool:
    """Fill `out` by eq. (25); False without numba.

    ``out[j, k] = decay[j, k] out[j, k - 1] - gain[j, k] change[k]``.

    `first`, shape (J,), stands before the first row, and is carried on. `decay` and `gain` have two columns where all
    rows but the first have the same.
    """
    run = compiled(_follow)
    if run is not None:
        run(change, decay, gain, first, out)
    return run is not None


@cache
def compiled(function: Callable[..., None]) -> Callable[..., None] | None:
    """A compiled function, cached; None without numba."""
    if os.environ.get("THERMOCORR_COMPILED", "1") == "0" or find_spec("numba") is None:
        return None
    from numba import njit

    options: Any = {"nogil": True, "fastmath": {"contract"}}
    try:
        kept = njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds no folder to keep the code in: each process compiles it
        plain: Callable[..., None] = njit(**options)(function)
        return plain

    def called(*arguments: Any) -> None:
        try:
            kept(*arguments)
        except OSError:  # it is compiled, and could not be kept: the disk is full
            kept(*arguments)

    return called


def _play(low: Any, high: Any, position: Any, out: Any) -> None:
    for k in range(len(out)):
        if position < low[k]:
            position = low[k]
        elif position > high[k]:
            position = high[k]
        out[k] = position


def _follow(change: Any, decay: Any, gain: Any, lags: Any, out: Any) -> None:
    n, even, low = len(change), decay.shape[1] < len(change), 0
    while low < n:  # a few rows of each body in turn: the processor, which waits for a last row, has begun others
        high = min(low + 16, n) if low else 1
        for j in range(len(lags)):
            d = lags[j]
            if even:
                a, g = decay[j, min(low, 1)], gain[j, min(low, 1)]
                for k in range(low, high):
                    d = a * d - g * change[k]
                    out[j, k] = d
            else:
                for k in range(low, high):
                    d = decay[j, k] * d - gain[j, k] * change[k]
                    out[j, k] = d
            lags[j] = d
        low = high
