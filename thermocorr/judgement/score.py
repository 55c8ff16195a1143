"""Likelihood of explanations, in bands of frequency.

Everything is a sum over bands of frequency of cross products, weighted by the power of the noise there. So the rows of
the record are touched once for each explanation and once for each cause that is taken in, whatever noise is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
from scipy.linalg import cho_solve, lapack, solve_triangular

from ..equations.noise import Bands, fitted_parts, whittle
from .levels import ALIVE, BATCH, QUIET, ROUNDED, STRUCTURE, VISIBLE


def orthonormal(columns: np.ndarray, tolerance: float = ROUNDED) -> np.ndarray:
    """Orthonormal basis of ill-scaled columns, (n, k)."""
    directions, size = _directions(columns)
    return directions[:, size > tolerance]


def visible(columns: np.ndarray, reading: np.ndarray) -> np.ndarray:
    """Orthonormal basis of what a plausible law can show.

    Lags that are close together differ by little, and their differences by less. Such directions take what another
    cause makes upon themselves, a delay most of all, with coefficients that are thousands of times those of the law.
    """
    directions, size = _directions(columns)
    known = directions[:, size > ROUNDED]
    rest = reading - known @ (known.T @ reading)
    noise = float(np.sqrt(np.mean(np.diff(rest) ** 2) / 2))
    constant = columns[:, 0] / (float(np.linalg.norm(columns[:, 0])) or 1.0)  # starts of all runs may hold it
    law = float(np.linalg.norm(reading - constant * (constant @ reading)))
    return directions[:, size > max(ROUNDED, VISIBLE * noise / law if law > 0 else 0.0)]


def _directions(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of unit columns, and relative sizes."""
    norms = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return np.asarray(left), singular / singular[:1].max(initial=1e-300)


@dataclass(frozen=True, kw_only=True)
class ExplanationColumns:
    """Columns of one explanation, transformed, with cross products."""

    rows: np.ndarray
    """Shape (n, k)."""
    own: np.ndarray
    """Cross products with one another, shape (bands, k, k)."""
    base: np.ndarray
    """Cross products with the base, shape (bands, p, k)."""
    reading: np.ndarray
    """Cross products with the reading, shape (bands, k)."""


@dataclass(frozen=True, kw_only=True)
class BaseProducts:
    """Cross products of reading and base, per band."""

    zz: np.ndarray
    """The reading's sums of squares, shape (bands,)."""
    Qz: np.ndarray
    """The base's with the reading, shape (bands, p)."""
    QQ: np.ndarray
    """The base's with itself, shape (bands, p, p)."""

    def solved(self, W: np.ndarray, rest: Sequence[ExplanationColumns | None]) -> tuple[list[np.ndarray], np.ndarray]:
        """Least squares with each explanation, own weights each.

        `W` (array of shape (J, bands)). `rest` (sequence of length J): None is the base alone. Returns coefs (list
        of J arrays): of the base's columns and the explanation's. Returns power (array of shape (bands, J)): sums of
        squares that they leave in each band.
        """
        p = self.Qz.shape[1]
        A, b = weighted(W, self.QQ), W @ self.Qz
        coefs = [solved(*_bordered(A[j], b[j], W[j], found)) for j, found in enumerate(rest)]
        base = np.stack([coef[:p] for coef in coefs])
        power = self.zz[:, None] - 2 * self.Qz @ base.T + forms(self.QQ, base, base)
        for j, found in enumerate(rest):
            if found is not None:
                more = coefs[j][None, p:]
                own = 2 * forms(found.base, base[j : j + 1], more) + forms(found.own, more, more)
                power[:, j] += own[:, 0] - 2 * found.reading @ more[0]
        return coefs, np.maximum(power, 1e-12 * self.zz[:, None])

    def half(self, weights: np.ndarray) -> np.ndarray:
        """Cholesky factor of the base's weighted products, weights of shape (bands,)."""
        A = weighted(weights, self.QQ)
        return np.linalg.cholesky(A + 1e-12 * np.trace(A) / len(A) * np.eye(len(A)))

    def taken(self, W: np.ndarray, founds: Sequence[ExplanationColumns]) -> tuple[np.ndarray, np.ndarray]:
        """Weighted squares that explanations remove given the base.

        `W` (array of shape (J, bands)). `founds` (sequence of length K > 0). Returns taken (array of shape (J, K)): 0
        where the base holds one of an explanation's columns. Returns left (array of shape (J,)): what the base alone
        leaves.
        """
        widths = np.array([found.own.shape[1] for found in founds])
        starts, single = np.cumsum(widths) - widths, np.flatnonzero(widths == 1)
        own = np.array([founds[i].own[:, 0, 0] for i in single.tolist()]).reshape(len(single), len(self.zz))
        together = weighted(W, np.concatenate([found.base for found in founds], axis=2))
        moments = W @ np.concatenate([found.reading for found in founds], axis=1)
        taken, left = np.zeros((len(W), len(founds))), np.empty(len(W))
        for j, weights in enumerate(W):
            half = self.half(weights)
            b = solve_triangular(half, weights @ self.Qz, lower=True)
            left[j] = weights @ self.zz - b @ b
            columns = solve_triangular(half, together[j], lower=True)
            moment = moments[j] - b @ columns
            full = own @ weights
            rest = full - squares_of(columns[:, starts[single]])
            alive = rest > ALIVE**2 * full
            taken[j, single[alive]] = moment[starts[single[alive]]] ** 2 / rest[alive]
            for i in np.flatnonzero(widths > 1).tolist():
                part = slice(starts[i], starts[i] + widths[i])
                full = weighted(weights, founds[i].own)
                rest = full - columns[:, part].T @ columns[:, part]
                if np.all(np.diag(rest) > ALIVE**2 * np.diag(full)):
                    taken[j, i] = moment[part] @ solved(rest, moment[part])
        return taken, left


def _bordered(
    A: np.ndarray, b: np.ndarray, weights: np.ndarray, found: ExplanationColumns | None
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of base and explanation."""
    if found is None:
        return A, b
    p, k = len(b), found.own.shape[1]
    both = np.empty((p + k, p + k))
    both[:p, :p], both[:p, p:], both[p:, p:] = A, weighted(weights, found.base), weighted(weights, found.own)
    both[p:, :p] = both[:p, p:].T
    return both, np.concatenate((b, weights @ found.reading))


def weighted(weights: np.ndarray, products: np.ndarray) -> np.ndarray:
    """Cross products summed over bands, weighted."""
    return np.asarray(weights @ products.reshape(len(products), -1)).reshape(*weights.shape[:-1], *products.shape[1:])


def forms(products: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """``left[j] @ products[g] @ right[j]`` per band g."""
    outer = left[:, :, None] * right[:, None, :]
    return np.asarray(products.reshape(len(products), -1) @ outer.reshape(len(outer), -1).T)


def side_by_side(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Several arrays' columns in one, Fortran order."""
    return np.concatenate([part.T for part in columns]).T


def squares_of(columns: np.ndarray) -> np.ndarray:
    """Sum of squares of each column."""
    return np.asarray(np.einsum("ij,ij->i", columns.T, columns.T))


def solved(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least squares from ill-scaled normal equations."""
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    unit = A * scale[:, None] * scale
    half, failed = lapack.dpotrf(unit, lower=1)
    if not failed and np.diag(half).min() > 1e-4:
        return np.asarray(scale * lapack.dpotrs(half, scale * b, lower=1)[0])
    values, vectors = np.linalg.eigh(unit)
    kept = values > 1e-11 * values[-1]
    V = vectors[:, kept]
    return np.asarray(scale * (V @ ((V.T @ (scale * b)) / values[kept])))


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The record under one explanation."""

    level: float
    """Log likelihood."""
    theta: np.ndarray
    """Variances of the parts of the noise, in units of the reading's variance given the first base."""


class Comparison:
    """A base, and explanations to compare.

    `reading` (array of shape (n,)). `base` (array of shape (n, p)). `segment` (array of shape (n,)): Number of the
    segment of each row. The noise of different segments is independent. `lost` (array of shape (n, k), optional):
    Orthonormal directions that reading and columns have lost before: they are degrees of freedom no more.
    """

    def __init__(self, reading: np.ndarray, base: np.ndarray, segment: np.ndarray, lost: np.ndarray | None = None):
        self.bands = Bands(segment)
        Q = orthonormal(self.bands.forward(base))
        z = self.bands.forward(reading[:, None])[:, 0]
        z -= Q @ (Q.T @ z)
        self.unit = float(np.sqrt(np.mean(z**2))) or 1.0
        self.z = z / self.unit
        self.Q = Q
        self.n_first = Q.shape[1]
        """Columns of the base of the start; those of the causes follow."""
        leverage = np.einsum("ij,ij->i", Q, Q)
        if lost is not None:
            leverage += np.sum(self.bands.forward(lost) ** 2, axis=1)
        self.free = len(z) - (0.0 if lost is None else float(np.sum(lost**2)))
        """Rows less the directions that they have lost."""
        self.share = np.maximum(self.bands.sizes - self.bands.sums(leverage), 1e-3)
        self.zz = np.maximum(self.bands.sums(self.z**2), 1e-300)  # an exact reading leaves nothing at all
        self.Qz = self.bands.sums(Q * self.z[:, None])
        self.QQ = self._products(Q, Q)
        self.explanations: list[ExplanationColumns | None] = []
        self.causes: list[slice] = []
        """Columns of the base that each adopted explanation has."""
        self.adopted: list[int] = []
        """Their numbers among the explanations."""
        self.base = self.first_fit()
        self.white = self._white()

    @property
    def total(self) -> float:
        """Log likelihood of the reading under the base."""
        return self.base.level - float(self.share.sum()) * float(np.log(self.unit))

    @property
    def wanders(self) -> bool:
        """True if wandering noise is far likelier than white."""
        return self.base.level - self.white > STRUCTURE

    @property
    def n(self) -> int:
        """Rows."""
        return len(self.z)

    @property
    def innovation(self) -> float:
        """Variance of the noise about its best forecast (Kolmogorov 1941)."""
        return float(np.exp(np.average(np.log(self.S(self.base.theta)), weights=self.bands.sizes)))

    def _products(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Cross products per band of two sets of columns."""
        edges = [*self.bands.starts.tolist(), self.n]
        return np.stack([one[a:b].T @ other[a:b] for a, b in pairwise(edges)])

    def add(self, columns: Sequence[np.ndarray]) -> None:
        """Add explanations, each of shape (n, k)."""
        for first in range(0, len(columns), BATCH):  # of a size that memory near the processor holds
            self._add(columns[first : first + BATCH])

    def _add(self, columns: Sequence[np.ndarray]) -> None:
        together = self.bands.forward(side_by_side(columns))
        full = np.sqrt(squares_of(together))
        first = self.Q[:, : self.n_first]  # not the causes: each may be dropped again
        together.T[:] -= (together.T @ first) @ first.T
        left = np.sqrt(squares_of(together))
        alive = left > ALIVE * np.maximum(full, 1e-300)
        together /= np.where(alive, left, 1.0)
        both = self._products(np.column_stack((self.Q, self.z)), together)
        base, reading = both[:, :-1], both[:, -1]
        edges = list(accumulate((block.shape[1] for block in columns), initial=0))
        for low, high in pairwise(edges):
            kept = low + np.flatnonzero(alive[low:high])
            rows = together.T[low:high].T if len(kept) == high - low else together.T[kept].T
            found = ExplanationColumns(
                rows=rows,
                own=self._crossed(rows, rows),
                base=np.ascontiguousarray(base[:, :, kept]),
                reading=reading[:, kept],
            )
            self.explanations.append(found if len(kept) else None)

    def width(self, i: int) -> int:
        """Columns of an explanation that the base does not hold already."""
        found = self.explanations[i]
        return 0 if found is None else found.rows.shape[1]

    def copy(self) -> Comparison:
        """An independent copy with the explanations."""
        other = copy(self)
        other.explanations, other.causes = list(self.explanations), list(self.causes)
        other.adopted = list(self.adopted)
        return other

    def let_go(self) -> None:
        """Free the rows of explanations; cross products stay."""
        self.explanations = [found and replace(found, rows=found.rows[:0].copy()) for found in self.explanations]

    def of(self, which: Sequence[int]) -> Comparison:
        """A copy with some of the explanations given the base."""
        other = self.copy()
        other.explanations = [self.explanations[i] for i in which]
        return other

    def adopt(self, i: int) -> None:
        """Take an explanation into the base."""
        found, fit = self.explanations[i], self.refit([i])[0]
        assert found is not None
        self.explanations[i] = None
        self.adopted.append(i)
        self.causes.append(slice(self.Q.shape[1], self.Q.shape[1] + found.rows.shape[1]))
        self.QQ = np.block([[self.QQ, found.base], [found.base.transpose(0, 2, 1), found.own]])
        self.Qz = np.concatenate((self.Qz, found.reading), axis=1)
        self.explanations = [
            other and replace(other, base=np.concatenate((other.base, self._crossed(found.rows, other.rows)), axis=1))
            for other in self.explanations
        ]
        self.Q = np.column_stack((self.Q, found.rows))
        self.base, self.white = fit, self._white()

    def _crossed(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """`_products`, quicker for few columns."""
        if one.shape[1] * other.shape[1] > 20:  # one sum over all bands is faster than a matrix product in each
            return self._products(one, other)
        each = other.T[:, None] * one.T
        return np.asarray(np.add.reduceat(each, self.bands.starts, axis=2).transpose(2, 1, 0))

    def S(self, theta: np.ndarray) -> np.ndarray:
        """Power of the noise in each band."""
        return np.asarray(self.bands.parts @ theta)

    def left(self, theta: np.ndarray) -> np.ndarray:
        """Residual after the base under a noise."""
        return np.asarray(self.z - self.Q @ self._solved_one(None, theta)[0])

    def taken(self, theta: np.ndarray, moments: np.ndarray) -> np.ndarray:
        """Weighted squares of columns within the base."""
        return np.asarray(np.sum(solve_triangular(self._half(theta), moments.T, lower=True) ** 2, axis=0))

    def _half(self, theta: np.ndarray) -> np.ndarray:
        return self._base_products.half(1 / self.S(theta))

    @property
    def _base_products(self) -> BaseProducts:
        return BaseProducts(zz=self.zz, Qz=self.Qz, QQ=self.QQ)

    def first_fit(self, *more: np.ndarray) -> Fit:
        """Fit of the base alone."""
        parts = self.bands.parts.shape[1]
        starts = [np.full(parts, 1 / parts), np.concatenate(([1.0], np.full(parts - 1, QUIET))), *more]
        return max(self._fits([None] * len(starts), starts, 4), key=lambda fit: fit.level)

    def _white(self) -> float:
        """Log likelihood of the base under white noise."""
        power = self._solved_one(None, self.only_white())[1]
        level = power.sum() / self.share.sum()
        return float(whittle(self.share, power[:, None], np.full((len(power), 1), level))[0])

    def refit(self, which: Sequence[int]) -> list[Fit]:
        """The base with each explanation, noise refitted."""
        if not which:
            return []
        quiet = np.maximum(QUIET * self.base.theta, 1e-3 * QUIET * self.base.theta[0])
        quiet[0] = self.base.theta[0]
        tried = [i for i in which for _ in (0, 1)]
        fits = self._fits(tried, [start for _ in which for start in (self.base.theta, quiet)], 3)
        return [max(pair, key=lambda fit: fit.level) for pair in zip(fits[::2], fits[1::2], strict=True)]

    def gained_given(self, i: int, which: Sequence[int]) -> np.ndarray:
        """Log likelihood gained given another explanation."""
        other = self.of([i, *which])
        other.adopt(0)
        return other.screen(other.base.theta)[1:]

    def dropped(self, k: int, tried: bool = True) -> Comparison:
        """The base without one adopted explanation."""
        part, other = self.causes[k], self.copy()
        kept = np.r_[0 : part.start, part.stop : self.Q.shape[1]]
        other.Q, other.Qz = self.Q[:, kept], self.Qz[:, kept]
        other.QQ = np.ascontiguousarray(self.QQ[:, kept][:, :, kept])
        del other.adopted[k]
        width = part.stop - part.start
        other.causes = [
            cause if cause.start < part.start else slice(cause.start - width, cause.stop - width)
            for cause in self.causes
            if cause != part
        ]
        other.explanations = [each and replace(each, base=each.base[:, kept]) for each in self.explanations if tried]
        if tried:
            other.explanations[self.adopted[k]] = ExplanationColumns(
                rows=self.Q[:, part],
                own=self.QQ[:, part][:, :, part],
                base=np.ascontiguousarray(self.QQ[:, kept][:, :, part]),
                reading=self.Qz[:, part],
            )
        other.base = other.first_fit(self.base.theta)
        return other

    def _fits(self, which: Sequence[int | None], starts: Sequence[np.ndarray], turns: int) -> list[Fit]:
        theta = np.column_stack(starts)
        for _ in range(turns):
            power = self._solved(which, theta)[1]
            theta = fitted_parts(self.bands.parts, self.share, power, theta)
        levels = whittle(self.share, power, self.bands.parts @ theta)
        return [Fit(level=float(level), theta=own) for level, own in zip(levels, theta.T, strict=True)]

    def _solved(self, which: Sequence[int | None], theta: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Coefficients and squares under each noise."""
        rest = [None if i is None else self.explanations[i] for i in which]
        return self._base_products.solved(1 / self.S(theta).T, rest)

    def _solved_one(self, i: int | None, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        coefs, power = self._solved([i], theta[:, None])
        return coefs[0], power[:, 0]

    def smallest(self, column: np.ndarray, gain: float) -> float:
        """Smallest coefficient of a column that shows.

        Infinite for a column that lies in the base.
        """
        row = self.bands.forward(column[:, None])
        full = float(np.linalg.norm(row))
        first = self.Q[:, : self.n_first]
        row -= first @ (first.T @ row)
        if not np.linalg.norm(row) > ALIVE * full:
            return np.inf
        W = 1 / self.bands.each_row(self.S(self.base.theta))
        cross = self.Q.T @ (row[:, 0] * W)
        own = float(np.sum(row[:, 0] ** 2 * W))
        information = own - float(self.taken(self.base.theta, cross[None])[0])
        return self.unit * float(np.sqrt(2 * gain / information)) if information > 1e-9 * own else np.inf

    def overlap(self, i: int, j: int) -> float:
        """Share of one explanation that another reproduces."""
        one, other = self.explanations[i], self.explanations[j]
        if one is None or other is None:
            return 0.0
        theta = self.base.theta
        own, rival, reading = (self._white_given(theta, part) for part in (one.rows, other.rows, self.z[:, None]))
        made = own @ np.linalg.lstsq(own, reading, rcond=1e-8)[0]
        again = rival @ np.linalg.lstsq(rival, made, rcond=1e-8)[0]
        return float(np.sum(again**2) / max(float(np.sum(made**2)), 1e-300))

    def _white_given(self, theta: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Columns less their part in the base, unwhitened."""
        W = 1 / self.bands.each_row(self.S(theta))[:, None]
        held = cho_solve((self._half(theta), True), self.Q.T @ (W * rows))
        return np.asarray(np.sqrt(W) * (rows - self.Q @ held))

    def unexplained(self, i: int | None = None) -> float:
        """Mean square left by plain least squares."""
        return float(self._solved_one(i, self.only_white())[1].sum()) / self.free

    def only_white(self) -> np.ndarray:
        """White noise of unit variance, as variances of the parts."""
        theta = np.zeros(self.bands.parts.shape[1])
        theta[0] = 1.0
        return theta

    def screen(self, theta: np.ndarray, which: Sequence[int] | None = None) -> np.ndarray:
        """Log likelihood that explanations gain under a given noise."""
        return np.asarray(0.5 * self._taken_by([theta], which)[0][0])

    def screen_twice(self) -> tuple[np.ndarray, np.ndarray]:
        """`screen` under this noise and under white noise."""
        (standing, white), (_, left) = self._taken_by([self.base.theta, self.only_white()])
        return 0.5 * standing, -0.5 * self.free * np.log1p(-np.minimum(white / left, 1 - 1e-12))

    def _taken_by(
        self, thetas: Sequence[np.ndarray], which: Sequence[int] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weighted squares removed and left, under each noise."""
        chosen = self.explanations if which is None else [self.explanations[i] for i in which]
        places = [i for i, found in enumerate(chosen) if found is not None]
        taken, left = np.zeros((len(thetas), len(chosen))), np.ones(len(thetas))
        if places:
            founds = [found for found in chosen if found is not None]
            taken[:, places], left = self._base_products.taken(1 / self.S(np.column_stack(thetas)).T, founds)
        return taken, left
