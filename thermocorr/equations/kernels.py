"""One pass over rows, tile by tile: decays, lags, averages, cross products; compiled by numba, where it is installed.

The columns of a tile of some hundred rows stay in the processor's nearest cache from the recursion, eq. (25), to the
cross products. Columns of a tile are the rows of `z`: start-up decays, the 1, lags, columns that others have made, the
reading. Imported by whoever has asked `thermocorr.equations.compiled` for it, for numba takes half a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import jitted
from .lag_kernels import TILE, factors_of_tile, follow, inline, keep_last
from .lags import FELT

Floats = NDArray[np.float64]
_GONE = math.exp(-FELT)
"""What is left of a start-up decay when it counts as over."""


class Rows(NamedTuple):
    """Consecutive rows of one segment."""

    temperature: Floats
    """Shape (n,), read-only."""
    steps: Floats
    """Time since the row before [s], shape (n,)."""
    reading: Floats
    """NaN where there is none, so that the row does not count. Shape (n,), read-only."""
    offset: float
    """What the readings are taken less."""
    root_weight: Floats
    """Shape (n,), or (0,) where all rows count alike."""
    ready: Floats
    """Columns that others have made, shape (K, n)."""
    parts: NDArray[np.int64]
    """First row of each part whose cross products are kept apart."""
    bins: NDArray[np.int64]
    """First row of each stretch over which columns are summed up."""


class Bodies(NamedTuple):
    """First-order bodies: the D start-up decays of a segment, and J lags."""

    rates: Floats
    """1/tau [1/s] of decays and lags, shape (D + J,)."""
    first_order: bool
    """Temperature between samples: a straight line, or the earlier value."""
    regular: bool
    """True if all steps but the first are alike; then `factors` hold what the first and all others do."""
    factors: Floats
    """Decay and gain of the first step, decay and gain of all others, shape (4, D + J)."""
    decays: Floats
    """Start-up decays at the first row, then at the last one, the fastest first, shape (D,); written to."""
    lags: Floats
    """Lag differences before the first row, then at the last one, shape (J,); written to."""
    temperature: Floats
    """Temperature before the first row, then at the last one, shape (1,); written to."""


@inline
def _sum_up(z, n, at, bins, sums):  # type: ignore[no-untyped-def]
    """Add the columns of a tile, whose first row is number `at`, to those of the last columns that `sums` asks for."""
    if not len(bins):
        return
    first = len(z) - sums.shape[1]
    b = np.searchsorted(bins, at, side="right") - 1
    k = 0
    while k < n:
        end = n if b + 1 == len(bins) else min(n, bins[b + 1] - at)
        for j in range(first, len(z)):
            total, some = 0.0, z[j, k:end]
            for i in range(end - k):
                total += some[i]
            sums[b, j - first] += total
        k = end
        b += 1


@inline
def _substitute(z, n, n_over, triangle):  # type: ignore[no-untyped-def]
    """Rows by the inverse of a unit triangle: the columns of a tile, each less its share in those before it.

    The first `n_over` are zero.
    """
    for j in range(n_over, len(z)):
        i = n_over
        while j - i >= 4:
            r0, r1, r2, r3 = triangle[i, j], triangle[i + 1, j], triangle[i + 2, j], triangle[i + 3, j]
            for k in range(n):
                z[j, k] -= (r0 * z[i, k] + r1 * z[i + 1, k]) + (r2 * z[i + 2, k] + r3 * z[i + 3, k])
            i += 4
        if j - i >= 2:
            r0, r1 = triangle[i, j], triangle[i + 1, j]
            for k in range(n):
                z[j, k] -= r0 * z[i, k] + r1 * z[i + 1, k]
            i += 2
        if i < j:
            r0 = triangle[i, j]
            for k in range(n):
                z[j, k] -= r0 * z[i, k]


@inline
def _cross(z, n, n_over, product):  # type: ignore[no-untyped-def]
    """Add the cross products of a tile's columns to the upper triangle of `product`; three by three in registers.

    The first `n_over` columns are zero.
    """
    q, i = len(z), n_over
    while q - i >= 3:
        j = n_over
        while j < i:
            s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
            for k in range(n):
                x0, x1, x2 = z[i, k], z[i + 1, k], z[i + 2, k]
                y0, y1, y2 = z[j, k], z[j + 1, k], z[j + 2, k]
                s00 += x0 * y0
                s01 += x0 * y1
                s02 += x0 * y2
                s10 += x1 * y0
                s11 += x1 * y1
                s12 += x1 * y2
                s20 += x2 * y0
                s21 += x2 * y1
                s22 += x2 * y2
            product[j, i] += s00
            product[j + 1, i] += s01
            product[j + 2, i] += s02
            product[j, i + 1] += s10
            product[j + 1, i + 1] += s11
            product[j + 2, i + 1] += s12
            product[j, i + 2] += s20
            product[j + 1, i + 2] += s21
            product[j + 2, i + 2] += s22
            j += 3
        s00 = s01 = s02 = s11 = s12 = s22 = 0.0
        for k in range(n):
            x0, x1, x2 = z[i, k], z[i + 1, k], z[i + 2, k]
            s00 += x0 * x0
            s01 += x0 * x1
            s02 += x0 * x2
            s11 += x1 * x1
            s12 += x1 * x2
            s22 += x2 * x2
        product[i, i] += s00
        product[i, i + 1] += s01
        product[i, i + 2] += s02
        product[i + 1, i + 1] += s11
        product[i + 1, i + 2] += s12
        product[i + 2, i + 2] += s22
        i += 3
    while i < q:
        for j in range(n_over, i + 1):
            s00 = 0.0
            for k in range(n):
                s00 += z[i, k] * z[j, k]
            product[j, i] += s00
        i += 1


@inline
def _is_beyond(product, inverse, largest):  # type: ignore[no-untyped-def]
    """True if an element of the diagonal, scaled, is larger, or NaN."""
    beyond = False
    for j in range(len(product)):
        beyond |= not product[j, j] * inverse[j] * inverse[j] <= largest
    return beyond


@inline
def _scale(product, inverse):  # type: ignore[no-untyped-def]
    """Multiply the upper triangle of cross products by the factors of both its columns."""
    for i in range(len(product)):
        for j in range(i, len(product)):
            product[i, j] *= inverse[i] * inverse[j]


@inline
def _fill(rows, bodies, at, n, n_over, z, change, decay, gain, usual):  # type: ignore[no-untyped-def]
    """Columns of the tile of `n` rows from row `at` on; `decay` and `gain` get the factors of each body and row.

    Their first column holds those of the step `usual`, shape (1,), which serve where all steps of the tile are that.
    The first `n_over` decays are over.
    """
    D, J = len(bodies.decays), len(bodies.lags)
    T, reading, ready = rows.temperature[at : at + n], rows.reading[at : at + n], rows.ready[:, at : at + n]
    change[0] = T[0] - bodies.temperature[0]
    for k in range(1, n):
        change[k] = T[k] - T[k - 1]
    bodies.temperature[0] = T[n - 1]
    even = bodies.regular
    if not bodies.regular:
        steps, per_step, power = rows.steps[at : at + n], np.empty(n), np.empty(n)
        first_order = bodies.first_order
        even = factors_of_tile(steps, n, usual[0], bodies.rates, n_over, first_order, per_step, power, decay, gain)
        usual[0] = steps[n - 1]
    each = 0 if even else 1
    for j in range(D):  # eq. (18)
        left = bodies.decays[j]
        for k in range(n):
            if at + k and left:
                left *= decay[j, k * each]
            z[j, k] = left if left > _GONE else 0.0
        bodies.decays[j] = left if left > _GONE else 0.0
    for k in range(n):
        z[D, k] = 1.0
    first = 0
    if bodies.regular and at == 0:  # the first step may be another one
        first = 1
        for j in range(J):
            bodies.lags[j] = bodies.factors[0, D + j] * bodies.lags[j] - bodies.factors[1, D + j] * change[0]
            z[D + 1 + j, 0] = bodies.lags[j]
    follow(change, first, n, decay[D:], gain[D:], even, bodies.lags, z[D + 1 :])
    if not even:
        keep_last(n_over, n, decay, gain)
    for j in range(len(ready)):
        for k in range(n):
            z[D + 1 + J + j, k] = ready[j, k]
    for k in range(n):
        z[len(z) - 1, k] = reading[k] - rows.offset


@inline
def _leave_out(z, n):  # type: ignore[no-untyped-def]
    """Rows without a reading become zeros."""
    missing = 0
    for k in range(n):
        missing += z[len(z) - 1, k] != z[len(z) - 1, k]
    if missing:
        for k in range(n):
            if z[len(z) - 1, k] != z[len(z) - 1, k]:
                for j in range(len(z)):
                    z[j, k] = 0.0


def _sweep(rows, bodies, triangle, inverse, largest, product, sums, out):  # type: ignore[no-untyped-def]
    q = len(bodies.decays) + 1 + len(bodies.lags) + len(rows.ready) + 1
    z, change = np.empty((q, TILE)), np.empty(TILE)
    decay, gain = np.empty((len(bodies.rates), TILE)), np.empty((len(bodies.rates), TILE))
    usual = np.full(1, np.nan)
    if bodies.regular:
        for j in range(len(bodies.rates)):
            decay[j, 0], gain[j, 0] = bodies.factors[2, j], bodies.factors[3, j]
    unit = np.empty_like(triangle)  # the triangle of columns that are scaled in the end, as cross products
    for i in range(len(inverse)):
        for j in range(i, len(inverse)):
            unit[i, j] = triangle[i, j] * inverse[i]
    for part in range(len(rows.parts)):
        end = rows.parts[part + 1] if part + 1 < len(rows.parts) else len(rows.temperature)
        for at in range(rows.parts[part], end, TILE):
            n, n_over = min(TILE, end - at), 0
            while n_over < len(bodies.decays) and bodies.decays[n_over] == 0.0:
                n_over += 1
            _fill(rows, bodies, at, n, n_over, z, change, decay, gain, usual)
            _leave_out(z, n)
            _sum_up(z, n, at, rows.bins, sums)
            if len(rows.root_weight):
                root_weight = rows.root_weight[at : at + n]
                for j in range(q):
                    for k in range(n):
                        z[j, k] *= root_weight[k]
            if len(out):
                here = out[:, at : at + n]
                for j in range(q):
                    for k in range(n):
                        here[j, k] = z[j, k]
            else:
                _substitute(z, n, n_over, unit)
                _cross(z, n, n_over, product[part])
                if _is_beyond(product[part], inverse, largest):
                    _scale(product[part], inverse)
                    return
        if not len(out):
            _scale(product[part], inverse)


sweep_tiles: Callable[[Rows, Bodies, Floats, Floats, float, Floats, Floats, Floats], None] = jitted(
    cache=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy"
)(_sweep)
"""Function ``(rows, bodies, triangle, inverse, largest, product, sums, out)`` that carries `bodies` on through `rows`.

Where `out`, shape (q, n), has rows, it gets the columns; else their cross products are added to `product`, shape
(parts, q, q), in the coordinates of `triangle`: of ``columns @ inv(triangle)``, `inverse` being one over its diagonal.
It ends where a diagonal element of `product` exceeds `largest`, and nothing of what it wrote is of use then.
`sums`, shape (bins, r), gets the sums of the last r columns. All arrays are contiguous in C's order, so that there is
one function to compile.
"""


class Pass:
    """The pass over some rows, from the same bodies as often as it is asked for.

    `rows` (Rows). `bodies` (Bodies): Before the rows; not written to. `n_summed` (int): How many of the last columns
    are summed up over the bins; 0 for all.
    """

    def __init__(self, rows: Rows, bodies: Bodies, n_summed: int):
        self._rows, self._before = rows, bodies
        self.n_columns = len(bodies.decays) + 1 + len(bodies.lags) + len(rows.ready) + 1
        self._n_summed = n_summed or self.n_columns
        self.bodies = bodies
        """Behind the rows, after the first pass."""
        self.sums: Floats = np.zeros((0, self._n_summed))
        """Sums over the bins, shape (bins, n_summed)."""

    def crossed(self, triangle: Floats, inverse: Floats, largest: float) -> Floats:
        """Upper triangles of each part's cross products of ``columns @ inv(triangle)``, shape (parts, q, q).

        Made no further than to where a diagonal element exceeds `largest`.
        """
        product = np.zeros((len(self._rows.parts), self.n_columns, self.n_columns))
        self._run(np.ascontiguousarray(triangle), inverse, largest, product, np.zeros((0, 0)))
        return product

    def columns(self) -> Floats:
        """The columns, shape (n, q), Fortran order."""
        out = np.empty((self.n_columns, len(self._rows.temperature)))
        self._run(np.zeros((0, 0)), np.zeros(0), np.inf, np.zeros((0, 0, 0)), out)
        return out.T

    def _run(self, triangle: Floats, inverse: Floats, largest: float, product: Floats, out: Floats) -> None:
        b = self._before
        self.bodies = b._replace(decays=b.decays.copy(), lags=b.lags.copy(), temperature=b.temperature.copy())
        self.sums = np.zeros((len(self._rows.bins), self._n_summed))
        sweep_tiles(self._rows, self.bodies, triangle, inverse, largest, product, self.sums, out)
