"""A fitted model as a JSON file: all digits, no pickle.

What `predict`, `correct`, `flags`, rows that follow on the fitted record and `OnlineCorrector` need is in it, and where
it all came from. Reading checks a digest first, then every value by its type hint, then that the parts belong together;
a file is taken only if the model that was read would be written as the same bytes.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import textwrap
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from ..effects import StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import needed_columns, own_starts, walk
from ..effects.wrap import as_effects
from ..model import DiffusiveFeatures, DynamicBiasRegressor, MergedRidge
from ..model.reading import Reading
from ..model.runs import RunLevels
from ..model.thermometers import Thermometer
from ..model.uncertainty import JointErrors
from ..readers.form import Form
from ..records import History, seconds_of
from ..records.history import HEAD
from ..records.read import temperature_column
from ..records.times import EARLIEST, LATEST
from ..records.types import LARGEST, Counted, Large, Loose, Size, within
from .codec import LARGEST_FILE, ModelFileError, fields, parse, read, read_bytes, read_fields, render, write
from .effect_nodes import EffectCodec, check_state
from .writer import write_file

FORMAT = "thermocorr model"
VERSION = 1
WRONG = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError, StopIteration)
"""Errors that parts of a model raise which do not belong together."""
_HEAD = re.compile(rb'\{"format": "thermocorr model", "version": ([0-9]{1,9}), "digest": "(sha256:[0-9a-f]{64})",\n')
"""First line of a file; the digest is that of all bytes behind it."""


class LaterVersionError(ModelFileError):
    """A model file was written by a later version of thermocorr."""

    remedy = "Update thermocorr: pip install -U thermocorr."


# --------------------------------------------------------------------------------------------------- what a file holds


@dataclass(frozen=True)
class WiderNode:
    """An effect with more time constants, in the errors."""

    place: Counted
    effect: Effect
    end_states: list[Any]


@dataclass(frozen=True)
class ModelNode:
    """All that a fitted model is."""

    parameters: dict[str, Any]
    columns: list[str]
    intercept: Large
    coefficients: list[Large]
    standard_errors: list[Size]
    alpha: Size
    rank: Counted
    residual_std: Size
    washout: Size
    ranges: list[tuple[Loose, Loose]]
    reading: Reading
    form: Form | None
    notes: list[str]
    n_features_in: Counted
    feature_names_in: list[str] | None
    effects: list[tuple[str, Effect]]
    history: History
    wider: list[WiderNode]


# ------------------------------------------------------------------------------------------------------------- to write


def save(model: DynamicBiasRegressor, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a fitted model to a JSON file.

    Of the fitted record it holds the first rows and the last one of each segment. Rows that repeat the record from the
    start of a segment, or follow on it, are corrected as by the model itself; rows that begin in the middle of a
    segment start afresh, and are flagged "washout".

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted. Its effects may be those of the catalogue, or your own if they can be imported.
    path : str or Path
        Written as a whole, or left as it was if anything goes wrong. A file that is there is refused, unless forced.
    force : bool, default False
        Overwrite a file that is there already.

    Returns
    -------
    Path

    Raises
    ------
    ModelFileError
        For a model that cannot be written safely: transformers as effects, classes that cannot be imported; for one
        that gives a file above 32 MiB.
    OutputError
        An OSError: the file cannot be written, or must not be.
    TypeError
        For something else than a `DynamicBiasRegressor`.
    """
    return write_file(path, content_of(model), force=force)


def content_of(model: DynamicBiasRegressor) -> bytes:
    """The bytes of the model file that `save` writes."""
    if not isinstance(model, DynamicBiasRegressor):
        raise TypeError(f"Only a DynamicBiasRegressor can be saved as a model file. Got {type(model).__name__}.")
    check_is_fitted(model, "pipeline_")
    codec = EffectCodec()
    errors = model._joint_errors() if model._knows_noise else None
    content = signed(
        {
            "provenance": _provenance(model),
            "model": write(ModelNode, _model_node(model, errors), "the model", codec.pack),
            "errors": None if errors is None else write(JointErrors, errors, "its errors"),
        }
    )
    if len(content) > LARGEST_FILE:
        raise ModelFileError(
            f"The model file would have {len(content)} bytes, and at most {LARGEST_FILE} are read again."
        )
    return content


def signed(content: dict[str, Any]) -> bytes:
    """A model file; its first line holds the digest."""
    body = (render(content) + "\n").removeprefix("{\n").encode("ascii")
    digest = hashlib.sha256(body).hexdigest()
    return f'{{"format": "{FORMAT}", "version": {VERSION}, "digest": "sha256:{digest}",\n'.encode("ascii") + body


def _model_node(model: DynamicBiasRegressor, errors: JointErrors | None) -> ModelNode:
    features, ridge = model.features_, model.pipeline_[1]
    own, names = features.effect_list(), getattr(model, "feature_names_in_", None)
    wide = [] if errors is None else [i for i, effect in enumerate(errors.effects) if effect is not own[i]]
    return ModelNode(
        parameters={**model.get_params(deep=False), "temperature": Thermometer.plain(model.temperature)},
        columns=list(features.get_feature_names_out()),
        intercept=ridge.intercept_,
        coefficients=ridge.coef_,
        standard_errors=model._standard_errors(),  # type: ignore[arg-type]
        alpha=model.alpha_,
        rank=ridge.rank_,
        residual_std=ridge.residual_std_,
        washout=model.washout_,
        ranges=model._learned_ranges(),  # type: ignore[arg-type]
        reading=model.reading_,
        form=model.form_,
        notes=list(model.notes_),
        n_features_in=model.n_features_in_,
        feature_names_in=None if names is None else list(map(str, names)),
        effects=features.effects_,
        history=features.history_.ends(),
        wider=[WiderNode(i, errors.effects[i], [ends[i] for ends in errors.history.end_states]) for i in wide],  # type: ignore[union-attr]
    )


def _provenance(model: DynamicBiasRegressor) -> dict[str, Any]:
    """Packages, and the fitted record."""
    if hasattr(model, "provenance_"):
        known: dict[str, Any] = model.provenance_
        return known
    from .._version import __version__

    versions = {"thermocorr": __version__, "python": platform.python_version()}
    versions |= {package: version(package) for package in ("numpy", "scipy", "scikit-learn", "pandas")}
    history = model.features_.history_
    record, last = history.record, history.record.n_rows - 1
    noted: dict[str, Any] = {
        "rows": history.n_fitted,
        "readings": model.reading_.n_readings,
        "first": record.times.label(0),
        "last": record.times.label(last),
        "span_s": float(history.between(record.stamp(last), record.stamp(0))),
        "columns": [str(column) for column in record.columns],
    }
    return {"versions": versions, "data": noted}


# -------------------------------------------------------------------------------------------------------------- to read


def load(path: str | os.PathLike[str], *, allow_imports: Collection[str] = ()) -> DynamicBiasRegressor:
    """Read a model that `save` wrote, equal bit for bit.

    Parameters
    ----------
    path : str or Path
    allow_imports : collection of str
        Import paths of a user's own effects that may be imported, such as ``["mypackage.effects.FanNoise"]``. Nothing
        else in the file can make anything run.

    Returns
    -------
    DynamicBiasRegressor
        Fitted. `search_` is None: how the time constants were found is not in the file. `provenance_` says where the
        model came from.

    Raises
    ------
    ModelFileError
        A ValueError: the file is damaged, foreign, of a later version, or needs an import that is not allowed. The
        message says what was found, where in the file, and what to do.
    """
    path = Path(path)
    try:
        return _model_of(read_bytes(path), EffectCodec(allow_imports))
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {error.strerror}. Check its name and folder.") from None
    except ModelFileError as error:
        # What a file's content says may be anything: it is cut.
        found = textwrap.shorten(str(error), 400, placeholder=" ...")
        raise type(error)(f"{path} is no model that can be loaded: {found}. {error.remedy}") from None


save_model, load_model = save, load
"""`save` and `load` under the names that `thermocorr` shows."""


def _model_of(content: bytes, codec: EffectCodec) -> DynamicBiasRegressor:
    head = _HEAD.match(content)
    if head is None:
        raise ModelFileError("its first line is not that of a model file: it is foreign, or damaged")
    if int(head[1]) > VERSION:
        raise LaterVersionError(f"it was written by a later version (format {int(head[1])}, this one reads {VERSION})")
    if head[2].decode() != f"sha256:{hashlib.sha256(content[head.end() :]).hexdigest()}":
        raise ModelFileError("$.digest does not fit the content: something was changed or lost")
    node = fields(parse(content), "$", ("format", "version", "digest", "provenance", "model", "errors"))
    try:
        model = _restored(read(ModelNode, node["model"], "$.model", codec.unpack), node["errors"])
        model.provenance_ = fields(node["provenance"], "$.provenance", ("versions", "data"))
        again = content_of(model)
    except ModelFileError:
        raise
    except WRONG as error:  # of a part that does not belong to the others, wherever that shows
        raise ModelFileError(f"its parts do not belong together: {error}") from None
    if again != content:
        raise ModelFileError("it is not as thermocorr writes this model")
    return model


def _restored(node: ModelNode, errors: Any) -> DynamicBiasRegressor:
    """The fitted model; errors show parts that disagree."""
    where = "$.model"
    parameters = dict(node.parameters)
    parameters["temperature"] = Thermometer.given(parameters["temperature"])
    model = DynamicBiasRegressor(**parameters)
    model._validate_params()
    for key in ("sampling_period", "max_gap"):
        if parameters[key] is not None:
            seconds_of(parameters[key], key)
    features: DiffusiveFeatures = model._unfitted_features(())
    features._validate_params()
    features.effects_ = node.effects
    model._run_levels = RunLevels.among(features.effects_, as_effects(model.effects))
    features.set_params(effects=model._run_levels.added_to(as_effects(model.effects)))
    effects = features.effect_list()
    static = next(effect for effect in effects if isinstance(effect, StaticPolynomial))
    lags: Any = next((effect for effect in effects if isinstance(effect, ThermalLag)), None)
    features.reference_temperature_ = static.reference_temperature_
    features.time_constants_ = np.zeros(0) if lags is None else lags.time_constants_
    further = features.thermometers().times_in(features.effects_)
    own = features.time_constants_.tolist()
    given = {features.thermometers().ambient: own, **{column: taus.tolist() for column, taus in further.items()}}
    features.time_constants = given if further else own
    names, count = list(features.get_feature_names_out()), len(node.columns)
    units = [unit for effect in effects for unit in effect.units()]
    _require(names == node.columns and len(units) == count, f"{where}.columns are not those that the effects have")
    features.history_ = _checked(node.history, effects, f"{where}.history")
    features.screen_ = features.history_.screen
    features.n_features_in_ = model.n_features_in_ = node.n_features_in
    names_in = node.feature_names_in
    if names_in is not None:
        features.feature_names_in_ = model.feature_names_in_ = np.array(names_in, dtype=object)
        _require(len({*names_in}) == len(names_in) == node.n_features_in, f"{where}.feature_names_in has a name twice")
    _require_columns(features, names_in, where)
    lengths = (len(node.coefficients), len(node.standard_errors) - 1, node.rank <= count, len(node.ranges))
    _require(lengths == (count, count, True, len(effects)), f"{where} has not as many numbers as columns")
    ridge = MergedRidge(node.alpha)
    ridge.coef_, ridge.intercept_ = np.array(node.coefficients, float), node.intercept
    ridge.rank_, ridge.residual_std_, ridge.n_features_in_ = node.rank, node.residual_std, count
    model.pipeline_ = Pipeline([("features", features), ("ridge", ridge)])
    model.alpha_, model.search_, model.washout_ = ridge.alpha, None, node.washout
    model._known_ranges = np.array(node.ranges, float).reshape(-1, 2)
    _require(node.form is None or node.form.is_sound(), f"{where}.form is none of a log")
    model.reading_, model.form_, model.notes_ = node.reading, node.form, tuple(node.notes)
    model._known_standard_errors = np.array(node.standard_errors, float)
    if errors is not None:
        model._known_errors = _errors(errors, node.wider, effects, features.history_)
    record = features.history_.record
    for _ in model._weighed(walk(effects, record, starts=own_starts(record))):
        pass  # what cannot be computed shows here
    return model


def _require(right: bool, wrong: str) -> None:
    if not right:
        raise ModelFileError(wrong)


def _require_columns(features: DiffusiveFeatures, names: list[str] | None, where: str) -> None:
    """Refuse names of X that the model cannot use."""
    fitted, layout = features.history_.record.temperature_name, features.layout()
    needed = [*features.history_.record.columns, *(each for each in (layout.time, layout.run) if each is not None)]
    found = features.thermometers().ambient
    if names is not None:
        missing = [column for column in needed if column not in names]
        _require(not missing, f"{where}.feature_names_in has no {missing[:1]}, which the model needs")
        found = temperature_column(pd.DataFrame(columns=names), layout, quiet=True)
    _require(found in (None, fitted), f"{where} makes {found!r} the temperature, not {fitted!r}")


def _checked(history: History, effects: Sequence[Effect], where: str) -> History:
    """The history, if its counts, orders and states belong together."""
    record, times = history.record, history.record.times
    starts = [segment.start for segment in record.segments]
    stops = [segment.stop for segment in record.segments]
    _require(
        starts == [0, *stops[:-1]] and all(0 < b - a <= HEAD + 1 for a, b in zip(starts, stops, strict=True)),
        f"{where}.record.segments have no such rows",
    )
    n, ticks = stops[-1], np.asarray(times.ticks)
    whole, unit = times.kind != "seconds", 1_000_000_000 // times.per_second
    low, high = (EARLIEST, LATEST) if times.kind.startswith("date") else (-LARGEST, LARGEST)
    _require(
        times.n == n <= history.n_fitted and ticks.shape == (n,) and ticks.dtype == ("int64" if whole else "float64")
        and all(low <= tick * unit <= high for tick in ticks.tolist()) and times.kind == history.kind
        and set(np.flatnonzero(~(np.diff(ticks) > 0)) + 1) <= {*starts} and history.zero == times.stamp(0)
        and type(history.zero) is type(times.stamp(0)),
        f"{where}.record.times are not those of {n} rows",
    )  # fmt: skip
    needed = {record.temperature_name, *needed_columns(list(effects))}
    limits, inputs = within(-LARGEST, LARGEST), {} if history.screen is None else history.screen.inputs
    right = all(values.shape == (n,) and limits.holds(values) for values in record.columns.values())
    right &= needed <= {*record.columns} == {*history.ranges} and {*history.gaps.squares, *inputs} <= {*record.columns}
    _require(right and history.stride == 0, f"{where}.record.columns are not those that are needed")
    for states, _ in zip(history.end_states, record.segments, strict=True):
        for effect, state in zip(effects, states, strict=True):
            check_state(effect, state, f"{where}.end_states")
    return history


def _errors(node: Any, wider: list[WiderNode], own: Sequence[Effect], history: History) -> JointErrors:
    """The errors of a model, wider effects included."""
    effects, ends = list(own), [list(states) for states in history.end_states]
    for each in wider:
        effect, place = each.effect, each.place
        _require(
            type(effect) is type(own[place])
            and effect.inputs() == own[place].inputs()
            and len(each.end_states) == len(ends),
            "$.model.wider is none of the model's effects",
        )
        effects[place] = effect
        for states, state in zip(ends, each.end_states, strict=True):
            check_state(effect, state, "$.model.wider.end_states")
            states[place] = state
    found = JointErrors(
        **read_fields(JointErrors, node, "$.errors"),
        effects=effects,
        history=replace(history, end_states=tuple(ends)),
        own=not wider,
    )
    width = 1 + sum(effect.n_columns() for effect in effects)
    shapes = [found.coef.shape, found.mean.shape, found.half.shape[:1]]
    right = shapes == [(width,), (width,), (width,)]
    _require(right and found.half.ndim == 2 and found.dof > 0, "$.errors have not as many numbers as columns")
    return found
