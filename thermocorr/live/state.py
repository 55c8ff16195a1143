"""State of a stream, to continue from."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from ..effects import Effect
from ..model import DynamicBiasRegressor
from ..output.codec import ModelFileError, read, write
from ..output.effect_nodes import EffectCodec, check_state
from ..records.gate import ACCEPTED_AGAIN, AGREED, EMPTY
from ..records.types import LARGEST, Counted, Large, Loose, Number, Positive, RunLabel, Stamp, within
from .samples import LiveErrors

Stand = Annotated[int, within(AGREED, ACCEPTED_AGAIN)]
Time = Annotated[Stamp, within(-LARGEST, LARGEST)]


@dataclass(frozen=True, kw_only=True)
class StreamState:
    """A stream between two samples."""

    last: Time | None = None
    """Stamp of the last sample; None before the first."""
    run: RunLabel = None
    """Label of its run."""
    seen: tuple[RunLabel, ...] = ()
    """Labels of all runs so far."""
    open: bool = False
    """True if a segment goes on: the last sample had all that the effects need."""
    key: Counted | None = None
    """Fitted segment that it belongs to."""
    segment_zero: Time = 0
    """Stamp of its first sample."""
    states: tuple[Any, ...] = ()
    """State of each effect, where a segment goes on."""
    behind_gap: tuple[tuple[Number, ...] | None, ...] = ()
    """Covariance of what the lags of each column feel of gaps, row by row; none where that is forgotten."""
    gates: tuple[tuple[Loose, ...], ...] = ()
    """What the gate of each input remembers."""
    gated: RunLabel = None
    """Label of the run that the gates judge."""
    doubts: tuple[tuple[Stand, ...], Loose] | None = None
    """How each input stands, and when the two courses were apart last [s]; None where there is one course."""
    twin: tuple[Any, ...] | None = None
    """States of the effects with other values in the place of those that were doubted; None where they agree."""
    averaged: tuple[Large, ...] = ()
    """Values in the window of the moving average."""
    tracked: tuple[Large, Number | None] | None = None
    """The tracked reference, and when it was moved last [s]."""


@dataclass(frozen=True, kw_only=True)
class StreamFile:
    """A stream's settings, state and previous state."""

    format: Literal["thermocorr stream 3"] = "thermocorr stream 3"
    model: str
    """`model_mark` of its model."""
    continues: bool
    average: Annotated[int, within(1, 1 << 24)] | None
    track: Positive | None
    uncertainty: bool
    next_row: Counted
    placed: bool
    """False until a sample has shown; until then rows are counted from the first after the fitted ones."""
    state: StreamState
    doubt: StreamState | None


def model_mark(model: DynamicBiasRegressor) -> str:
    """Digest that tells models apart."""
    history = model.features_.history_
    said = repr((list(model.features_.get_feature_names_out()), history.kind, history.zero, float(model.intercept_)))
    return hashlib.sha256(said.encode() + model.coef_.astype("<f8").tobytes()).hexdigest()


def to_json(stream: StreamFile) -> dict[str, Any]:
    """All of a stream as plain values for `json.dumps`."""
    node: dict[str, Any] = write(StreamFile, stream, "the stream")
    return node


def from_json(model: DynamicBiasRegressor, node: Any) -> StreamFile:
    """The stream that `to_json` wrote, checked."""
    try:
        found: StreamFile = read(StreamFile, node, "$", EffectCodec().unpack)
        _require(found.model == model_mark(model), "it belongs to another model")
        effects = LiveErrors(model).effects if found.uncertainty else model.features_.effect_list()
        for state in (found.state, found.doubt):
            if state is not None:
                _check(state, model, effects, found)
        _require(to_json(found) == node, "it is not as thermocorr writes it")
    except (ModelFileError, ValueError, TypeError) as error:
        raise ModelFileError(
            f"The stream cannot go on from this state: {error}. Start afresh with OnlineCorrector(model)."
        ) from None
    return found


def _check(state: StreamState, model: DynamicBiasRegressor, effects: Sequence[Effect], stream: StreamFile) -> None:
    """Refuse a state that does not fit the model."""
    history = model.features_.history_
    inputs = 0 if history.screen is None else sum(one.motion is not None for one in history.screen.inputs.values())
    kind = float if history.kind == "seconds" else int
    stamps: list[Any] = [state.last] * (state.last is not None) + [state.segment_zero] * state.open
    laws, segments = len(state.behind_gap), len(history.record.segments)
    widths = [None if each is None else len(each) for each in state.behind_gap]
    wanted = [len(law.weights) ** 2 for law in model._gap_error().laws] if laws else []
    twin, n = state.twin, len(effects) if state.open else 0
    for right, what in (
        (all(type(stamp) is kind for stamp in stamps) and (state.last is not None or not state.open), "last"),
        (history.kind != "rows" or all(0 <= stamp < 1 << 53 for stamp in stamps), "last, or segment_zero,"),
        (state.key is None or state.key < segments, "key"),
        (len(state.states) == n and len(twin or state.states) == n, "states"),
        (
            (state.doubts is not None) == (twin is not None) and len((state.doubts or ([0] * inputs,))[0]) == inputs,
            "doubts",
        ),
        (not state.gates or [len(gate) for gate in state.gates] == [len(EMPTY)] * inputs, "gates"),
        (all(gate[3] == gate[3] for gate in state.gates), "gates"),  # the one number that is never missing
        (len(widths) == len(wanted) and all(a in (None, b) for a, b in zip(widths, wanted, strict=True)), "behind_gap"),
        (len(state.averaged) <= (stream.average or 0), "averaged"),
        ((state.tracked is None) == (stream.track is None), "tracked"),
    ):
        _require(right, f"$.state.{what} does not fit the model")
    for states in (state.states, twin or ()):
        for effect, one in zip(effects, states, strict=False):
            check_state(effect, one, "$.state.states")


def _require(right: bool, wrong: str) -> None:
    if not right:
        raise ModelFileError(wrong)
