"""Factors of steps and the recursion of eq. (25), for numba to compile.

Imported by whoever has asked `thermocorr.equations.compiled` for it, for numba takes half a second.
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
_TURN = 16
"""Rows of one body before it is the next one's turn: the compiler writes them out."""
_LN2, _PER_LN2 = math.log(2.0), 1.0 / math.log(2.0)


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
            # Largest step over time constant; beyond it the decay stays at 1e-304
            r = min(steps[k] * rate, 700.0)
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
def factors_of_tile(  # type: ignore[no-untyped-def]
    steps, n, usual, rates, first, first_order, per_step, power, decay, gain
):
    """True if all `n` steps are the `usual` one; where not, the factors of each row and each body from `first` on."""
    others = 0
    for k in range(n):
        others += steps[k] != usual
    if others:
        longest = 0.0
        for k in range(n):
            longest = max(longest, steps[k])
            per_step[k] = 1.0 / steps[k]
        for j in range(first, len(rates)):
            factors_of_steps(steps, per_step, longest, n, rates[j], first_order, power, decay[j], gain[j])
    return others == 0


@inline
def keep_last(first, n, decay, gain):  # type: ignore[no-untyped-def]
    """The factors of the last of `n` rows, which serve as long as steps are even, go to the first column."""
    for j in range(first, len(decay)):
        decay[j, 0], gain[j, 0] = decay[j, n - 1], gain[j, n - 1]


@inline
def _carry_on(change, at, n, decay, gain, even, lags, out):  # type: ignore[no-untyped-def]
    """The recursion through `n` rows from row `at` on, one body after the other."""
    for j in range(len(lags)):
        d, a, g = lags[j], decay[j, 0], gain[j, 0]
        for k in range(n):
            if not even:
                a, g = decay[j, at + k], gain[j, at + k]
            d = a * d - g * change[at + k]
            out[j, at + k] = d
        lags[j] = d


@inline
def follow(change, first, n, decay, gain, even, lags, out):  # type: ignore[no-untyped-def]
    """The recursion of eq. (25): it fills columns `first` to `n` of `out` and carries `lags` on.

    `decay` and `gain` have a column for each row, and where steps are `even` one for all. A few rows of each body at a
    time: the processor, which must wait for a body's last row, has begun with the next bodies by then, and numbers that
    lie side by side are written together.
    """
    at = first
    while n - at >= _TURN:
        _carry_on(change, at, _TURN, decay, gain, even, lags, out)
        at += _TURN
    _carry_on(change, at, n - at, decay, gain, even, lags, out)


def _recursion(temperature, before, steps, first_step, rates, first_order, lags, out):  # type: ignore[no-untyped-def]
    n_lags, n = out.shape
    here, per_step, power, change = np.empty(TILE), np.empty(TILE), np.empty(TILE), np.empty(TILE)
    decay, gain = np.empty((n_lags, TILE)), np.empty((n_lags, TILE))
    usual = np.nan  # the step whose factors stand in the first columns
    for at in range(0, n, TILE):
        rows = min(TILE, n - at)
        here[:rows] = steps[at : at + rows]
        if at == 0:
            here[0] = first_step
        full = (rows + _LANES - 1) // _LANES * _LANES
        here[rows:full] = here[rows - 1]
        even = factors_of_tile(here, full, usual, rates, 0, first_order, per_step, power, decay, gain)
        some = temperature[at : at + rows]
        change[0] = some[0] - before
        for k in range(1, rows):
            change[k] = some[k] - some[k - 1]
        before = some[rows - 1]
        follow(change, 0, rows, decay, gain, even, lags, out[:, at : at + rows])
        if not even:
            usual = here[rows - 1]
            keep_last(0, rows, decay, gain)


recursion: Callable[[Floats, float, Floats, float, Floats, bool, Floats, Floats], None] = jitted(
    cache=True, fastmath={"contract"}, error_model="numpy"
)(_recursion)
"""Function ``(temperature, before, steps, first_step, rates, first_order, lags, out)`` that fills `out`, shape (J, n).

``out[:, k] = decay[k] * out[:, k - 1] - gain[k] * (temperature[k] - temperature[k - 1])``, with `lags`, shape (J,), and
the temperature `before` in front; `lags` are carried on. Steps are [s], `first_step` stands for the first of `steps`;
`rates` are 1/tau [1/s]. Arrays are of float64, contiguous in C's order; temperature and steps are read-only, so that
there is one function to compile.
"""
