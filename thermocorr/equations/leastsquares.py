"""Least squares by merged triangular factors, eqs. (11)-(13) (30)-(32).

The paper solves ``(Q'Q + eps I)^-1 Q'U``; forming Q'Q squares the condition number, and with neighbouring time
constants every digit is lost. Here the rows of ``[1 | Q | U]`` are swept, block by block, into one small triangle R
with ``R'R`` equal to the cross products. Two triangles merge into one, so blocks, folds, files and machines can be
treated apart and joined at the end.

Start-up decays of hundreds of segments do not meet one another: their cross products are block diagonal, with a border
of the shared columns. So each segment's own columns are eliminated by themselves, and what is left is a small problem
in the shared ones (Bjorck 1996, Numerical Methods for Least Squares Problems, section 6.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Floats = NDArray[np.float64]

_PANEL = 8  # columns that LAPACK reflects at once
NARROW, SHORT = 40, 800  # columns and rows up to which triangles are merged at once: half the time of one by one
WIDE = 64  # columns at which columns of zeros are looked for
WELL_CONDITIONED = 1e-8
"""Reciprocal condition of the unit-column triangle at which its columns are surely independent."""


def triangle(matrix: Floats) -> Floats:
    """R of a QR factorisation, shape (min(m, n), n)."""
    factored = lapack.dgeqrf(matrix)[0]
    return np.asarray(np.triu(factored[: matrix.shape[1]]), np.float64)


def swept_in(part: Floats, rows: Floats) -> Floats:
    """A triangle with more rows; overwrites rows in Fortran order."""
    part = np.asfortranarray(part)
    if not len(rows):
        return part
    part, _, _, info = lapack.dtpqrt(0, min(_PANEL, len(part)), part, rows, overwrite_a=1, overwrite_b=1)
    if info:  # pragma: no cover - only for arguments of wrong shape
        raise ValueError(f"dtpqrt refused its argument {-info}.")
    return np.asarray(part, np.float64)


class TriangularFactor:
    """Upper triangle R of all rows: ``R'R = [1 Q U]' [1 Q U]``.

    Parameters
    ----------
    n_columns : int
        Columns of one row, the leading 1 and the trailing reading included.
    """

    def __init__(self, n_columns: int) -> None:
        self.r: Floats = np.zeros((n_columns, n_columns), order="F")
        self.n_rows = 0

    def update(self, rows: Floats) -> TriangularFactor:
        """Sweep in `rows`, an array of shape (n, n_columns).

        A float64 array whose columns are contiguous (Fortran order, or a single row) is overwritten: pass a copy.
        """
        self._sweep(rows)
        self.n_rows += len(rows)
        return self

    def merge(self, *others: TriangularFactor) -> TriangularFactor:
        """Add what other factors have seen; they stay as they are."""
        for other in others:
            self._sweep(other.r.copy(order="F"))
            self.n_rows += other.n_rows
        return self

    def _sweep(self, rows: Floats) -> None:
        if not len(rows):
            return
        if rows.shape[1] > WIDE:
            touched = self._touched(rows)
            if len(touched) < rows.shape[1]:
                part, rows = self.r[np.ix_(touched, touched)], np.asfortranarray(rows[:, touched])
                self.r[np.ix_(touched, touched)] = swept_in(part, rows[rows.any(axis=1)])
                return
        zero = 0  # leading columns of zeros leave their part of R as it is: start-up decays that are over
        while zero < rows.shape[1] and not rows[0, zero] and not rows[:, zero].any():
            zero += 1
        if zero < rows.shape[1]:
            self.r[zero:, zero:] = swept_in(self.r[zero:, zero:], rows[:, zero:])

    def _touched(self, rows: Floats) -> NDArray[np.intp]:
        """Numbers of the rows and columns that may change.

        Start-up decays of many segments hardly meet one another: a block has those of its own segment.
        """
        touched = rows.any(axis=0)
        while True:
            wider = touched | self.r[touched].any(axis=0)
            if (wider == touched).all():
                return np.flatnonzero(touched)
            touched = wider

    def select(self, columns: Iterable[int]) -> TriangularFactor:
        """Factor of some of the columns, in the order given."""
        return self.standing_for(self.r[:, list(columns)], self.n_rows)

    def behind(self, n: int) -> TriangularFactor:
        """Factor of the columns behind the first `n`, given these."""
        part = TriangularFactor(self.r.shape[1] - n)
        part.r[:], part.n_rows = self.r[n:, n:], self.n_rows
        return part

    def combined(self, combination: Floats) -> TriangularFactor:
        """Factor of linear combinations of the columns: of ``rows @ combination``."""
        return self.standing_for(self.r @ combination, self.n_rows)

    @classmethod
    def standing_for(cls, matrix: Floats, n_rows: int) -> TriangularFactor:
        """Factor of a small matrix F that stands for `n_rows` rows."""
        part = cls(matrix.shape[1])
        if not len(matrix):
            return part
        columns = np.flatnonzero(matrix.any(axis=0)) if matrix.shape[1] > WIDE else np.arange(matrix.shape[1])
        r = triangle(matrix[:, columns])
        part.r[columns[: len(r), None], columns] = r
        part.n_rows = n_rows
        return part

    @classmethod
    def merged(cls, factors: Iterable[TriangularFactor]) -> TriangularFactor:
        """One factor of everything that `factors` have seen."""
        factors = list(factors)
        width = factors[0].r.shape[1]
        if len(factors) == 1 or width > NARROW or width * len(factors) > SHORT:
            return cls(width).merge(*factors)
        return cls.standing_for(np.concatenate([factor.r for factor in factors]), sum(f.n_rows for f in factors))


@dataclass(frozen=True, kw_only=True)
class RidgeSolution:
    """Coefficients of eq. (32) and what is needed to judge them."""

    intercept: float
    coef: Floats
    """Shape (p,): one per column of Q, in units of U per unit of the column."""
    residual_sum_of_squares: float
    rank: int
    n_rows: int
    scale: Floats
    """Shape (p,): standard deviation of each column over the rows."""
    mean: Floats
    """Shape (p,): mean of each column over the rows."""
    inverse_triangle: Floats
    """Shape (p, rank or more): ``inverse_triangle @ inverse_triangle.T`` is (Q'Q + penalty)^-1 of centred columns."""


def solve_ridge(factor: TriangularFactor, alpha: float = 0.0) -> RidgeSolution:
    """Ridge least squares from a triangle of ``[1 Q U]``, eq. (13).

    Minimises ``sum (U - U0 - Q b)^2 + alpha sum (scale_j b_j)^2``: the intercept is free and each coefficient is
    penalised on the scale of its column's standard deviation, so that `alpha` means the same in any unit (the penalty
    of ``sklearn.linear_model.Ridge`` behind a ``StandardScaler``). Columns that depend on others get the smallest
    coefficients that fit (minimum norm in the scaled columns).

    Examples
    --------
    >>> import numpy as np
    >>> column = np.arange(5.0)
    >>> factor = TriangularFactor(3)
    >>> for rows in (slice(0, 3), slice(3, 5)):  # in two blocks: 1, column, reading
    ...     factor = factor.update(np.column_stack([np.ones(5), column, 7.0 + 2.0 * column])[rows])
    >>> solution = solve_ridge(factor)
    >>> round(solution.intercept, 6), solution.coef.round(6)
    (7.0, array([2.]))
    """
    r = factor.r
    p = r.shape[1] - 2
    centred = r[1:, 1:-1]  # the first row holds the means: below it, the columns are centred
    target = r[1:, -1]
    norms = np.sqrt(np.einsum("ij,ij->j", centred, centred))
    magnitude = np.sqrt(np.einsum("ij,ij->j", r[:, 1:-1], r[:, 1:-1]))
    alive = norms > 1e-13 * magnitude  # a constant column is the intercept's business
    safe = np.where(alive, norms, 1.0)
    unit = np.where(alive, centred / safe, 0.0)
    n = max(factor.n_rows, 1)
    penalty = np.sqrt(alpha / n)
    triangular = _triangular_solution(unit, target, penalty) if p > WIDE else None
    if triangular is not None:
        inverse, coef, rank = triangular[0] / safe[:, None], triangular[1] / safe, p
    elif p:
        if alpha > 0:
            unit = np.vstack((unit, penalty * np.eye(p)))
            target = np.concatenate((target, np.zeros(p)))
        left, singular, right = np.linalg.svd(unit, full_matrices=False)
        # Smaller singular values carry no information.
        keep = singular > 1e-11 * max(singular[0], np.finfo(float).tiny)
        inverse = (right[keep].T / singular[keep]) / safe[:, None]
        coef = inverse @ (left[:, keep].T @ target)
        rank = int(keep.sum())
    else:
        inverse, coef, rank = np.zeros((0, 0)), np.zeros(0), 0
    rest = r[1:, -1] - centred @ coef
    intercept = (r[0, -1] - r[0, 1:-1] @ coef) / r[0, 0] if r[0, 0] else 0.0
    return RidgeSolution(
        intercept=float(intercept),
        coef=coef,
        residual_sum_of_squares=float(rest @ rest),
        rank=rank,
        n_rows=factor.n_rows,
        scale=norms / np.sqrt(n),
        mean=r[0, 1:-1] / r[0, 0] if r[0, 0] else np.zeros(p),
        inverse_triangle=inverse,
    )


def _triangular_solution(unit: Floats, target: Floats, penalty: float) -> tuple[Floats, Floats] | None:
    """Inverse triangle and solution; None where columns may be dependent.

    A tenth of the singular value decomposition's time: the start-up decays of hundreds of segments.
    """
    p = unit.shape[1]
    joined = np.zeros((p + 1, p + 1), order="F")
    joined[:p, :p], joined[: len(target), p] = unit[:p], target[: p + 1]
    if penalty > 0:
        joined = swept_in(joined, np.asfortranarray(np.column_stack((penalty * np.eye(p), np.zeros(p)))))
    triangle_ = np.asfortranarray(joined[:p, :p])
    inverse, failed = lapack.dtrtri(triangle_)
    if failed or np.linalg.norm(triangle_, 1) * np.linalg.norm(inverse, 1) > 1 / WELL_CONDITIONED:
        return None
    return np.triu(inverse), np.triu(inverse) @ joined[:p, p]


class Segments(NamedTuple):
    """Segments with equally many columns of their own, k."""

    own: np.ndarray
    """Numbers of these columns in ``[1 | Q | U]``, shape (segments, k)."""
    rows: Floats
    """Triangles of the columns ``[own | shared]``, shape (segments, k + q, k + q)."""

    @property
    def k(self) -> int:
        """Number of columns."""
        return int(self.own.shape[1])


@dataclass(frozen=True)
class BorderedFactor:
    """Triangles of ``[own | shared]`` columns, one per segment."""

    shared: np.ndarray
    """Numbers of the q shared columns in ``[1 | Q | U]``: the 1 first, the reading last."""
    groups: Sequence[Segments]
    n_rows: int

    @classmethod
    def of(cls, shared: Sequence[int], segments: Sequence[tuple[Sequence[int], Floats]], n_rows: int) -> BorderedFactor:
        """Join segments: numbers of each one's own columns, its triangle."""
        alike: dict[int, list[tuple[Sequence[int], Floats]]] = {}
        for own, r in segments:
            alike.setdefault(len(own), []).append((own, r))
        groups = [
            Segments(np.array([own for own, _ in some], np.intp).reshape(len(some), k), np.stack([r for _, r in some]))
            for k, some in alike.items()
        ]
        return cls(np.array(shared, np.intp), groups, n_rows)

    def solution(self, alpha: float) -> RidgeSolution | None:
        """Solution of `solve_ridge`; None where columns may be dependent."""
        mean, length = self._centred()
        # A column of which less than 1e-13 is left without its mean is a constant.
        if not (length > 1e-13 * np.hypot(length, mean * np.sqrt(self.n_rows))).all():
            return None
        unit = np.concatenate(([np.sqrt(self.n_rows)], length))  # of [1 | Q]
        held, border = self._eliminated(unit, np.sqrt(alpha / self.n_rows))
        spread, made, size = self._inverse(held, border)
        # columns of unit length: the Frobenius norm of their triangle is at least the root of their number
        if spread is None or not size * np.sqrt(len(unit)) <= 1 / WELL_CONDITIONED:
            return None
        found = made / unit
        spread[1:] /= length[:, None]  # in its place: it may be large
        return RidgeSolution(
            intercept=float(found[0]),
            coef=found[1:],
            residual_sum_of_squares=self._left(found),
            rank=len(length),
            n_rows=self.n_rows,
            scale=length / unit[0],
            mean=mean,
            inverse_triangle=spread[1:],
        )

    def _centred(self) -> tuple[Floats, Floats]:
        """Mean and centred length of each column, shape (p,) each."""
        p = sum(group.own.size for group in self.groups) + len(self.shared) - 2
        sums, squares = np.zeros(p + 1), np.zeros(p + 1)
        for group in self.groups:
            own, one = group.rows[:, :, : group.k], group.rows[:, :, group.k]
            sums[group.own], squares[group.own] = np.einsum("sij,si->sj", own, one), np.einsum("sij,sij->sj", own, own)
        length = np.sqrt(np.maximum(squares - sums**2 / self.n_rows, 0.0))
        together = triangle(np.concatenate([g.rows[:, :, g.k :].reshape(-1, len(self.shared)) for g in self.groups]))
        inside = self.shared[1:-1]  # their means may be large: only a triangle keeps the rest
        sums[inside], length[inside] = together[0, 1:-1] * together[0, 0], np.linalg.norm(together[1:, 1:-1], axis=0)
        return sums[1:] / self.n_rows, length[1:]

    def _eliminated(self, unit: Floats, penalty: float) -> tuple[list[Floats], Floats]:
        """Rows of the own columns, and the triangle of the shared.

        All columns of ``[1 | Q]`` get unit length, and the penalty as further rows.
        """
        q, held = len(self.shared), []
        rest = [np.diag([0.0, *[penalty] * (q - 2), 0.0])]
        border = np.append(unit[self.shared[:-1]], 1.0)
        for group in self.groups:
            k, count = group.k, len(group.own)
            lengths = np.concatenate((unit[group.own], np.broadcast_to(border, (count, q))), axis=1)
            rows = group.rows / lengths[:, None]
            if penalty and k:
                below = np.broadcast_to(penalty * np.eye(k, k + q), (count, k, k + q))
                rows = np.linalg.qr(np.concatenate((rows, below), axis=1), mode="r")
            held.append(rows[:, :k])
            rest.append(rows[:, k:, k:].reshape(-1, q))
        return held, triangle(np.concatenate(rest))

    def _inverse(self, held: Sequence[Floats], border: Floats) -> tuple[Floats | None, Floats, float]:
        """Inverse of the triangle of ``[1 | Q]``, coefficients, norm.

        Shapes (1 + p, 1 + p), (1 + p,). None in place of an inverse that does not exist.
        """
        p, shared = sum(group.own.size for group in self.groups) + len(self.shared) - 2, self.shared[:-1]
        spread, made = np.zeros((p + 1, p + 1)), np.zeros(p + 1)
        try:
            inside, target = np.linalg.inv(border[: len(shared), : len(shared)]), border[: len(shared), -1]
            spread[shared[:, None], shared], made[shared] = inside, inside @ target
            squares = float(np.sum(inside**2))
            for group, rows in zip(self.groups, held, strict=True):
                inverse, own = np.linalg.inv(rows[:, :, : group.k]), group.own[:, :, None]
                across = -inverse @ rows[:, :, group.k : -1] @ inside
                spread[own, group.own[:, None, :]], spread[own, shared] = inverse, across
                made[group.own] = np.einsum("sij,sj->si", inverse, rows[:, :, -1]) + across @ target
                squares += float(np.sum(inverse**2) + np.sum(across**2))
        except np.linalg.LinAlgError:
            return None, made, np.inf
        return spread, made, float(np.sqrt(squares))

    def _left(self, found: Floats) -> float:
        """Sum of squares of the residuals of ``[1 | Q]``."""
        shared, squares = np.append(-found[self.shared[:-1]], 1.0), 0.0
        for group in self.groups:
            missed = group.rows[:, :, group.k :] @ shared
            missed -= np.einsum("sij,sj->si", group.rows[:, :, : group.k], found[group.own])
            squares += float(np.sum(missed**2))
        return squares
