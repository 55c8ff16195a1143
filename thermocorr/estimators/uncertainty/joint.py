"""Joint errors of a fitted model's coefficients, and its noise, from the record that it was fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...effects import StaticPolynomial, ThermalLag
from ...effects.protocol import Effect
from ...equations import RidgeSolution, TriangularFactor
from ...equations.noise import spans
from ...records import History
from ..evenness import evenness
from ..fitting import Swept
from ..time_constants.spectrum import TOLERANCE
from .basis import Basis, basis_of
from .noise_model import NoiseModel
from .restricted import BandSums, Restricted, Within

UNKNOWN = (
    "This model does not know the noise of the record it was fitted to: it was read from an old file, or fitted on "
    "several processes, with a fleet as its prior, or to readings that count differently. Fit it again with "
    "DynamicBiasRegressor.fit, to a record of its own, to have uncertainties."
)
FORGETS = 1.2
"""Variance of a bin's mean over that of white noise, from which on the noise within bins is taken to remember."""
PER_MEMORY = 2.0
"""Degrees of freedom that a correlation time adds to a wandering variance: a sum of squares alone would give 1, a known
shape of the spectrum more. Corrected readings in a random walk are covered in 100, 99, 96 % with 1, 2, 4 (time
constants given) and 100, 98, 95 % (searched): `python benchmarks/interval_coverage.py --first 600 --seeds 24`."""
CLEARLY = 3.0
"""Logarithm of the ratio of evidences from which on bodies slower than a twelfth of the record are the device's (Kass
& Raftery, J. Am. Stat. Assoc. 90, 1995: "strong"). In random walks of 5000 rows it is -2.9 to 0.8; in white noise of
1200 rows it is -2.9 to -0.3 where the device has no such body and 24 to 84 where it has."""
MOST_MOVED = 1.1
"""Standard deviation of the temperature inside a device, over that outside, above which it is none."""
SIZES = 200
"""Moments at which the size of a noise that changes with time is kept."""


@dataclass(frozen=True, kw_only=True)
class Beyond:
    """The next power of the static law, which the model leaves out: what it may do outside the fitted temperatures."""

    power: int
    size: float
    """Root mean square of its coefficient, from estimate and standard error [reading per K^power]."""
    alike: np.ndarray
    """Combination of the lower powers that is like it inside, from the zeroth on, shape (power,)."""
    weights: np.ndarray
    """What the columns of `effects` make of the temperature that the device acts by, shape (p,): its lags included."""

    def error(self, columns: np.ndarray) -> np.ndarray:
        """Standard error of what the power may do in rows of columns, shape (n, p) [reading]."""
        powers = (columns @ self.weights)[:, None] ** np.arange(self.power + 1)
        return np.asarray((powers[:, -1] - powers[:, :-1] @ self.alike) * self.size)


@dataclass(frozen=True, kw_only=True)
class JointErrors:
    """The best estimate of a model's coefficients, its covariance and the noise, in the unit of the reading.

    Where time constants were searched, the columns are lags of the whole grid, with a prior: what the chosen few leave
    out counts, too. The fit's own error is that of this estimate plus the distance between the two.
    """

    effects: list[Effect]
    history: History
    own: bool
    """Whether these are the model's own effects."""
    coef: np.ndarray
    """Intercept and coefficients by generalised least squares, shape (1 + p,)."""
    half: np.ndarray
    """``half @ half.T`` is their covariance, shape (1 + p, rank)."""
    dof: float
    """Degrees of freedom of the bias's variance."""
    usual: float
    """Mean variance of the bias over the fitted record, the fit's distance from the best estimate left aside."""
    mean: np.ndarray
    """Mean of the columns over the record, 1 first, shape (1 + p,)."""
    noise: NoiseModel
    last: np.ndarray
    """Covariance of the coefficients with each part of the noise at the record's end, shape (1 + p, parts)."""
    end: float
    """Time of the record's end since it began [s]."""
    last_segment: int
    """Number of the fitted segment that ends last: only what follows on it shares its noise."""
    representation: float
    """Variance of what the chosen time constants may leave of the modelled reading."""
    beyond: Beyond | None

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of intercept and coefficients, shape (1 + p, 1 + p)."""
        return np.asarray(self.half @ self.half.T)

    def combined(self, columns: np.ndarray, value: np.ndarray) -> np.ndarray:
        """Standard errors of what the fit says, of linear combinations of the columns, shape (k,).

        Parameters
        ----------
        columns : array of shape (k, p)
            Of `effects`.
        value : array of shape (k,)
            The same by the fit.
        """
        variance = np.sum((columns @ self.half[1:]) ** 2, axis=1) + (columns @ self.coef[1:] - value) ** 2
        return np.asarray(np.sqrt(variance + self.representation))

    def fading(self, seconds: np.ndarray, key: int | None) -> np.ndarray:
        """Correlation of each part of the noise at times after the record with its end, shape (n, parts); 0 inside.

        `key` is the fitted segment that the times belong to: the noise of others, and of new ones, is another one.
        """
        later = np.maximum(seconds - self.end, 0.0)
        if key != self.last_segment or not later.any():
            return np.zeros((len(seconds), len(self.noise.wander)))
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(-later[:, None] / self.noise.correlation_times) * (later > 0)[:, None])


def joint_errors(model: Any, swept: Swept, solution: RidgeSolution) -> JointErrors:
    """Errors of a fitted `DynamicBiasRegressor`, from what its fit has swept together and solved.

    Raises
    ------
    ValueError
        Where the record was not averaged.
    """
    if swept.binned is None:
        raise ValueError(UNKNOWN)
    basis = basis_of(model, swept.binned, swept.reading_offset)
    basis, scaled, sums = _likelier(basis, swept.total())
    found = sums.said()
    residual = solution.residual_sum_of_squares / max(solution.n_rows, 1)
    noise = _noise(basis, scaled, sums, found, residual)
    scale = scaled.unit / scaled.norms
    coef, mean = np.zeros(basis.width), np.zeros(basis.width)
    coef[basis.free] = found.coef * scale
    coef[0] += scaled.mean + basis.offset
    mean[basis.free] = basis.columns.mean(axis=0)
    values, vectors = np.linalg.eigh(found.covariance)
    half, last = np.zeros((basis.width, len(values))), np.zeros((basis.width, len(noise.wander)))
    half[basis.free] = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    last[basis.free] = scale[:, None] * scaled.unit * sums.last_covariance(_end_correlations(basis, scaled, noise))
    last *= scaled.size[np.argmax(basis.begins)]
    inner = (basis.columns / scaled.norms).T @ (basis.columns / scaled.norms) / len(basis.columns)
    inner[0], inner[:, 0] = 0.0, 0.0  # the bias has no intercept
    return JointErrors(
        effects=basis.effects, history=basis.history, own=basis.own, coef=coef, half=half, dof=found.freedom(inner),
        usual=float(np.sum(inner * found.covariance)) * scaled.unit**2,
        mean=mean, noise=noise, last=last, end=float(basis.begins.max()),
        last_segment=int(basis.segment[np.argmax(basis.begins)]),
        representation=TOLERANCE * residual if not basis.searched and model.search_ is not None else 0.0,
        beyond=_beyond(basis, scaled, sums, coef),
    )  # fmt: skip


def _likelier(basis: Basis, factor: TriangularFactor) -> tuple[Basis, ScaledBasis, BandSums]:
    """The basis without its slowest bodies, or with them, where they make the record clearly likelier.

    In a short record they may be the device's; in one that wanders they take the noise upon themselves.
    """
    scaled = ScaledBasis.of(basis)
    groups = [group / scaled.norms**2 for group in basis.groups]
    sums = BandSums(scaled.columns, scaled.reading, scaled.span, groups, _within(factor, basis, scaled))
    if not basis.slow.any():
        return basis, scaled, sums.settle()
    less = sums.without(basis.slow).settle()
    if sums.settle().evidence() > less.evidence() + CLEARLY:
        return basis, scaled, sums
    return basis.without_slow(), scaled.only(~basis.slow), less


@dataclass(frozen=True, kw_only=True)
class ScaledBasis:
    """A basis in columns of unit length and a reading of unit noise, of the same size at all times."""

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
        norms[norms == 0] = 1.0
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

    def only(self, kept: np.ndarray) -> ScaledBasis:
        """Some of the columns, shape (p,): True for those that stay."""
        return replace(self, columns=self.columns[:, kept], norms=self.norms[kept])


def _within(factor: TriangularFactor, basis: Basis, scaled: ScaledBasis) -> Within | None:
    """What rows say beside their bins, from the factor of all rows; None where nobody knows, or a bin is a row."""
    if basis.rows == 1 or basis.searched or len(basis.free) < basis.width:
        return None
    own = basis.in_fit >= 0  # decays that the model leaves out hardly change within a bin
    r = factor.r[:, [*basis.in_fit[own], -1]]
    r[:, -1] -= scaled.mean * r[:, 0]
    whole, columns, y, norms = r.T @ r, basis.columns[:, own], basis.reading - scaled.mean, scaled.norms[own]
    values, vectors = np.linalg.eigh(
        (whole[:-1, :-1] - columns.T @ (basis.count[:, None] * columns)) / norms[:, None] / norms
    )
    half, moments = np.zeros((len(own), len(values))), np.zeros(len(own))
    half[own] = vectors * np.sqrt(np.maximum(values, 0.0))
    moments[own] = (whole[:-1, -1] - columns.T @ (basis.count * y)) / norms / scaled.unit
    return Within(
        columns=half @ half.T,
        moments=moments,
        power=max(float(whole[-1, -1] - basis.count @ y**2), 0.0) / scaled.unit**2,
        freedom=factor.n_rows - len(columns),
    )


def _noise(basis: Basis, scaled: ScaledBasis, sums: BandSums, found: Restricted, residual: float) -> NoiseModel:
    """Noise of single readings; `residual` is the mean square that the fit leaves of them."""
    theta, covariance, rows = found.theta, found.theta_covariance, basis.rows
    white = float(theta[0])
    if rows > 1:
        left = (scaled.reading - scaled.columns @ found.coef) * scaled.size
        between = max(residual / scaled.unit**2 - float(np.mean(left**2)), 0.0) * rows / (rows - 1)
        white = found.within or between or white
    memory = rows * float(theta[0]) / white
    kept = (memory - 1) / (memory + 1) if memory > FORGETS else 0.0
    wander, spread = theta[1:], float(covariance[1:, 1:].sum())
    times, total = basis.bin_seconds() * sums.times, float(wander.sum())
    dof = 2 * total**2 / spread if spread > 0 else np.inf  # as long as the correlation times are right
    if total > 0:
        dof = min(dof, max(PER_MEMORY, PER_MEMORY * float(np.ptp(basis.begins)) * total / float(wander @ times)))
    at: np.ndarray = np.unique(np.linspace(0, len(scaled.size) - 1, SIZES).astype(int))
    at = at[:0] if np.ptp(scaled.size) == 0 else at
    return NoiseModel(
        white=white * scaled.unit**2,
        recent=-basis.bin_seconds() / rows / float(np.log(kept)) if kept > 0 else 0.0,
        wander=wander * scaled.unit**2,
        correlation_times=times,
        white_dof=float(max(len(scaled.reading) - len(scaled.norms), 1)),
        wander_dof=dof,
        size_seconds=basis.begins[at],
        sizes=scaled.size[at],
    )


def _end_correlations(basis: Basis, scaled: ScaledBasis, noise: NoiseModel) -> np.ndarray:
    """Correlation of each bin with the record's end, for each wandering part, shape (bins, parts); 0 in other spans."""
    same = scaled.span == scaled.span[np.argmax(basis.begins)]
    with np.errstate(under="ignore"):
        before = np.exp(-(basis.begins.max() - basis.begins)[:, None] / noise.correlation_times)
    return np.asarray(before * same[:, None])


def _beyond(basis: Basis, scaled: ScaledBasis, sums: BandSums, coef: np.ndarray) -> Beyond | None:
    """The next power of the temperature that the device acts by, as its linear law has it.

    What is curved may lie deep inside, and feel the temperature late. Inside it moves no more than outside: where the
    law says otherwise, as when the sensitivity is next to nothing, the measured temperature is taken.
    """
    first = basis.effects[0]
    if not isinstance(first, StaticPolynomial) or first.degree < 1 or first.lowest_power > 1:
        return None
    power, slope = first.degree + 1, float(coef[1])
    lags = [isinstance(effect, ThermalLag) for effect in basis.effects for _ in effect.names()]
    weights = np.where(lags, coef[1:] / slope, 0.0) if abs(slope) > 0 else np.zeros(len(lags))
    weights[0] = 1.0
    felt = basis.columns @ np.concatenate(([0.0], weights))[basis.free]
    if not np.std(felt) <= MOST_MOVED * np.std(basis.columns[:, 1]):
        weights[1:], felt = 0.0, basis.columns[:, 1]
    lower = felt[:, None] ** np.arange(power)
    column = felt**power
    alike = np.linalg.lstsq(lower, column, rcond=1e-10)[0]
    rest = column - lower @ alike
    if not float(np.linalg.norm(rest)) > 1e-9 * float(np.linalg.norm(column)):
        return None
    known = sums.beside(rest / scaled.size)
    if known is None:
        return None
    size = float(np.hypot(known[0], np.sqrt(known[1]))) * scaled.unit
    return Beyond(power=power, size=size, alike=alike, weights=weights)
