"""What the lags of one column feel of gaps: how it fades, and what it moves the bias by.

The error of lag j behind a gap is forgotten as exp(-t/tau_j), eq. (17) with no input, so a covariance C of these errors
fades as ``C_jk exp(-(1/tau_j + 1/tau_k) t)``, number by number, and the bias errs by the variance ``w' C w``. No matrix
products are needed: C is kept as one row of J (J + 1)/2 numbers, its diagonal first.
"""

from __future__ import annotations

import numpy as np

from .input_law import InputLaw

KEPT_STEPS = 64
"""Different steps whose decays are remembered; a clock that jitters does not fill the memory."""


class Fading:
    """Covariances of what the lags of a column feel, as rows of numbers.

    What is felt is forgotten when the bias would move by no more than `InputLaw.least` if all lags erred together by
    their standard deviations: ``sum_j |w_j| sqrt(C_jj) <= least``. A row, a block and a whole record ask alike.

    Parameters
    ----------
    law : InputLaw
        How the bias depends on the column.
    """

    def __init__(self, law: InputLaw):
        self.law, self._n = law, len(law.weights)
        above = np.triu_indices(self._n, 1)
        self._places = tuple(np.concatenate((np.arange(self._n), one)) for one in above)
        first, second = self._places
        self.width = len(first)
        """Numbers of a row."""
        self._rates = -1.0 / law.time_constants[first] - 1.0 / law.time_constants[second]
        self._products = law.weights[first] * law.weights[second] * np.where(first == second, 1.0, 2.0)
        self._sizes = np.abs(law.weights)
        self._known: dict[float, np.ndarray] = {}

    def row(self, covariance: np.ndarray) -> np.ndarray:
        """A covariance of shape (J, J) as a row; rounding may have made variances less than 0."""
        row = covariance[self._places]
        row[: self._n] = np.maximum(row[: self._n], 0.0)
        return row

    def covariance(self, row: np.ndarray) -> np.ndarray:
        """The covariance that a row stands for, shape (J, J)."""
        full, (first, second) = np.empty((self._n, self._n)), self._places
        full[first, second] = full[second, first] = row
        return full

    # ------------------------------------------------------------------------------------------------- one by one

    def faded(self, row: np.ndarray, step: float) -> np.ndarray:
        """What is left after a while [s]."""
        decay = self._known.get(step)
        if decay is None:
            decay = np.exp(self._rates * step)
            if len(self._known) < KEPT_STEPS:
                self._known[step] = decay
        return np.asarray(row * decay)

    def variance(self, row: np.ndarray) -> float | None:
        """Variance of the bias; None where it is forgotten."""
        if self._sizes.dot(np.sqrt(row[: self._n])) <= self.law.least:
            return None
        return max(float(self._products.dot(row)), 0.0)

    # -------------------------------------------------------------------------------------------------- in blocks

    def of_rows(
        self, elapsed: np.ndarray, gaps: np.ndarray, bridges: np.ndarray, felt: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Variance of the bias in consecutive rows, and what is felt after the last of them.

        Parameters
        ----------
        elapsed : array of shape (n,)
            Time since the row before these [s].
        gaps : array of shape (m,)
            Numbers of the rows behind a gap.
        bridges : array of shape (m, J (J + 1)/2)
            What each gap adds.
        felt : row, optional
            After the row before these; None for nothing.
        """
        first, begun, rows = gaps, elapsed[gaps], bridges
        if felt is not None and gaps[:1].tolist() == [0]:
            rows[0] += self.faded(felt, float(begun[0]))
        elif felt is not None:
            first, begun, rows = np.append(0, gaps), np.append(0.0, begun), np.vstack((felt, bridges))
        variance = np.zeros(len(elapsed))
        if not len(first):
            return variance, None
        told = self._chained(rows, begun, elapsed[np.append(first[1:], len(elapsed)) - 1])
        counts = np.diff(np.append(first, len(elapsed)))
        variance[first[0] :] = self._between(rows, counts, elapsed[first[0] :] - begun.repeat(counts))
        return variance, rows[-1] * np.exp(self._rates * (elapsed[-1] - begun[-1])) if told else None

    def _chained(self, rows: np.ndarray, begun: np.ndarray, last: np.ndarray) -> bool:
        """Add to what each gap adds what is still felt of those before it; whether the last one is felt to the end.

        `begun` and `last` are the times of the first and the last row behind each gap [s].
        """
        passed = np.exp(np.diff(begun, prepend=begun[0])[:, None] * self._rates)
        left = np.exp((begun - last)[:, None] / self.law.time_constants) * self._sizes
        n, least, before, told = self._n, self.law.least, rows[0], False
        alone = np.einsum("ij,ij->i", left, np.sqrt(rows[:, :n])) > least  # the more so beside what was felt before
        for row, decay, share, sure in zip(rows, passed, left, alone.tolist(), strict=True):
            if told:
                decay *= before
                row += decay
            told = sure or share.dot(np.sqrt(row[:n])) > least
            before = row
        return bool(told)

    def _between(self, rows: np.ndarray, counts: np.ndarray, since: np.ndarray) -> np.ndarray:
        """Variance of the bias in so many rows behind each gap, at times [s] since it was over."""
        decays = np.exp(np.multiply.outer(-1.0 / self.law.time_constants, since))
        most, variance, at = np.zeros(len(since)), np.zeros(len(since)), self._n
        sizes, products = np.sqrt(rows[:, : self._n]) * self._sizes, rows * self._products
        for j, decay in enumerate(decays):
            most += sizes[:, j].repeat(counts) * decay
            inner = products[:, j].repeat(counts) * decay
            for other in decays[j + 1 :]:
                inner += products[:, at].repeat(counts) * other
                at += 1
            variance += inner * decay
        return np.where(most > self.law.least, np.maximum(variance, 0.0), 0.0)
