"""Joint errors of a fitted model and its noise, as JSON and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..effects import InitialTransient, LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import ThermalLag
from ..estimators.uncertainty.beyond import Beyond
from ..estimators.uncertainty.joint import JointErrors
from ..estimators.uncertainty.noise_model import NoiseModel
from ..records import History
from ..records.grammar import LARGEST
from .codec import fields, integer, items, number, pack, positive, unexpected, unpack, vector
from .effect_nodes import EffectCodec, check_state

_ERRORS = (
    "wider", "coef", "half", "dof", "usual", "mean", "noise", "last", "end", "last_segment", "representation", "beyond",
)  # fmt: skip
_NOISE = (
    "white", "recent", "wander", "correlation_times", "white_dof", "wander_dof", "size_seconds", "sizes",
)  # fmt: skip
MOST_POWER = 12
"""Highest power of the static law that a file may speak of."""


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
            "white": noise.white,
            "recent": noise.recent,
            "wander": pack(noise.wander, "the wandering noise"),
            "correlation_times": pack(noise.correlation_times, "its correlation times"),
            "white_dof": _finite(noise.white_dof),
            "wander_dof": _finite(noise.wander_dof),
            "size_seconds": pack(noise.size_seconds, "times of the noise"),
            "sizes": pack(noise.sizes, "sizes of the noise"),
        },
        "last": pack(joint.last, "errors at the record's end"),
        "end": joint.end,
        "last_segment": joint.last_segment,
        "representation": joint.representation,
        "beyond": joint.beyond
        and {
            "power": joint.beyond.power,
            "size": joint.beyond.size,
            "weights": pack(joint.beyond.weights, "the temperatures inside the device"),
            "alike": pack(joint.beyond.alike, "what is like the next power"),
            "lowest": pack(joint.beyond.lowest, "their lowest values"),
            "highest": pack(joint.beyond.highest, "their highest values"),
        },
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
        beyond=None if node["beyond"] is None else _unpack_beyond(node["beyond"], f"{where}.beyond", width - 1),
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


def _unpack_beyond(node: Any, where: str, width: int) -> Beyond:
    node = fields(node, where, ("power", "size", "weights", "alike", "lowest", "highest"))
    power = integer(node["power"], f"{where}.power", 2, MOST_POWER)
    size = number(node["size"], f"{where}.size", 0.0, LARGEST**2)
    if (
        node["lowest"] is None
    ):  # of a file that asks the temperature which the device acts by, where the measured is out
        weights = np.eye(1, width)[0] if node["weights"] is None else _vector(node, "weights", where, width)
        alike, ever = _vector(node, "alike", where, power), np.array([LARGEST])
        return Beyond(power=power, size=size, weights=weights[None], alike=alike[None], lowest=-ever, highest=ever)
    lowest = _vector(node, "lowest", where)
    return Beyond(
        power=power,
        size=size,
        weights=_matrix(node, "weights", where, len(lowest), width),
        alike=_matrix(node, "alike", where, len(lowest), power),
        lowest=lowest,
        highest=_vector(node, "highest", where, len(lowest)),
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
