"""`joint_errors`, from a fitted record: bodies that may be there unseen, the noise, what lies beyond temperatures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import expit

from ...equations import RidgeSolution
from ..fitting import Swept
from ..time_constants.spectrum import TOLERANCE
from .basis import Basis, basis_of
from .beyond import beyond_of
from .joint import UNKNOWN, JointErrors
from .noise_model import NoiseModel
from .restricted import BandSums, Restricted
from .scaled import ScaledBasis, within_bins

FORGETS = 1.2
"""Variance of a bin's mean over that of white noise, from which the noise within bins is taken to remember."""
PER_MEMORY = 2.0
"""Degrees of freedom that a correlation time adds to a wandering variance: a sum of squares alone would give 1, a known
shape of the spectrum more. Corrected readings in a random walk are covered in 100, 99, 96 % with 1, 2, 4 (time
constants given) and 100, 98, 95 % (searched): `python benchmarks/interval_coverage.py --first 600 --seeds 24`."""
NEGLIGIBLE = 0.05
"""Share of an average below which the basis with bodies slower than a twelfth of the record, or the one without, is
left out: a ratio of evidences of e^3, "strong" (Kass & Raftery, J. Am. Stat. Assoc. 90, 1995). Its logarithm is -2.9 to
0.8 in random walks of 5000 rows, and 24 to 84 in 1200 rows of white noise and a device that has such a body."""
SIZES = 200
"""Moments at which the size of a noise that changes with time is kept."""


def joint_errors(model: Any, swept: Swept, solution: RidgeSolution) -> JointErrors:
    """Errors of a fitted `DynamicBiasRegressor`, from what its fit has swept together and solved.

    The slowest bodies may be the device's in a short record; in one that wanders they would take the noise upon
    themselves. Bases with them and without are averaged, each by how likely it makes the record.

    Raises
    ------
    ValueError
        Where the record was not averaged.
    """
    if swept.binned is None:
        raise ValueError(UNKNOWN)
    basis = basis_of(model, swept.binned, swept.reading_offset)
    scaled = ScaledBasis.of(basis)
    groups = [group / scaled.norms**2 for group in basis.groups]
    within = within_bins(swept.total(), basis, scaled)
    sums = BandSums(scaled.columns, scaled.reading, scaled.span, groups, within).settle()
    residual = solution.residual_sum_of_squares / max(solution.n_rows, 1)
    tolerated = TOLERANCE * residual if not basis.searched and model.search_ is not None else 0.0
    every = Way(basis, scaled, sums, residual, tolerated)
    if not basis.slow.any():
        return every.errors()
    fewer = every.without_slow()
    share = float(expit(sums.evidence() - fewer.sums.evidence()))
    if not NEGLIGIBLE <= share <= 1 - NEGLIGIBLE:
        return (every if share > 0.5 else fewer).errors()
    return every.errors().averaged(fewer.errors(), share, every.bias_form())


@dataclass(frozen=True)
class Way:
    """One way to account for a record: a basis, and what the record says beside it once its noise has settled."""

    basis: Basis
    scaled: ScaledBasis
    sums: BandSums
    residual: float
    """Mean square that the fit leaves of single readings."""
    tolerated: float
    """Variance of what the chosen time constants may leave of the modelled reading."""

    def without_slow(self) -> Way:
        """The way without bodies that are slower than what is told from noise."""
        slow = self.basis.slow
        sums = self.sums.without(slow).settle()
        return Way(self.basis.without_slow(), self.scaled.only(~slow), sums, self.residual, self.tolerated)

    def bias_form(self) -> np.ndarray:
        """Mean products of the columns, shape (1 + p, 1 + p): with a covariance of the coefficients, of the bias."""
        basis, form = self.basis, np.zeros((self.basis.width, self.basis.width))
        form[np.ix_(basis.free, basis.free)] = basis.columns.T @ basis.columns / len(basis.columns)
        form[0], form[:, 0] = 0.0, 0.0  # the bias has no intercept
        return form

    def errors(self) -> JointErrors:
        """Errors under an average of models of the noise."""
        basis, scaled, sums = self.basis, self.scaled, self.sums
        found = sums.said()
        noise = _noise(basis, scaled, sums, found, self.residual)
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
        form = self.bias_form()
        return JointErrors(
            effects=basis.effects, history=basis.history, own=basis.own, coef=coef, half=half,
            dof=found.freedom(form[np.ix_(basis.free, basis.free)] * scale[:, None] * scale),
            usual=float(np.sum((form @ half) * half)), mean=mean, noise=noise, last=last,
            end=float(basis.begins.max()), last_segment=int(basis.segment[np.argmax(basis.begins)]),
            representation=self.tolerated, beyond=beyond_of(basis, scaled, sums, coef),
        )  # fmt: skip


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
