"""Whether another recorded column would be the better temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..records import RecordError
from ..records.record_log import as_data
from ..records.types import kind_of
from ..records.units import is_temperature
from .later import later_rms
from .regressor import DynamicBiasRegressor

BETTER = 0.8
"""Error on later blocks, over that with the present temperature, up to which another one is worth a word."""
MOST = 3
"""Columns that are tried: those that go most with the reading."""


class OtherThermometer(NamedTuple):
    """A column that does better as the temperature than the one that is."""

    column: Any
    error: float
    """Rms error on later blocks with it, in the unit of the reading."""
    present: float
    """Rms error with the present temperature."""


def better_thermometer(model: DynamicBiasRegressor, X: Any, y: Any) -> OtherThermometer | None:
    """The column that foretells later blocks better in place of the temperature; None where there is none.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted, with one thermometer.
    X : DataFrame
        As for its fit. Columns are tried whose unit or name is a temperature's.
    y : as for its fit

    Returns
    -------
    OtherThermometer or None
        Better together and in most of the blocks, each foretold from everything before it.
    """
    X = as_data(X)
    present = model.features_.history_.record.temperature_name
    if not isinstance(X, pd.DataFrame) or len(model.thermometers_) > 1:
        return None
    taken = {present, model.time, model.run, *(name for e in model.features_.effect_list() for name in e.inputs())}
    names = [
        name for name in X.columns if name not in taken and is_temperature(name, X) and kind_of(X[name]) == "number"
    ]
    if not names:
        return None
    own = later_rms(model, X, y)
    found: list[OtherThermometer] = []
    for name in _most_alike(X, y, names):
        other = clone(model).set_params(temperature=name)
        try:
            error = later_rms(other.fit(X, y), X, y)
        except RecordError:  # it never changes, or has hardly a value
            continue
        both = np.isfinite(error) & np.isfinite(own)
        if both[-1] and error[-1] < BETTER * own[-1] and np.mean((error < own)[:-1][both[:-1]]) > 0.5:
            found.append(OtherThermometer(name, float(error[-1]), float(own[-1])))
    return min(found, key=lambda other: other.error, default=None)


def _most_alike(X: pd.DataFrame, y: Any, names: Sequence[Any]) -> list[Any]:
    """The columns that go most with the reading, the most first."""
    reading = pd.Series(np.asarray(y, float))
    likeness = {name: abs(pd.Series(X[name].to_numpy(float)).corr(reading)) for name in names}
    return sorted(names, key=lambda name: -np.nan_to_num(likeness[name]))[:MOST]
