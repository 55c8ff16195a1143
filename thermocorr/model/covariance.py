"""Noise of a record by restricted maximum likelihood.

Patterson & Thompson (Biometrika 58, 1971) for the noise, MacKay's updates (Neural Comput. 4, 1992) for the scale of the
priors, both on sums over bands of frequency, as in `thermocorr.equations.noise`. The noise is an average of models,
each of white noise and two kinds of wandering, by their likelihoods: one model of ten free parts gives the slowest
noise too little power, since the model of the reading has taken the few rows that would show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import InitialTransient, LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import ThermalLag
from ..equations.noise import RATIO, Bands, fitted_parts, spans
from ..records import History
from .averages import Binned, binned_columns
from .folds import MOST_SEGMENTS
from .heteroscedasticity import evenness

DRAWS = 40
"""Records drawn from the noise found, to estimate the uncertainty of its variances."""
EXACT = 1e-24
"""Variance of a reading that is exact, in units of its residuals'."""
LEAST = 1e-12
"""Directions in which the columns have less than this share of the largest carry no information."""


@dataclass(frozen=True, kw_only=True)
class Restricted:
    """Restricted likelihood of a record: its noise and coefficients."""

    theta: np.ndarray
    """Variances of the parts of the noise of bins, white first, shape (parts,)."""
    theta_covariance: np.ndarray
    """Shape (parts, parts)."""
    coef: np.ndarray
    """Generalised least squares, shape (p,)."""
    covariance: np.ndarray
    """Covariance of these coefficients, shape (p, p)."""
    by_part: np.ndarray
    """What a unit of each part's variance makes of the covariance, weights held, shape (parts, p, p)."""

    def freedom(self, form: np.ndarray) -> float:
        """Satterthwaite's degrees of freedom of ``trace(form @ covariance)``."""
        each = np.einsum("kij,ji->k", self.by_part, form)
        mean, variance = float(each @ self.theta), float(each @ self.theta_covariance @ each)
        return 2 * mean**2 / variance if variance > 0 else np.inf


class BandSums:
    """Sums of a record in bands of frequency.

    `columns` (array of shape (n, p)): Of about unit length each. `reading` (array of shape (n,)). `span` (array of
    shape (n,)): Number of the span of each row; the noise of different spans is independent. `groups` (sequence of
    arrays of shape (p,)): Each the inverse variances, up to a common scale, of coefficients that are drawn alike; 0
    for the others. `theta` (ndarray of shape (parts,)):
    Variances of the parts of the noise, white first, by the turns so far. `times` (ndarray of shape (parts - 1,)):
    Correlation times of the wandering parts [rows]. `scales` (ndarray of shape (groups,)): Prior variances of the
    groups.
    """

    def __init__(self, columns: np.ndarray, reading: np.ndarray, span: np.ndarray, groups: Sequence[np.ndarray] = ()):
        # No part remembers longer than the record: random walks are slower than any. Readings in a random walk are
        # covered in 93, 99, 100 % with 0.5, 1, 2 of it; where the noise remembers a quarter of the record they are
        # stated 1.0 times as uncertain as they are with 0.5, 1.4 times with 2 (time constants given): `python
        # benchmarks/interval_coverage.py --first 600 --seeds 24`.
        self.bands = Bands(span, 1.0)
        self.times, self.parts = self.bands.times, self.bands.exact_parts
        A, z = self.bands.forward(columns), self.bands.forward(reading[:, None])[:, 0]
        self.columns, self.reading = A, z
        edges = [*self.bands.starts.tolist(), len(z)]
        self.products = np.stack([A[a:b].T @ A[a:b] for a, b in pairwise(edges)])
        self.moments = self.bands.sums(A * z[:, None])
        self.power = np.maximum(self.bands.sums(z**2), EXACT)
        self.groups = groups
        self.scales = np.full(len(groups), max(float(np.sum(z**2)) / columns.shape[1], EXACT))
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
        for i, group in enumerate(self.groups):
            known = float(np.sum(group > 0) - np.sum(group * np.diag(V)) / self.scales[i])
            self.scales[i] = max(float(np.sum(group * coef**2)) / max(known, 0.1), 1e-300)

    def left(self, coef: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual degrees of freedom and squares, per band."""
        flat = self.products.reshape(len(self.power), -1)
        share = self.bands.sizes - flat @ V.ravel() / (self.parts @ self.theta)
        power = self.power - 2 * self.moments @ coef + flat @ np.outer(coef, coef).ravel()
        return np.maximum(share, 1e-3), np.maximum(power, 1e-12 * self.power)

    def without(self, columns: np.ndarray) -> BandSums:
        """Sums with fewer columns, shape (p,): True for those that go."""
        kept = ~columns
        other = copy(self)
        other.columns, other.moments = self.columns[:, kept], self.moments[:, kept]
        other.products = np.ascontiguousarray(self.products[:, kept][:, :, kept])
        other.groups, other.scales = [group[kept] for group in self.groups], self.scales.copy()
        other.models = AveragedModels(self.parts)
        return other

    def settle(self) -> BandSums:
        """Noise and priors with all parts free."""
        # Coefficients, noise and priors are estimated in turn, all parts free, before the models are averaged.
        for _ in range(8):
            before = np.concatenate((self.parts @ self.theta, self.scales))
            self.turn(averaged=False)
            # A change of 1 % ends the rounds: it moves uncertainties by less than 0.13 % on the average of twelve
            # records, in each of eleven kinds of noise.
            if np.abs(np.concatenate((self.parts @ self.theta, self.scales)) / before - 1).max() < 0.01:
                break
        return self

    def evidence(self) -> float:
        """Log likelihood, coefficients integrated out.

        For comparing columns of which all that differ have a prior.
        """
        S, precision = self.parts @ self.theta, self.precision()
        H, b = np.tensordot(1 / S, self.products, axes=1), self.moments.T @ (1 / S)
        H[np.diag_indices(len(H))] += precision
        prior = precision[precision > 0]
        size = np.linalg.slogdet(H)[1] - np.sum(np.log(prior)) + self.bands.sizes @ np.log(S)
        return float(-0.5 * (size + self.power @ (1 / S) - b @ inverse(H) @ b))

    def estimate(self, seed: int = 0) -> Restricted:
        """The answer; `seed` is that of its draws."""
        # Three more rounds are made with the average.
        for _ in range(3):
            self.turn(averaged=True)
        coef, V = self.solved()
        share, _ = self.left(coef, V)
        S = self.parts @ self.theta
        drawn = np.random.default_rng(seed).gamma(share[:, None] / 2, 2.0, (len(S), DRAWS)) * S[:, None]
        again = fitted_parts(self.parts, share, drawn, np.repeat(self.theta[:, None], DRAWS, axis=1))
        weighted = self.products / (S**2)[:, None, None]
        by_part = np.stack([V @ np.tensordot(part, weighted, axes=1) @ V for part in self.parts.T])
        return Restricted(
            theta=self.theta, theta_covariance=np.atleast_2d(np.cov(again)), coef=coef, covariance=V, by_part=by_part
        )


class AveragedModels:
    """Models of white and wandering noise, averaged by likelihood.

    A kind is one part, or a mix of all of them whose variances go with a power of their correlation time.

    `parts` (array of shape (bands, parts)): Powers of the parts, white first.
    """

    def __init__(self, parts: np.ndarray):
        k = parts.shape[1] - 1
        # Mixed kinds of wandering: the variances of the parts go with a power of their correlation time; 0 is flicker
        # noise.
        weights = [RATIO ** (slope * np.arange(k)) for slope in (-0.5, 0.0, 0.5)]
        kinds = np.column_stack((np.eye(k), *(each / each.sum() for each in weights)))
        powers = (parts[:, 1:] @ kinds).T
        one, other = np.triu_indices(len(powers))
        self.one, self.other = kinds[:, one], kinds[:, other]
        self.shapes = np.stack((np.ones((len(one), len(parts))), powers[one], powers[other]), axis=1)
        self.theta: np.ndarray | None = None

    def average(self, share: np.ndarray, power: np.ndarray) -> np.ndarray:
        """Averaged variances of the parts, shape (parts,).

        A second call goes on from what the first has found.
        """
        # Forty multiplicative updates of a model's variances: with twice as many, uncertainties change by 0.4 to 1.2 %
        # on the average (six records of each of six kinds of noise), and cost a fifth more.
        total, rounds = float(power.sum() / share.sum()), 40
        if self.theta is None:
            self.theta = np.full((len(self.shapes), 3), total) * [0.5, 0.25, 0.25]
        else:
            # Fewer updates do for a slightly different record.
            rounds = 15
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
    """Inverse of an ill-scaled symmetric matrix; null directions get 0."""
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H * scale[:, None] * scale)
    kept = values > LEAST * values[-1]
    half = vectors[:, kept] / np.sqrt(values[kept]) * scale[:, None]
    return np.asarray(half @ half.T)


SPECTRUM_SHARE = 1 / 12
"""Longest time constant that may be there unseen, as a share of the longest segment: slower bodies are noise as far as
the record is not likelier with them. With 1/8, 1/12, 1/16 of it, readings in a random walk are covered in 90, 92, 89 %,
the bias in white noise in 98, 98, 97 % (searched time constants, seeds 600 to 659):
`python benchmarks/interval_coverage.py --first 600 --seeds 60`."""


@dataclass(frozen=True, kw_only=True)
class Basis:
    """Effects, and their columns in the bins of the record."""

    effects: list[Effect]
    history: History
    """The fitted record's, with the states of these effects at its end."""
    own: bool
    """True if these are the model's own effects."""
    columns: np.ndarray
    """Means of the columns that have an error, 1 first, shape (bins, p)."""
    free: np.ndarray
    """Where these stand among the intercept and all columns, shape (p,)."""
    width: int
    """The intercept and all columns."""
    reading: np.ndarray
    """Means of the readings, shape (bins,); the starts of many segments are taken out."""
    offset: float
    """What was taken off the readings."""
    segment: np.ndarray
    begins: np.ndarray
    rows: int
    """Rows of a bin."""
    groups: list[np.ndarray]
    """Coefficients that have a prior: 1 for those drawn alike, 0 for others, shape (p,) each."""
    searched: bool
    """True if the lags of a whole grid stand for those of the model."""
    slow: np.ndarray
    """Lags of that grid beyond `SPECTRUM_SHARE`, shape (p,): True for those."""

    def bin_seconds(self) -> float:
        """Usual time from bin to bin [s]."""
        steps = np.diff(self.begins)[np.diff(self.segment) == 0]
        return float(np.median(steps)) if len(steps) else self.history.usual_step


def basis_of(model: Any, bins: Binned, offset: float) -> Basis:
    """The basis of a fitted model, from its bins."""
    effects, history = model.features_.effect_list(), model.features_.history_
    grid, usual_longest = _spectrum(model)
    if bins.columns is not None:
        means, own = bins.columns, True
    else:
        searched = () if model.search_ is None else tuple(model.search_.further)
        wide = [_widened(effect, grid, searched, history) for effect in effects]
        own = all(one is other for one, other in zip(effects, wide, strict=True))
        effects = wide
        means, ends = binned_columns(effects, history, bins)
        history = replace(history, end_states=tuple(ends))
    columns = np.column_stack((np.ones(len(means)), means))
    free, starts = np.arange(columns.shape[1]), np.zeros(len(columns))
    if len(history.record.segments) > MOST_SEGMENTS:  # their starts have no say on the rest
        decays = np.array([False, *(isinstance(e, InitialTransient) for e in effects for _ in e.names())])
        fitted = np.array([isinstance(e, InitialTransient) for e in model.features_.effect_list() for _ in e.names()])
        free, starts = np.flatnonzero(~decays), columns[:, decays] @ model.coef_[fitted]
    usual = float(np.median(bins.count[bins.count > 0]))  # of readings: a record may have few, or nothing but bursts
    known = bins.count >= usual / 2
    return Basis(
        effects=effects, history=history, own=own, columns=columns[known][:, free], free=free, width=columns.shape[1],
        reading=(bins.reading - starts)[known], offset=offset, segment=bins.segment[known],
        begins=bins.begins[known], rows=max(1, round(usual)),
        searched=not own and len(grid) > 0, slow=_slower(effects, grid, usual_longest)[free],
        groups=[group[free] for group in _priors(effects, model.features_.effect_list())],
    )  # fmt: skip


def _slower(effects: Sequence[Effect], grid: np.ndarray, longest: float) -> np.ndarray:
    """Lags beyond the model's slowest, shape (1 + p,)."""
    slow = [np.zeros(1, bool)]
    for effect in effects:
        wide = np.array_equal(getattr(effect, "time_constants", ()), grid) and effect.n_columns() == len(grid)
        slow.append(grid > longest if wide and len(grid) else np.zeros(effect.n_columns(), bool))
    return np.concatenate(slow)


def _priors(effects: Sequence[Effect], own: Sequence[Effect]) -> list[np.ndarray]:
    """Columns added to the model's own lags and decays."""
    edges = np.cumsum([1, *(effect.n_columns() for effect in effects)])
    groups = []
    for start, effect, narrow in zip(edges, effects, own, strict=False):
        known = narrow.names()
        if effect.names() == known:
            continue
        if not isinstance(effect, InitialTransient):  # the lags chosen are not known better than their neighbours
            known = effect.names()[:1] if isinstance(effect, LaggedCovariate) else []
        drawn = [name not in known for name in effect.names()]
        group = np.zeros(edges[-1])
        group[start : start + len(drawn)] = drawn
        groups.append(group)
    return groups


def _spectrum(model: Any) -> tuple[np.ndarray, float]:
    """Possible time constants, and the longest certain one [s].

    Empty for others.
    """
    choice, record = model.search_, model.features_.history_.record
    if (
        choice is None
        or choice.reference is None
        or model.products
        or not (choice.further or len(choice.time_constants))
    ):
        return np.zeros(0), np.inf
    span = record.longest_read()
    slowest = max(taus.max(initial=0.0) for taus in (choice.time_constants, *choice.further.values()))
    usual = SPECTRUM_SHARE * span
    # Where slower ones were chosen, a body may be there that is 1.3 times slower than any of them.
    return np.unique(choice.grid[choice.grid <= max(usual, 1.3 * slowest)]), usual


def _widened(effect: Effect, grid: np.ndarray, searched: Sequence[Any], history: History) -> Effect:
    """An effect with all time constants of a grid.

    So are lags of further thermometers, the columns `searched`.
    """
    lags = isinstance(effect, ThermalLag) or (isinstance(effect, LaggedCovariate) and effect.column in searched)
    if lags and len(grid):
        changed: dict[str, Any] = {"time_constants": grid}
    elif isinstance(effect, InitialTransient) and 1 < len(history.record.segments) <= MOST_SEGMENTS:
        changed = {"longest_share": 1.0}
    else:
        return effect
    wide: Effect = clone(effect).set_params(**changed)
    wide.learn(history.record)
    return effect if wide.names() == effect.names() else wide


@dataclass(frozen=True, kw_only=True)
class ScaledBasis:
    """A basis of unit columns and unit noise."""

    columns: np.ndarray
    reading: np.ndarray
    norms: np.ndarray
    """Shape (p,): a column is that many times `columns` times `size`."""
    unit: float
    mean: float
    """Mean of the reading, taken off."""
    size: np.ndarray
    """Size of the noise at each bin, over its usual one, shape (bins,)."""
    span: np.ndarray

    @classmethod
    def of(cls, basis: Basis) -> ScaledBasis:
        """Scale the columns and readings of a basis."""
        norms = np.linalg.norm(basis.columns, axis=0)
        norms[norms < 1e-60] = 1.0  # nothing, or decays that are over
        columns, mean = basis.columns / norms, float(basis.reading.mean())
        reading = basis.reading - mean
        rest = reading - columns @ np.linalg.lstsq(columns, reading, rcond=1e-10)[0]
        runs = [segment.run for segment in basis.history.record.segments]
        size = 1 / evenness(rest, basis.segment)
        unit = float(np.std(rest)) or 1.0
        return cls(
            columns=columns / size[:, None], reading=reading / unit / size, norms=norms, unit=unit, mean=mean,
            size=size, span=spans(basis.segment, basis.begins, runs),
        )  # fmt: skip
