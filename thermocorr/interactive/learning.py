"""From an arrangement to a fitted model: what is learned from, what is shown beside it, and the curves of both."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import Rate, SeveralSteps, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..estimators import DynamicBiasRegressor
from ..estimators.thermometers import Thermometers
from ..files.effect_nodes import EffectCodec
from ..judgement import Diagnosis
from ..judgement.where import largest_lag
from ..pages.charts import recorded
from ..pictures.timeline import TimeLine
from ..pictures.walk import Walk
from ..records import Record, RecordError, RecordWarning
from ..records.types import kind_of
from .arrangement import Arrangement
from .source import ReadLog
from .tiles import Store

RUNS = "run (workbench)"
"""Column of the labels of runs, where stretches were made runs of their own."""
EFFECT, COLUMN = "effect ", "column "
"""Beginnings of the names of curves: contributions of effects, and recorded columns."""


class Data(NamedTuple):
    """What a model is fitted to."""

    X: pd.DataFrame
    y: pd.Series
    """The readings, without those that were marked as spikes."""
    learned: pd.Series
    """Readings that are learned from; NaN in stretches that are left out."""
    said: tuple[str, ...]
    """How the log was understood."""


@dataclass
class Fitted:
    """A fitted arrangement, and what became known of it since."""

    arrangement: Arrangement
    data: Data
    model: DynamicBiasRegressor
    notes: tuple[str, ...]
    curves: dict[str, str]
    """Names of curves, and under which names the store has them."""
    timeline: TimeLine
    diagnosis: Diagnosis | None = None
    charts: list[dict[str, Any]] | None = None
    said: dict[str, str] = field(default_factory=dict)
    """Why there are no errors or no diagnosis, by the name of what is lacking."""


def data_of(source: ReadLog, arrangement: Arrangement) -> Data:
    """Columns and readings as an arrangement has them.

    Raises RecordError where the arrangement does not say which column is what, or names columns that are not there.
    """
    roles = arrangement.roles
    if roles is None:
        raise RecordError("Say which column is the temperature and which the reading.")
    roles.check(source.frame.columns)
    log, said = source.timed(roles.time)
    y = log[roles.reading]
    y.attrs = dict(log.attrs)
    X = log.drop(columns=[roles.reading, *(name for name in roles.ignored if name in log.columns)])
    if kind_of(y) != "number":
        raise RecordError(f"The column {roles.reading!r} holds no numbers, so it cannot be the reading.")
    if arrangement.spikes:
        y = _without(y, [(row, row + 1) for row in arrangement.spikes])
    if arrangement.own_runs:
        X = X.assign(**{RUNS: run_labels(len(X), X[roles.run] if roles.run else None, arrangement.own_runs)})
    X.attrs = dict(log.attrs)
    return Data(X, y, _without(y, arrangement.left_out) if arrangement.left_out else y, said)


def run_labels(n_rows: int, runs: Any, stretches: Sequence[tuple[int, int]]) -> list[str]:
    """Labels of runs: another one from the start of each stretch, and behind its end."""
    part = np.zeros(n_rows, int)
    for start, stop in stretches:
        part[start:] += 1
        part[stop:] += 1
    before = [""] * n_rows if runs is None else [f"{run}, " for run in runs]
    return [f"{label}part {number}" for label, number in zip(before, part + 1, strict=True)]


def _without(y: pd.Series, stretches: Sequence[tuple[int, int]]) -> pd.Series:
    values = y.to_numpy(float, copy=True)
    for start, stop in stretches:
        values[start:stop] = np.nan
    kept = pd.Series(values, index=y.index, name=y.name)
    kept.attrs = dict(y.attrs)
    return kept


def unfitted(arrangement: Arrangement, codec: EffectCodec, base: DynamicBiasRegressor) -> DynamicBiasRegressor:
    """The model of an arrangement, before its fit; what an arrangement does not say is as in `base`."""
    roles, settings = arrangement.roles, arrangement.settings
    assert roles is not None
    effects: list[Effect] = [
        codec.unpack(json.loads(effect.node), "effect", learned=False) for effect in arrangement.effects
    ]
    if arrangement.changes:
        effects.append(SeveralSteps(list(arrangement.changes)))
    given = settings.time_constants
    model: DynamicBiasRegressor = clone(base)
    return model.set_params(
        temperature=roles.temperature,
        time_constants=list(given) if isinstance(given, tuple) else given,
        degree=settings.degree,
        products=settings.products,
        effects=effects,
        time=roles.time,
        run=RUNS if arrangement.own_runs else roles.run,
        sampling_period=settings.sampling_period,
        max_gap=settings.max_gap,
        screen=settings.screen,
    )


def fitted(
    source: ReadLog,
    arrangement: Arrangement,
    codec: EffectCodec,
    store: Store,
    base: DynamicBiasRegressor | None = None,
) -> Fitted:
    """Fit an arrangement, and write its curves to the store.

    Raises RecordError, ValueError: what the fit says of unusable data and settings.
    """
    data = data_of(source, arrangement)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        model = unfitted(arrangement, codec, base or DynamicBiasRegressor()).fit(data.X, data.learned)
        said = [str(w.message) for w in caught if issubclass(w.category, RecordWarning)]
        curves, timeline = curves_of(model, data, store)
    return Fitted(
        arrangement=arrangement,
        data=data,
        model=model,
        notes=tuple(dict.fromkeys((*said, *model.notes_))),
        curves=curves,
        timeline=timeline,
    )


def curves_of(model: DynamicBiasRegressor, data: Data, store: Store) -> tuple[dict[str, str], TimeLine]:
    """Every row in the order of time, as curves in the store: names there by names of curves, and their time line."""
    walked = Walk(model, data.X, data.y)
    line = walked.timeline
    labels = walked.labels()
    found: dict[str, list[np.ndarray]] = {}
    begins, count, last = [], 0, -1
    for part in walked.parts():
        modelled = part.contributions.sum(axis=1) + model.intercept_
        values = {
            "place": part.seconds + line.shifts[part.segment],
            "seconds": part.seconds,
            "row": np.asarray(np.arange(len(data.y))[part.rows], float),
            "temperature": part.temperature,
            "reading": part.measured,
            "model": modelled,
            "corrected": walked.corrected(part),
            "residual": part.measured - modelled,
        }
        values |= {f"{EFFECT}{label}": part.contributions[:, k] for k, label in enumerate(labels)}
        for name in data.X.columns:
            if kind_of(data.X[name]) in ("number", "switch") and name != Thermometers.of(model.temperature).ambient:
                values[f"{COLUMN}{name}"] = recorded(data.X, name, part.rows)
        for name, array in values.items():
            found.setdefault(name, []).append(array)
        if part.segment != last:
            begins.append(count)
        count, last = count + len(part.seconds), part.segment
    arrays = {name: np.concatenate(parts) for name, parts in found.items()}
    arrays["begins"] = np.array(begins, float)
    arrays |= _conditions(model, walked.record, arrays["seconds"], line)
    return {name: store.put(array) for name, array in arrays.items()}, line


def _conditions(
    model: DynamicBiasRegressor, record: Record, seconds: np.ndarray, line: TimeLine
) -> dict[str, np.ndarray]:
    """What a model may fail under, beside the temperature and recorded columns: as `Diagnosis.where` has it."""
    lag = largest_lag(model)
    effects: list[Effect] = [Rate(), *([] if lag is None else [ThermalLag([lag])])]
    for effect in effects:
        effect.learn(record)
    columns = np.concatenate([step.columns for step in walk(effects, record, starts=own_starts(record))])
    found = {"rate": columns[:, 0] * 3600.0}
    if lag is not None:
        found["lag difference"] = columns[:, 1]
    if line.dates:
        found["hour"] = (line.zero + seconds) % 86_400 / 3600
    return found


def quietly(run: Callable[[], Any]) -> Any:
    """What `run` returns, its warnings about parts of the record left unsaid."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        return run()
