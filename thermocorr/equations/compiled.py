"""Compiled code, where numba is installed (extra "fast").

Set the environment variable THERMOCORR_COMPILED=0 to do without. Results agree with the plain path to the last digit or
two.
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
Play = Callable[[Floats, Floats, float, Floats], None]


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


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """A view that is so whatever the values are: there is one function to compile."""
    view = values.view()
    view.flags.writeable = False
    return view


def is_compiled() -> bool:
    """True if there is compiled code: numba is installed, and the environment does not forbid it."""
    return os.environ.get("THERMOCORR_COMPILED", "1") != "0" and find_spec("numba") is not None


def jitted(*, cache: bool = False, **options: Any) -> Callable[[Any], Any]:
    """Decorator that compiles a function when it is first called; without numba the function stays as it is.

    With `cache` the code is kept next to the source for other processes. Functions that it calls are decorated with
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

    def called(*arguments: Any) -> Any:
        try:
            return kept(*arguments)
        except OSError:  # it is compiled, and could not be kept: the disk is full
            return kept(*arguments)

    return called


def _play(low: Any, high: Any, position: Any, out: Any) -> None:
    for k in range(len(out)):
        if position < low[k]:
            position = low[k]
        elif position > high[k]:
            position = high[k]
        out[k] = position
