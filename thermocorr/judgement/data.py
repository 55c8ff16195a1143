"""The data of a judgement: suspect columns, base, residuals."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import CATALOGUE, LagProducts, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..equations.noise import made_from, shows_the_same
from ..model.averages import rms
from ..model.reading import check_columns
from ..model.regressor import DynamicBiasRegressor
from ..records import Block, Record, RecordError, read_record
from ..records.errors import listing, warn
from ..records.history import in_memory
from ..records.numbers import is_frame, numeric_reading
from ..records.screen import screened
from ..records.types import kind_of
from .levels import LAGS, MOST_ROWS, MOST_SOUND, SLOWEST


def filled(record: Record, used: Collection[Any], most_missing: float = 1 - MOST_SOUND) -> Record:
    """The record with short holes in columns interpolated.

    Columns that are `used`, the temperature among them, stay as they are: rows that lack one are passed over.
    """
    columns = {}
    for name, values in record.columns.items():
        numbers = np.asarray(values, float)
        missing = np.isnan(numbers)
        if name in used or not missing.any():
            columns[name] = values
        elif missing.mean() <= most_missing:
            rows = np.arange(len(numbers))
            columns[name] = np.interp(rows, rows[~missing], numbers[~missing])
    return replace(record, columns=columns, known_moments={})


@dataclass(frozen=True)
class ThermalBase:
    """The model's columns, its slow lags replaced."""

    effects: list[Effect]
    """Static law, fast and middle lags, the model's further effects."""
    slow: list[Effect]
    """The model's slow lags, which compete with drift and ageing."""
    slowest: float
    """Time constant of the slowest lag [s]."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, record: Record) -> ThermalBase:
        """Unlearned effects, for this record or its averages."""
        slowest, own = _slowest(record), np.asarray(model.time_constants_, float)
        # A device faster than the sampling shows as a lag of less than a step.
        grid = np.geomspace(0.25 * record.usual_step(), slowest, LAGS)
        further = [clone(effect) for _, effect in model.features_.further_effects()]
        if model.products:
            further += [clone(effect) for effect in model.features_.effect_list() if isinstance(effect, LagProducts)]
        static = StaticPolynomial(model.degree_, model.reference_temperature)
        taus = np.unique(np.concatenate((grid, own[own <= slowest])))
        # Time constants closer than 2 % are one.
        taus = taus[np.concatenate(([True], np.diff(np.log(taus)) > 0.02))]
        slow: list[Effect] = [ThermalLag([tau]) for tau in own[own > slowest]]
        return cls([static, ThermalLag(taus.tolist()), *further], slow, slowest)


def _slowest(record: Record) -> float:
    """Time constant of the base's slowest lag [s].

    It is at least a few samples long, however short the segments.
    """
    together = sum(record.read_duration(segment) for segment in record.segments)
    # However short the segments, the slowest lag of the base lasts eight steps.
    return max(min(SLOWEST * together, record.longest_read()), 8 * record.usual_step())


def residuals_of(model: DynamicBiasRegressor, read: Record, judged: Record) -> tuple[np.ndarray, float]:
    """Residuals of the judged record, and their rms.

    `model` (DynamicBiasRegressor): Fitted. `read` (Record): The user's record with its readings, see `record_of`.
    `judged` (Record): What `suspect_record` made of it.
    """
    residual = np.full(read.n_rows, np.nan)
    for block, values in _blocks(model, read, judged):
        residual[block.rows] = values
    return residual, rms(residual)


def _blocks(model: DynamicBiasRegressor, read: Record, judged: Record) -> Iterator[tuple[Block, np.ndarray]]:
    """Residuals block by block, NaN for screened rows."""
    refused = np.concatenate([np.zeros(0, np.intp), *(found.rows for found in judged.refused if model.screen)])
    places = refused if read.order is None else np.flatnonzero(np.isin(read.order, refused))
    for block, values in model._residual_blocks(read):
        if len(places):
            values[np.isin(block.places, places)] = np.nan
        yield block, values


def quiet_share(residual: np.ndarray, record: Record, loud: Sequence[tuple[float, float]]) -> float:
    """Rms residual outside loud stretches, over that of all."""
    quiet = quiet_rows(residual, record, loud)
    return rms(quiet) / max(rms(residual), 1e-300) if loud and np.isfinite(quiet).any() else 1.0


def quiet_rows(residual: np.ndarray, record: Record, loud: Sequence[tuple[float, float]]) -> np.ndarray:
    """The residual outside loud stretches [s]."""
    if not loud:
        return residual
    seconds = record.times.seconds(np.arange(len(residual)), record.first_stamp())
    return residual[np.all([(seconds < start) | (seconds > end) for start, end in loud], axis=0)]


def record_of(model: DynamicBiasRegressor, X: Any, y: Any, further: Sequence[Effect] = ()) -> Record:
    """The user's record with all columns that effects use."""
    check_columns(model.features_, as_fitted(model, X), reset=False)
    own = [name for effect in (*model.features_.effect_list(), *further) for name in effect.inputs()]
    features = model.features_
    read = read_record(X, features.layout(), y=numeric_reading(y, X), needed=own, quiet=True)
    return model._without_spoilt(read)


def suspect_record(model: DynamicBiasRegressor, read: Record, X: Any, y: Any, columns: Sequence[Any] | None) -> Record:
    """A record in memory with every suspect column.

    Its `refused` rows are left out as the model leaves them out in its fit, or only named.
    """
    if read.n_used > MOST_ROWS:
        raise RecordError(
            f"The record has {read.n_used} rows, and a diagnosis holds at most {MOST_ROWS} in memory. Average them "
            "first, such as frame.resample('1min').mean(), fit a model to these rows, and diagnose it."
        )
    layout = model.features_.layout()
    special = {layout.time, layout.run, layout.reference}
    if columns is None:
        columns = [name for name in _numeric(X) if name not in special]
    columns = [name for name in columns if name != layout.reference]
    checked = screened(read, model.features_.longest_step())[0]
    read = checked if model.screen else replace(read, refused=checked.refused)
    suspects = {name: _recorded(X, name) for name in columns if name not in read.columns}
    short, sound = in_memory(read, suspects)
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
    return filled(replace(short, columns=kept, known_moments={}), used=read.columns)


def _recorded(X: Any, name: Any) -> Any:
    """A column of the data."""
    return X[name] if is_frame(X) else np.asarray(X)[:, name]


def _numeric(X: Any) -> list[Any]:
    """Columns that hold numbers or switches."""
    if not is_frame(X):
        return [*range(np.shape(X)[1])]
    return [name for name in X.columns if kind_of(X[name]) in ("number", "switch")]


def _clock(column: np.ndarray, read: Record) -> bool:
    """True if a column tells nothing but the time."""
    rows = np.arange(len(column)) if read.order is None else np.argsort(read.order)
    if len(rows) != len(column):
        return False
    sound = np.isfinite(column)
    together = np.corrcoef(rows[sound], column[sound])
    # A column that goes with time so closely is a clock, no suspect.
    return bool(abs(together[0, 1]) > 0.999_999)


def as_fitted(model: DynamicBiasRegressor, X: Any) -> Any:
    """The columns of a frame that the model needs."""
    names = list(getattr(model, "feature_names_in_", ()))
    if not (names and is_frame(X) and set(names) < set(X.columns)):
        return X
    return X[names]


def candidates_of(record: Record, exclude: Collection[str], further: Any) -> list[Effect]:
    """All suspects, the catalogue's and the user's.

    Effects and transformers of the user's are taken as they are, classes of effects over their range.
    """
    columns = [name for name in record.columns if name != record.temperature_name]
    found = [
        effect
        for kind, effects in CATALOGUE.items()
        if effects.tried and kind not in exclude
        for effect in effects.candidates(record, columns)
    ]
    for item in further:
        if isinstance(item, type) and issubclass(item, Effect):
            if item.candidates.__func__ is Effect.candidates.__func__:  # type: ignore[attr-defined]  # of a class method
                raise ValueError(f"{item.__name__} has no `candidates`: pass {item.__name__}(...), or write them.")
            found += item.candidates(record, columns)
        else:
            found.append(clone(as_effects([item], "suspects")[0][1]))
    return found


def given_effects(further: Any) -> list[Effect]:
    """A user's own suspects, as far as they are effects already."""
    return [as_effects([item], "suspects")[0][1] for item in further if not isinstance(item, type)]
