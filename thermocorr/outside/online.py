"""`OnlineCorrector`: a fitted model that corrects readings as they arrive, one by one or in blocks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from operator import mul
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ..effects.steppers import Sample, stepper_of
from ..effects.stream import Walked, needed_columns, states_before, walk
from ..effects.thermal import column_text
from ..estimators import DynamicBiasRegressor
from ..records import Record, RecordError, Segment, SegmentStart
from ..records.read import from_polars, is_frame, numeric_column, times_of
from ..records.times import Times
from .averages import MovingAverage, Tracker
from .clock import Clock
from .stream_state import restore, stored

GAP_STEPS = 10.0
"""A step of more than so many usual ones is flagged as a gap, where the model has no `max_gap`."""
_NO_TEMPERATURE, _BACKWARD, _STALE = ("no temperature",), ("backward time",), ("stale time",)
_REASONS = ("no reading", "washout", "outside fitted range", "gap")
_FLAGS = tuple(tuple(reason for bit, reason in enumerate(_REASONS) if mask >> bit & 1) for mask in range(16))
_SHORT = 8
"""Mean length of segments below which rows are cheaper one by one than in blocks."""


class Corrected(NamedTuple):
    """What is known about one sample."""

    corrected: float
    """Reading less bias, eq. (24); NaN without a reading."""
    bias: float
    """What was taken away; NaN without a temperature."""
    flags: tuple[str, ...]
    """Every reason for distrust, the weightiest first; empty where there is none."""
    smoothed: float = math.nan
    """Moving average of the corrected reading, eq. (26); NaN unless asked for."""
    reference: float = math.nan
    """Tracked U0; NaN unless asked for."""

    @property
    def flag(self) -> str:
        """The weightiest reason for distrust, as in `DynamicBiasRegressor.flags`; "" where there is none."""
        return self.flags[0] if self.flags else ""


class OnlineCorrector:
    """Corrects a stream of samples: the same numbers as `DynamicBiasRegressor.correct` on the whole of it.

    A stream whose first sample follows on the fitted record in time continues its lags; one that begins with a fitted
    row repeats it; any other starts afresh, by the model's `initial_state`, and is flagged for the model's washout. A
    step longer than the model's `max_gap`, a sample without a temperature and a change of the run start afresh too.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted, or loaded with `thermocorr.load_model`. It is not changed.
    average : int, optional
        Report the mean of the last so many corrected readings too, eq. (26).
    track : float or time span, optional
        Report a slowly tracked U0 too: the mean of the corrected readings under an exponential weight with this time
        constant [s], starting with the model's U0. Flagged readings do not enter; a gap alone does not keep one out.
    continues : bool, default True
        False starts afresh whatever the first sample's time is: another instrument of the same kind, say.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, OnlineCorrector
    >>> from thermocorr.datasets import make_record
    >>> lab = make_record(2000, seed=1)
    >>> X, y = lab[["temperature"]], lab["reading"]
    >>> model = DynamicBiasRegressor(time_constants=["5 min", "2 h"]).fit(X[:1500], y[:1500])
    >>> live = OnlineCorrector(model)
    >>> values = [live.update(time, T, U).corrected for time, T, U in zip(X.index, X["temperature"], y)]
    >>> bool(abs(model.correct(X, y) - values).max() < 1e-12)
    True
    """

    def __init__(
        self, model: DynamicBiasRegressor, *, average: int | None = None, track: Any = None, continues: bool = True
    ):
        if not isinstance(model, DynamicBiasRegressor):
            raise TypeError(f"The model must be a DynamicBiasRegressor. Got {type(model).__name__}.")
        check_is_fitted(model, "pipeline_")
        self.model = model
        self.average = None if average is None else MovingAverage(average)
        self.track = None if track is None else Tracker(track, model.intercept_)
        self.continues = bool(continues)
        self._history = model.features_.history_
        self._effects = model.features_.effect_list()
        temperature = self._history.record.temperature_name
        times = self._history.record.times
        self._temperature = temperature
        self._inputs = [column for column in needed_columns(self._effects) if column != temperature]
        self._given = [column_text(column) for column in self._inputs]
        self._steppers = [stepper_of(effect, times, self._history.zero, temperature) for effect in self._effects]
        self._removed = [effect.removed_by_correct for effect in self._effects]
        edges = np.cumsum([0, *(len(effect.names()) for effect in self._effects)]).tolist()
        self._coefficients = [
            (model.coef_[low:high] * removed).tolist()
            for (low, high), removed in zip(pairwise(edges), self._removed, strict=True)
        ]
        self._low, self._high = model.reading_.temperature_range
        self._washout = model.washout_
        self._max_gap = math.inf if self._history.max_gap is None else self._history.max_gap
        self._gap = GAP_STEPS * self._history.usual_step if self._history.max_gap is None else self._history.max_gap
        self._run_column = model.run
        self.reset()

    def reset(self) -> None:
        """Forget the stream: the next sample is taken as the first."""
        self._clock = Clock(self._history)
        self._sample = Sample()
        self._last: Any = None
        self._run: Any = None
        self._seen: list[Any] = []
        self._open, self._until = False, -math.inf
        for part in (self.average, self.track):
            if part is not None:
                part.reset()

    # ------------------------------------------------------------------------------------------------- one by one

    def update(self, time: Any = None, temperature: Any = None, reading: Any = math.nan, **columns: Any) -> Corrected:
        """Correct one sample.

        Parameters
        ----------
        time : date, time span, or seconds
            Of the kind that the fitted record had, on the same clock; None where it had none (a fixed sampling period).
        temperature, reading : float
            None or NaN where there is none. A sample without a temperature ends what is known about the device.
        **columns : float
            Other recorded columns that the model's effects use, and the run's label under the name of its column.

        Returns
        -------
        Corrected
            A sample whose time does not lie after the one before is refused (flagged "stale time" or "backward time",
            NaN) and changes nothing.

        Raises
        ------
        RecordError
            For a time of another kind.
        TypeError
            For columns that are missing, or no numbers.
        """
        run = columns.get(self._run_column) if self._run_column is not None else None
        values = {self._temperature: _number(temperature)}
        for column, name in zip(self._inputs, self._given, strict=True):
            if name not in columns:
                raise TypeError(f"update() needs the column {name!r}, which the model uses.")
            values[column] = _number(columns[name])
        U = _number(reading)
        return self._advance(self._clock.stamp(time), run, values, U)

    def _advance(self, stamp: Any, run: Any, values: dict[Any, float], U: float) -> Corrected:
        """Correct one sample whose values are numbers."""
        sample, last, clock = self._sample, self._last, self._clock
        same_run = last is not None and run == self._run
        step = clock.between(stamp, last) if same_run else math.inf
        if step <= 0.0:
            return self._nothing(_STALE if step == 0.0 else _BACKWARD)
        self._last, self._run = stamp, run
        T = values[self._temperature]
        for value in values.values():
            if value - value != 0.0:  # NaN or infinity
                self._open = False
                return self._nothing(_NO_TEMPERATURE)
        if self._open and same_run and step <= self._max_gap:
            sample.begins, sample.step = False, step
        else:
            since = self._begin(stamp, run, values)
            step = since if step == math.inf else step
        sample.temperature, sample.values, sample.stamp = T, values, stamp
        sample.seconds = clock.between(stamp, self._history.zero)
        sample.elapsed = elapsed = clock.between(stamp, sample.segment_zero)
        if elapsed > self._until:
            self._settle(elapsed)
        row: list[float] = []
        for advance in self._steps:
            row += advance(sample)
        bias = sum(map(mul, row, self._weights))
        known = U - U == 0.0
        mask = 0 if known else 1
        if sample.key is None and elapsed < self._washout:
            mask |= 2
        if not self._low <= T <= self._high:
            mask |= 4
        if step > self._gap:
            mask |= 8
        corrected = U - bias if known else math.nan
        if self.average is None and self.track is None:
            return Corrected(corrected, bias, _FLAGS[mask])
        smoothed = math.nan if self.average is None else self.average.one(corrected)
        reference = math.nan if self.track is None else self.track.one(stamp * clock.unit, corrected, not mask & 7)
        return Corrected(corrected, bias, _FLAGS[mask], smoothed, reference)

    def _nothing(self, flags: tuple[str, ...]) -> Corrected:
        return Corrected(math.nan, math.nan, flags, reference=math.nan if self.track is None else self.track.value)

    def _settle(self, elapsed: float) -> None:
        """Leave out effects that have nothing more to say in this segment: start-up decays that are over."""
        key = self._sample.key
        active = [i for i, stepper in enumerate(self._steppers) if stepper.over(key) >= elapsed]
        self._steps = [self._steppers[i].step for i in active]
        self._weights = [weight for i in active for weight in self._coefficients[i]]
        self._until = min((self._steppers[i].over(key) for i in active), default=math.inf)

    def _begin(self, stamp: Any, run: Any, values: Any) -> float:
        """Start a segment; returns the step since the sample that it continues [s], 0 where it starts afresh."""
        start, states = self._tied(stamp, run, values)
        sample = self._sample
        sample.key, sample.segment_zero = (None, stamp) if start is None else (start.key, start.segment_zero)
        known = start is not None and start.step is not None
        sample.begins, sample.step = not known, start.step if known else 1.0  # type: ignore[union-attr, assignment]
        for stepper, state in zip(self._steppers, states, strict=True):
            stepper.start(state)
        self._open, self._until = True, -math.inf
        return sample.step if known else 0.0

    def _tied(self, stamp: Any, run: Any, values: Any) -> tuple[SegmentStart | None, list[Any]]:
        """How a segment that begins with this row hangs on the fitted record, and its states."""
        first = run not in self._seen
        if first:
            self._seen.append(run)
        tied = self._history.tie(stamp, run, values, first) if self.continues else None
        nothing: list[Any] = [None] * len(self._effects)
        if tied is None:
            return None, nothing
        start, replay = tied
        if start.step is None:
            return start, nothing
        return start, states_before(self._effects, self._history, start.key, replay)

    # -------------------------------------------------------------------------------------------------- in blocks

    def update_many(self, X: Any, y: Any = None) -> pd.DataFrame:
        """Correct the next samples of the stream, all at once.

        Parameters
        ----------
        X : DataFrame or array of shape (n, n_columns)
            As for `DynamicBiasRegressor.correct`. Rows stand in the order of their arrival.
        y : array-like of shape (n,), optional
            Readings; NaN where there is none.

        Returns
        -------
        DataFrame
            `corrected`, `bias`, `flag`, and `smoothed`, `reference` where they were asked for; rows as they came.
        """
        X = from_polars(X)
        X = X if is_frame(X) else np.asarray(X)
        n = len(X)
        reading = np.full(n, np.nan) if y is None else _readings(y, n)
        columns = {name: _column(X, name, "column") for name in self._inputs}
        columns[self._temperature] = _column(X, self._temperature, "temperature")
        out = _Output(n)
        if n:
            layout = self.model.features_._layout()
            times = times_of(X, layout)
            if times.ticks is not None:
                times = replace(times, ticks=np.asarray(times.ticks[:]))
            stamps = self._clock.stamps(times)
            for low, high, run in _stretches(X, self._run_column, n):
                self._stretch(slice(low, high), run, times, stamps, columns, reading, out)
        result = {"corrected": out.corrected, "bias": out.bias, "flag": out.flags}
        if self.average is not None:
            result["smoothed"] = self.average.many(out.corrected)
        if self.track is not None:
            trusted = (out.flags == "") | (out.flags == "gap")
            result["reference"] = self.track.many(
                stamps * self._clock.unit if n else np.zeros(0), out.corrected, trusted
            )
        return pd.DataFrame(result, index=X.index if isinstance(X, pd.DataFrame) else None)

    def _stretch(
        self, rows: slice, run: Any, times: Times, stamps: np.ndarray, columns: Any, reading: np.ndarray, out: _Output
    ) -> None:
        """Rows of one run."""
        given = np.arange(rows.start, rows.stop)
        same_run = self._last is not None and run == self._run
        here = stamps[given]
        before = np.maximum.accumulate(np.concatenate(([self._last if same_run else here[0] - 1], here)))[:-1]
        late = here <= before
        out.flags[given[late]] = np.where(here[late] == before[late], "stale time", "backward time")
        given, here = given[~late], here[~late]
        if not len(given):
            return
        values = {name: column[given] for name, column in columns.items()}
        valid = np.logical_and.reduce([np.isfinite(column) for column in values.values()])
        fresh_run = not (self._last is not None and run == self._run)
        steps = np.empty(len(given))
        steps[0] = np.inf if fresh_run else self._clock.between(here[0], self._last)
        steps[1:] = self._clock.between(here[1:], here[:-1])
        goes_on = np.concatenate(([self._open and not fresh_run], valid[:-1])) & (steps <= self._max_gap)
        fresh = valid & ~goes_on
        if fresh.sum() * _SHORT > len(given):
            self._one_by_one(given, here, run, values, reading, out)
            return
        self._last, self._run = here[-1].item(), run
        record, starts, states = self._record(times, given, here, steps, values, fresh, valid, run)
        walked: Walked | None = None

        def noted() -> Iterator[Walked]:
            nonlocal walked
            for step in walk(self._effects, record, zero=self._history.zero, starts=starts, states=states):
                walked = step
                yield step

        measured = reading[given]
        for block, parts in self.model.weighed(noted()):
            into = given[block.rows]
            out.bias[into] = parts[:, self._removed].sum(axis=1)
            flags = self.model.block_flags(block, measured[block.rows])
            flags[(flags == "") & (steps[block.rows] > self._gap)] = "gap"
            out.flags[into] = flags
        out.corrected[given] = measured - out.bias[given]
        self._open, self._until = bool(valid[-1]), -math.inf
        if self._open:
            assert walked is not None
            self._sample.key, self._sample.segment_zero = walked.block.segment_key, walked.block.segment_zero
            for stepper, state in zip(self._steppers, walked.states, strict=True):
                stepper.start(state)

    def _one_by_one(self, given: Any, here: Any, run: Any, values: Any, reading: Any, out: _Output) -> None:
        """Rows that hardly ever follow on one another: blocks would be no longer than a row or two."""
        names = list(values)
        rows = zip(given.tolist(), here.tolist(), *(values[name].tolist() for name in names), strict=True)
        average, track, self.average, self.track = self.average, self.track, None, None
        try:
            for k, stamp, *row in rows:
                result = self._advance(stamp, run, dict(zip(names, row, strict=True)), float(reading[k]))
                out.corrected[k], out.bias[k], out.flags[k] = result.corrected, result.bias, result.flag
        finally:
            self.average, self.track = average, track

    def _record(
        self, times: Times, given: Any, here: Any, steps: Any, values: Any, fresh: Any, valid: Any, run: Any
    ) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """A record of these rows, how its segments hang on what came before, and the states they start with."""
        ticks = here if times.ticks is None else times.ticks[given]
        begins = fresh.copy()
        begins[0] = valid[0]
        edges = np.flatnonzero(begins)
        segments, starts, states = [], {}, {}
        gone = np.append(np.flatnonzero(~valid), len(valid))
        for number, start in enumerate(edges.tolist()):
            stop = int(gone[np.searchsorted(gone, start)])
            if number + 1 < len(edges):
                stop = min(stop, int(edges[number + 1]))
            segments.append(Segment(start, stop, run))
            if not fresh[start]:  # the stream goes on
                starts[number] = SegmentStart(self._sample.key, self._sample.segment_zero, float(steps[start]))
                states[number] = [stepper.state() for stepper in self._steppers]
                continue
            first = {name: column[start] for name, column in values.items()}
            tied, known = self._tied(here[start].item(), run, first)
            if steps[start] == np.inf:
                steps[start] = 0.0 if tied is None or tied.step is None else tied.step
            if tied is not None:
                starts[number], states[number] = tied, known
        kept = Times(len(given), times.kind, ticks, times.per_second, times.period)
        return Record(kept, self._temperature, values, tuple(segments)), starts, states

    # ------------------------------------------------------------------------------------------------ stop and go on

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, in another process: a dict for `json.dumps`."""
        return stored(self)

    @classmethod
    def from_state(cls, model: DynamicBiasRegressor, state: dict[str, Any]) -> OnlineCorrector:
        """Go on where `state` was taken, with the same model.

        Raises
        ------
        ModelFileError
            A ValueError: the state is damaged, or belongs to another model.
        """
        return restore(cls, model, state)


class _Output:
    """Columns of the result, as they are filled."""

    def __init__(self, n: int):
        self.corrected, self.bias = np.full(n, np.nan), np.full(n, np.nan)
        self.flags = np.full(n, "no temperature", dtype=object)


def _number(value: Any) -> float:
    """A float; NaN for None."""
    return math.nan if value is None else float(value)


def _floats(values: Any) -> np.ndarray:
    """A column as floats of its own, NaN for what is missing or infinite; TypeError or ValueError for text."""
    array = np.array(values, float)
    array[np.isinf(array)] = np.nan
    return array


def _readings(y: Any, n: int) -> np.ndarray:
    values = _floats(from_polars(y)[:])
    values = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if values.shape != (n,):
        raise RecordError(
            f"X has {n} rows and y has the shape {values.shape}. Each row needs one reading (NaN where none)."
        )
    return values


def _column(X: Any, name: Any, role: str) -> np.ndarray:
    try:
        return _floats(X[name][:] if is_frame(X) else X[:, name])
    except (KeyError, IndexError, TypeError, ValueError):
        return _floats(numeric_column(X, name, role))  # the same, or a sentence about what is wrong


def _stretches(X: Any, run_column: Any, n: int) -> list[tuple[int, int, Any]]:
    """Stretches of rows of the same run: first row, row after the last, label."""
    if run_column is None:
        return [(0, n, None)]
    labels = pd.Series(X[run_column][:] if is_frame(X) else X[:, run_column])
    codes = pd.factorize(labels, use_na_sentinel=False)[0]
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), n]
    return [(low, high, labels.iloc[low]) for low, high in pairwise(edges)]
