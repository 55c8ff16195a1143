"""Uncertainties of a fitted model, and its refusals."""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ..records import Record, RecordError
from ..records.errors import warn
from ..records.numbers import quantity_texts, span_texts
from .budget import PARTS, Uncertainty
from .prediction import FittedModel
from .progress import one_blas_thread
from .reading import no_flags
from .runs import level_variance
from .tables import VERDICTS
from .uncertainty import UNKNOWN, ErrorWalk, JointErrors, Reference, Sensor, joint_errors, sensor_variance

OTHER = 2.0
"""Ratio of residuals beyond which a diagnosis cannot be of this model."""
MEMORIES = 5.0
"""Correlation times of its noise that a record must last for the size of that noise to be known."""
WANDERS = 0.05
"""Wandering share of the residual variance at which, without a diagnosis, a model counts as incomplete."""

HIDDEN_DRIFT = (
    "the model can mimic a drift on the fitted record, so a forecast may be wrong (diagnosis.left has the size of the "
    "drift). Record longer, through the same temperatures again."
)
GOES_ON = (
    "the model's start-up decay may as well be something that continues (diagnosis.left.start_or), so a forecast "
    "may be wrong. Record longer."
)


def uncertainty_of(
    model: Any,
    joint: JointErrors,
    record: Record,
    index: Any,
    *,
    sensor: Sensor,
    reference: Reference,
    coverage: float,
    why_provisional: str,
    allow_missing: bool,
) -> Uncertainty:
    """Walk once through a record that was read with its readings.

    Where the model is incomplete, what is missing may go with the temperature: then the model has taken as much of it
    as it has left in the residuals, and its coefficients are wrong by as much again as wandering makes them by chance.
    That is "structure".
    """
    n = record.n_rows
    corrected, bias = (np.full(n, np.nan) for _ in range(2))
    variances = {part: np.full(n, np.nan) for part in PARTS}
    inputs, status = np.zeros(n), no_flags(record)
    noise = joint.noise
    doubt = 1.0 if why_provisional else 0.0
    for block, parts, value, errors in ErrorWalk(model, joint, removed=True).blocks(record):
        rows = block.rows
        if record.reading is None:
            raise RecordError("There are no readings. Pass y, the readings of the rows of X.")
        given = np.asarray(record.reading[rows], float)
        flags = model._block_flags(block, given, parts)
        measured = np.where(model._in_washout(block), np.nan, model._screened(block, given))
        corrected[rows], bias[rows] = measured - value, value
        lost = np.where(np.isfinite(measured), 0.0, np.nan)
        wander, bias_variance = noise.wander_variance * errors.noise, errors.level + errors.coefficients
        each = {
            "noise": noise.white * errors.noise, "wander": wander, "level": errors.level,
            "coefficients": errors.coefficients,
            "structure": doubt * (wander + bias_variance), "reference": reference.uncertainty**2,
        }  # fmt: skip
        for part, variance in each.items():
            variances[part][rows] = variance + lost
        inputs[rows] = record.input_variance(rows)
        fine = "provisional" if why_provisional else "signed"
        flags[flags.are("")] = fine
        status[rows] = flags
    fixed, own = sensor_variance(model, record, sensor)
    variances["sensor"] = fixed + own + inputs + 0.0 * variances["noise"]
    return Uncertainty(
        model=model, joint=joint, record=record, index=index, corrected=corrected, bias=bias, variances=variances,
        sensor_own=own, status=status.texts(), sensor=sensor, reference=reference, coverage=coverage,
        why_provisional=why_provisional, allow_missing=allow_missing,
    )  # fmt: skip


def why_incomplete(model: Any, joint: JointErrors, diagnosis: Any) -> str:
    """Reason against signing corrected readings, or ""."""
    if diagnosis is not None:
        verdict = _verdict_on(model, diagnosis)
        if not VERDICTS[verdict].calm:
            return f"the diagnosis says {verdict!r}."
        if diagnosis.left.drift_hides:
            return HIDDEN_DRIFT
        return GOES_ON if diagnosis.left.start_or else ""
    share = joint.noise.wander_variance / joint.noise.variance if joint.noise.variance > 0 else 0.0
    if share <= WANDERS:
        return ""
    return (
        f"{100 * share:.0f} % of the residual variance wanders, which may be a missing effect "
        "(check: pass diagnosis=diagnose(model, X, y))."
    )


def too_short(joint: JointErrors) -> str:
    """Sentence on a record too short for its noise, or ""."""
    noise = joint.noise
    if noise.wander_variance <= WANDERS * noise.variance or MEMORIES * noise.memory <= joint.end:
        return ""
    memory, end, needed = span_texts((noise.memory, joint.end, MEMORIES * noise.memory))
    return (
        f"The noise remembers for about {memory}, and the fitted record lasts {end}: what wanders so slowly has hardly "
        f"been seen, and uncertainties may be too small. Record for at least {needed}."
    )


def _verdict_on(model: Any, diagnosis: Any) -> str:
    """Verdict of a diagnosis of this model, or ValueError."""
    if not (hasattr(diagnosis, "verdict") and hasattr(diagnosis, "residual_rms")):
        raise ValueError(
            f"The 'diagnosis' parameter must be what diagnose(model, X, y) returns. Got {diagnosis!r:.60} instead."
        )
    found, own = float(diagnosis.residual_rms), model.residual_std_
    if not own / OTHER <= found <= own * OTHER and max(found, own) > 0:
        residual, left = quantity_texts((found, own), model.reading_.unit)
        raise ValueError(
            f"The diagnosis is of another model: it found a residual of {residual}, and this model has "
            f"one of {left}. Pass diagnose(model, X, y) of the same model."
        )
    return str(diagnosis.verdict)


class SignedModel(FittedModel):
    """Uncertainties of a fitted model."""

    if TYPE_CHECKING:

        def predict(self, X: Any, return_std: bool = False) -> Any:
            """Modelled reading, of `DynamicBiasRegressor`."""

    @property
    def _knows_noise(self) -> bool:
        """True if the model knows its uncertainties."""
        return hasattr(self, "_known_errors") or getattr(getattr(self, "_swept", None), "binned", None) is not None

    def _joint_errors(self) -> JointErrors:
        """Coefficients with covariance, and the noise; made once."""
        check_is_fitted(self, "pipeline_")
        if not hasattr(self, "_known_errors"):
            if not self._knows_noise:
                raise ValueError(UNKNOWN)
            with one_blas_thread():
                self._known_errors = joint_errors(self, self._swept, self._solution)
        return self._known_errors

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
        joint = self._joint_errors()
        if doubt := too_short(joint):
            warn(doubt)
        record, _, _ = self._resumed_with_gaps(X, y)
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
        """Bias, corrected or new reading, and its uncertainty."""
        joint = self._joint_errors()
        record, _, _ = self._resumed_with_gaps(X)
        values, result = np.full(record.n_rows, np.nan), np.full(record.n_rows, np.nan)
        walk = ErrorWalk(self, joint, removed=of != "reading")
        runs = {segment.run for segment in self.features_.history_.record.segments}
        of_levels = level_variance(self) if of == "reading" else 0.0
        for block, _, value, errors in walk.blocks(record):
            variance = errors.bias if of == "bias" else errors.of_readings(joint.noise)
            variance[self._in_washout(block)] = np.nan
            if record.segments[block.segment].run not in runs:  # its level is not known
                variance += of_levels
            if reading is not None:
                value = self._screened(block, reading[block.rows]) - value
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
