"""Ridge least squares of columns that live in one segment each, beside some that all segments share.

Start-up decays of hundreds of segments do not meet one another: their cross products are block diagonal, with a border
of the shared columns. So each segment's own columns are eliminated by themselves, and what is left is a small problem
in the shared ones (Bjorck 1996, Numerical Methods for Least Squares Problems, section 6.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .leastsquares import WELL_CONDITIONED, Floats, RidgeSolution, triangle

CONSTANT = 1e-13
"""Length of a column less its mean, over its whole length, below which it is a constant."""


class Segments(NamedTuple):
    """Segments with equally many columns of their own, k."""

    own: np.ndarray
    """Numbers of these columns in ``[1 | Q | U]``, shape (segments, k)."""
    rows: Floats
    """Triangles of the columns ``[own | shared]``, shape (segments, k + q, k + q)."""

    @property
    def k(self) -> int:
        """How many they are."""
        return int(self.own.shape[1])


@dataclass(frozen=True)
class BorderedFactor:
    """Triangles of ``[own | shared]`` columns of each segment, in place of one of all columns."""

    shared: np.ndarray
    """Numbers of the q shared columns in ``[1 | Q | U]``: the 1 first, the reading last."""
    groups: Sequence[Segments]
    n_rows: int

    @classmethod
    def of(cls, shared: Sequence[int], segments: Sequence[tuple[Sequence[int], Floats]], n_rows: int) -> BorderedFactor:
        """Put segments together: the numbers of each one's own columns, and a matrix that stands for its rows."""
        alike: dict[int, list[tuple[Sequence[int], Floats]]] = {}
        for own, matrix in segments:
            square, found = np.zeros((len(own) + len(shared),) * 2), triangle(matrix)
            square[: len(found)] = found
            alike.setdefault(len(own), []).append((own, square))
        groups = [
            Segments(np.array([own for own, _ in some], np.intp).reshape(len(some), k), np.stack([r for _, r in some]))
            for k, some in alike.items()
        ]
        return cls(np.array(shared, np.intp), groups, n_rows)

    def solution(self, alpha: float) -> RidgeSolution | None:
        """What `solve_ridge` gives, to rounding; None where columns are not clearly independent."""
        mean, length = self._centred()
        if not (length > CONSTANT * np.hypot(length, mean * np.sqrt(self.n_rows))).all():
            return None
        unit = np.concatenate(([np.sqrt(self.n_rows)], length))  # of [1 | Q]
        held, border = self._eliminated(unit, np.sqrt(alpha / self.n_rows))
        spread, target = self._inverse(held, border)
        # columns of unit length: the Frobenius norm of their triangle is at least the root of their number
        if spread is None or not np.linalg.norm(spread) * np.sqrt(len(unit)) <= 1 / WELL_CONDITIONED:
            return None
        found = (spread @ target) / unit
        return RidgeSolution(
            intercept=float(found[0]),
            coef=found[1:],
            residual_sum_of_squares=self._left(found),
            rank=len(length),
            n_rows=self.n_rows,
            scale=length / unit[0],
            mean=mean,
            inverse_triangle=spread[1:] / length[:, None],
        )

    def _centred(self) -> tuple[Floats, Floats]:
        """Mean of each column of Q over all rows, and its length less that; shape (p,) each."""
        p = sum(group.own.size for group in self.groups) + len(self.shared) - 2
        sums, squares = np.zeros(p + 1), np.zeros(p + 1)
        for group in self.groups:
            own, one = group.rows[:, :, : group.k], group.rows[:, :, group.k]
            sums[group.own], squares[group.own] = np.einsum("sij,si->sj", own, one), np.einsum("sij,sij->sj", own, own)
        length = np.sqrt(np.maximum(squares - sums**2 / self.n_rows, 0.0))
        together = triangle(np.concatenate([g.rows[:, :, g.k :].reshape(-1, len(self.shared)) for g in self.groups]))
        inside = self.shared[1:-1]  # their means may be large: only a triangle keeps what is beside these
        sums[inside], length[inside] = together[0, 1:-1] * together[0, 0], np.linalg.norm(together[1:, 1:-1], axis=0)
        return sums[1:] / self.n_rows, length[1:]

    def _eliminated(self, unit: Floats, penalty: float) -> tuple[list[Floats], Floats]:
        """Rows that hold each segment's own columns, (segments, k, k + q), and the triangle of the shared, (q, q).

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

    def _inverse(self, held: Sequence[Floats], border: Floats) -> tuple[Floats | None, Floats]:
        """Inverse of the triangle of ``[1 | Q]``, shape (1 + p, 1 + p), and what the reading has in it, (1 + p,).

        None in place of the inverse where there is none.
        """
        p, shared = sum(group.own.size for group in self.groups) + len(self.shared) - 2, self.shared[:-1]
        spread, target = np.zeros((p + 1, p + 1)), np.zeros(p + 1)
        try:
            inside = np.linalg.inv(border[: len(shared), : len(shared)])
            spread[shared[:, None], shared], target[shared] = inside, border[: len(shared), -1]
            for group, rows in zip(self.groups, held, strict=True):
                inverse, own = np.linalg.inv(rows[:, :, : group.k]), group.own[:, :, None]
                spread[own, group.own[:, None, :]] = inverse
                spread[own, shared] = -inverse @ rows[:, :, group.k : -1] @ inside
                target[group.own] = rows[:, :, -1]
        except np.linalg.LinAlgError:
            return None, target
        return spread, target

    def _left(self, found: Floats) -> float:
        """Sum of squares of what the coefficients of ``[1 | Q]`` leave of the readings."""
        shared, squares = np.append(-found[self.shared[:-1]], 1.0), 0.0
        for group in self.groups:
            missed = group.rows[:, :, group.k :] @ shared
            missed -= np.einsum("sij,sj->si", group.rows[:, :, : group.k], found[group.own])
            squares += float(np.sum(missed**2))
        return squares
