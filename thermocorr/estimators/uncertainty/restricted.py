"""Noise of a record by restricted maximum likelihood, beside columns of which some have a prior.

Patterson & Thompson (Biometrika 58, 1971) for the noise, MacKay's updates (Neural Comput. 4, 1992) for the scale of the
priors, both on sums over bands of frequency, as in `thermocorr.equations.noise`. The noise is an average of models,
each of white noise and two kinds of wandering, by their likelihoods: one model of ten free parts gives the slowest
noise too little power, since the model of the reading has taken the few rows that would show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...equations.noise import RATIO, Bands, fitted_parts

LONGEST = 1.0
"""Longest correlation time, as a share of the record: random walks are slower than any. Readings in a random walk are
covered in 93, 99, 100 % with 0.5, 1, 2; where the noise remembers a quarter of the record they are stated 1.0 times as
uncertain as they are with 0.5, 1.4 times with 2 (time constants given):
`python benchmarks/interval_coverage.py --first 600 --seeds 24`."""
SLOPES = (-0.5, 0.0, 0.5)
"""Mixed kinds of wandering: variances of the parts go with this power of their correlation time; 0 is flicker noise."""
TURNS = 8
"""Most rounds of coefficients, noise and priors with all parts free, before the models are averaged."""
SETTLED = 0.01
"""Change of the noise's power in any band, and of the priors, from one round to the next, below which no more follows.
It moves uncertainties by less than 0.13 % on the average of twelve records, in each of eleven kinds of noise."""
AVERAGED_TURNS = 3
"""Rounds with the average."""
ROUNDS = 40
"""Multiplicative updates of a model's variances. With twice as many, uncertainties change by 0.4 to 1.2 % on the
average (six records of each of six kinds of noise), and cost a fifth more."""
FEWER_ROUNDS = 15
"""Further ones, for a slightly different record."""
DRAWS = 40
"""Records drawn from the noise found, by which the uncertainty of its variances is told."""
EXACT = 1e-24
"""Variance of a reading that is exact, in units of its residuals'."""
HELD = 1e-9
"""Share of a column outside of the others below which it is rounding."""
LEAST = 1e-12
"""Directions in which the columns have less than this share of the largest carry no information."""


@dataclass(frozen=True, kw_only=True)
class Within:
    """What rows say beside their bins' means: cross products of their distances from them."""

    columns: np.ndarray
    """Shape (p, p)."""
    moments: np.ndarray
    """With the reading, shape (p,)."""
    power: float
    """Sum of squares of the readings' distances."""
    freedom: int
    """Rows less bins."""


@dataclass(frozen=True, kw_only=True)
class Restricted:
    """What a record says about its noise and coefficients."""

    theta: np.ndarray
    """Variances of the parts of the noise of bins, white first, shape (parts,)."""
    theta_covariance: np.ndarray
    """Shape (parts, parts)."""
    within: float
    """Variance of the rows within bins; 0 where a bin is a row."""
    coef: np.ndarray
    """Generalised least squares, shape (p,)."""
    covariance: np.ndarray
    """Covariance of these coefficients, shape (p, p)."""
    by_part: np.ndarray
    """What a unit of each part's variance makes of the covariance, weights held, shape (parts, p, p)."""

    def freedom(self, form: np.ndarray) -> float:
        """Effective degrees of freedom of ``trace(form @ covariance)`` (Satterthwaite, Biometrics Bull. 2, 1946)."""
        each = np.einsum("kij,ji->k", self.by_part, form)
        mean, variance = float(each @ self.theta), float(each @ self.theta_covariance @ each)
        return 2 * mean**2 / variance if variance > 0 else np.inf


class BandSums:
    """Sums of a record in bands of frequency, and what they say under any noise.

    `columns` (array of shape (n, p)): Of about unit length each. `reading` (array of shape (n,)). `span` (array of
    shape (n,)): Number of the span of each row; the noise of different spans is independent. `groups` (sequence of
    arrays of shape (p,)): Each the inverse variances, up to a common scale, of coefficients that are drawn alike; 0
    for the others. `within` (Within, optional): Beside bins of several rows. `theta` (ndarray of shape (parts,)):
    Variances of the parts of the noise, white first, by the turns so far. `times` (ndarray of shape (parts - 1,)):
    Correlation times of the wandering parts [rows]. `scales` (ndarray of shape (groups,)): Prior variances of the
    groups. `fast` (float): Variance of rows within their bins.
    """

    def __init__(
        self,
        columns: np.ndarray,
        reading: np.ndarray,
        span: np.ndarray,
        groups: Sequence[np.ndarray] = (),
        within: Within | None = None,
    ):
        self.bands = Bands(span, LONGEST)
        self.times, self.parts = self.bands.times, self.bands.exact_parts
        A, z = self.bands.forward(columns), self.bands.forward(reading[:, None])[:, 0]
        self.columns, self.reading = A, z
        edges = [*self.bands.starts.tolist(), len(z)]
        self.products = np.stack([A[a:b].T @ A[a:b] for a, b in pairwise(edges)])
        self.moments = self.bands.sums(A * z[:, None])
        self.power = np.maximum(self.bands.sums(z**2), EXACT)
        self.groups, self.within = groups, within
        self.scales = np.full(len(groups), max(float(np.sum(z**2)) / columns.shape[1], EXACT))
        self.fast = within.power / max(within.freedom, 1) if within else 0.0
        variance = max(float(np.mean(z**2)), EXACT)
        parts = self.parts.shape[1]
        self.models = AveragedModels(self.parts)
        self.theta = np.r_[variance / 2, np.full(parts - 1, variance / 2 / max(parts - 1, 1))]

    def precision(self) -> np.ndarray:
        """Inverse prior variances of the coefficients, shape (p,)."""
        total = np.zeros(self.products.shape[1])
        for scale, group in zip(self.scales, self.groups, strict=True):
            total += group / scale
        return total

    def solved(self) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients under the present noise and priors, and their covariance."""
        W = 1 / (self.parts @ self.theta)
        H, b = np.tensordot(W, self.products, axes=1), W @ self.moments
        if self.within and self.fast > 0:
            H, b = H + self.within.columns / self.fast, b + self.within.moments / self.fast
        H[np.diag_indices(len(H))] += self.precision()
        V = inverse(H)
        return V @ b, V

    def turn(self, averaged: bool) -> None:
        """Better noise and priors, from what the coefficients leave."""
        coef, V = self.solved()
        share, power = self.left(coef, V)
        start = self.theta[:, None]
        self.theta = (
            self.models.average(share, power)
            if averaged
            else fitted_parts(self.parts, share, power[:, None], start)[:, 0]
        )
        if self.within and self.within.freedom > 0:
            rest = self.within.power - 2 * coef @ self.within.moments + coef @ self.within.columns @ coef
            self.fast = max(rest, 1e-9 * self.within.power) / self.within.freedom
        for i, group in enumerate(self.groups):
            known = float(np.sum(group > 0) - np.sum(group * np.diag(V)) / self.scales[i])
            self.scales[i] = max(float(np.sum(group * coef**2)) / max(known, 0.1), 1e-300)

    def beside(self, column: np.ndarray) -> tuple[float, float] | None:
        """Coefficient of one more column, shape (n,), and its variance; None where the others hold all of it."""
        W = 1 / self.bands.each_row(self.parts @ self.theta)
        x, (coef, V) = self.bands.forward(column[:, None])[:, 0], self.solved()
        cross = self.columns.T @ (W * x)
        own = float(x @ (W * x))
        left = own - float(cross @ V @ cross)
        if not left > HELD * own:
            return None
        moment = float(x @ (W * self.reading) - cross @ coef)
        return moment / left, 1 / left

    def last_covariance(self, last: np.ndarray) -> np.ndarray:
        """Covariance of the coefficients with each part of the noise at the end of the record, shape (p, parts).

        `last` is the correlation of each row with that end, for each wandering part, shape (n, parts - 1).
        """
        W = 1 / self.bands.each_row(self.parts @ self.theta)
        through = self.columns.T @ (W[:, None] * self.bands.forward(last * self.theta[1:]))
        return np.asarray(self.solved()[1] @ through)

    def left(self, coef: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Degrees of freedom that the coefficients leave in each band, and sums of squares."""
        flat = self.products.reshape(len(self.power), -1)
        share = self.bands.sizes - flat @ V.ravel() / (self.parts @ self.theta)
        power = self.power - 2 * self.moments @ coef + flat @ np.outer(coef, coef).ravel()
        return np.maximum(share, 1e-3), np.maximum(power, 1e-12 * self.power)

    def without(self, columns: np.ndarray) -> BandSums:
        """Sums beside fewer columns, shape (p,): True for those that go."""
        kept = ~columns
        other = copy(self)
        other.columns, other.moments = self.columns[:, kept], self.moments[:, kept]
        other.products = np.ascontiguousarray(self.products[:, kept][:, :, kept])
        other.groups, other.scales = [group[kept] for group in self.groups], self.scales.copy()
        other.models = AveragedModels(self.parts)
        return other

    def settle(self) -> BandSums:
        """Noise and priors with all parts free, before models of the noise are averaged."""
        for _ in range(TURNS):
            before = np.concatenate((self.parts @ self.theta, self.scales))
            self.turn(averaged=False)
            if np.abs(np.concatenate((self.parts @ self.theta, self.scales)) / before - 1).max() < SETTLED:
                break
        return self

    def evidence(self) -> float:
        """Log likelihood under the present noise and priors, the coefficients integrated out, but for a constant.

        For comparing columns of which all that differ have a prior.
        """
        S, precision = self.parts @ self.theta, self.precision()
        H, b = np.tensordot(1 / S, self.products, axes=1), self.moments.T @ (1 / S)
        H[np.diag_indices(len(H))] += precision
        prior = precision[precision > 0]
        size = np.linalg.slogdet(H)[1] - np.sum(np.log(prior)) + self.bands.sizes @ np.log(S)
        return float(-0.5 * (size + self.power @ (1 / S) - b @ inverse(H) @ b))

    def said(self, seed: int = 0) -> Restricted:
        """The answer, once settled; `seed` is that of the draws which tell how well the noise is known."""
        for _ in range(AVERAGED_TURNS):
            self.turn(averaged=True)
        coef, V = self.solved()
        share, _ = self.left(coef, V)
        S = self.parts @ self.theta
        drawn = np.random.default_rng(seed).gamma(share[:, None] / 2, 2.0, (len(S), DRAWS)) * S[:, None]
        again = fitted_parts(self.parts, share, drawn, np.repeat(self.theta[:, None], DRAWS, axis=1))
        weighted = self.products / (S**2)[:, None, None]
        by_part = np.stack([V @ np.tensordot(part, weighted, axes=1) @ V for part in self.parts.T])
        return Restricted(
            theta=self.theta,
            theta_covariance=np.atleast_2d(np.cov(again)),
            within=self.fast,
            coef=coef,
            covariance=V,
            by_part=by_part,
        )


class AveragedModels:
    """All models of white noise and two kinds of wandering, averaged by their likelihoods.

    A kind is one part, or a mix of all of them whose variances go with a power of their correlation time.

    `parts` (array of shape (bands, parts)): Powers of the parts, white first.
    """

    def __init__(self, parts: np.ndarray):
        k = parts.shape[1] - 1
        weights = [RATIO ** (slope * np.arange(k)) for slope in SLOPES]
        kinds = np.column_stack((np.eye(k), *(each / each.sum() for each in weights)))
        powers = (parts[:, 1:] @ kinds).T
        one, other = np.triu_indices(len(powers))
        self.one, self.other = kinds[:, one], kinds[:, other]
        self.shapes = np.stack((np.ones((len(one), len(parts))), powers[one], powers[other]), axis=1)
        self.theta: np.ndarray | None = None

    def average(self, share: np.ndarray, power: np.ndarray) -> np.ndarray:
        """Variances of the parts, shape (parts,); `share` and `power` are those of `fitted_parts`, for one record.

        A second call goes on from what the first has found.
        """
        total, rounds = float(power.sum() / share.sum()), ROUNDS
        if self.theta is None:
            self.theta = np.full((len(self.shapes), 3), total) * [0.5, 0.25, 0.25]
        else:
            rounds = FEWER_ROUNDS
        for _ in range(rounds):
            S = np.matmul(self.theta[:, None], self.shapes)[:, 0]
            ratio = np.matmul(self.shapes, np.stack((power / S**2, share / S), axis=2))
            self.theta = np.maximum(self.theta * ratio[:, :, 0] / ratio[:, :, 1], LEAST * total)
        S = np.matmul(self.theta[:, None], self.shapes)[:, 0]
        level = -0.5 * np.sum(share * np.log(S) + power / S, axis=1)  # Whittle
        weight = np.exp(level - level.max())
        weight /= weight.sum()
        wandering = self.one @ (weight * self.theta[:, 1]) + self.other @ (weight * self.theta[:, 2])
        return np.concatenate(([weight @ self.theta[:, 0]], wandering))


def inverse(H: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix of columns of very different size; directions that are not there get nothing."""
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H * scale[:, None] * scale)
    kept = values > LEAST * values[-1]
    half = vectors[:, kept] / np.sqrt(values[kept]) * scale[:, None]
    return np.asarray(half @ half.T)
