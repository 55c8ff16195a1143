"""Which recorded columns and which effects are under suspicion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Log, Record, RecordError, read_record
from ..records.grammar import LARGEST
from ..records.numbers import from_polars, is_frame, numeric_reading
from ..records.screen import screened
from .blocks import filled
from .levels import TIME_LIKE


def suspect_record(
    model: DynamicBiasRegressor, X: Any, y: Any, columns: Sequence[Any] | None, further: Sequence[Effect] = ()
) -> Record:
    """The record with every suspect column beside those that the model and further effects use.

    Its `refused` rows are left out as the model leaves them out in its fit, or only named.
    """
    X = from_polars(X)
    if isinstance(X, Log):
        raise RecordError("Diagnosis works on a frame or an array. Pass a part of the log that fits in memory.")
    layout = model.features_.layout()
    own = [name for effect in (*model.features_.effect_list(), *further) for name in effect.inputs()]
    temperature = model.features_.history_.record.temperature_name
    special = {layout.time, layout.run, temperature}
    if columns is None:
        frame = X.select_dtypes("number") if is_frame(X) else pd.DataFrame(np.asarray(X))
        columns = [name for name in frame.columns if name not in special and frame[name].nunique() > 1]
    read = read_record(X, layout, y=numeric_reading(y, X), needed=list(dict.fromkeys(own)), quiet=True)
    told = screened(read, model.features_.longest_step())[0]
    read = told if model.screen else replace(read, refused=told.refused)
    suspects = {name: (X[name] if is_frame(X) else np.asarray(X)[:, name]) for name in columns if name not in own}
    values = {name: np.asarray(column, float) for name, column in suspects.items()}
    sound = {name: np.abs(column) <= LARGEST for name, column in values.items()}
    known = {n: column for n, column in values.items() if sound[n].mean() > 0.95 and not _clock(column, sound[n], read)}
    return filled(
        replace(
            read,
            columns={
                **read.columns,
                **{name: np.where(sound[name], column, np.nan) for name, column in known.items()},
            },
            known_moments={},
        ),
        used=read.columns,
    )


def _clock(column: np.ndarray, sound: np.ndarray, read: Record) -> bool:
    """Whether a column tells nothing but the time."""
    rows = np.arange(len(column)) if read.order is None else np.argsort(read.order)
    if len(rows) != len(column):
        return False
    together = np.corrcoef(rows[sound], column[sound])
    return bool(abs(together[0, 1]) > TIME_LIKE)


def as_fitted(model: DynamicBiasRegressor, X: Any) -> Any:
    """The columns of a frame that the model was fitted with; it may hold more, all of them suspects."""
    X = from_polars(X)
    names = list(getattr(model, "feature_names_in_", ()))
    return X[names] if names and is_frame(X) and set(names) < set(X.columns) else X


def further_candidates(further: Any, record: Record) -> list[Effect]:
    """A user's own suspects: effects and transformers as they are, classes of effects over their range."""
    found: list[Effect] = []
    for item in further:
        if isinstance(item, type) and issubclass(item, Effect):
            found += item.candidates(record)
        else:
            found.append(clone(as_effects([item])[0][1]))
    return found


def given_effects(further: Any) -> list[Effect]:
    """Those of a user's own suspects that are effects already."""
    return [as_effects([item])[0][1] for item in further if not isinstance(item, type)]
