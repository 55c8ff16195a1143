"""Readings without those that the screen of a fit would refuse, for figures about a record as a whole."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..records import read_record
from ..records.numbers import numeric_reading
from ..records.screen import screened


def believed_readings(model: Any, X: Any, y: Any) -> np.ndarray:
    """The readings as a model with these settings would learn them from the whole record.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted or not; with ``screen=False`` all readings are believed.
    X, y : as for `DynamicBiasRegressor.fit`

    Returns
    -------
    array of shape (n_rows,)
        NaN where there is none, or a refused one.
    """
    reading = np.array(numeric_reading(y, X), float)
    if model.screen:
        features = model.unfitted_features(())
        record = read_record(X, features.layout(), y=reading, quiet=True)
        for refused in screened(record, features.longest_step())[0].refused:
            if refused.what == "reading":
                reading[refused.rows] = np.nan
    return reading
