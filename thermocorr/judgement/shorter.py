"""A long record in fewer rows, for all the fits that a refinement tries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects.wrap import as_effects
from ..estimators.regressor import DynamicBiasRegressor
from ..records.history import Thinned, ThinnedLog
from ..records.record_log import as_data
from .candidates import given_effects, record_of, suspect_record
from .levels import MOST_TRIED
from .residual import ThermalBase, residuals_of


@dataclass(frozen=True)
class Shorter:
    """Averages of a long record, and a model for them."""

    model: DynamicBiasRegressor
    """Unfitted; time constants and penalty are those found in all rows."""
    X: ThinnedLog
    y: pd.Series

    def whole(self, found: DynamicBiasRegressor, current: DynamicBiasRegressor) -> DynamicBiasRegressor:
        """An unfitted model for all rows, with the effects found in the averages.

        Where a lag was among these, the time constants stay; else they are chosen anew beside the effects.
        """
        whole: DynamicBiasRegressor = clone(current)
        whole.set_params(effects=[clone(effect) for _, effect in as_effects(found.effects)])
        if np.array_equal(found.time_constants_, current.time_constants_):
            return whole
        return whole.set_params(**found.chosen(), alpha=current.alpha_)


def shorter(
    current: DynamicBiasRegressor, X: Any, y: Any, columns: Sequence[Any] | None, suspects: Sequence[Any]
) -> Shorter | None:
    """The averages of a record that is too long to be fitted many times; None for any other."""
    if isinstance(X, ThinnedLog):
        return None
    X = as_data(X)
    read = record_of(current, X, y, given_effects(suspects))
    base = ThermalBase.of(current, read)
    record = suspect_record(current, read, X, y, columns, [*base.effects, *base.slow], MOST_TRIED)
    if not isinstance(record, Thinned):
        return None
    residual, rms = residuals_of(current, read, record)
    known = np.isfinite(residual)
    shown = float(np.average(residual[known] ** 2, weights=record.counts[known]))
    record = replace(record, unseen=max(rms**2 - shown, 0.0))
    reading = pd.Series(record.reading, name=current.reading_.name)
    reading.attrs = dict(getattr(y, "attrs", {}))
    width = record.n_used / max(int(record.counts.sum()), 1)
    model: DynamicBiasRegressor = clone(current)
    model.set_params(**current.chosen(), alpha=current.alpha_ * width)
    if not isinstance(model.temperature, list):
        model.set_params(temperature=record.temperature_name)
    return Shorter(model, ThinnedLog(record, dict(getattr(X, "attrs", {}))), reading)
