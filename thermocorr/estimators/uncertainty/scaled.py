"""A basis in columns and readings of about unit size, for the search of its noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...equations import TriangularFactor
from ...equations.noise import spans
from ..evenness import evenness
from .basis import Basis
from .restricted import Within


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


def within_bins(factor: TriangularFactor, basis: Basis, scaled: ScaledBasis) -> Within | None:
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
