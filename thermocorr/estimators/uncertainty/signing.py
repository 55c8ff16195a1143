"""The part of `DynamicBiasRegressor` that says what its numbers are worth."""

from __future__ import annotations

from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ...records.errors import warn
from ..fitted import FittedModel
from ..progress import one_blas_thread
from ..run_levels import level_variance
from .assessed import too_short, uncertainty_of, why_incomplete
from .declared import Reference, Sensor
from .joint import UNKNOWN, JointErrors, joint_errors
from .rows import ErrorWalk
from .signed import Uncertainty


class SignedModel(FittedModel):
    """Uncertainties of a fitted model."""

    if TYPE_CHECKING:

        def predict(self, X: Any, return_std: bool = False) -> Any:
            """Modelled reading, of `DynamicBiasRegressor`."""

    @property
    def knows_noise(self) -> bool:
        """Whether the model can tell uncertainties: not if it was fitted on several processes or beside a fleet."""
        return hasattr(self, "joint_errors_") or getattr(getattr(self, "_swept", None), "binned", None) is not None

    def slim(self, history_rows: int = 100) -> Any:
        """Forget the fitted record but for so many rows: small to send and to keep, as a model read from a file.

        Later rows are corrected as ever, uncertainties and standard errors included; rows that repeat the fitted record
        find their states from the rows that are kept. Errors of further combinations need the record.
        """
        if history_rows < 1:
            raise ValueError(f"The 'history_rows' parameter must be at least 1. Got {history_rows!r} instead.")
        self.standard_errors()
        if self.knows_noise:
            errors = self.joint_errors()
            self.joint_errors_ = replace(errors, history=errors.history.thinned(history_rows))
        features = self.features_
        features.history_ = features.history_.thinned(history_rows)
        if hasattr(self, "_swept"):
            self.law_ = self.law()
            del self._swept
        return self

    def joint_errors(self) -> JointErrors:
        """Best estimate and covariance of the coefficients, and the noise of the fitted record; kept once made."""
        check_is_fitted(self, "pipeline_")
        if not hasattr(self, "joint_errors_"):
            if not self.knows_noise:
                raise ValueError(UNKNOWN)
            with one_blas_thread():
                self.joint_errors_ = joint_errors(self, self._swept, self._solution)
        return self.joint_errors_

    def uncertainty(
        self,
        X: Any,
        y: Any,
        *,
        sensor: Sensor | None = None,
        reference: float | None = None,
        reference_dof: float = np.inf,
        coverage: float = 0.95,
        diagnosis: Any = None,
        allow_missing: bool = False,
    ) -> Uncertainty:
        """Corrected readings with their uncertainties, after the GUM.

        Parameters
        ----------
        X, y : as for `fit`
            Any record: the fitted one, its continuation, or another of the same device.
        sensor : Sensor, optional
            What is known of the thermometer (type B); nothing by default, and listed as not declared.
        reference : float, optional
            Standard uncertainty of what the level of the readings was set with, in the unit of y (type B).
        reference_dof : float, default inf
            Its degrees of freedom.
        coverage : float, default 0.95
            Of the intervals.
        diagnosis : Diagnosis, optional
            Of this model: readings are signed where it says "nothing missing". Without it they are signed where what
            wanders in the residuals is at most a twentieth of their variance.
        allow_missing : bool, default False
            Whether what is provisional may be exported all the same.

        Returns
        -------
        Uncertainty

        Raises
        ------
        ValueError
            For a model that does not know the noise of its record, or parameters out of range.

        Warns
        -----
        RecordWarning
            For a record shorter than five correlation times of its noise, with the length that is needed.

        Examples
        --------
        >>> from thermocorr import DynamicBiasRegressor
        >>> from thermocorr.datasets import make_record
        >>> record = make_record(4000, seed=1)
        >>> X, y = record[["temperature"]], record["reading"].rename("reading [ppm]")
        >>> signed = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y).uncertainty(X, y)
        >>> list(signed.frame().columns[:7]), signed.frame()["status"].iloc[-1]
        (['corrected', 'u', 'dof', 'k', 'U', 'low', 'high'], 'signed')
        """
        if not isinstance(sensor, Sensor | None):
            raise ValueError(
                f"The 'sensor' parameter must be a Sensor, such as Sensor(noise=0.01). Got {sensor!r:.60}."
            )
        if y is None:
            raise ValueError("The readings are missing: y is None. Pass the readings of the rows of X.")
        _check_share("coverage", coverage)
        _check_not_negative("reference", 0.0 if reference is None else reference)
        _check_not_negative("reference_dof", reference_dof, strictly=True)
        joint = self.joint_errors()
        if doubt := too_short(joint):
            warn(doubt)
        record, _, _ = self.judged(X, y)
        return uncertainty_of(
            self,
            joint,
            record,
            X.index if isinstance(X, pd.DataFrame) else None,
            sensor=Sensor() if sensor is None else sensor,
            reference=Reference(
                uncertainty=float(reference or 0.0), dof=float(reference_dof), declared=reference is not None
            ),
            coverage=float(coverage),
            why_provisional=why_incomplete(self, joint, diagnosis),
            allow_missing=allow_missing,
        )

    def _uncertain(self, X: Any, of: str, reading: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The "bias", the "corrected" reading or a "reading" to come, and its standard uncertainty, (n_rows,) each."""
        joint = self.joint_errors()
        record, _, _ = self.judged(X)
        values, result = np.full(record.n_rows, np.nan), np.full(record.n_rows, np.nan)
        walk = ErrorWalk(self, joint, removed=of != "reading")
        runs = {segment.run for segment in self.features_.history_.record.segments}
        of_levels = level_variance(self) if of == "reading" else 0.0
        for block, value, errors in walk.blocks(record):
            variance = errors.bias if of == "bias" else errors.of_readings(joint.noise)
            variance[self.block_flags(block, None).are("washout")] = np.nan
            if record.segments[block.segment].run not in runs:  # its level is not known
                variance += of_levels
            if reading is not None:
                value = self.believed(block, reading[block.rows]) - value
                variance[np.isnan(value)] = np.nan
            values[block.rows] = value
            result[block.rows] = np.sqrt(variance + block.record.input_variance(block.rows))
        return values, result


def _check_share(name: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, Real) or not 0 < float(value) < 1:
        raise ValueError(
            f"The {name!r} parameter must be a share between 0 and 1, such as 0.95. Got {value!r} instead."
        )


def _check_not_negative(name: str, value: Any, strictly: bool = False) -> None:
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not number or not (float(value) > 0 if strictly else 0 <= float(value) < np.inf):
        least = "above zero" if strictly else "zero or above"
        raise ValueError(f"The {name!r} parameter must be a number, {least}. Got {value!r} instead.")
