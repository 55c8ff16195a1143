"""`JointErrors`: what a record says of the coefficients of a model fitted to it, and of its own noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...effects.protocol import Effect
from ...records import History
from .beyond import Beyond
from .noise_model import NoiseModel, dof_of_average

UNKNOWN = (
    "This model does not know the noise of the record it was fitted to: it was read from an old file, or fitted on "
    "several processes, with a fleet as its prior, or to readings that count differently. Fit it again with "
    "DynamicBiasRegressor.fit, to a record of its own, to have uncertainties."
)


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

    def averaged(self, other: JointErrors, share: float, bias_form: np.ndarray) -> JointErrors:
        """Mean and variance over two, this one with a share of 0 to 1: what lies between them is an error, too.

        Coefficients that the other leaves out are zero there; `bias_form` are the mean products of the columns of the
        bias, shape (1 + p, 1 + p).
        """
        apart = np.sqrt(share * (1 - share)) * (self.coef - other.coef)
        covariance = share * self.covariance + (1 - share) * other.covariance + np.outer(apart, apart)
        values, vectors = np.linalg.eigh(covariance)
        kept = values > 0
        return replace(
            self,
            coef=share * self.coef + (1 - share) * other.coef,
            half=np.ascontiguousarray(vectors[:, kept] * np.sqrt(values[kept])),
            dof=dof_of_average((self.usual, other.usual), (self.dof, other.dof), share),
            usual=float(np.sum(bias_form * covariance)),
            noise=self.noise.averaged(other.noise, share),
            last=share * self.last + (1 - share) * other.last,
            beyond=(self if share > 0.5 else other).beyond,
        )
