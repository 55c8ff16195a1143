"""A stream that stops and goes on: the part of a live corrector that is saved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

from ..estimators import DynamicBiasRegressor
from .advance import Stream
from .clock import MovingAverage, Tracker
from .filled import LiveErrors
from .state import StreamPlace, StreamSettings, StreamState, from_json, to_json


class Resumable:
    """State of an `OnlineCorrector`, taken and taken up again."""

    model: DynamicBiasRegressor
    average: MovingAverage | None
    track: Tracker | None
    errors: LiveErrors | None
    continues: bool
    _stream: Stream
    _doubt: StreamState | None
    _placed: bool

    def __init__(self, model: DynamicBiasRegressor, **settings: Any):
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, in another process: a dict for `json.dumps`."""
        average = None if self.average is None else self.average.count
        track = None if self.track is None else self.track.time_constant
        settings = StreamSettings(self.continues, average, track, self.errors is not None)
        place = StreamPlace(self._stream.clock.next_row, self._placed)
        return to_json(self.model, self._stream.effects, settings, place, self._state(), self._doubt)

    @classmethod
    def from_state(cls, model: DynamicBiasRegressor, state: dict[str, Any]) -> Self:
        """Go on where `state` was taken, with the same model.

        Raises
        ------
        ModelFileError
            A ValueError: the state is damaged, or belongs to another model.
        """
        settings, place, now, doubt = from_json(model, state)
        corrector = cls(
            model,
            average=settings.average,
            track=settings.track,
            continues=settings.continues,
            uncertainty=settings.uncertainty,
        )
        corrector.go_on(now, doubt, place)
        return corrector

    def go_on(self, now: StreamState, doubt: StreamState | None = None, place: StreamPlace | None = None) -> None:
        """Go on where a stream stood.

        Parameters
        ----------
        now : StreamState
            What it remembered of its samples.
        doubt : StreamState, optional
            What it remembered before a sample whose time is in doubt.
        place : Place, optional
            Where the next sample stands in a record without times.
        """
        if place is not None:
            self._stream.clock.next_row, self._placed = place
        self._put(now)
        self._doubt = doubt

    def _state(self) -> StreamState:
        averaged = () if self.average is None else tuple(self.average.values)
        tracked = None if self.track is None else (self.track.value, self.track.last)
        return replace(self._stream.state(), averaged=averaged, tracked=tracked)

    def _put(self, state: StreamState) -> None:
        self._stream.put(state)
        if self.average is not None:
            self.average.reset()
            self.average.values.extend(state.averaged)
        if self.track is not None and state.tracked is not None:
            self.track.value, self.track.last = state.tracked
