"""Uncertainties, gaps, screen and reading of a model as JSON and back."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ..effects import InitialTransient, LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import ThermalLag
from ..estimators.reading import Reading, unit_by_size
from ..estimators.uncertainty.joint import JointErrors, NoiseModel
from ..records import History
from ..records.gaps import Gaps
from ..records.gate import Motion
from ..records.grammar import LARGEST
from ..records.screen import MOST_KEPT, Limits, Screen
from .codec import (
    LARGEST_INTEGER,
    ModelFileError,
    fields,
    integer,
    items,
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

MOST_CODES = 2 * MOST_KEPT


_MOTION = ("low", "high", "spread", "farthest", "rest", "step")


def pack_screen(screen: Screen) -> dict[str, Any]:
    """Screen of each input and of the reading as JSON; a spike is its time stamp and its value."""
    inputs = [
        {"column": pack(column, "a column's name"), **pack_limits(each)} for column, each in screen.inputs.items()
    ]
    return {"inputs": inputs, "reading": pack_limits(screen.reading)}


def pack_limits(limits: Limits) -> dict[str, Any]:
    """Limits of one quantity as JSON."""
    spikes = [[stamp, value] for stamp, value in limits.spikes.items()]
    motion = None if limits.motion is None else {name: getattr(limits.motion, name) for name in _MOTION}
    return {"middle": limits.middle, "codes": list(limits.codes), "spikes": spikes, "motion": motion}


def unpack_screen(node: Any, where: str, columns: Collection[Any]) -> Screen:
    """The screen, every number checked; the model reads these columns."""
    node = fields(node, where, ("inputs", "reading"))
    inputs = {}
    for i, item in enumerate(items(node["inputs"], f"{where}.inputs", len(columns))):
        place = f"{where}.inputs[{i}]"
        if not isinstance(item, dict) or "column" not in item:
            raise ModelFileError(f"{place} has no 'column'")
        column = name(unpack(item["column"], f"{place}.column"), f"{place}.column")
        if column not in columns or column in inputs:
            raise ModelFileError(f"{place}.column is {column!r}, which the model does not read, or twice")
        inputs[column] = unpack_limits({key: value for key, value in item.items() if key != "column"}, place)
    return Screen(inputs=inputs, reading=unpack_limits(node["reading"], f"{where}.reading"))


def unpack_limits(node: Any, where: str) -> Limits:
    """Limits of one quantity, checked."""
    node = fields(node, where, ("middle", "codes", "spikes", "motion"))
    codes = [number(code, f"{where}.codes[{i}]") for i, code in enumerate(items(node["codes"], f"{where}.codes"))]
    if len(codes) > MOST_CODES or any(abs(code) > LARGEST for code in codes):
        raise unexpected(f"{where}.codes", f"{len(codes)} codes", f"at most {MOST_CODES}, none beyond {LARGEST:g}")
    spikes = {}
    for i, item in enumerate(items(node["spikes"], f"{where}.spikes")):
        place = f"{where}.spikes[{i}]"
        stamp, value = items(item, place, 2)
        if type(stamp) is int:
            if abs(stamp) > LARGEST_INTEGER:
                raise unexpected(f"{place}[0]", str(stamp)[:60], "a time")
        else:
            number(stamp, f"{place}[0]")
        spikes[stamp] = number(value, f"{place}[1]")
    if len(spikes) > MOST_KEPT:
        raise unexpected(f"{where}.spikes", f"{len(spikes)} spikes", f"at most {MOST_KEPT}")
    motion = None if node["motion"] is None else _motion(node["motion"], f"{where}.motion")
    return Limits(middle=number(node["middle"], f"{where}.middle"), codes=tuple(codes), spikes=spikes, motion=motion)


def _motion(node: Any, where: str) -> Motion:
    """Motion of an input, checked."""
    node = fields(node, where, _MOTION)
    low, high = (number(node[key], f"{where}.{key}", -LARGEST, LARGEST) for key in ("low", "high"))
    if low > high:
        raise unexpected(f"{where}.low", f"{low} above {high}", "the lower end of the range")
    spread, farthest, rest = (
        number(node[key], f"{where}.{key}", 0.0, LARGEST) for key in ("spread", "farthest", "rest")
    )
    return Motion(low, high, spread, farthest, rest, positive(node["step"], f"{where}.step"))


_READING = tuple(n for n in Reading.__dataclass_fields__ if n not in ("unit_named", "temperature_gaps"))


def pack_reading(reading: Reading) -> dict[str, Any]:
    """Names, units and ranges; a unit that the record did not name is none."""
    unit = reading.temperature_unit if reading.unit_named else ""
    node = {**asdict(reading), "temperature_unit": unit, "temperature_range": list(reading.temperature_range)}
    gaps = [list(gap) for gap in reading.temperature_gaps]
    return {name: node[name] for name in _READING} | ({"temperature_gaps": gaps} if gaps else {})


def unpack_reading(node: Any, where: str) -> Reading:
    """Names, units and ranges, checked."""
    node = fields(node, where, _READING, ("temperature_gaps",))
    low, high = _range(node["temperature_range"], f"{where}.temperature_range")
    gaps = items(node.get("temperature_gaps", []), f"{where}.temperature_gaps")
    unit = text(node["temperature_unit"], f"{where}.temperature_unit")
    return Reading(
        name=text(node["name"], f"{where}.name"),
        unit=text(node["unit"], f"{where}.unit"),
        temperature_unit=unit or unit_by_size(low),
        unit_named=bool(unit),
        n_readings=integer(node["n_readings"], f"{where}.n_readings", 1),
        mean=number(node["mean"], f"{where}.mean"),
        std=number(node["std"], f"{where}.std", 0.0),
        temperature_range=(low, high),
        temperature_gaps=tuple(_range(gap, f"{where}.temperature_gaps[{i}]") for i, gap in enumerate(gaps)),
    )


def _range(node: Any, where: str) -> tuple[float, float]:
    low, high = (number(value, f"{where}[{i}]") for i, value in enumerate(items(node, where, 2)))
    if low > high:
        raise unexpected(where, f"{low} above {high}", "the lower one first")
    return low, high


def pack_gaps(gaps: Gaps) -> dict[str, Any]:
    """Gaps as JSON: the least step of one, and the structure function of each column."""
    return {
        "least": gaps.least,
        "lags": gaps.lags.tolist(),
        "columns": [
            {"name": pack(column, "a column's name"), "squares": squares.tolist()}
            for column, squares in gaps.squares.items()
        ],
    }


def unpack_gaps(node: Any, where: str, columns: Collection[Any]) -> Gaps | None:
    """Gaps from JSON, every number checked, for these columns; None where there are none."""
    if node is None:
        return None
    node = fields(node, where, ("least", "lags", "columns"))
    lags = numbers(node["lags"], f"{where}.lags", low=0.0)
    if not len(lags) or lags[0] != 0 or (np.diff(lags) <= 0).any():
        raise unexpected(f"{where}.lags", "other times", "0 first, and then increasing times")
    squares: dict[Any, np.ndarray] = {}
    for i, item in enumerate(items(node["columns"], f"{where}.columns", len(columns))):
        place = f"{where}.columns[{i}]"
        item = fields(item, place, ("name", "squares"))
        column = name(unpack(item["name"], f"{place}.name"), f"{place}.name")
        if column not in columns or column in squares:
            raise ModelFileError(f"{place}.name is {column!r}, which the model does not keep, or twice")
        squares[column] = numbers(item["squares"], f"{place}.squares", len(lags), 0.0)
    return Gaps(positive(node["least"], f"{where}.least"), lags, squares)


def numbers_or_nan(node: Any, where: str, length: int) -> list[float]:
    """Numbers of a given count, NaN for null."""
    values = items(node, where, length)
    return [
        np.nan if value is None else number(value, f"{where}[{k}]", -LARGEST, LARGEST) for k, value in enumerate(values)
    ]


_ERRORS = (
    "wider", "coef", "half", "dof", "usual", "mean", "noise", "last", "end", "last_segment", "representation",
)  # fmt: skip
_NOISE = tuple(NoiseModel.__dataclass_fields__)


def pack_errors(joint: JointErrors, own: Sequence[Effect], codec: EffectCodec) -> dict[str, Any]:
    """Everything but what the model has itself: its `own` effects, and the history."""
    noise = joint.noise
    wider = [i for i, effect in enumerate(joint.effects) if all(effect is not each for each in own)]
    return {
        "wider": [_pack_wider(i, joint, codec) for i in wider],
        "coef": pack(joint.coef, "the best coefficients"),
        "half": pack(joint.half, "their covariance"),
        "dof": _finite(joint.dof),
        "usual": joint.usual,
        "mean": pack(joint.mean, "the columns' means"),
        "noise": {
            **{name: pack(getattr(noise, name), "the noise") for name in _NOISE},
            "white_dof": _finite(noise.white_dof),
            "wander_dof": _finite(noise.wander_dof),
        },
        "last": pack(joint.last, "errors at the record's end"),
        "end": joint.end,
        "last_segment": joint.last_segment,
        "representation": joint.representation,
    }


def unpack_errors(
    node: Any, where: str, effects: list[Effect], history: History, codec: EffectCodec
) -> JointErrors | None:
    """The errors, every number checked; None for a model that does not know them."""
    if node is None:
        return None
    node = fields(node, where, _ERRORS)
    wider = items(node["wider"], f"{where}.wider")
    for i, item in enumerate(wider):
        effects, history = _unpack_wider(item, f"{where}.wider[{i}]", effects, history, codec)
    width = 1 + sum(effect.n_columns() for effect in effects)
    noise = _unpack_noise(node["noise"], f"{where}.noise")
    return JointErrors(
        effects=effects,
        history=history,
        own=not wider,
        coef=_vector(node, "coef", where, width),
        half=_matrix(node, "half", where, width),
        dof=_dof(node, "dof", where),
        usual=number(node["usual"], f"{where}.usual", 0.0, LARGEST**2),
        mean=_vector(node, "mean", where, width),
        noise=noise,
        last=_matrix(node, "last", where, width, len(noise.wander)),
        end=number(node["end"], f"{where}.end", 0.0, LARGEST),
        last_segment=integer(node["last_segment"], f"{where}.last_segment", 0, len(history.record.segments) - 1),
        representation=number(node["representation"], f"{where}.representation", 0.0, LARGEST),
    )


def _pack_wider(at: int, joint: JointErrors, codec: EffectCodec) -> dict[str, Any]:
    """An effect that stands for one of the model with more time constants."""
    what = f"the wider {joint.effects[at].label()!r}"
    ends = [pack(states[at], f"the state of {what}", codec.pack_learned) for states in joint.history.end_states]
    return {"place": at, "effect": codec.pack(joint.effects[at], what, learned=True), "end_states": ends}


def _unpack_wider(
    node: Any, where: str, effects: list[Effect], history: History, codec: EffectCodec
) -> tuple[list[Effect], History]:
    """Effects and history with one effect, and its states, in the place of the model's."""
    node = fields(node, where, ("place", "effect", "end_states"))
    at = integer(node["place"], f"{where}.place", 0, len(effects) - 1)
    wide = codec.unpack(node["effect"], f"{where}.effect", learned=True)
    alike = type(wide) is type(effects[at]) and wide.inputs() == effects[at].inputs()
    if not (alike and isinstance(wide, ThermalLag | InitialTransient | LaggedCovariate)):
        raise unexpected(f"{where}.effect", type(wide).__name__, f"another {type(effects[at]).__name__}")
    given = items(node["end_states"], f"{where}.end_states", len(history.end_states))
    ends = []
    for i, (state, states) in enumerate(zip(given, history.end_states, strict=True)):
        found = unpack(state, f"{where}.end_states[{i}]", codec.unpack_nested)
        check_state(wide, found, f"{where}.end_states[{i}]")
        ends.append([*states[:at], found, *states[at + 1 :]])
    return [*effects[:at], wide, *effects[at + 1 :]], replace(history, end_states=tuple(ends))


def _unpack_noise(node: Any, where: str) -> NoiseModel:
    node = fields(node, where, _NOISE)
    wander = _vector(node, "wander", where)
    sizes = _vector(node, "sizes", where)
    times, moments = (
        _vector(node, "correlation_times", where, len(wander)),
        _vector(node, "size_seconds", where, len(sizes)),
    )
    if (wander < 0).any() or (times <= 0).any() or (sizes <= 0).any() or (np.diff(moments) <= 0).any():
        raise unexpected(where, "numbers", "variances, times and sizes above zero, moments in order")
    return NoiseModel(
        white=number(node["white"], f"{where}.white", 0.0, LARGEST**2),
        recent=number(node["recent"], f"{where}.recent", 0.0, LARGEST),
        wander=wander,
        correlation_times=times,
        white_dof=_dof(node, "white_dof", where),
        wander_dof=_dof(node, "wander_dof", where),
        size_seconds=moments,
        sizes=sizes,
    )


def _finite(dof: float) -> float | None:
    return float(dof) if np.isfinite(dof) else None


def _dof(node: dict[str, Any], key: str, where: str) -> float:
    return np.inf if node[key] is None else positive(node[key], f"{where}.{key}")


def _vector(node: dict[str, Any], key: str, where: str, length: int | None = None) -> np.ndarray:
    return vector(unpack(node[key], f"{where}.{key}"), f"{where}.{key}", length, LARGEST**2)


def _matrix(node: dict[str, Any], key: str, where: str, rows: int, columns: int | None = None) -> np.ndarray:
    place = f"{where}.{key}"
    found = unpack(node[key], place)
    right = isinstance(found, np.ndarray) and found.ndim == 2 and found.dtype == np.float64
    if not right or found.shape != (rows, found.shape[1] if columns is None else columns):
        raise unexpected(place, repr(node[key])[:60], f"a table of {rows} rows")
    vector(found.ravel(), place, most=LARGEST**2)
    return np.asarray(found)
