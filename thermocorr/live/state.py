"""State of a stream, and how it goes on from it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..effects import Effect
from ..estimators import DynamicBiasRegressor
from ..files.codec import (
    ModelFileError,
    counted,
    fields,
    integer,
    items,
    label,
    number,
    numbers,
    pack,
    positive,
    unexpected,
    unpack,
)
from ..files.effect_nodes import EffectCodec, check_state
from ..files.error_nodes import numbers_or_nan
from ..records.gate import AGREED, BELIEVED_AGAIN, EMPTY
from ..records.grammar import LARGEST
from .uncertain import LiveErrors

_MOST_CORRECTED = 1e300
"""Bound of corrected readings, which hold states times coefficients; sums of them are numbers."""
FORMAT = "thermocorr stream 3"
EMPTY_ODD = EMPTY.index(0.0)
"""The number of a gate that is never missing."""


@dataclass(frozen=True, kw_only=True)
class StreamState:
    """A stream between two samples."""

    last: Any = None
    """Stamp of the last sample; None before the first."""
    run: Any = None
    """Label of its run."""
    seen: tuple[Any, ...] = ()
    """Labels of all runs so far."""
    open: bool = False
    """True if a segment goes on: the last sample had all that the effects need."""
    key: int | None = None
    """Fitted segment that it belongs to."""
    segment_zero: Any = 0
    """Stamp of its first sample."""
    states: tuple[Any, ...] = ()
    """State of each effect, where a segment goes on."""
    behind_gap: tuple[tuple[float, ...] | None, ...] = ()
    """Covariance of what the lags of each column feel of gaps, row by row; none where that is forgotten."""
    gates: tuple[tuple[float, ...], ...] = ()
    """What the gate of each input remembers."""
    gated: Any = None
    """Label of the run that the gates judge."""
    doubts: tuple[tuple[int, ...], float] | None = None
    """How each input stands, and when the two courses were apart last [s]; None where there is one course."""
    twin: tuple[Any, ...] | None = None
    """States of the effects with other values in the place of those that were doubted; None where they agree."""
    averaged: tuple[float, ...] = ()
    """Values in the window of the moving average."""
    tracked: tuple[float, float | None] | None = None
    """The tracked reference, and when it was moved last [s]."""


@dataclass(frozen=True)
class StreamSettings:
    """Settings of a stream."""

    continues: bool
    average: int | None
    track: float | None
    uncertainty: bool = False


class StreamPlace(NamedTuple):
    """Position of a stream in a record without times."""

    next_row: int
    sure: bool
    """False until a sample has told; until then rows are counted from the first after the fitted ones."""


def model_mark(model: DynamicBiasRegressor) -> str:
    """Digest that tells models apart: of columns, coefficients and the times of the fitted record."""
    history = model.features_.history_
    said = repr((list(model.features_.get_feature_names_out()), history.kind, history.zero, float(model.intercept_)))
    return hashlib.sha256(said.encode() + model.coef_.astype("<f8").tobytes()).hexdigest()


def to_json(
    model: DynamicBiasRegressor,
    effects: Sequence[Effect],
    settings: StreamSettings,
    place: StreamPlace,
    state: StreamState,
    doubt: StreamState | None,
) -> dict[str, Any]:
    """All of a stream as plain values for `json.dumps`; `effects` are those that its states belong to."""
    return {
        "format": FORMAT,
        "model": model_mark(model),
        "continues": settings.continues,
        "average": settings.average,
        "track": settings.track,
        **({"uncertainty": True} if settings.uncertainty else {}),
        "next_row": place.next_row,
        "placed": place.sure,
        "state": _packed(state, effects),
        "doubt": None if doubt is None else _packed(doubt, effects),
    }


_FIELDS = ("format", "model", "continues", "average", "track", "next_row", "placed", "state", "doubt")
_STATE_FIELDS = tuple(StreamState.__dataclass_fields__)


def from_json(
    model: DynamicBiasRegressor, node: Any
) -> tuple[StreamSettings, StreamPlace, StreamState, StreamState | None]:
    """Settings, place of the next row, state and the state to return to; every value is checked."""
    try:
        node = fields(node, "$", _FIELDS, ("uncertainty",))
        if node["format"] != FORMAT:
            raise unexpected("$.format", repr(node["format"])[:60], repr(FORMAT))
        if node["model"] != model_mark(model):
            raise ModelFileError("it belongs to another model")
        average = None if node["average"] is None else integer(node["average"], "$.average", 1)
        track = None if node["track"] is None else positive(node["track"], "$.track")
        uncertain = "uncertainty" in node and _truth(node, "$", "uncertainty")
        settings = StreamSettings(_truth(node, "$", "continues"), average, track, uncertain)
        effects = LiveErrors(model).effects if uncertain else model.features_.effect_list()
        doubt = None if node["doubt"] is None else _unpacked(node["doubt"], "$.doubt", model, effects, settings)
        state = _unpacked(node["state"], "$.state", model, effects, settings)
        place = StreamPlace(counted(node["next_row"], "$.next_row"), _truth(node, "$", "placed"))
        return settings, place, state, doubt
    except ModelFileError as error:
        raise ModelFileError(
            f"The stream cannot go on from this state: {error}. Start afresh with OnlineCorrector(model)."
        ) from None


def _packed(state: StreamState, effects: Sequence[Effect]) -> dict[str, Any]:
    return {
        "last": state.last,
        "run": pack(state.run, "the label of the run"),
        "seen": [pack(run, "the label of a run") for run in state.seen],
        "open": state.open,
        "key": state.key,
        "segment_zero": state.segment_zero,
        "states": _packed_states(state.states, effects),
        "behind_gap": [None if each is None else list(each) for each in state.behind_gap],
        "gates": [[None if math.isnan(value) else value for value in each] for each in state.gates],
        "gated": pack(state.gated, "the label of the run"),
        "doubts": None if state.doubts is None else [*state.doubts[0], state.doubts[1]],
        "twin": None if state.twin is None else _packed_states(state.twin, effects),
        "averaged": list(state.averaged),
        "tracked": None if state.tracked is None else list(state.tracked),
    }


def _packed_states(states: Sequence[Any], effects: Sequence[Effect]) -> list[Any]:
    pairs = zip(effects, states, strict=False)
    return [pack(inner, f"the state of {effect.label()!r}") for effect, inner in pairs]


def _unpacked_states(node: Any, where: str, effects: Sequence[Effect]) -> tuple[Any, ...]:
    codec, states = EffectCodec(), []
    for i, packed in enumerate(items(node, where, len(effects))):
        states.append(unpack(packed, f"{where}[{i}]", codec.unpack_nested))
        check_state(effects[i], states[-1], f"{where}[{i}]")
    return tuple(states)


def _unpacked(
    node: Any, where: str, model: DynamicBiasRegressor, effects: Sequence[Effect], settings: StreamSettings
) -> StreamState:
    node = fields(node, where, _STATE_FIELDS)
    history = model.features_.history_

    def stamp(key: str) -> Any:
        place = f"{where}.{key}"
        if history.kind == "seconds":
            return number(node[key], place, -LARGEST, LARGEST)
        return counted(node[key], place) if history.kind == "rows" else integer(node[key], place)

    is_open = _truth(node, where, "open")
    if is_open and node["last"] is None:
        raise unexpected(f"{where}.last", "null", "a time")
    states = _unpacked_states(node["states"], f"{where}.states", effects if is_open else ())
    twin = None if node["twin"] is None else _unpacked_states(node["twin"], f"{where}.twin", effects if is_open else ())
    segments = len(history.record.segments)
    averaged = items(node["averaged"], f"{where}.averaged")
    if len(averaged) > (settings.average or 0):
        raise unexpected(f"{where}.averaged", f"{len(averaged)} values", f"at most {settings.average or 0}")
    return StreamState(
        last=None if node["last"] is None else stamp("last"),
        run=label(unpack(node["run"], f"{where}.run"), f"{where}.run"),
        seen=tuple(
            label(unpack(run, f"{where}.seen"), f"{where}.seen") for run in items(node["seen"], f"{where}.seen")
        ),
        open=is_open,
        key=None if node["key"] is None else integer(node["key"], f"{where}.key", 0, segments - 1),
        segment_zero=stamp("segment_zero") if is_open else 0,
        states=states,
        behind_gap=_behind_gap(node["behind_gap"], f"{where}.behind_gap", model),
        gates=_gates(node["gates"], f"{where}.gates", model),
        gated=label(unpack(node["gated"], f"{where}.gated"), f"{where}.gated"),
        doubts=None if twin is None else _doubts(node["doubts"], f"{where}.doubts", model),
        twin=twin,
        averaged=tuple(_corrected(value, f"{where}.averaged[{i}]") for i, value in enumerate(averaged)),
        tracked=_tracked(node["tracked"], f"{where}.tracked", settings),
    )


def _inputs(model: DynamicBiasRegressor) -> int:
    """Number of inputs with a gate."""
    screen = model.features_.history_.screen
    return 0 if screen is None else sum(one.motion is not None for one in screen.inputs.values())


def _doubts(node: Any, where: str, model: DynamicBiasRegressor) -> tuple[tuple[int, ...], float]:
    *stands, apart = items(node, where, _inputs(model) + 1)
    found = tuple(integer(value, f"{where}[{i}]", AGREED, BELIEVED_AGAIN) for i, value in enumerate(stands))
    return found, number(apart, f"{where}[{len(stands)}]", -LARGEST, LARGEST)


def _gates(node: Any, where: str, model: DynamicBiasRegressor) -> tuple[tuple[float, ...], ...]:
    if node == []:
        return ()
    found = []
    for i, each in enumerate(items(node, where, _inputs(model))):
        found.append(tuple(numbers_or_nan(each, f"{where}[{i}]", len(EMPTY))))
        if found[-1][EMPTY_ODD] != found[-1][EMPTY_ODD]:
            raise unexpected(f"{where}[{i}][{EMPTY_ODD}]", "null", "a number")
    return tuple(found)


def _behind_gap(node: Any, where: str, model: DynamicBiasRegressor) -> tuple[tuple[float, ...] | None, ...]:
    if node == []:
        return ()
    laws = model._gap_error().laws
    return tuple(
        None
        if each is None
        else tuple(numbers(each, f"{where}[{i}]", len(law.weights) ** 2, -LARGEST, LARGEST).tolist())
        for i, (each, law) in enumerate(zip(items(node, where, len(laws)), laws, strict=True))
    )


def _tracked(node: Any, where: str, settings: StreamSettings) -> tuple[float, float | None] | None:
    if settings.track is None:
        return None
    value, last = items(node, where, 2)
    moved = None if last is None else number(last, f"{where}[1]", -LARGEST, LARGEST)
    return _corrected(value, f"{where}[0]"), moved


def _corrected(value: Any, where: str) -> float:
    return number(value, where, -_MOST_CORRECTED, _MOST_CORRECTED)


def _truth(node: dict[str, Any], where: str, key: str) -> bool:
    value = node[key]
    if value is True or value is False:
        return value
    raise unexpected(f"{where}.{key}", repr(value)[:60], "true or false")
