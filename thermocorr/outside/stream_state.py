"""A live corrector's state as plain JSON values, and back."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

from ..estimators import DynamicBiasRegressor
from .codec import ModelFileError, fields, integer, items, label, number, pack, positive, unexpected, unpack
from .effect_nodes import EffectCodec, check_state

if TYPE_CHECKING:
    from .online import OnlineCorrector

FORMAT = "thermocorr stream 1"
_FIELDS = (
    "format", "model", "continues", "average", "track", "last", "next_row", "run", "seen", "open", "segment",
    "segment_zero", "states", "averaged", "tracked",
)  # fmt: skip


def model_mark(model: DynamicBiasRegressor) -> str:
    """What tells models apart: a digest of columns, coefficients and where the fitted record stands in time."""
    history = model.features_.history_
    said = repr((list(model.features_.get_feature_names_out()), history.kind, history.zero, float(model.intercept_)))
    return hashlib.sha256(said.encode() + model.coef_.astype("<f8").tobytes()).hexdigest()


def stored(corrector: OnlineCorrector) -> dict[str, Any]:
    """The state of a corrector between two samples."""
    sample, average, track = corrector._sample, corrector.average, corrector.track
    open_ = corrector._open
    return {
        "format": FORMAT,
        "model": model_mark(corrector.model),
        "continues": corrector.continues,
        "average": None if average is None else average.count,
        "track": None if track is None else track.time_constant,
        "last": corrector._last,
        "next_row": corrector._clock.next_row,
        "run": pack(corrector._run, "the label of the run"),
        "seen": [pack(run, "the label of a run") for run in corrector._seen],
        "open": open_,
        "segment": sample.key if open_ else None,
        "segment_zero": sample.segment_zero if open_ else 0,
        "states": [
            pack(stepper.state(), f"the state of {effect.label()!r}")
            for effect, stepper in zip(corrector._effects, corrector._steppers, strict=True)
        ]
        if open_
        else [],
        "averaged": [] if average is None else list(average.values),
        "tracked": None if track is None else [track.value, track.last],
    }


def restore(cls: type[OnlineCorrector], model: DynamicBiasRegressor, state: Any) -> OnlineCorrector:
    """A corrector that goes on where `state` was taken; every value is checked."""
    try:
        return _restored(cls, model, state)
    except ModelFileError as error:
        raise ModelFileError(
            f"The stream cannot go on from this state: {error}. Start afresh with OnlineCorrector(model)."
        ) from None


def _restored(cls: type[OnlineCorrector], model: DynamicBiasRegressor, state: Any) -> OnlineCorrector:
    node = fields(state, "$", _FIELDS)
    if node["format"] != FORMAT:
        raise unexpected("$.format", repr(node["format"])[:60], repr(FORMAT))
    if node["model"] != model_mark(model):
        raise ModelFileError("it belongs to another model")
    average = None if node["average"] is None else integer(node["average"], "$.average", 1)
    track = None if node["track"] is None else positive(node["track"], "$.track")
    for key in ("continues", "open"):
        if type(node[key]) is not bool:
            raise unexpected(f"$.{key}", repr(node[key])[:60], "true or false")
    corrector = cls(model, average=average, track=track, continues=node["continues"])
    corrector._last = None if node["last"] is None else _stamp(corrector, node["last"], "$.last")
    corrector._clock.next_row = integer(node["next_row"], "$.next_row", 0)
    corrector._run = label(unpack(node["run"], "$.run"), "$.run")
    corrector._seen = [label(unpack(run, "$.seen"), "$.seen") for run in items(node["seen"], "$.seen")]
    if node["open"]:
        _open(corrector, node)
    if corrector.average is not None:
        values = items(node["averaged"], "$.averaged")
        corrector.average.values.extend(number(value, f"$.averaged[{i}]") for i, value in enumerate(values))
    if corrector.track is not None:
        value, last = items(node["tracked"], "$.tracked", 2)
        corrector.track.value = number(value, "$.tracked[0]")
        corrector.track.last = None if last is None else number(last, "$.tracked[1]")
    return corrector


def _open(corrector: OnlineCorrector, node: dict[str, Any]) -> None:
    codec, sample = EffectCodec(), corrector._sample
    segments = len(corrector._history.record.segments)
    if corrector._last is None:
        raise unexpected("$.last", "null", "a time")
    sample.key = None if node["segment"] is None else integer(node["segment"], "$.segment", 0, segments - 1)
    sample.segment_zero = _stamp(corrector, node["segment_zero"], "$.segment_zero")
    for i, packed in enumerate(items(node["states"], "$.states", len(corrector._effects))):
        state = unpack(packed, f"$.states[{i}]", codec.unpack_nested)
        check_state(corrector._effects[i], state, f"$.states[{i}]")
        corrector._steppers[i].start(state)
    corrector._open = True


def _stamp(corrector: OnlineCorrector, value: Any, where: str) -> float:
    return number(value, where) if corrector._clock.kind == "seconds" else integer(value, where)
