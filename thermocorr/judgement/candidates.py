"""Which recorded columns and which effects are under suspicion."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import CATALOGUE, SeveralSteps
from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..equations.noise import made_from, shows_the_same
from ..estimators.reading import check_columns
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.run_levels import moments_between_runs
from ..records import Log, ParquetLog, Record, read_record
from ..records.errors import listing, warn
from ..records.history import Thinned, thinned
from ..records.labels import is_state, parted_state, state, states_of
from ..records.log import SomeColumns
from ..records.numbers import is_frame, numeric_reading
from ..records.record_log import RecordLog
from ..records.screen import screened
from ..records.types import kind_of
from .blocks import filled, with_exact
from .levels import FINE, MANY_STARTS, MOST_ROWS, MOST_SOUND, TIME_LIKE


def record_of(model: DynamicBiasRegressor, X: Any, y: Any, further: Sequence[Effect] = ()) -> Record:
    """The user's record with its readings and the columns that model and further effects use."""
    check_columns(model.features_, as_fitted(model, X), reset=False)
    own = [name for effect in (*model.features_.effect_list(), *further) for name in effect.inputs()]
    features = model.features_
    fill = features.fill_in if features.filling_.stand_ins else None
    return model.without_spoilt(
        read_record(X, features.layout(), y=numeric_reading(y, X), needed=own, quiet=True, fill=fill)
    )


def suspect_record(
    model: DynamicBiasRegressor,
    read: Record,
    X: Any,
    y: Any,
    columns: Sequence[Any] | None,
    exactly: Sequence[Effect],
    most: int | None = None,
) -> Record:
    """A record of `record_of` in at most `most` rows, with every suspect column beside its own.

    Where its rows are averages, those of the columns of `exactly` these effects are computed in the longer record. Its
    `refused` rows are left out as the model leaves them out in its fit, or only named.
    """
    layout = model.features_.layout()
    special = {layout.time, layout.run, getattr(y, "name", None) if isinstance(X, Log) else None}
    if columns is None:
        columns = [name for name in _numeric(X) if name not in special and not _is_of(name, special)]
    told = screened(read, model.features_.longest_step())[0]
    read = told if model.screen else replace(read, refused=told.refused)
    suspects = {name: _recorded(X, name) for name in columns if name not in read.columns}
    short, sound = thinned(read, suspects, most or MOST_ROWS)
    values = {name: short.columns[name] for name in suspects if sound[name] > MOST_SOUND}
    holey = [name for name in suspects if 0 < sound[name] <= MOST_SOUND]
    if holey:
        least = 1 - max(sound[name] for name in holey)
        warn(
            f"{listing(holey)}: no number in {least:.0%} of the rows or more. Not under suspicion. Where the holes are "
            "short, fill them first: X[column].interpolate()."
        )
    known = {name: column for name, column in values.items() if not _clock(column, short)}
    order = slice(None) if short.order is None else short.order
    reading = np.asarray(short.reading, float)[order]
    copies = [name for name, column in known.items() if made_from(column[order], reading)]
    if copies:
        warn(
            f"{listing(copies)}: made from the reading (the reading itself, a line, a mean, a low pass or an earlier "
            "value of it), whose own noise it carries, so it explains nothing. Not under suspicion. Leave such columns "
            "out of X."
        )
        known = {name: column for name, column in known.items() if name not in copies}
    same = [name for name, column in known.items() if shows_the_same(column[order], reading)]
    if same:
        warn(
            f"{listing(same)}: the numbers of the reading, on its scale. Where that is a second measurement of the "
            "same, leave it out of X: it explains the reading, and correcting by it takes away what is to be measured."
        )
    kept = {**{name: short.columns[name] for name in read.columns}, **known}
    found = filled(replace(short, columns=kept, known_moments={}), used=read.columns)
    if isinstance(found, Thinned) and short is not read and not isinstance(read, Thinned):
        own = [clone(effect) for effect in (*exactly, *model.features_.effect_list())]
        return with_exact(found, read, own, FINE)
    return found


def _recorded(X: Any, name: Any) -> Any:
    """A column of the data, or a state of one."""
    if is_state(X, name):
        return state(X, name)
    return X[name] if is_frame(X) else np.asarray(X)[:, name]


def _numeric(X: Any) -> list[Any]:
    """Columns that hold numbers or switches, and the states of columns that hold words."""
    if isinstance(X, ParquetLog):
        return [name for name in X.columns if X[name].kind == "number"]
    if isinstance(X, Log):
        return list(X.columns)
    if not is_frame(X):
        return [*range(np.shape(X)[1])]
    return [*(name for name in X.columns if kind_of(X[name]) in ("number", "switch")), *states_of(X)]


def _is_of(name: Any, special: Collection[Any]) -> bool:
    """Whether a state is one of a column that plays another role: a run's label, a date."""
    return isinstance(name, str) and any(parted_state(name, [column]) for column in special if column is not None)


def _clock(column: np.ndarray, read: Record) -> bool:
    """Whether a column tells nothing but the time."""
    rows = np.arange(len(column)) if read.order is None else np.argsort(read.order)
    if len(rows) != len(column):
        return False
    sound = np.isfinite(column)
    together = np.corrcoef(rows[sound], column[sound])
    return bool(abs(together[0, 1]) > TIME_LIKE)


def as_fitted(model: DynamicBiasRegressor, X: Any) -> Any:
    """The columns of a frame that the model was fitted with; it may hold more, all of them suspects."""
    names = list(getattr(model, "feature_names_in_", ()))
    if isinstance(X, RecordLog):
        return X.with_columns(names)
    if not (names and is_frame(X) and set(names) < set(X.columns)):
        return X
    return SomeColumns(X, names) if isinstance(X, Log) else X[names]


def candidates_of(record: Record, exclude: Collection[str], further: Any) -> list[Effect]:
    """All suspects of a record: those of the catalogue, and a user's own.

    Effects and transformers of the user's are taken as they are, classes of effects over their range.
    """
    columns = [name for name in record.columns if name != record.temperature_name]
    found = [
        effect
        for kind, effects in CATALOGUE.items()
        if effects.tried and kind not in exclude
        for effect in effects.candidates(record, columns)
    ]
    between = moments_between_runs(record)
    if SeveralSteps.kind not in exclude and 1 < len(between) < MANY_STARTS:  # one alone is among the steps at any row
        found.append(SeveralSteps(list(between)))
    for item in further:
        if isinstance(item, type) and issubclass(item, Effect):
            found += item.candidates(record, columns)
        else:
            found.append(clone(as_effects([item], "suspects")[0][1]))
    return found


def given_effects(further: Any) -> list[Effect]:
    """A user's own suspects, as far as they are effects already."""
    return [as_effects([item], "suspects")[0][1] for item in further if not isinstance(item, type)]
