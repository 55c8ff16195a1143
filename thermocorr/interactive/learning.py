"""From an arrangement to a fitted model: what is learned from, what is shown beside it, and the curves of both."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..displays.axes import TimeLine, Walk, where_read
from ..effects import Rate, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..estimators import DynamicBiasRegressor
from ..estimators.averages import rms
from ..estimators.run_levels import is_level
from ..estimators.thermometers import Thermometers
from ..files.effect_nodes import EffectCodec
from ..judgement import Diagnosis
from ..judgement.refine import with_missing
from ..judgement.where import largest_lag
from ..pages import figures
from ..pages.charts import recorded
from ..pages.html import percent_text, quantity
from ..records import Record, RecordError, RecordWarning
from ..records.errors import noted
from ..records.numbers import Scale, scale_of, span_texts
from ..records.types import kind_of
from .acts import Arrangement
from .source import ReadLog
from .tiles import Store

LESS_LEVEL = " less level"
"""End of the names of curves without the level of each run."""
EFFECT, COLUMN = "effect ", "column "
"""Beginnings of the names of curves: contributions of effects, and recorded columns."""


class Data(NamedTuple):
    """Data that a model is fitted to."""

    X: pd.DataFrame
    y: pd.Series
    """The readings."""
    learned: pd.Series
    """Readings that are learned from; NaN in stretches that are left out."""
    said: tuple[str, ...]
    """Say how the log was read."""


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
    own = [] if roles.reading == roles.temperature else [roles.reading]
    X = log.drop(columns=[*own, *(name for name in roles.ignored if name in log.columns)])
    if kind_of(y) != "number":
        raise RecordError(f"The column {roles.reading!r} holds no numbers, so it cannot be the reading.")
    X.attrs = dict(log.attrs)
    return Data(X, y, _without(y, arrangement.left_out) if arrangement.left_out else y, said)


def _without(y: pd.Series, stretches: Sequence[tuple[int, int]]) -> pd.Series:
    values = y.to_numpy(float, copy=True)
    for start, stop in stretches:
        values[start:stop] = np.nan
    kept = pd.Series(values, index=y.index, name=y.name)
    kept.attrs = dict(y.attrs)
    return kept


def unfitted(
    source: ReadLog, arrangement: Arrangement, codec: EffectCodec, base: DynamicBiasRegressor
) -> DynamicBiasRegressor:
    """The model of an arrangement, before its fit; what an arrangement does not say is as in `base`."""
    roles, settings = arrangement.roles, arrangement.settings
    assert roles is not None
    effects: list[Effect] = [codec.unpack(json.loads(effect.node), "effect") for effect in arrangement.effects]
    given = settings.time_constants
    model: DynamicBiasRegressor = clone(base)
    return model.set_params(
        temperature=roles.temperature,
        reference=roles.reference,
        time_constants=list(given) if isinstance(given, tuple) else given,
        degree=settings.degree,
        products=settings.products,
        effects=effects,
        time=None if source.files else roles.time,
        run=roles.run,
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
    with noted() as said:
        model = unfitted(source, arrangement, codec, base or DynamicBiasRegressor()).fit(data.X, data.learned)
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
    levels = next((k for k, effect in enumerate(model.features_.effect_list()) if is_level(model, effect)), None)
    found: dict[str, list[np.ndarray]] = {}
    begins, count, last = [], 0, -1
    for part in walked.parts():
        values = {
            "place": part.seconds + line.shifts[part.segment],
            "seconds": part.seconds,
            "row": np.asarray(np.arange(len(data.y))[part.rows], float),
            "temperature": part.temperature,
            "reading": part.measured,
            "model": where_read(part.modelled, part.measured),
            "corrected": walked.corrected(part),
            "residual": part.measured - part.modelled,
        }
        values |= {f"{EFFECT}{label}": part.contributions[:, k] for k, label in enumerate(labels)}
        if levels is not None:
            level = part.contributions[:, levels]
            values |= {f"{name}{LESS_LEVEL}": values[name] - level for name in ("reading", "model", "corrected")}
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
    """Further conditions under which a model may fail, as in `Diagnosis.where`."""
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
    """Result of `run`, without its warnings about parts of the record."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        return run()


def axis_of(found: Fitted) -> figures.Axis:
    """The axis of time on which a fitted arrangement is drawn; its x is left empty."""
    return figures.axis_of(found.timeline, np.zeros(0))


def moment_words(found: Fitted, places: np.ndarray, seconds: np.ndarray) -> str:
    """From when to when two rows lie: places in the order of time, and seconds since the first row."""
    line = found.timeline
    if line.samples:
        return f"samples {places[0] + 1} to {places[1] + 1}"
    if line.dates:
        first, last = (pd.Timestamp(moment).round("s") for moment in line.times(seconds))
        start, end = f"{first:%Y-%m-%d %H:%M:%S}", f"{last:%Y-%m-%d %H:%M:%S}"
        return f"{start} to {end.removeprefix(f'{first:%Y-%m-%d} ')}"
    return f"{' to '.join(span_texts(seconds[:2]))} after the first row"


def chosen_lags(given: str) -> Any:
    """Time constants as a person types them: a number of them, "auto", "none", or a list."""
    words = given.strip()
    if words == "auto":
        return words
    if words == "none":
        return []
    return int(words) if words.isascii() and words.isdigit() and len(words) < 4 else spans(words)


def sentence(error: BaseException) -> str:
    """Message of an error in one line; the kind of error where it has none for people."""
    if isinstance(error, MemoryError):
        return "There is not enough memory for this. Open a shorter log."
    said = " ".join(str(error).split())
    if isinstance(error, ValueError | TypeError | OSError) and said:
        return said
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def spans(given: str) -> list[float | str]:
    """Time constants as a person types them: ``60, 15min, 2h``; ValueError for anything else."""
    found: list[float | str] = []
    for part in (word.strip() for word in given.split(",")):
        if not part:
            continue
        try:
            seconds: float | str = float(part)
        except ValueError:
            seconds = part
        if isinstance(seconds, float) and not (math.isfinite(seconds) and seconds > 0):
            raise ValueError(f"{part!r} is no time constant. Write such as 60, 15min, 2h.")
        found.append(seconds)
    if not found:
        raise ValueError("Say how many time constants to choose (6), auto, none, or which: 60, 15min, 2h.")
    return found


def figure(value: float | None, scale: Scale, digits: int = 4) -> dict[str, Any] | None:
    """A number as text with a unit that suits it and its neighbours, and as it is; None for one that nobody knows."""
    if value is None or not math.isfinite(value):
        return None
    return {"text": quantity(float(value), digits=digits, scale=scale), "value": float(value)}


def share(value: float) -> dict[str, Any]:
    """A share; of what nobody knows it is nothing."""
    known = float(value) if math.isfinite(value) else 0.0
    return {"text": percent_text(known), "value": known}


def gain(value: float) -> dict[str, Any] | None:
    """Decibels, with their sign."""
    if not math.isfinite(value):
        return None
    return {"text": f"{value:+.1f}\u00a0dB".replace("-", "\u2212"), "value": float(value)}


def fall(after: float | None, before: float | None) -> dict[str, Any] | None:
    """By how many decibels an error has changed: negative is good."""
    if not (after and before) or not (math.isfinite(after) and math.isfinite(before)):
        return None
    return gain(20 * math.log10(after / before))


AFTER, TAKEN = "preview after", "preview taken"
"""Names of curves: the residual that an effect would leave, and what it would take away."""


def preview_of(found: Fitted, effect: Effect, store: Store) -> dict[str, Any]:
    """Fit the model with one effect more, its time constants held, and put its curves beside those there are.

    Returns dict: curves (names in the store), before and after (rms residual of the rows that are learned from),
    label.
    """
    extended = with_missing(found.model, effect)
    if not isinstance(effect, ThermalLag):
        extended.set_params(time_constants=found.model._fixed_time_constants())
    extended.set_params(alpha=found.model.alpha_).fit(found.data.X, found.data.learned)
    rows = store.get(found.curves["row"]).astype(int)
    after = extended.evaluate(found.data.X, found.data.y)["residual"].to_numpy(float)[rows]
    before = np.asarray(store.get(found.curves["residual"]))
    learned = np.isfinite(found.data.learned.to_numpy(float)[rows]) & np.isfinite(after) & np.isfinite(before)
    found.curves |= {AFTER: store.put(after), TAKEN: store.put(before - after)}
    errors = rms(before[learned]), rms(after[learned])
    scale = scale_of(errors, found.model.reading_.unit)
    return {
        "curves": {name: found.curves[name] for name in (AFTER, TAKEN)},
        "before": figure(errors[0], scale),
        "after": figure(errors[1], scale),
        "label": effect.label(),
    }
