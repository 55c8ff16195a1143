"""Uncertainties of a stream: of its corrected readings, and of cells that are filled."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..equations import MovingAverage
from ..estimators import DynamicBiasRegressor
from ..estimators.uncertainty.joint import ErrorWalk
from ..records import History
from .clock import Clock


class LiveErrors:
    """Standard uncertainties of corrected readings: those of `DynamicBiasRegressor.correct` with ``return_std=True``.

    A model that has searched its time constants carries the lags of the whole spectrum beside its own.

    `model` (DynamicBiasRegressor): Fitted.
    """

    def __init__(self, model: DynamicBiasRegressor):
        self.joint = joint = model._joint_errors()
        self._walk = ErrorWalk(model, joint, removed=True)
        own, history = model.features_.effect_list(), model.features_.history_
        more = [i for i, effect in enumerate(joint.effects) if all(effect is not each for each in own)]
        self.effects = [*own, *(joint.effects[i] for i in more)]
        """Effects of the model, and what its errors need beside them."""
        ends = zip(history.end_states, joint.history.end_states, strict=True)
        self.history: History = replace(
            history, end_states=tuple([*states, *(wide[i] for i in more)] for states, wide in ends)
        )
        """The fitted record, with the states of all these effects."""
        edges = np.cumsum([0, *(effect.n_columns() for effect in self.effects)])
        place = {
            id(effect): range(low, high) for effect, (low, high) in zip(self.effects, pairwise(edges), strict=True)
        }
        self._columns = [column for effect in joint.effects for column in place[id(effect)]]
        self._mean_variances: dict[int, float] = {}

    def variances(
        self, columns: np.ndarray, seconds: np.ndarray, temperature: np.ndarray, bias: np.ndarray, key: int | None
    ) -> np.ndarray:
        """Variance of the bias (less what it shares with the noise), and of the noise over its usual one, shape (2, n).

        `columns` are those of all `effects`, shape (n, p); `key` is the fitted segment that the rows belong to.
        """
        errors = self._walk.errors(columns[:, self._columns], seconds, temperature, bias, key)
        return np.stack((errors.bias - 2 * errors.shared, errors.noise))

    def u(self, variances: np.ndarray, count: int = 1) -> np.ndarray:
        """Standard uncertainty of corrected readings, or of the mean of the last `count`, shape (n,).

        The bias of a mean is taken to be as sure as that of its last reading.
        """
        noise = self.joint.noise.variance if count == 1 else self._mean_variance(count)
        return np.asarray(np.sqrt(np.maximum(variances[0] + noise * variances[1], 0.0)))

    def of_block(
        self, variances: np.ndarray, corrected: np.ndarray, average: MovingAverage | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Standard uncertainties of a block's corrected readings, and of their moving averages, before these go on."""
        variances[:, np.isnan(corrected)] = np.nan
        of_mean = np.full(len(corrected), np.nan)
        if average is not None:
            counts = np.minimum(np.cumsum(np.isfinite(corrected)) + len(average.values), average.count)
            for count in np.unique(counts).tolist():
                of_mean[counts == count] = self.u(variances[:, counts == count], max(count, 1))
        return self.u(variances), of_mean

    def _mean_variance(self, count: int) -> float:
        """Variance of the mean noise of that many readings, a usual step apart."""
        if count not in self._mean_variances:
            noise = replace(self.joint.noise, size_seconds=np.zeros(0), sizes=np.zeros(0))
            self._mean_variances[count] = sum(noise.of_mean(np.arange(count) * self.history.usual_step))
        return self._mean_variances[count]


Numbers = tuple[tuple[float, ...], ...]
NOTHING = (0.0, 0.0, 0.0, 0.0)
"""What is said of a sample that has no filled cell, and feels none, where no hole has ended a segment."""


class LiveFilling:
    """State of the imputation in a stream.

    It counts every sample whose time goes on, those that lack all thermometers too: a stream passes over these.

    `model` (DynamicBiasRegressor). `continues` (bool): Whether the stream may continue the fitted record.
    """

    def __init__(self, model: DynamicBiasRegressor, continues: bool):
        features = model.features_
        self.filling, self.history, self.continues = features.filling_, features.history_, continues
        self.law = model._filling_error()
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
        """State of each stand-in, then the covariance of each column's error with the lags."""
        states = [each.tolist() for each in self._states or ()]
        felt = [each.ravel().tolist() for each in self._felt or ()]
        return tuple(tuple(each) for each in (*states, *felt))

    def widths(self, n_parts: int) -> list[int]:
        """Number of values in each part of the state; without errors where there are fewer parts."""
        if n_parts == len(self.filling.stand_ins):
            return [one.width for one in self.filling.stand_ins]
        return [*(one.width for one in self.filling.stand_ins), *((len(law.weights) + 1) ** 2 for law in self.law.laws)]

    def one(self, stamp: Any, run: Any, values: dict[Any, float], clock: Clock) -> Any:
        """Look at one sample as `rows` does; one that lacks nothing and feels nothing is kept for later."""
        begins = not self._pending and (self.last is None or run != self.run)
        plain = (
            not begins
            and run == self.run
            and self._felt is None
            and stamp > (self._pending[-1][0] if self._pending else self.last)
        )
        given = [(values[one.column], one.limits) for one in self.filling.stand_ins]
        if plain and all(math.isfinite(value) and not limits.reason(value, stamp) for value, limits in given):
            self._pending.append((stamp, values))
            # Samples that lack nothing are looked at together: one by one takes seventeen times as long
            if len(self._pending) == 256:
                self._catch_up(clock)
            return (0.0, 0.0, self.n_ended, 0.0)
        arrays = {name: np.array([value]) for name, value in values.items()}
        felt = self.rows(np.array([stamp]), run, arrays, clock)[0].tolist()
        values.update({name: float(value[0]) for name, value in arrays.items()})
        return felt

    def _catch_up(self, clock: Clock) -> None:
        """Look at the samples that lack nothing."""
        if self._pending:
            stamps, rows = zip(*self._pending, strict=True)
            self._pending = []
            values = {name: np.array([row[name] for row in rows], float) for name in self.filling.columns}
            self.rows(np.array(stamps), self.run, values, clock)

    def rows(self, stamps: np.ndarray, run: Any, values: dict[Any, np.ndarray], clock: Clock) -> np.ndarray:
        """Fill missing cells of the next samples of one run, in place.

        Returns array of shape (n, 4): standard deviation of the bias by filled cells, 0 where none is felt; 1 where
        one of the row's own is; how many segments have been ended by holes so far, `n_ended`; and which of the
        stand-ins have filled a cell, a bit for each.
        """
        self._catch_up(clock)
        result = np.zeros((len(stamps), len(NOTHING)))
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
        believed = self.filling.screened(given, lambda k: stamps[rows[k]].item())
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
        bits = sum(2.0**k * np.isfinite(each) for k, each in enumerate(filled.errors.values()))
        return np.column_stack((error, own, ended, bits))
