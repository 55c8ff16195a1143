"""Evenness of noise, and the readings that a model learns from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ..records import read_record
from ..records.numbers import as_data, numeric_reading
from ..records.screen import error_of, screened

NEARBY = 100
"""Rows over which the size of the noise is measured where it changes with time: known to 7 %."""
CLOSE = 25
"""Rows over which a burst of noise is measured: known to 14 %."""
BURST = 4.0
"""Size of the noise in `CLOSE` rows over its usual size, above which they are a burst and weighted by it: in a million
rows normal noise reaches 2.0, Laplace's 2.5, Student's t with three degrees of freedom 3.2, one quantised to three
standard deviations 3.1. Glitches in one reading of a hundred reach 4.7: fifty rows in a million count less, then."""
LARGEST = 4.0
"""Times the mean step, in the record or close by, beyond which a step is no noise."""


def evenness(residual: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Usual noise over the noise near each row.

    The size is that of the steps between neighbouring rows, of which the largest count less: a quantised reading moves
    in few of them, and a spike is no noise. A burst, in which many steps are large, counts in full.
    """
    steps = np.abs(np.diff(residual))[np.diff(segment) == 0]
    jump = np.abs(np.diff(residual, prepend=np.nan))
    jump[np.diff(segment, prepend=segment[0]) != 0] = np.nan
    if len(steps) < 10 * NEARBY or not steps.any():
        return np.ones(len(residual))
    usual_step = np.mean(steps)
    first = np.minimum(jump, LARGEST * usual_step)
    size = np.sqrt(_nearby(first**2))
    low, usual, high = np.quantile(size, (0.05, 0.5, 0.95))
    if usual == 0:
        return np.ones(len(residual))
    whole = np.minimum(jump, LARGEST * np.maximum(_nearby(first, CLOSE), usual_step))
    close = pd.Series(_nearby(whole**2, CLOSE)).rolling(CLOSE, center=True, min_periods=1).max()  # up to its edges
    bursts = np.sqrt(np.maximum(_nearby(whole**2), close.to_numpy()))
    loud = bursts > BURST * usual
    # Rows are weighted by their noise where it changes by more than a factor of two (95 % over 5 %).
    if not (high > 2.0 * low or loud.any()):
        return np.ones(len(residual))
    # No weight exceeds 10: where a quantised reading rests, its noise is not known to be smaller.
    return np.asarray(1 / np.maximum(np.where(loud, bursts, size) / usual, 1 / 10.0))


def _nearby(values: np.ndarray, rows: int = NEARBY) -> np.ndarray:
    """Mean of the values near each row."""
    rolling = pd.Series(values).rolling(rows, center=True, min_periods=rows // 4)
    return np.asarray(rolling.mean().bfill().ffill().to_numpy())


def accepted_readings(model: Any, X: Any, y: Any) -> np.ndarray:
    """The readings as a model would learn them.

    `model` (DynamicBiasRegressor): Fitted or not; with ``screen=False`` all readings are accepted. `X`, `y` (as for
    `DynamicBiasRegressor.fit`). Returns array of shape (n_rows,): NaN where there is none, or a refused one.
    """
    features = model._unfitted_features(())
    error = np.array(error_of(y, as_data(X), model.reference), float)
    reading = np.where(np.isnan(error), np.nan, np.asarray(numeric_reading(y, X), float))
    if model.screen:
        record = read_record(X, replace(features.layout(), reference=None), y=error, quiet=True)
        for refused in screened(record, features.longest_step())[0].refused:
            if refused.what == "reading":
                reading[refused.rows] = np.nan
    return reading
