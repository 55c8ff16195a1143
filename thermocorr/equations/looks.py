"""Looks at values and times: whether values stay near each other, their mean, spread and range; steps of times.

In one to three passes of compiled code where numba is installed, in up to eight of NumPy otherwise: what they find is
the same, sums to the last digits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import is_compiled, jitted, read_only

Floats = NDArray[np.float64]
_COMPILED = (np.dtype(np.float64), np.dtype(np.int64))
_LANES = 32
"""Values whose range is followed side by side."""


class Summed(NamedTuple):
    """What some values come to; the mean is no number where one of them is none."""

    mean: float
    squares: float
    """Sum of the squared deviations from the mean."""
    low: float
    high: float


def stay_within(values: Floats, most: float) -> bool:
    """Whether no step from a value to the next is larger than `most`; not so where one is missing (NaN)."""
    kernels = _kernels() if _is_plain(values) else None
    if kernels is not None:
        return not kernels.beyond(read_only(values), most)
    steps = values[1:] - values[:-1]
    return bool(steps.max(initial=0.0) <= most and steps.min(initial=0.0) >= -most)


def summed(values: Floats) -> Summed:
    """What one value or more come to, shape (n,)."""
    kernels = _kernels() if _is_plain(values) else None
    if kernels is not None:
        found = np.empty(4)
        kernels.sum_up(read_only(values), found)
        return Summed(*found.tolist())
    mean = float(values.sum() / len(values))
    if np.isnan(mean):
        return Summed(mean, mean, mean, mean)
    centred = values - mean
    return Summed(mean, float(centred @ centred), float(values.min()), float(values.max()))


def are_apart(ticks: NDArray[Any], step: float) -> bool:
    """Whether each time is exactly a step later than the one before; integers or floats, shape (n,)."""
    kernels = _kernels() if _is_plain(ticks) else None
    return bool((np.diff(ticks) == step).all()) if kernels is None else not kernels.not_apart(read_only(ticks), step)


def steps_between(ticks: NDArray[Any], per_second: int, out: Floats) -> None:
    """Steps from each of the times to the next [s], shape (n - 1,); no two may lie too far apart for a difference."""
    kernels = _kernels() if _is_plain(ticks) and _is_plain(out) else None
    if kernels is None:
        np.divide(ticks[1:] - ticks[:-1], per_second, out=out)
    else:
        kernels.step(read_only(ticks), per_second, out)


class _Kernels(NamedTuple):
    not_apart: Callable[[NDArray[Any], float], int]
    step: Callable[[NDArray[Any], int, Floats], None]
    beyond: Callable[[Floats, float], int]
    sum_up: Callable[[Floats, Floats], None]


@cache
def _kernels() -> _Kernels | None:
    if not is_compiled():
        return None
    compiled = jitted(cache=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
    return _Kernels(*(compiled(function) for function in (_not_apart, _step, _beyond, _sum_up)))


def _is_plain(values: NDArray[Any]) -> bool:
    return values.dtype in _COMPILED and values.flags.c_contiguous and values.flags.aligned


def _not_apart(ticks: Any, step: Any) -> Any:
    """Number of steps that are others."""
    count = 0
    for k in range(1, len(ticks)):
        count += ticks[k] - ticks[k - 1] != step
    return count


def _step(ticks: Any, per_second: Any, out: Any) -> None:
    for k in range(len(out)):
        out[k] = (ticks[k + 1] - ticks[k]) / per_second


def _beyond(values: Any, most: Any) -> Any:
    """Number of steps that are larger, or NaN."""
    count = 0
    for k in range(1, len(values)):
        count += not abs(values[k] - values[k - 1]) <= most
    return count


def _sum_up(values: Any, found: Any) -> None:
    n, total, off, squares = len(values), 0.0, 0.0, 0.0
    for k in range(n):
        total += values[k]
    mean = total / n
    for k in range(n):  # and correct the mean (Chan, Golub & LeVeque 1983, two passes)
        deviation = values[k] - mean
        off += deviation
        squares += deviation * deviation
    mean += off / n
    squares = max(squares - off * off / n, 0.0)
    lows, highs = np.full(_LANES, values[0]), np.full(_LANES, values[0])
    full = n // _LANES * _LANES
    for at in range(0, full, _LANES):
        for k in range(_LANES):
            x = values[at + k]
            lows[k] = x if x < lows[k] else lows[k]
            highs[k] = x if x > highs[k] else highs[k]
    low, high = lows.min(), highs.max()
    for k in range(full, n):
        low = values[k] if values[k] < low else low
        high = values[k] if values[k] > high else high
    found[0], found[1] = mean, squares
    found[2], found[3] = (low, high) if mean == mean else (mean, mean)
