"""How much each candidate explains, beyond a thermal part that is rich enough, in noise made white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import stats

from .blocks import Averages
from .noise import NoiseModel, noise_model

SATURATED = 4
"""Most candidates in the saturated model: with more, hundreds of candidates imitate any slow noise."""
SLOW = 40
"""Rows that are averaged to see whether the noise wanders."""
SLOW_EXCESS = 1.5
"""Variance of these averages over that of white noise, above which the noise wanders (and above every draw)."""
FURTHER_LOOKS = 2.5
"""Factor on the number of tests: the search around the best candidates looks further than their list, and the noise
model is only an estimate. Measured on clean simulated records (`benchmarks/hidden_effects.py --kinds none`)."""
DRAWS = 300
"""Draws of white noise that calibrate the family-wise error probability."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What each candidate explains of the residual of the base, in noise made white."""

    noise: NoiseModel
    segment: np.ndarray
    space: np.ndarray
    """Orthonormal basis of the whitened base, shape (n, p)."""
    reading: np.ndarray
    """Whitened readings, shape (n,)."""
    bases: list[np.ndarray]
    """Orthonormal basis of each candidate's whitened columns, base taken out: shape (n, k)."""
    tests: float
    """Effective number of independent tests in the family."""

    @cached_property
    def residual(self) -> np.ndarray:
        """Whitened residual of the base, shape (n,)."""
        rest: np.ndarray = self.reading - self.space @ (self.space.T @ self.reading)
        return rest

    @property
    def freedom(self) -> int:
        """Rows less columns of the base."""
        return len(self.space) - int(self.space.shape[1])

    def basis(self, columns: np.ndarray) -> np.ndarray:
        """Orthonormal basis of a candidate's columns, whitened, base taken out."""
        whitened = self.noise.whitened(columns, self.segment)
        return own_part(whitened, self.space)

    def gain(self, basis: np.ndarray) -> float:
        """Share of the residual sum of squares that a candidate explains."""
        residual = self.residual
        return float(np.sum((basis.T @ residual) ** 2) / (residual @ residual))

    def score(self, basis: np.ndarray) -> float:
        """Log likelihood above the base's, less half of BIC's penalty for each column."""
        n = len(self.space)
        explained = float(np.log1p(-min(self.gain(basis), 1 - 1e-15)))
        return -0.5 * n * explained - 0.5 * int(basis.shape[1]) * float(np.log(n))

    def family_p(self, basis: np.ndarray) -> float:
        """Error probability of a candidate, the whole family having been tried (Sidak, effective number of tests)."""
        log_p = float(log_p_of(np.array([self.gain(basis)]), np.array([basis.shape[1]]), self.freedom)[0])
        return float(-np.expm1(self.tests * np.log1p(-min(np.exp(log_p), 1 - 1e-16))))

    def wanders(self, rng: np.random.Generator) -> bool:
        """Whether averages over `SLOW` rows vary more than white noise's would: structure too weak for each row.

        The share of the residual's sum of squares that is in these averages, against draws of white noise from which
        the same columns have been taken out.
        """
        draws = rng.normal(size=(len(self.space), DRAWS))
        draws -= self.space @ (self.space.T @ draws)
        usual = _slow_share(draws)
        found = float(_slow_share(self.residual[:, None])[0])
        return found > SLOW_EXCESS * float(np.median(usual)) and found > float(usual.max())

    def alike(self, one: np.ndarray, other: np.ndarray) -> float:
        """Squared cosine of what two candidates explain."""
        residual = self.residual
        a, b = (basis @ (basis.T @ residual) for basis in (one, other))
        return float((a @ b) ** 2 / max((a @ a) * (b @ b), 1e-300))

    def held_out_gain(self, basis: np.ndarray, n_blocks: int = 5) -> float:
        """Sum of squares of blocks of time over that with the candidate, its coefficients from other blocks [dB].

        The base's part is taken out beforehand: only what the candidate adds is put to the test.
        """
        residual, moment = self.residual, basis.T @ self.residual
        edges = np.linspace(0, len(basis), n_blocks + 1).astype(int)
        left = 0.0
        for low, high in pairwise(edges):
            rows, values = basis[low:high], residual[low:high]
            learned = np.eye(basis.shape[1]) - rows.T @ rows
            coef = np.linalg.lstsq(learned, moment - rows.T @ values, rcond=1e-3)[0]
            left += float(np.sum((values - rows @ coef) ** 2))
        return float(10 * np.log10(residual @ residual / left))


def _slow_share(residuals: np.ndarray) -> np.ndarray:
    """Share of each column's sum of squares that is left in averages over `SLOW` rows."""
    n = len(residuals) // SLOW * SLOW
    means = residuals[:n].reshape(n // SLOW, SLOW, -1).mean(axis=1)
    return np.asarray(SLOW * np.sum(means**2, axis=0) / np.maximum(np.sum(residuals[:n] ** 2, axis=0), 1e-300))


def own_part(columns: np.ndarray, space: np.ndarray) -> np.ndarray:
    """Orthonormal basis of what columns have outside a space; those that lie in it are dropped."""
    return own_parts([columns], space)[0]


def own_parts(blocks: Sequence[np.ndarray], space: np.ndarray) -> list[np.ndarray]:
    """Orthonormal bases of what many blocks of columns have outside a space: `own_part` of each."""
    if not len(blocks):
        return []
    columns = np.column_stack(blocks)
    norms = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    columns -= space @ (space.T @ columns)
    left = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    edges = np.cumsum([0, *(block.shape[1] for block in blocks)])
    return [
        orthonormal(columns[:, low:high][:, left[low:high] > 1e-4 * norms[low:high]]) for low, high in pairwise(edges)
    ]


def orthonormal(columns: np.ndarray, tolerance: float = 1e-5) -> np.ndarray:
    """Orthonormal basis of columns of very different size; directions below the tolerance are dropped."""
    norms = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    alive = norms > 0
    if not alive.any():
        return np.zeros((len(columns), 0))
    unit: np.ndarray = columns[:, alive] / norms[alive]
    if unit.shape[1] == 1:
        return unit
    left, singular, _ = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(left[:, singular > tolerance * singular[0]])


def evidence(data: Averages, base: np.ndarray, candidates: Sequence[np.ndarray], rng: np.random.Generator) -> Evidence:
    """Noise model from a saturated fit; gains of all candidates on data whitened by it."""
    noise = noise_model(saturated_residual(data, base, candidates), data.segment)
    whitened = noise.whitened(np.column_stack((data.reading, base)), data.segment)
    space = orthonormal(whitened[:, 1:])
    bases = own_parts([noise.whitened(columns, data.segment) for columns in candidates], space)
    freedom = len(space) - space.shape[1]
    return Evidence(
        noise=noise,
        segment=data.segment,
        space=space,
        reading=whitened[:, 0],
        bases=bases,
        tests=_effective_tests(bases, space, freedom, rng),
    )


def saturated_residual(data: Averages, base: np.ndarray, candidates: Sequence[np.ndarray]) -> np.ndarray:
    """Residual of the base and of the few candidates, one after the other, that explain most."""
    space = orthonormal(base)
    residual: np.ndarray = data.reading - space @ (space.T @ data.reading)
    bases = own_parts(candidates, space)
    n = len(residual)
    for _ in range(SATURATED):
        sizes = np.array([basis.shape[1] for basis in bases])
        gains = np.array([np.sum((basis.T @ residual) ** 2) for basis in bases]) / (residual @ residual)
        scores = -0.5 * n * np.log1p(-np.minimum(gains, 1 - 1e-12)) - 0.5 * sizes * np.log(n) - np.log(len(bases))
        best = bases[int(np.argmax(scores))]
        if scores.max() <= 0 or best.shape[1] == 0:
            break
        residual = residual - best @ (best.T @ residual)
        bases = own_parts(bases, best)
    return residual


def log_p_of(gains: np.ndarray, sizes: np.ndarray, freedom: int) -> np.ndarray:
    """Log of the error probability of gains of spaces of given sizes, each alone: F test."""
    left = freedom - sizes
    ratio = np.where(sizes > 0, gains / np.maximum(sizes, 1) / (np.maximum(1 - gains, 1e-12) / left), 0.0)
    return np.where(sizes > 0, stats.f.logsf(ratio, np.maximum(sizes, 1), left), 0.0)


def _effective_tests(bases: Sequence[np.ndarray], space: np.ndarray, freedom: int, rng: np.random.Generator) -> float:
    """Number of independent tests whose smallest p would be distributed as the family's, by draws of white noise."""
    draws = rng.normal(size=(len(space), DRAWS))
    draws -= space @ (space.T @ draws)
    totals = np.sum(draws**2, axis=0)
    sizes = np.array([basis.shape[1] for basis in bases if basis.shape[1]])
    if not len(sizes):
        return 1.0
    squares = (np.column_stack([basis for basis in bases if basis.shape[1]]).T @ draws) ** 2 / totals
    gains = np.add.reduceat(squares, np.cumsum([0, *sizes[:-1]]), axis=0)
    log_p = log_p_of(gains.T, sizes, freedom)
    levels = np.array((0.1, 0.2, 0.5))
    typical = np.exp(np.quantile(log_p.min(axis=1), levels))
    return FURTHER_LOOKS * float(np.max(np.log1p(-levels) / np.log1p(-typical)))
