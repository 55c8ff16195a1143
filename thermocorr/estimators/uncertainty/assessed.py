"""A record walked through with everything that makes its corrected readings uncertain."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...records import Record, RecordError
from ...records.numbers import quantity_texts, span_texts
from ..reading import no_flags
from ..tables import VERDICTS
from .declared import Reference, Sensor
from .joint import JointErrors
from .rows import ErrorWalk, sensor_variance
from .signed import PARTS, Uncertainty

OTHER = 2.0
"""Ratio of residuals beyond which a diagnosis cannot be of this model."""
MEMORIES = 5.0
"""Correlation times of its noise that a record must last for the size of that noise to be known."""
WANDERS = 0.05
"""Wandering share of the residual variance from which, without a diagnosis, a model counts as incomplete."""
EXTRAPOLATED = 0.1
"""Share of the variance of a corrected reading from which it is outside the fitted range, though the measured
temperature is inside: a part of the device is not."""

HIDDEN_DRIFT = (
    "in the fitted record a drift passes for what the model has, and a forecast goes wrong by it (diagnosis.left says "
    "how large a drift). Record on, through the same temperatures again."
)
GOES_ON = (
    "what the model takes for the start of the fitted record is as likely something that goes on "
    "(diagnosis.left.start_or), and a forecast goes wrong by it. Record on."
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
    corrected, bias, shared = (np.full(n, np.nan) for _ in range(3))
    variances = {part: np.full(n, np.nan) for part in PARTS}
    inputs, status = np.zeros(n), no_flags(record)
    noise = joint.noise
    doubt = 1.0 if why_provisional else 0.0
    for block, value, errors in ErrorWalk(model, joint, removed=True).blocks(record):
        rows = block.rows
        if record.reading is None:
            raise RecordError("There are no readings. Pass y, the readings of the rows of X.")
        given = np.asarray(record.reading[rows], float)
        flags = model.block_flags(block, given)
        measured = np.where(flags.are("washout"), np.nan, model.believed(block, given))
        corrected[rows], bias[rows] = measured - value, value
        lost = np.where(np.isfinite(measured), 0.0, np.nan)
        wander, bias_variance = noise.wander_variance * errors.noise, errors.level + errors.coefficients
        each = {
            "noise": noise.white * errors.noise, "wander": wander, "level": errors.level,
            "coefficients": errors.coefficients, "extrapolation": errors.extrapolation,
            "structure": doubt * (wander + bias_variance), "reference": reference.uncertainty**2,
        }  # fmt: skip
        for part, variance in each.items():
            variances[part][rows] = variance + lost
        inputs[rows] = record.input_variance(rows)
        shared[rows] = errors.shared + lost
        fine = "provisional" if why_provisional else "signed"
        outside = errors.extrapolation > EXTRAPOLATED * errors.of_readings(noise)
        flags[flags.are("") & outside] = "outside fitted range"
        flags[flags.are("")] = fine
        status[rows] = flags
    fixed, own = sensor_variance(model, record, sensor)
    variances["sensor"] = fixed + own + inputs + 0.0 * variances["noise"]
    return Uncertainty(
        model=model, joint=joint, record=record, index=index, corrected=corrected, bias=bias, variances=variances,
        shared=shared, sensor_own=own, status=status.texts(), sensor=sensor, reference=reference, coverage=coverage,
        why_provisional=why_provisional, allow_missing=allow_missing,
    )  # fmt: skip


def why_incomplete(model: Any, joint: JointErrors, diagnosis: Any) -> str:
    """What keeps corrected readings from being signed; "" where nothing does."""
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
        f"{100 * share:.0f} % of the residual variance wanders, which a missing effect may do "
        "(diagnosis=diagnose(model, X, y) looks for it)."
    )


def too_short(joint: JointErrors) -> str:
    """A sentence on a record that is too short for its noise; "" where it is not."""
    noise = joint.noise
    if noise.wander_variance <= WANDERS * noise.variance or MEMORIES * noise.memory <= joint.end:
        return ""
    memory, end, needed = span_texts((noise.memory, joint.end, MEMORIES * noise.memory))
    return (
        f"The noise remembers for about {memory}, and the fitted record lasts {end}: what wanders so slowly has hardly "
        f"been seen, and uncertainties may be too small. Record for at least {needed}."
    )


def _verdict_on(model: Any, diagnosis: Any) -> str:
    """What a diagnosis says of a model; ValueError for something else, and for one of another model."""
    if not (hasattr(diagnosis, "verdict") and hasattr(diagnosis, "residual_rms")):
        raise ValueError(
            f"The 'diagnosis' parameter must be what diagnose(model, X, y) returns. Got {diagnosis!r:.60} instead."
        )
    found, own = float(diagnosis.residual_rms), model.residual_std_
    if not own / OTHER <= found <= own * OTHER and max(found, own) > 0:
        residual, left = quantity_texts((found, own), model.reading_.unit)
        raise ValueError(
            f"The diagnosis is of another model: it found a residual of {residual}, and this model left {left} of "
            "its record. Pass diagnose(model, X, y) of the same model."
        )
    return str(diagnosis.verdict)
