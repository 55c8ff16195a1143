"""Parts of a fitted model as JSON and back: history, reading, coefficients."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from sklearn.pipeline import Pipeline

from ..effects import StaticPolynomial, ThermalLag
from ..effects.stream import needed_columns
from ..effects.wrap import as_effects
from ..estimators import DiffusiveFeatures, DynamicBiasRegressor, MergedRidge
from ..estimators.run_levels import RunLevels
from ..estimators.thermometers import Thermometer, Thermometers
from ..records import History, Record, Segment, seconds_of
from ..records.errors import quoted
from ..records.grammar import LARGEST
from ..records.read import temperature_column
from ..records.times import EARLIEST, LATEST, Times
from .codec import (
    LARGEST_INTEGER,
    ModelFileError,
    counted,
    fields,
    integer,
    items,
    label,
    name,
    number,
    numbers,
    pack,
    positive,
    text,
    unexpected,
    unpack,
    vector,
)
from .effect_nodes import EffectCodec, check_state
from .error_nodes import (
    numbers_or_nan,
    pack_errors,
    pack_gaps,
    pack_reading,
    pack_screen,
    unpack_errors,
    unpack_gaps,
    unpack_reading,
    unpack_screen,
)

KINDS = ("datetime", "datetime with time zone", "timedelta", "seconds", "rows")
MOST_ROWS = 1 << 24


# ------------------------------------------------------------------------------------------------------------- history


def pack_history(history: History, effects: list[Any], codec: EffectCodec) -> dict[str, Any]:
    """History as JSON: kept rows, and the states at the end of each segment."""
    record, times = history.record, history.record.times
    ticks = times.ticks
    assert ticks is not None
    segments = []
    for segment, states in zip(record.segments, history.end_states, strict=True):
        packed = [
            pack(state, f"the state of {effect.label()!r}", codec.pack_learned)
            for effect, state in zip(effects, states, strict=True)
        ]
        segments.append({"stop": segment.stop, "run": pack(segment.run, "the label of a run"), "end_states": packed})
    whole = ticks.dtype.kind in "iu"
    return {
        "kind": history.kind,
        "zero": pack(history.zero, "the first time"),
        "rows": history.n_fitted,
        "stride": history.stride,
        "usual_step": history.usual_step,
        "max_gap": history.max_gap,
        "ticks_per_second": times.per_second,
        "period": float(times.period),
        "temperature": pack(record.temperature_name, "the temperature's name"),
        "segments": segments,
        "skipped": record.skipped.tolist(),
        "screen": None if history.screen is None else pack_screen(history.screen),
        "gaps": pack_gaps(history.gaps),
        "first_tick": int(ticks[0]) if whole else float(ticks[0]),
        "ticks": np.diff(ticks).tolist() if whole else ticks[1:].tolist(),
        "columns": [
            {"name": pack(column, "a column's name"), "values": pack(values, f"column {column!r}")}
            for column, values in record.columns.items()
        ],
    }


_HISTORY = (
    "kind", "zero", "rows", "stride", "usual_step", "max_gap", "ticks_per_second", "period", "temperature", "segments",
    "skipped", "screen", "gaps", "first_tick", "ticks", "columns",
)  # fmt: skip


def unpack_history(node: Any, where: str, effects: list[Any], codec: EffectCodec) -> History:
    """The history; every count, order and state is checked."""
    node = fields(node, where, _HISTORY)
    kind = node["kind"]
    if kind not in KINDS:
        raise unexpected(f"{where}.kind", repr(kind)[:60], f"one of {', '.join(KINDS)}")
    segments, ends, at = [], [], 0
    for i, item in enumerate(items(node["segments"], f"{where}.segments")):
        place = f"{where}.segments[{i}]"
        item = fields(item, place, ("stop", "run", "end_states"))
        stop = integer(item["stop"], f"{place}.stop", at + 1, MOST_ROWS)
        segments.append(Segment(at, stop, label(unpack(item["run"], f"{place}.run"), f"{place}.run")))
        at = stop
        states = []
        for k, state in enumerate(items(item["end_states"], f"{place}.end_states", len(effects))):
            spot = f"{place}.end_states[{k}]"
            states.append(unpack(state, spot, codec.unpack_nested))
            check_state(effects[k], states[-1], spot)
        ends.append(states)
    if not segments:
        raise unexpected(f"{where}.segments", "an empty list", "at least one segment")
    per_second = integer(node["ticks_per_second"], f"{where}.ticks_per_second", 1, 1_000_000_000)
    if per_second not in (1, 1_000, 1_000_000, 1_000_000_000):
        raise unexpected(f"{where}.ticks_per_second", str(per_second), "1, 1000, 1000000 or 1000000000")
    ticks = _unpack_ticks(node, where, kind, per_second, [segment.start for segment in segments], at)
    skipped = _unpack_skipped(node["skipped"], f"{where}.skipped", segments)
    columns: dict[object, np.ndarray] = {}
    for i, item in enumerate(items(node["columns"], f"{where}.columns")):
        place = f"{where}.columns[{i}]"
        item = fields(item, place, ("name", "values"))
        column = name(item["name"], f"{place}.name")
        if column in columns:
            raise unexpected(f"{place}.name", repr(column)[:60], "another name")
        columns[column] = vector(unpack(item["values"], f"{place}.values"), f"{place}.values", at, LARGEST, skipped)
    temperature = name(node["temperature"], f"{where}.temperature")
    for column in (temperature, *needed_columns(effects)):
        if column not in columns:
            raise ModelFileError(f"{where}.columns has no {quoted(column)}, which the model needs")
    times = Times(at, kind, ticks, per_second, positive(node["period"], f"{where}.period"))
    zero = times.stamp(0)
    if type(node["zero"]) is not type(zero) or node["zero"] != zero:
        raise unexpected(f"{where}.zero", repr(node["zero"])[:60], f"the first row's time {zero!r}")
    return History(
        kind=kind,
        zero=zero,
        record=Record(times, temperature, columns, tuple(segments), skipped=skipped),
        end_states=tuple(ends),
        n_fitted=counted(node["rows"], f"{where}.rows", at),
        stride=integer(node["stride"], f"{where}.stride", 1),
        usual_step=positive(node["usual_step"], f"{where}.usual_step"),
        max_gap=None if node["max_gap"] is None else positive(node["max_gap"], f"{where}.max_gap"),
        screen=None if node["screen"] is None else unpack_screen(node["screen"], f"{where}.screen", columns),
        known_gaps=unpack_gaps(node["gaps"], f"{where}.gaps", columns),
    )


def _unpack_skipped(node: Any, where: str, segments: list[Segment]) -> np.ndarray:
    """Rows inside segments that are passed over, in order; no segment begins or ends with one."""
    rows: list[int] = []
    at = 0
    for i, row in enumerate(items(node, where)):
        row = integer(row, f"{where}[{i}]", rows[-1] + 1 if rows else 1)
        while at < len(segments) and segments[at].stop <= row:
            at += 1
        if at == len(segments) or not segments[at].start < row < segments[at].stop - 1:
            raise unexpected(f"{where}[{i}]", str(row), "a row inside a segment")
        rows.append(row)
    return np.array(rows, np.intp)


def _unpack_ticks(
    node: dict[str, Any], where: str, kind: str, per_second: int, starts: list[int], n: int
) -> np.ndarray:
    """Times of the kept rows, of which there are `n`; they increase inside segments, which begin at `starts`."""
    given = items(node["ticks"], f"{where}.ticks", n - 1)
    if kind == "seconds":
        values = [node["first_tick"], *given]
        for i, value in enumerate(values):
            if type(value) is not float or abs(value) > LARGEST:
                raise unexpected(f"{where}.ticks[{i - 1}]", repr(value)[:60], "seconds")
        ticks = np.array(values, float)
    else:
        for i, value in enumerate(given):
            integer(value, f"{where}.ticks[{i}]")
        total = integer(node["first_tick"], f"{where}.first_tick", 1 - LARGEST_INTEGER, LARGEST_INTEGER - 1)
        stamps = [total]
        for step in given:
            total += step
            stamps.append(total)
        unit = 1_000_000_000 // per_second
        if max(stamps) > LATEST // unit or min(stamps) < EARLIEST // unit:
            raise unexpected(f"{where}.ticks", "times", "times between 1880 and 2170")
        ticks = np.array(stamps, np.int64)
    back = np.flatnonzero(np.diff(ticks) <= 0) + 1
    wrong = np.setdiff1d(back, starts)
    if len(wrong):
        raise unexpected(f"{where}.ticks[{wrong[0] - 1}]", "a time that does not increase", "a later time")
    return ticks


# ---------------------------------------------------------------------------------------------------------- the model


_MODEL = (
    "parameters", "intercept", "coefficients", "standard_errors", "columns", "alpha", "rank", "residual_std", "washout",
    "ranges", "notes", "n_features_in", "feature_names_in", "reading", "effects", "history", "errors",
)  # fmt: skip


def pack_model(model: DynamicBiasRegressor, history_rows: int | None) -> dict[str, Any]:
    """A fitted model; see `thermocorr.save_model`."""
    codec = EffectCodec()
    features, ridge = model.features_, model.pipeline_[1]
    history = features.history_ if history_rows is None else features.history_.thinned(history_rows)
    effects = []
    for part, effect in features.effects_:
        effects.append({"name": part, **codec.pack(effect, f"the effect {part!r}", learned=True)})
    names = getattr(model, "feature_names_in_", None)
    return {
        "parameters": {
            key: pack(value, f"the parameter {key!r}", codec.pack_effect)
            for key, value in {
                **model.get_params(deep=False),
                "temperature": Thermometer.plain(model.temperature),
            }.items()
        },
        "columns": list(features.get_feature_names_out()),
        "intercept": float(ridge.intercept_),
        "coefficients": [float(value) for value in ridge.coef_],
        "standard_errors": [float(value) for value in model._standard_errors()],
        "alpha": float(model.alpha_),
        "rank": int(ridge.rank_),
        "residual_std": float(ridge.residual_std_),
        "washout": float(model.washout_),
        "ranges": [[x if np.isfinite(x) else None for x in row] for row in model._learned_ranges().tolist()],
        "reading": pack_reading(model.reading_),
        "notes": list(model.notes_),
        "n_features_in": int(model.n_features_in_),
        "feature_names_in": None if names is None else [str(column) for column in names],
        "effects": effects,
        "history": pack_history(history, features.effect_list(), codec),
        "errors": pack_errors(model._joint_errors(), features.effect_list(), codec) if model._knows_noise else None,
    }


def unpack_model(node: Any, where: str, codec: EffectCodec) -> DynamicBiasRegressor:
    """The fitted model, every part of it checked."""
    node = fields(node, where, _MODEL)
    given = fields(node["parameters"], f"{where}.parameters", tuple(DynamicBiasRegressor._get_param_names()))
    parameters = {key: unpack(value, f"{where}.parameters.{key}", codec.unpack_nested) for key, value in given.items()}
    try:
        parameters["temperature"] = Thermometer.given(parameters["temperature"])
        ambient, further, _ = Thermometers.of(parameters["temperature"])
    except (ValueError, TypeError) as error:
        raise ModelFileError(f"{where}.parameters.temperature: {error}") from None
    named = {"temperature": (ambient, *further), "time": (parameters["time"],), "run": (parameters["run"],)}
    for key, columns in named.items():
        for column in columns:
            if column is not None:
                name(column, f"{where}.parameters.{key}")
    if parameters["reference"] is not None:
        text(parameters["reference"], f"{where}.parameters.reference")
    model = DynamicBiasRegressor(**parameters)
    given_effects = model.effects if isinstance(model.effects, list | tuple) else ()
    for i, item in enumerate(given_effects):
        if isinstance(item, tuple) and len(item) == 2:
            text(item[0], f"{where}.parameters.effects[{i}]")
    try:
        as_effects(model.effects)
        for key in ("sampling_period", "max_gap"):
            value = parameters[key]
            if value is not None:
                seconds_of(value, key)
        model._validate_params()
        features = model._unfitted_features(())
        features._validate_params()
    except (ValueError, TypeError, AttributeError) as error:
        raise ModelFileError(f"{where}.parameters: {error}") from None
    learned = []
    for i, item in enumerate(items(node["effects"], f"{where}.effects")):
        place = f"{where}.effects[{i}]"
        effect = codec.unpack(item, place, learned=True)
        learned.append((text(item.get("name"), f"{place}.name"), effect))
    features.effects_ = learned
    model._run_levels = RunLevels.among(learned, as_effects(model.effects))
    features.set_params(effects=model._run_levels.beside(as_effects(model.effects)))
    _restore_features(features, node, where)
    features.history_ = unpack_history(node["history"], f"{where}.history", features.effect_list(), codec)
    features.screen_ = features.history_.screen
    features.n_features_in_ = model.n_features_in_ = integer(node["n_features_in"], f"{where}.n_features_in", 1)
    if parameters["temperature"] is not None:
        _check_temperature(features.thermometers().ambient, features, f"{where}.parameters.temperature")
    if node["feature_names_in"] is not None:
        names = items(node["feature_names_in"], f"{where}.feature_names_in", model.n_features_in_)
        checked = [text(column, f"{where}.feature_names_in[{i}]") for i, column in enumerate(names)]
        _check_names(checked, features, f"{where}.feature_names_in")
        features.feature_names_in_ = model.feature_names_in_ = np.array(checked, dtype=object)
    _restore_numbers(model, features, node, where)
    errors = unpack_errors(node["errors"], f"{where}.errors", features.effect_list(), features.history_, codec)
    if errors is not None:
        model._known_errors = errors
    return model


def _check_names(names: list[str], features: DiffusiveFeatures, where: str) -> None:
    """Names of the columns that X had in the fit: each once, those that the model reads among them.

    Their order is that of the fitted X, whatever it was: nothing else in a file depends on it but the temperature that
    nobody named.
    """
    twice = pd.Index(names).duplicated()
    if twice.any():
        raise unexpected(f"{where}[{twice.argmax()}]", repr(names[twice.argmax()])[:60], "another name")
    record, layout = features.history_.record, features.layout()
    special = [column for column in (layout.time, layout.run) if column is not None]
    for column in (*record.columns, *special):
        if column not in names:
            raise ModelFileError(f"{where} has no {quoted(column)}, which the model needs")
    _check_temperature(temperature_column(pd.DataFrame(columns=names), layout, quiet=True), features, where)


def _check_temperature(found: object, features: DiffusiveFeatures, where: str) -> None:
    fitted = features.history_.record.temperature_name
    if found != fitted:
        raise ModelFileError(f"{where} makes {found!r} the temperature, where {fitted!r} is that of the fit")


def _restore_features(features: DiffusiveFeatures, node: dict[str, Any], where: str) -> None:
    effects = features.effect_list()
    static = next((effect for effect in effects if isinstance(effect, StaticPolynomial)), None)
    if static is None:
        raise ModelFileError(f"{where}.effects has no static polynomial, with which every model begins")
    lags: Any = next((effect for effect in effects if isinstance(effect, ThermalLag)), None)
    features.reference_temperature_ = static.reference_temperature_
    features.time_constants_ = np.zeros(0) if lags is None else lags.time_constants_
    further = features.thermometers().times_in(features.effects_)
    own = features.time_constants_.tolist()
    given = {features.thermometers().ambient: own, **{column: taus.tolist() for column, taus in further.items()}}
    features.time_constants = given if further else own
    try:
        names = list(features.get_feature_names_out())
        for effect in effects:
            effect.label()
            if len(effect.units()) != effect.n_columns():
                raise ValueError(f"{type(effect).__name__} has another number of units than of names")
    except Exception as error:
        raise ModelFileError(f"{where}.effects cannot name their columns: {error}") from None
    if names != [str(column) for column in items(node["columns"], f"{where}.columns")]:
        raise unexpected(f"{where}.columns", "names", f"the {len(names)} names that the effects give")


def _restore_numbers(model: Any, features: DiffusiveFeatures, node: dict[str, Any], where: str) -> None:
    count = len(node["columns"])
    ridge = MergedRidge(number(node["alpha"], f"{where}.alpha", 0.0))
    ridge.coef_ = numbers(node["coefficients"], f"{where}.coefficients", count)
    ridge.intercept_ = number(node["intercept"], f"{where}.intercept")
    ridge.rank_ = integer(node["rank"], f"{where}.rank", 0, count)
    ridge.residual_std_ = number(node["residual_std"], f"{where}.residual_std", 0.0)
    ridge.n_features_in_ = count
    model.pipeline_ = Pipeline([("features", features), ("ridge", ridge)])
    model.alpha_, model.search_ = ridge.alpha, None
    model.washout_ = number(node["washout"], f"{where}.washout", 0.0)
    rows = items(node["ranges"], f"{where}.ranges", len(features.effect_list()))
    ranges = [numbers_or_nan(row, f"{where}.ranges[{i}]", 2) for i, row in enumerate(rows)]
    model._known_ranges = np.where(np.isnan(ranges), [-np.inf, np.inf], ranges).reshape(-1, 2)
    model.reading_ = unpack_reading(node["reading"], f"{where}.reading")
    notes = items(node["notes"], f"{where}.notes")
    model.notes_ = tuple(text(note, f"{where}.notes[{i}]") for i, note in enumerate(notes))
    model._known_standard_errors = numbers(node["standard_errors"], f"{where}.standard_errors", count + 1, 0.0)
