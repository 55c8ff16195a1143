"""Missing cells of a stream, filled as they come, and what that may move the bias by."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ..estimators import DynamicBiasRegressor
from ..estimators.stand_in import StandIn
from .clock import Clock

Numbers = tuple[tuple[float, ...], ...]
TOGETHER = 256
"""Samples that lack nothing are looked at together: one by one takes seventeen times as long."""
NOTHING = (0.0, 0.0, 0.0)
"""What is said of a sample that has no filled cell, and feels none, where no hole has ended a segment."""


class LiveFilling:
    """Where the filling of a stream stands.

    It counts every sample whose time goes on, those that lack all thermometers too: a stream passes over these.

    Parameters
    ----------
    model : DynamicBiasRegressor
    continues : bool
        Whether the stream may continue the fitted record.
    """

    def __init__(self, model: DynamicBiasRegressor, continues: bool):
        features = model.features_
        self.filling, self.history, self.continues = features.filling_, features.history_, continues
        self.law = model.filling_error()
        self.max_gap = np.inf if self.history.max_gap is None else self.history.max_gap
        self.ranges = [(one.column, *one.range) for one in self.filling.stand_ins]
        self.n_ended = 0
        self.put(None, None, ())

    def put(self, last: Any, run: Any, remembered: Numbers) -> None:
        """Go on where `remembered` was taken, after a sample of this time and run."""
        self._pending: list[tuple[Any, dict[Any, float]]] = []
        self.last, self.run = last, run
        n = len(self.filling.stand_ins)
        self._states = [np.array(each) for each in remembered[:n]] or None
        sizes = [len(law.weights) + 1 for law in self.law.laws]
        felt = zip(remembered[n:], sizes, strict=False)
        self._felt: list[np.ndarray] | None = [np.array(each).reshape(size, size) for each, size in felt] or None

    def state(self, clock: Clock) -> tuple[Any, Any, Numbers]:
        """Time and run of the last sample, and what is remembered: the arguments of `put`."""
        self._catch_up(clock)
        return self.last, self.run, self._remembered()

    def _remembered(self) -> Numbers:
        """What each stand-in remembers, and then the covariance of each column's error with what the lags feel."""
        states = [each.tolist() for each in self._states or ()]
        felt = [each.ravel().tolist() for each in self._felt or ()]
        return tuple(tuple(each) for each in (*states, *felt))

    def widths(self, n_parts: int) -> list[int]:
        """How many numbers stand in each part of what is remembered; without errors where there are fewer parts."""
        if n_parts == len(self.filling.stand_ins):
            return [one.width for one in self.filling.stand_ins]
        return [*(one.width for one in self.filling.stand_ins), *((len(law.weights) + 1) ** 2 for law in self.law.laws)]

    def one(self, stamp: Any, run: Any, values: dict[Any, float], clock: Clock) -> Any:
        """Look at one sample as `rows` does; one that lacks nothing and feels nothing is kept for later."""
        begins = not self._pending and (self.last is None or run != self.run)
        plain = not begins and run == self.run and self._felt is None and stamp > self._newest()
        if plain and all(self._is_plain(one, values[one.column], stamp) for one in self.filling.stand_ins):
            self._pending.append((stamp, values))
            if len(self._pending) == TOGETHER:
                self._catch_up(clock)
            return (0.0, 0.0, self.n_ended)
        arrays = {name: np.array([value]) for name, value in values.items()}
        felt = self.rows(np.array([stamp]), run, arrays, clock)[0].tolist()
        values.update({name: float(value[0]) for name, value in arrays.items()})
        return felt

    def _newest(self) -> Any:
        return self._pending[-1][0] if self._pending else self.last

    @staticmethod
    def _is_plain(one: StandIn, value: float, stamp: Any) -> bool:
        return value - value == 0.0 and not one.limits.reason(value, stamp)

    def _catch_up(self, clock: Clock) -> None:
        """Look at the samples that lack nothing."""
        if self._pending:
            stamps, rows = zip(*self._pending, strict=True)
            self._pending = []
            values = {name: np.array([row[name] for row in rows], float) for name in self.filling.columns}
            self.rows(np.array(stamps), self.run, values, clock)

    def rows(self, stamps: np.ndarray, run: Any, values: dict[Any, np.ndarray], clock: Clock) -> np.ndarray:
        """Fill missing cells of the next samples of one run, in place.

        Returns
        -------
        array of shape (n, 3)
            Standard deviation of the bias by filled cells, 0 where none is felt; 1 where one of the row's own is; and
            how many segments have been ended by holes so far, `n_ended`.
        """
        self._catch_up(clock)
        result = np.zeros((len(stamps), 3))
        result[:, 2] = self.n_ended
        same_run = self.last is not None and run == self.run
        before = np.maximum.accumulate(np.concatenate(([self.last if same_run else stamps[0]], stamps)))[:-1]
        late = stamps <= before
        late[0] &= same_run
        rows = np.flatnonzero(~late)  # the others will be refused
        if not len(rows):
            return result
        steps = np.asarray(clock.between(stamps[rows], before[rows]), float)
        fresh = steps > self.max_gap
        fresh[0] |= not same_run
        if fresh[0]:
            self._states = self._felt = None
            if self.last is None and self.continues:
                end, steps[0] = self.filling.before(self.history, stamps[rows[0]].item(), run)
                self._states = None if end is None else list(end)
        edges = [0, *(np.flatnonzero(fresh[1:]) + 1).tolist(), len(rows)]
        for low, high in pairwise(edges):
            if low:
                self._states = self._felt = None
            result[rows[low:high]] = self._piece(rows[low:high], stamps, steps[low:high], values)
        self.last, self.run = stamps[rows[-1]].item(), run
        return result

    def _piece(
        self, rows: np.ndarray, stamps: np.ndarray, steps: np.ndarray, values: dict[Any, np.ndarray]
    ) -> np.ndarray:
        given = {name: values[name][rows] for name in self.filling.columns}
        believed = self.filling.believed(given, lambda k: stamps[rows[k]].item())
        filled = self.filling.fill(believed, steps, self._states)
        self._states = filled.states
        error = np.zeros(len(rows))
        edges = [0, *(np.flatnonzero(filled.begins[1:]) + 1).tolist(), len(rows)]
        for low, high in pairwise(edges):
            some, gone = ({name: each[low:high] for name, each in of.items()} for of in (filled.values, filled.errors))
            felt = None if filled.begins[low] else self._felt
            error[low:high], self._felt = self.law.of_rows(some, gone, steps[low:high], felt)
        for name in self.filling.columns:
            if name in filled.errors:
                values[name] = np.array(values[name], float)
                values[name][rows] = filled.values[name]
        if not any(each.any() for each in self._felt or ()):
            self._felt = None
        own = np.logical_or.reduce([np.isfinite(each) for each in filled.errors.values()])
        ended = self.n_ended + np.cumsum(filled.begins)
        self.n_ended = int(ended[-1])
        return np.column_stack((error, own, ended))


def outside(ranges: Sequence[tuple[Any, float, float]], values: dict[Any, float]) -> bool:
    """Whether a further column lies outside its fitted range."""
    return any(not low <= values[column] <= high for column, low, high in ranges)
