"""`OnlineCorrector`: a stream that stops and continues."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Self

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ..effects.protocol import refuse_foresight
from ..effects.thermal import column_text
from ..equations import MovingAverage
from ..model import DynamicBiasRegressor
from ..model.checks import UnitGuard
from ..records import RecordError, read_record
from ..records.errors import check_bool, quoted
from ..records.numbers import as_data, is_frame
from ..records.read import times_of
from .advance import Advanced, Stream
from .clock import Tracker
from .samples import (
    NO_TEMPERATURE,
    Answers,
    Corrected,
    LiveErrors,
    checked_label,
    column_of,
    one_number,
    readings,
    refused_rows,
    stretches,
)
from .state import StreamFile, StreamState, from_json, model_mark, to_json


class OnlineCorrector:
    """Correct a stream, with the numbers of `correct`.

    A stream whose first sample follows on the fitted record in time continues its lags; one that begins with a fitted
    row repeats it; any other starts afresh, at rest, and is flagged for the model's washout. A step longer than the
    model's `max_gap` and a change of the run start afresh too. Where the record has no times, a first block is placed
    as `correct` places its rows, and a first single sample follows on the fitted rows. A sample that lacks its
    temperature, or a column that the model needs, is passed over as if it had not come.

    A sample after a gap is flagged "gap", after an absurdly long one "suspect time". It is accepted until the next
    one: if that lies before it, and after the samples before the gap, its time was false, and the stream goes on as if
    it had not been. One damaged date does not end a stream.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted, or loaded with `thermocorr.load_model`. It is not changed.
    average : int, optional
        Report the mean of that many last corrected readings too, eq. (26).
    track : float or time span, optional
        Report a slowly tracked U0 too: the mean of the corrected readings under an exponential weight with this time
        constant [s], starting with the model's U0. Flagged readings do not enter; a gap alone does not keep one out.
    continues : bool, default True
        False starts afresh whatever the first sample's time is: another instrument of the same kind, say.
    uncertainty : bool, default False
        Report the standard uncertainty of each corrected reading too, `u`, and of the moving average, `u_smoothed`: as
        ``correct(X, y, return_std=True)``. NaN where there is no corrected reading, and in the washout.

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
        self,
        model: DynamicBiasRegressor,
        *,
        average: int | None = None,
        track: Any = None,
        continues: bool = True,
        uncertainty: bool = False,
    ):
        if not isinstance(model, DynamicBiasRegressor):
            raise TypeError(f"The model must be a DynamicBiasRegressor. Got {type(model).__name__}.")
        check_is_fitted(model, "pipeline_")
        refuse_foresight(model.features_.effect_list(), "a stream")
        if track is not None and model.reference is not None:
            raise ValueError("track follows U0, which a model with a reference takes away. Leave track out.")
        self.model = model
        self.average = None if average is None else MovingAverage(average)
        self.track = None if track is None else Tracker(track, model.intercept_)
        self.continues = check_bool("OnlineCorrector", "continues", continues)
        self.errors = LiveErrors(model) if uncertainty else None
        self._stream = Stream(model, self.continues, self.errors)
        self._screen = self._stream.history.later_screen
        self.columns = tuple(self._stream.inputs)
        """Recorded columns that the model needs besides the temperature."""
        self._given = [column_text(column) for column in self.columns]
        self.reset()

    @property
    def names(self) -> list[str]:
        """Names of the results.

        Those asked for besides the corrected reading come last.
        """
        names = ["corrected", "bias", "flag"]
        names += [] if self.average is None else ["smoothed"]
        names += [] if self.track is None else ["reference"]
        names += [] if self.errors is None else ["u"]
        return names + ([] if self.errors is None or self.average is None else ["u_smoothed"])

    def state(self) -> dict[str, Any]:
        """The state as a dict for `json.dumps`.

        All that another process needs to continue.
        """
        average = None if self.average is None else self.average.count
        track = None if self.track is None else self.track.time_constant
        return to_json(
            StreamFile(
                model=model_mark(self.model), continues=self.continues, average=average, track=track,
                uncertainty=self.errors is not None, next_row=self._stream.clock.next_row, placed=self._placed,
                state=self._state(), doubt=self._doubt,
            )
        )  # fmt: skip

    @classmethod
    def from_state(cls, model: DynamicBiasRegressor, state: dict[str, Any]) -> Self:
        """Go on where `state` was taken, with the same model.

        Raises
        ------
        ModelFileError
            A ValueError: the state is damaged, or belongs to another model.
        """
        known = from_json(model, state)
        settings = {"average": known.average, "track": known.track, "uncertainty": known.uncertainty}
        corrector = cls(model, continues=known.continues, **settings)  # type: ignore[arg-type]
        corrector._stream.clock.next_row, corrector._placed = known.next_row, known.placed
        corrector._put(known.state)
        corrector._doubt = known.doubt
        return corrector

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

    def reset(self) -> None:
        """Forget the stream: the next sample is taken as the first."""
        self._stream.reset()
        self._doubt: StreamState | None = None
        self._placed = self._stream.history.kind != "rows" or not self.continues
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
            None or NaN where there is none.
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
            For a time of another kind, and a run without a label.
        TypeError
            For columns that are missing, or no numbers.
        """
        stream = self._stream
        values = {stream.temperature: one_number(temperature)}
        for column, name in zip(self.columns, self._given, strict=True):
            if name not in columns:
                raise TypeError(f"update() needs the column {quoted(name)}, which the model uses.")
            values[column] = one_number(columns[name])
        U = one_number(reading)
        run = None if self.model.run is None else checked_label(columns.get(self.model.run), self.model.run)
        self._placed = True
        return self._advance(stream.clock.stamp(time), run, values, U)

    def _advance(self, stamp: Any, run: Any, values: dict[Any, float], U: float) -> Corrected:
        """The answer to one sample."""
        stream = self._stream
        refused = ""
        for name, limits in self._screen.inputs.items():
            refused = limits.reason(values[name], stamp) or refused
        if not all(map(math.isfinite, values.values())):
            refused = NO_TEMPERATURE
        if refused:  # as if it had not come
            return self._accompanied(math.nan, Advanced(math.nan, (refused,), False), stamp)
        if self._doubt is not None or stream.step_to(stamp, run) > stream.gap:
            self._consider(stamp, run)
        doubted = self._screen.reading.reason(U, stamp)
        known = U - U == 0.0 and not doubted
        done = stream.advance(stamp, run, values, known)
        if doubted:
            done = done._replace(flags=tuple(doubted if flag == "no reading" else flag for flag in done.flags))
        corrected = U - done.bias if known else math.nan
        if self.average is None and self.track is None and self.errors is None:
            return Corrected(corrected, done.bias, done.flags)
        return self._accompanied(corrected, done, stamp)

    def _accompanied(self, corrected: float, done: Advanced, stamp: Any) -> Corrected:
        smoothed = math.nan if self.average is None else self.average.one(corrected)
        seconds = stamp * self._stream.clock.unit
        reference = math.nan if self.track is None else self.track.one(seconds, corrected, done.counts)
        u = u_smoothed = math.nan
        if self.errors is not None and done.variances is not None and not math.isnan(corrected):
            u = float(self.errors.u(done.variances)[0])
            if self.average is not None:
                u_smoothed = float(self.errors.u(done.variances, len(self.average.values))[0])
        more = {"smoothed": smoothed, "reference": reference, "u": u, "u_smoothed": u_smoothed}
        return Corrected(corrected, done.bias, done.flags, **more)

    def _consider(self, stamp: Any, run: Any) -> None:
        """Check a sample's time and jump before it counts."""
        stream = self._stream
        if self._doubt is not None and stream.returns_behind(self._doubt, stamp, run):
            self._put(self._doubt)
        step = stream.step_to(stamp, run)
        if step > 0.0:  # one that repeats the last time does not confirm it, and one that is refused tells nothing
            self._doubt = self._state() if step > stream.gap else None

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
            `corrected`, `bias`, `flag`, and `smoothed`, `reference`, `u`, `u_smoothed` where they were asked for; rows
            as they came. RecordError for readings or temperatures in another unit, as `correct`.
        """
        X = as_data(X)
        X = X if is_frame(X) else np.asarray(X)
        n, stream, run = len(X), self._stream, self.model.run
        guard = UnitGuard.of(self.model)
        guard.check_readings(y, X)
        reading = np.full(n, np.nan) if y is None else readings(y, X)
        values = {stream.temperature: column_of(X, stream.temperature, "temperature")}
        values |= {name: column_of(X, name, "column") for name in self.columns}
        if not n:
            return Answers(0).frame(X, self.names)
        for thermometer in guard.ranges:
            guard.check_values(thermometer, values[thermometer], X)
        times = times_of(X, self.model.features_.layout())
        labels = None if run is None else pd.Series(X[run][:] if is_frame(X) else X[:, run]).reset_index(drop=True)
        if stream.clock.kind == times.kind == "rows":
            self._place(pd.DataFrame(values if labels is None else {**values, run: labels}))
            stamps = stream.clock.next_rows(n)
        else:
            stamps = stream.clock.stamps(times)
        return self._updated(stamps, values, reading, labels).frame(X, self.names)

    def _place(self, X: pd.DataFrame) -> None:
        """Find the first rows in the fitted record.

        Rows that lack what the model needs tell nothing; they are taken for the next ones, and those behind them too.
        """
        clock, history = self._stream.clock, self._stream.history
        if self._placed:
            return
        try:
            record = read_record(X, self.model.features_.layout(), needed=self.columns, quiet=True)
            row = history.first_row(self._screen.without_codes(record, history.max_gap))
        except RecordError:
            return
        clock.next_row, self._placed = clock.next_row if row == history.n_fitted else row, True

    def _updated(self, stamps: np.ndarray, values: dict[Any, np.ndarray], reading: Any, runs: Any) -> Answers:
        """Answers to many samples."""
        why = refused_rows(self._screen.inputs, stamps, values)
        if why is not None:
            return self._passed_over(why, stamps, values, reading, runs)
        out = Answers(len(reading))
        for low, high, run in stretches(runs, len(stamps)):
            at = low
            while at < high:
                # A block has 65 536 rows at most.
                ahead = stamps[at : min(at + (1 << 16), high)]
                n_sure = 0 if self._doubt is not None else self._stream.next_doubt(ahead, run)
                stop = at + max(n_sure, 1)
                rows = slice(at, stop)
                if not n_sure:
                    self._consider(ahead[0].item(), run)
                self._together(rows, stamps, run, values, reading, out)
                at = stop
        return out

    def _passed_over(self, why: Any, stamps: Any, values: Any, reading: Any, runs: Any) -> Answers:
        """Answers without the rows that the screen refuses."""
        kept = why == ""
        before, inner = math.nan if self.track is None else self.track.value, Answers(0)
        if kept.any():
            some = {name: column[kept] for name, column in values.items()}
            of_runs = None if runs is None else runs[kept]
            inner = self._updated(stamps[kept], some, reading[kept], of_runs)
        return inner.spread(why, before)

    def _together(self, rows: slice, stamps: Any, run: Any, values: Any, reading: Any, out: Answers) -> None:
        some = {name: column[rows] for name, column in values.items()}
        block = self._stream.advance_block(stamps[rows], run, some, reading[rows])
        corrected = reading[rows] - block.bias
        for doubted, _ in self._screen.reading.reasons(reading[rows], lambda k: stamps[rows.start + k].item()):
            corrected[doubted] = np.nan
        out.corrected[rows], out.bias[rows], out.flags[rows] = corrected, block.bias, block.flags
        if self.errors is not None:
            out.u[rows], out.u_smoothed[rows] = self.errors.of_block(block.variances, corrected, self.average)
        if self.average is not None:
            out.smoothed[rows] = self.average.many(corrected)
        if self.track is not None:
            trusted = block.flags.are("", "gap")
            out.reference[rows] = self.track.many(stamps[rows] * self._stream.clock.unit, corrected, trusted)
