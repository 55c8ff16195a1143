"""First-order thermal lags, eqs. (17) (19) (25).

A body of time constant ``tau`` follows the ambient temperature T by ``tau d(lagged)/dt = T - lagged``:
eq. (17) in its unit-gain form. As printed, (17) and (25) have the steady state ``T tau`` [K s];
(19) subtracts T [K]; the unit-gain form (``lagged = psi / tau``, steady state T) is the temperature that the
paper plots. Linear fits span the same space either way; penalties, coefficients and products do not.

The recursion runs on ``d = lagged - T`` itself, eq. (19) [K]: no reference temperature, no cancellation, and
the same line for regular and irregular steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.blas import dtbsv

from .compiled import follow

Floats = NDArray[np.float64]
Structure = Callable[[Floats], Floats]
CELLS, FINEST = 32, 2e-3
"""Cells that a gap is cut into, and the last of them as a share of the gap, or less where a lag is fast. With eight
times as many, ten times finer, the error is the same to 2 %."""
Hold = Literal["first_order", "zero_order"]


class LagState(NamedTuple):
    """State of the lags between samples, blocks or partitions."""

    lag_difference: Floats
    """``lag_difference[j]`` is lagged - T of time constant j at the last sample [K]."""
    temperature: float
    """Temperature at the last sample [K or degC]."""


FELT = 46.0
"""Time constants after which a start is no longer felt: exp(-46) is below 1e-20."""


def equilibrium(temperature: float, time_constants: ArrayLike) -> LagState:
    """State of a device that rests at `temperature`."""
    return LagState(np.zeros(np.size(time_constants)), float(temperature))


def decay_and_gain(steps: Floats, time_constant: float | Floats, hold: Hold = "first_order") -> tuple[Floats, Floats]:
    """Factors a, g of ``d_next = a d - g (T_next - T)``, eq. (25).

    Parameters
    ----------
    steps : array
        Time from the previous sample to this one [s].
    time_constant : float, or array that broadcasts with `steps`
        [s].
    hold : {"first_order", "zero_order"}
        Temperature between samples: a straight line, or the earlier value. Both are exact for what they assume.

    Returns
    -------
    decay, gain : arrays of the broadcast shape
        ``a = exp(-dt/tau)``; ``g = (1 - a) tau/dt`` for the first-order hold, 1 for the zero-order hold.
    """
    ratio = steps / time_constant
    # Below a tenth, a rational approximation replaces the exponential.
    small = ratio < 0.1  # element by element, so that a value does not depend on its neighbours
    if small.all():
        decay, gain = _of_small_steps(ratio)
    else:
        decay = np.exp(-ratio)
        gain = (1.0 - decay) / ratio if ratio.all() else np.divide(1.0 - decay, ratio, out=0 * ratio, where=~small)
        if small.any():
            decay[small], gain[small] = _of_small_steps(ratio[small])
    return decay, gain if hold == "first_order" else np.ones_like(decay)


def _of_small_steps(ratio: Floats) -> tuple[Floats, Floats]:
    """exp(-r) and (1 - exp(-r))/r for r < 0.1, accurate.

    ``1 - exp(-r) = 2 t/(1 + t)`` with ``t = tanh(r/2)``, whose continued fraction (Abramowitz & Stegun 4.5.70) stops
    at ``tanh(x)/x = (105 + 10 x^2)/(105 + 45 x^2 + x^4)``: wrong by x^8/1.2e6, below 5e-17 here.
    """
    half = 0.5 * ratio
    square = half * half
    below = square + 45.0
    below *= square
    below += 105.0
    square *= 10.0
    square += 105.0
    half *= square
    below += half
    gain = np.divide(square, below, out=square)
    decay = np.multiply(ratio, gain, out=half)
    return np.subtract(1.0, decay, out=decay), gain


def lag_differences(
    temperature: Floats,
    steps: Floats,
    time_constants: Floats,
    state: LagState | None = None,
    *,
    hold: Hold = "first_order",
) -> tuple[Floats, LagState]:
    """Lag differences Psi_j of eq. (19), state in, state out.

    Parameters
    ----------
    temperature : array of shape (n,)
        Ambient temperature at each sample [K or degC].
    steps : array of shape (n,)
        ``steps[k]`` is the time from the sample before k to sample k [s], > 0. ``steps[0]`` reaches back to the
        sample that `state` describes; without a state it is not used.
    time_constants : array of shape (J,)
        [s], > 0.
    state : LagState, optional
        Where the previous block ended. None starts in equilibrium with ``temperature[0]``.
    hold : {"first_order", "zero_order"}
        Temperature between samples.

    Returns
    -------
    lag_difference : array of shape (n, J), Fortran order
        ``lag_difference[k, j]`` is what a body of time constant j feels at sample k, less T [K].
    state : LagState
        To continue with the next block: the result is the same to the last bit however a record is cut.

    Examples
    --------
    A step of 1 K, one hour ago: a body of half an hour still lacks exp(-2) of it.

    >>> import numpy as np
    >>> temperature = np.r_[20.0, np.full(61, 21.0)]
    >>> steps = np.r_[1e-6, 1e-6, np.full(60, 60.0)]
    >>> lag_difference, state = lag_differences(temperature, steps, np.array([1800.0]))
    >>> lag_difference[-1].round(4)
    array([-0.1353])
    """
    time_constants = np.asarray(time_constants, np.float64)
    n, n_lags = len(temperature), len(time_constants)
    if state is not None and np.isnan(state.temperature):
        state = None  # only empty blocks so far
    if n == 0:
        return np.empty((0, n_lags), order="F"), state or equilibrium(np.nan, time_constants)
    first_step = float(steps[0])
    if state is None:
        state, first_step = equilibrium(temperature[0], time_constants), 1.0  # T has not moved: any step will do
    change = np.empty(n)
    change[0] = temperature[0] - state.temperature
    np.subtract(temperature[1:], temperature[:-1], out=change[1:])
    steps = np.concatenate(([first_step], steps[1:]), dtype=np.float64)
    result = _solved(change, steps, time_constants, state.lag_difference, hold)
    return result, LagState(result[-1].copy(), float(temperature[-1]))


def _solved(change: Floats, steps: Floats, time_constants: Floats, first: Floats, hold: Hold) -> Floats:
    """The recursion, compiled or as a bidiagonal system."""
    n = len(change)
    if n > 1 and (steps[1:] == steps[1]).all():
        steps = steps[:2]
    if len(steps) <= 2:
        decay, gain = decay_and_gain(steps, time_constants[:, None], hold)
    else:  # one body after the other, as memory near the processor holds them
        decay, gain = np.stack([decay_and_gain(steps, tau, hold) for tau in time_constants], axis=1)
    result = np.empty((n, len(time_constants)), order="F")
    if follow(change, decay, gain, np.array(first, np.float64), result.T):
        return result
    band, column = np.empty((2, n + 1), order="F"), np.empty(n + 1)  # row 1 of the band is the subdiagonal, - a
    for j, d in enumerate(first):
        band[1, 0], band[1, 1:n] = -decay[j, 0], -decay[j, 1:]
        column[0], column[1], column[2:] = d, -gain[j, 0] * change[0], -gain[j, 1:] * change[1:]
        dtbsv(1, band, column, lower=1, diag=1, overwrite_x=1)  # d[k] = a[k] d[k-1] - g[k] (T[k] - T[k-1])
        result[:, j] = column[1:]
    return result


def bridge_error(structure: Structure, length: float, time_constants: Floats) -> Floats:
    """Covariance of the lags' errors after a gap, shape (J, J).

    A quantity of stationary increments, known at both ends of the gap, leaves the straight line between them by b(t),
    ``cov(b(s), b(t)) = g(s, t) - t/h g(s, h) - s/h g(h, t) + s t/h^2 g(h, h)`` with
    ``g(s, t) = (D(s) + D(t) - D(|s - t|)) / 2`` (Yaglom, Correlation Theory of Stationary and Related Random Functions,
    1987, sec. 23); a lag feels ``integral b(t) exp(-(h - t)/tau) / tau dt``, eq. (17).

    `structure` (callable): D: mean square of the quantity's changes over times [s], its structure function. `length`
    (float): h [s]. `time_constants` (array of shape (J,)): [s].
    """
    finest = min(FINEST * length, float(time_constants.min()) / 4)
    edges = length - np.concatenate((np.geomspace(length, finest, CELLS), [0.0]))  # fast lags feel the end alone
    t = (edges[1:] + edges[:-1]) / 2

    def g(s: Floats, t: Floats) -> Floats:
        return np.asarray((structure(s) + structure(t) - structure(np.abs(s - t))) / 2)

    end, share = np.array(length), t / length
    cross = share[:, None] * g(end, t)
    conditional = g(t[:, None], t) - cross - cross.T + np.outer(share, share) * g(end, end)
    felt = np.diff(np.exp((edges - length) / time_constants[:, None]), axis=1)
    # an estimated D may be that of no quantity: the nearest covariance (Higham, Linear Algebra Appl. 103, 1988)
    values, vectors = np.linalg.eigh(felt @ conditional @ felt.T)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def decays(elapsed: Floats, time_constants: Floats) -> Floats:
    """Start-up columns exp(-t/tau_j) of eq. (18).

    Parameters
    ----------
    elapsed : array of shape (n,)
        Time since the start of the segment [s].
    time_constants : array of shape (J,)
        [s].

    Returns
    -------
    array of shape (n, J), Fortran order
        Dimensionless, 1 at the start of the segment; exactly 0 below 1e-20, where denormals would begin to cost.

    Examples
    --------
    >>> import numpy as np
    >>> decays(np.array([0.0, 600.0]), np.array([600.0])).round(4)
    array([[1.    ],
           [0.3679]])
    """
    columns = np.zeros((len(elapsed), len(time_constants)), order="F")
    least, most = elapsed.min(initial=np.inf), elapsed.max(initial=-np.inf)
    for column, time_constant in zip(columns.T, time_constants, strict=True):
        if least > FELT * time_constant:
            continue
        np.divide(elapsed, -time_constant, out=column)
        over = column < -FELT if most >= FELT * time_constant * (1 - 1e-12) else None  # its quotient is rounded
        with np.errstate(under="ignore"):
            np.exp(column, out=column)
        if over is not None:
            column[over] = 0.0
    return columns
