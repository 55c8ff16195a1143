"""Recursions as compiled code, where numba is installed (extra "fast"); about ten times faster than LAPACK's solver.

Four time constants run side by side, so that the processor works on three while it waits for one. Set the environment
variable THERMOCORR_COMPILED=0 to do without. Results agree with the plain path to the last digit or two.
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
Recursion = Callable[[Floats, Floats, Floats, Floats, Floats], None]
Play = Callable[[Floats, Floats, float, Floats], None]


@cache
def compiled_recursion() -> Recursion | None:
    """Function ``(change, decay, gain, first, out)`` that fills `out`, shape (n, J); None without numba.

    ``out[k] = decay[k] * out[k - 1] - gain[k] * change[k]``, `first` before `out`; `decay` and `gain` have n rows, or
    two where every step but the first is the same.
    """
    compiled: Recursion | None = _compiled(_recursion)
    return compiled


def play(low: Floats, high: Floats, position: float) -> Floats:
    """A position that is pushed, shape (n,): the last one (first `position`), brought between ``low`` and ``high``."""
    compiled = _compiled_play()
    if compiled is None:
        followed = [0.0] * len(low)
        _play(low.tolist(), high.tolist(), position, followed)
        return np.array(followed)
    out = np.empty(len(low))
    compiled(low, high, position, out)
    return out


@cache
def _compiled_play() -> Play | None:
    compiled: Play | None = _compiled(_play)
    return compiled


def is_compiled() -> bool:
    """Whether there is compiled code: numba is installed, and the environment does not forbid it."""
    return os.environ.get("THERMOCORR_COMPILED", "1") != "0" and find_spec("numba") is not None


def jitted(*, cache: bool = False, **options: Any) -> Callable[[Any], Any]:
    """Decorator that compiles a function when it is first called; without numba the function stays as it is.

    With `cache` the code is kept beside the source for other processes. Functions that it calls are decorated with
    ``inline="always"``: compiled apart, they may round otherwise in the process that compiles them.
    """
    if find_spec("numba") is None:
        return lambda function: function
    from numba import njit

    plain = njit(nogil=True, **options)
    return (lambda function: _kept(function, plain, njit(nogil=True, cache=True, **options))) if cache else plain


def _compiled(function: Any) -> Any:
    """A function whose products and sums may be rounded once, not twice: the processor waits half as long for each."""
    return jitted(cache=True, fastmath={"contract"})(function) if is_compiled() else None


def _kept(function: Any, plain: Any, keeping: Any) -> Any:
    try:
        kept = keeping(function)
    except RuntimeError:  # numba finds no folder to keep the code in: it is compiled by each process
        return plain(function)

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


def _recursion(change: Any, decay: Any, gain: Any, first: Any, out: Any) -> None:
    n, n_lags = out.shape
    last = decay.shape[0] - 1
    for j in range(0, n_lags - n_lags % 4, 4):
        d0, d1, d2, d3 = first[j], first[j + 1], first[j + 2], first[j + 3]
        for k in range(n):
            row = min(k, last)
            step = change[k]
            d0 = decay[row, j] * d0 - gain[row, j] * step  # eq. (25) for d = lagged - T
            d1 = decay[row, j + 1] * d1 - gain[row, j + 1] * step
            d2 = decay[row, j + 2] * d2 - gain[row, j + 2] * step
            d3 = decay[row, j + 3] * d3 - gain[row, j + 3] * step
            out[k, j], out[k, j + 1], out[k, j + 2], out[k, j + 3] = d0, d1, d2, d3
    for j in range(n_lags - n_lags % 4, n_lags):
        d = first[j]
        for k in range(n):
            row = min(k, last)
            d = decay[row, j] * d - gain[row, j] * change[k]
            out[k, j] = d
