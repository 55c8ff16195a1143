"""`NoiseModel`: noise of one reading, and of means of several, after a fit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

EVEN = 1e-9
"""Spread of steps, as a share of one, up to which they are equal."""
NEAR_ONE = 1e-5
"""Correlation of neighbours, less than one by this, at which the series' sum would lose its digits."""


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """White noise, noise that forgets within some rows, and Ornstein-Uhlenbeck parts of many correlation times.

    Variances in the unit of the reading squared.
    """

    white: float
    """Variance of one reading that the readings before it do not foretell: white, or forgotten within `recent`."""
    recent: float
    """Correlation time of that part [s]; 0 for white noise."""
    wander: np.ndarray
    """Variances of the parts, shape (parts,)."""
    correlation_times: np.ndarray
    """Correlation times of the parts [s], increasing."""
    white_dof: float
    """Degrees of freedom of `white`."""
    wander_dof: float
    """Degrees of freedom of the wandering variance."""
    size_seconds: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Times at which the size of the noise is known, where it changes in the course of the record [s]."""
    sizes: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Size of the noise then, over the one that the variances are of."""

    @property
    def wander_variance(self) -> float:
        """Variance of all wandering parts together."""
        return float(self.wander.sum())

    @property
    def variance(self) -> float:
        """Variance of one reading."""
        return self.white + self.wander_variance

    @property
    def memory(self) -> float:
        """Mean correlation time of what wanders, each part by its variance [s]; 0 where nothing does."""
        total = self.wander_variance
        return float(self.wander @ self.correlation_times) / total if total > 0 else 0.0

    def size(self, seconds: np.ndarray) -> np.ndarray:
        """Size of the noise at times [s], over that of the variances.

        For what comes later, and before: the nearest one known, and its root mean square over the record at least. Of a
        noise that went on growing nothing better is known; one that goes with the temperature will be large again.
        """
        if not len(self.sizes):
            return np.ones(len(seconds))
        known = np.interp(seconds, self.size_seconds, self.sizes)
        usual = float(np.sqrt(np.mean(self.sizes**2)))
        apart = (seconds < self.size_seconds[0]) | (seconds > self.size_seconds[-1])
        return np.asarray(np.where(apart, np.maximum(known, usual), known))

    @property
    def dof(self) -> float:
        """Degrees of freedom of `variance` (Welch and Satterthwaite)."""
        spread = self.white**2 / self.white_dof + self.wander_variance**2 / self.wander_dof
        return self.variance**2 / spread if spread > 0 else np.inf

    def averaged(self, other: NoiseModel, share: float) -> NoiseModel:
        """Mean of two for one record, this one with a share of 0 to 1; the correlation times are the same."""
        white = share * self.white + (1 - share) * other.white
        forgotten = share * self.white * self.recent + (1 - share) * other.white * other.recent
        wandering = self.wander_variance, other.wander_variance
        return replace(
            self,
            white=white,
            recent=forgotten / white if white > 0 else 0.0,
            wander=share * self.wander + (1 - share) * other.wander,
            white_dof=dof_of_average((self.white, other.white), (self.white_dof, other.white_dof), share),
            wander_dof=dof_of_average(wandering, (self.wander_dof, other.wander_dof), share),
        )

    def covariance(self, seconds: np.ndarray, runs: np.ndarray) -> np.ndarray:
        """Covariance matrix of the noise of different readings, shape (n, n); that of different runs is independent."""
        lag, size = np.abs(seconds[:, None] - seconds), self.size(seconds)
        with np.errstate(under="ignore"):
            total = np.exp(-lag / self.recent) * self.white if self.recent > 0 else self.white * np.eye(len(seconds))
            for variance, time in zip(self.wander.tolist(), self.correlation_times.tolist(), strict=True):
                if variance > 0:
                    total += variance * np.exp(-lag / time)
        return np.asarray(total * (runs[:, None] == runs) * size[:, None] * size)

    def of_mean(self, seconds: np.ndarray, runs: np.ndarray | None = None) -> tuple[float, float]:
        """Variances of the mean of readings at times [s]: unforeseen part, wandering parts.

        With the number of each reading's run, shape (n,): the noise of different runs is independent.
        """
        if runs is not None and (runs != runs[0]).any():
            each = [(runs == run) for run in np.unique(runs)]
            of_runs = [np.mean(one) ** 2 * np.array(self.of_mean(seconds[one])) for one in each]
            white, slow = np.sum(of_runs, axis=0).tolist()
            return white, slow
        steps = np.diff(np.sort(np.asarray(seconds, float)))
        larger = float(np.mean(self.size(seconds) ** 2))
        parts = zip(self.wander.tolist(), self.correlation_times.tolist(), strict=True)
        wander = sum(variance * _mean_correlation(steps, time) for variance, time in parts if variance > 0)
        return larger * self.white * _mean_correlation(steps, self.recent), larger * float(wander)


def dof_of_average(variances: tuple[float, float], dof: tuple[float, float], share: float) -> float:
    """Degrees of freedom of the mean of two variances that one record tells, the first with a share of 0 to 1.

    They err together, not independently as Welch and Satterthwaite have it.
    """
    parts = np.array([share, 1 - share]) * variances
    error = float(parts @ (1 / np.sqrt(dof)))
    return (float(parts.sum()) / error) ** 2 if error > 0 else np.inf


def _mean_correlation(steps: np.ndarray, correlation_time: float) -> float:
    """Mean of exp(-|t_i - t_j| / correlation_time) over all pairs of times with the given steps [s]."""
    n = len(steps) + 1
    if correlation_time <= 0 or n == 1:
        return 1 / n
    with np.errstate(under="ignore"):
        kept = np.exp(-steps / correlation_time)
    if np.ptp(steps) <= EVEN * steps[0] and kept[0] < 1 - NEAR_ONE:  # a geometric series
        k = float(kept[0])
        return float((n + 2 * k * (n - 1 - n * k + k**n) / (1 - k) ** 2) / n**2)
    behind = before = 0.0
    for k in kept.tolist():  # sum of correlations with all earlier times
        before = k * (before + 1.0)
        behind += before
    return (n + 2 * behind) / n**2
