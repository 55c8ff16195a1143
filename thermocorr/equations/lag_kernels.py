"""Factors of steps and the recursion of eq. (25), for numba to compile.

Imported by whoever has asked `thermocorr.equations.compiled` for it, for numba takes half a second. What numba keeps
for other processes is as old as the file of the function it belongs to: who changes this file removes `__pycache__`
beside it, for `kernels.py` holds copies of what is written here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .compiled import jitted

Floats = NDArray[np.float64]
inline: Callable[[Any], Any] = jitted(inline="always")
TILE = 256
"""Rows of a tile: its numbers stay in the processor's nearest caches."""
_LANES = 32
"""`_recursion` makes factors for a multiple of so many rows: those of a row are the same whatever is around it."""
_LN2, _PER_LN2 = math.log(2.0), 1.0 / math.log(2.0)
_LARGEST_RATIO = 700.0
"""Step over time constant up to which the decay is known, and from which it stays what it is there, 1e-304."""


@inline
def _series(f):  # type: ignore[no-untyped-def]
    """(exp(f) - 1)/f for |f| <= ln(2)/2, to the last digit."""
    p = 1.0 / 39916800.0 + f * (1.0 / 479001600.0 + f * (1.0 / 6227020800.0))
    p = 1.0 / 40320.0 + f * (1.0 / 362880.0 + f * (1.0 / 3628800.0 + f * p))
    p = 1.0 / 120.0 + f * (1.0 / 720.0 + f * (1.0 / 5040.0 + f * p))
    return 1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * p)))


@inline
def factors_of_steps(steps, per_step, longest, n, rate, first_order, power, decay, gain):  # type: ignore[no-untyped-def]
    """exp(-r) and (1 - exp(-r))/r of r = step * rate, each element for itself, to the last digit or two.

    ``exp(-r) = 2^-m exp(f)`` with a whole m and ``|f| <= ln(2)/2``; where r is small, m is 0 and nothing is lost.
    `per_step` is 1/steps, `longest` no step exceeds; `power`, of n numbers, is written to.
    """
    if longest * rate * _PER_LN2 < 0.499:  # all m are 0: what is below would come to the same
        for k in range(n):
            f = -steps[k] * rate
            p = _series(f)
            gain[k], decay[k] = p, 1.0 + f * p
    else:
        tau, bits = 1.0 / rate, power.view(np.int64)
        for k in range(n):
            r = min(steps[k] * rate, _LARGEST_RATIO)
            m = np.floor(r * _PER_LN2 + 0.5)
            f = m * _LN2 - r
            p = _series(f)
            gain[k], decay[k], power[k] = p, 1.0 + f * p, m
        for k in range(n):
            bits[k] = (1023 - np.int64(np.int32(power[k]))) << 52  # 2^-m as a floating-point number of IEEE 754
        for k in range(n):
            decay[k] *= power[k]
            gain[k] = gain[k] if power[k] == 1.0 else (1.0 - decay[k]) * (per_step[k] * tau)
    if not first_order:
        for k in range(n):
            gain[k] = 1.0


@inline
def follow(change, first, n, decay, gain, each, lags, out):  # type: ignore[no-untyped-def]
    """The recursion of eq. (25), six bodies side by side: the processor works on five while it waits for one.

    It fills columns `first` to `n` of `out` and carries `lags` on. `decay` and `gain` have a column for each row where
    `each` is 1, and one for all where it is 0.
    """
    j = 0
    while len(lags) - j >= 6:
        d0, d1, d2, d3, d4, d5 = lags[j], lags[j + 1], lags[j + 2], lags[j + 3], lags[j + 4], lags[j + 5]
        for k in range(first, n):
            step, i = change[k], k * each
            d0 = decay[j, i] * d0 - gain[j, i] * step
            d1 = decay[j + 1, i] * d1 - gain[j + 1, i] * step
            d2 = decay[j + 2, i] * d2 - gain[j + 2, i] * step
            d3 = decay[j + 3, i] * d3 - gain[j + 3, i] * step
            d4 = decay[j + 4, i] * d4 - gain[j + 4, i] * step
            d5 = decay[j + 5, i] * d5 - gain[j + 5, i] * step
            out[j, k], out[j + 1, k], out[j + 2, k] = d0, d1, d2
            out[j + 3, k], out[j + 4, k], out[j + 5, k] = d3, d4, d5
        lags[j], lags[j + 1], lags[j + 2], lags[j + 3], lags[j + 4], lags[j + 5] = d0, d1, d2, d3, d4, d5
        j += 6
    while len(lags) - j >= 2:
        d0, d1 = lags[j], lags[j + 1]
        for k in range(first, n):
            step, i = change[k], k * each
            d0 = decay[j, i] * d0 - gain[j, i] * step
            d1 = decay[j + 1, i] * d1 - gain[j + 1, i] * step
            out[j, k], out[j + 1, k] = d0, d1
        lags[j], lags[j + 1] = d0, d1
        j += 2
    if j < len(lags):
        d0 = lags[j]
        for k in range(first, n):
            d0 = decay[j, k * each] * d0 - gain[j, k * each] * change[k]
            out[j, k] = d0
        lags[j] = d0


def _recursion(change, steps, rates, first_order, alike, lags, out):  # type: ignore[no-untyped-def]
    n_lags, n = out.shape
    here, per_step, power = np.empty(TILE), np.empty(TILE), np.empty(TILE)
    decay, gain = np.empty((n_lags, TILE)), np.empty((n_lags, TILE))
    at = 0
    while at < n:
        rows = min(TILE, n - at)
        if at == 0 or not alike:
            full = _LANES if alike else (rows + _LANES - 1) // _LANES * _LANES
            longest = 0.0
            for k in range(full):
                here[k] = steps[min(at + k, n - 1)]
                longest = max(longest, here[k])
                per_step[k] = 1.0 / here[k]
            for j in range(n_lags):
                factors_of_steps(here, per_step, longest, full, rates[j], first_order, power, decay[j], gain[j])
        if alike:  # the first step may be another one: that row goes alone, and then all others
            rows = 1 if at == 0 else n - at
        follow(change[at : at + rows], 0, rows, decay, gain, 0 if alike else 1, lags, out[:, at : at + rows])
        if alike and at == 0:
            for j in range(n_lags):
                decay[j, 0], gain[j, 0] = decay[j, 1], gain[j, 1]
        at += rows


recursion: Callable[[Floats, Floats, Floats, bool, bool, Floats, Floats], None] = jitted(
    cache=True, fastmath={"contract"}, error_model="numpy"
)(_recursion)
"""Function ``(change, steps, rates, first_order, alike, lags, out)`` that fills `out`, shape (J, n).

``out[:, k] = decay[k] * out[:, k - 1] - gain[k] * change[k]``, with `lags`, shape (J,), in front, which are carried on.
`steps` are [s], `rates` 1/tau [1/s]; `alike` says that all steps but the first are the same. Arrays are of float64,
contiguous in C's order and writable, so that there is one function to compile.
"""
