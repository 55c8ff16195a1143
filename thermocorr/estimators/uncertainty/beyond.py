"""What a static law may do beyond the temperatures that it was fitted to, at each depth of the device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...effects import StaticPolynomial
from ...effects.thermal import ThermalLag
from .basis import Basis, ScaledBasis
from .restricted import BandSums

MOST_MOVED = 1.1
"""Standard deviation of the temperature inside a device, over that outside, above which it is none."""
ROUNDING = 1e-9
"""A temperature that lies beyond the fitted ones by this share of their range is not outside yet."""


@dataclass(frozen=True, kw_only=True)
class Beyond:
    """The next power of the static law, which the model leaves out.

    What is curved may feel the temperature at any depth: k temperatures are asked, first the one that the device acts
    by as its linear law has it, then that of each of its parts.
    """

    power: int
    size: float
    """Root mean square of its coefficient, from estimate and standard error [reading per K^power]."""
    weights: np.ndarray
    """What the columns of the joint errors' effects make of each temperature about the reference [K], shape (k, p)."""
    alike: np.ndarray
    """Combination of the lower powers that is like it inside, from the zeroth on, shape (k, power)."""
    lowest: np.ndarray
    """Lowest value of each temperature in the fitted record [K], shape (k,)."""
    highest: np.ndarray
    """Highest value of each temperature in the fitted record [K], shape (k,)."""

    def variance(self, columns: np.ndarray, outside: np.ndarray) -> np.ndarray:
        """Variance of what the power may do in rows of columns, shape (n, p): the largest at any depth, shape (n,).

        A depth counts in rows whose measured temperature is `outside` the fitted ones, shape (n,), and where its own
        is: after an excursion it is so for a while.
        """
        found = np.zeros(len(columns))
        for weights, alike, low, high in zip(self.weights, self.alike, self.lowest, self.highest, strict=True):
            felt = columns @ weights
            rows = np.flatnonzero(outside | (felt < low) | (felt > high))
            if len(rows):
                powers = felt[rows, None] ** np.arange(self.power + 1)
                error = (powers[:, -1] - powers[:, :-1] @ alike) * self.size
                found[rows] = np.maximum(found[rows], error**2)
        return found


def beyond_of(basis: Basis, scaled: ScaledBasis, sums: BandSums, coef: np.ndarray) -> Beyond | None:
    """The next power, for coefficients of intercept and all columns; None where the record holds nothing of it."""
    first = basis.effects[0]
    if not isinstance(first, StaticPolynomial) or first.degree < 1 or first.lowest_power > 1:
        return None
    power = first.degree + 1
    weights = np.vstack((_acting(basis, coef), _parts(basis)))
    felt = basis.columns[:, 1:] @ weights[:, basis.free[1:] - 1].T
    alike = []
    for each in felt.T:
        lower = each[:, None] ** np.arange(power)
        alike.append(np.linalg.lstsq(lower, each**power, rcond=1e-10)[0])
    rest = felt[:, 0] ** power - felt[:, :1] ** np.arange(power) @ alike[0]
    if not float(np.linalg.norm(rest)) > 1e-9 * float(np.linalg.norm(felt[:, 0] ** power)):
        return None
    known = sums.beside(rest / scaled.size)
    if known is None:
        return None
    size = float(np.hypot(known[0], np.sqrt(known[1]))) * scaled.unit
    lowest, highest = _ranges(felt, basis)
    return Beyond(power=power, size=size, weights=weights, alike=np.array(alike), lowest=lowest, highest=highest)


def _acting(basis: Basis, coef: np.ndarray) -> np.ndarray:
    """What columns make of the temperature that the device acts by, as its linear law has it, shape (p,).

    Inside it moves no more than outside: where the law says otherwise, as when the sensitivity is next to nothing, the
    measured temperature is taken.
    """
    slope = float(coef[1])
    lags = [isinstance(effect, ThermalLag) for effect in basis.effects for _ in effect.names()]
    weights = np.where(lags, coef[1:] / slope, 0.0) if abs(slope) > 0 else np.zeros(len(lags))
    weights[0] = 1.0
    felt = basis.columns[:, 1:] @ weights[basis.free[1:] - 1]
    if not np.std(felt) <= MOST_MOVED * np.std(basis.columns[:, 1]):
        weights[1:] = 0.0
    return weights


def _parts(basis: Basis) -> np.ndarray:
    """What columns make of the temperatures of the device's parts, one for each of its time constants, shape (k, p)."""
    edges = np.cumsum([0, *(effect.n_columns() for effect in basis.effects)])
    parts = []
    for start, effect in zip(edges, basis.effects, strict=False):
        if isinstance(effect, ThermalLag) and len(effect.time_constants_):
            apart = np.abs(np.log(effect.time_constants_[:, None] / basis.time_constants))
            for at in np.unique(apart.argmin(axis=0)):
                weights = np.zeros(edges[-1])
                weights[[0, start + at]] = 1.0  # a lag difference and the measured temperature
                parts.append(weights)
    return np.array(parts).reshape(-1, edges[-1])


def _ranges(felt: np.ndarray, basis: Basis) -> tuple[np.ndarray, np.ndarray]:
    """Ranges over all rows of temperatures that are known in the bins, shape (bins, k), which average peaks away."""
    (low, high), measured = basis.inside, basis.columns[:, 1]
    rounding = ROUNDING * (high - low)
    below, above = max(measured.min() - low, 0.0), max(high - measured.max(), 0.0)
    return felt.min(axis=0) - below - rounding, felt.max(axis=0) + above + rounding
