"""Events: the measurand was stepped, and what it is since then is to stay in the corrected reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..records import Record, RecordError
from ..records.errors import quoted
from .protocol import SINCE_START, EffectInfo
from .several_steps import SeveralSteps

MOST = 1000
"""Events, of which each has a level of its own."""


class Events(SeveralSteps):
    """Moments at which the measurand was stepped: each begins a level of its own, which `correct` keeps.

    The lags go on through an event: the device does not know of it.

    Parameters
    ----------
    times : sequence of float, time span or date
        The moments, see `Step`.
    column : str or int, optional
        A recorded column that is 1 in the row where an event happens and 0 elsewhere; ones that follow one another are
        one event. It is read where the model is fitted; later rows need it too.
    removed_by_correct : bool, default False
        Whether `correct` takes the levels away.

    Raises
    ------
    RecordError
        By `learn`, for a column that holds anything but 0 and 1, and for more than 1000 events.

    Examples
    --------
    A load cell that was loaded in row 400: the corrected reading keeps the load.

    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.datasets import make_record
    >>> from thermocorr.effects import Events
    >>> record = make_record(4000, seed=1)
    >>> loaded = record["reading"] + 5.0 * (record.index >= record.index[400])
    >>> model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], effects=[Events([record.index[400]])])
    >>> corrected = model.fit(record[["temperature"]], loaded).correct(record[["temperature"]], loaded)
    >>> bool(abs(corrected[400:].mean() - corrected[:400].mean() - 5.0) < 0.05)
    True
    """

    kind = "events"
    learned = SeveralSteps.learned
    info = EffectInfo(
        physics="Somebody or something stepped what is measured: a load was put on, a reference was exchanged.",
        bench_check="Look in the laboratory's log book at these moments; at constant temperature the reading stays at "
        "its new level.",
        formula="step[t] = 0 before t, 1 from t on, one for each event",
        parameters={"times": SINCE_START},
        example={"times": ("2 h", "3 h")},
        place=3.36,
    )

    def __init__(self, times: Sequence[Any] = (), column: Any = None, removed_by_correct: bool = False):
        super().__init__(times, removed_by_correct)
        self.column = column

    def inputs(self) -> list[Any]:
        """The column of events."""
        return [] if self.column is None else [self.column]

    def moments(self, record: Record) -> list[Any]:
        """The moments given, and those that the column has."""
        found = list(self.times)
        if self.column is not None:
            found += self._marked(record)
        if len(found) > MOST:
            raise RecordError(
                f"There are {len(found)} events, and {MOST} are the most. A column that goes to and fro is no list of "
                "events: take it as Covariate."
            )
        return found

    def _marked(self, record: Record) -> list[float]:
        """Moments at which the column becomes 1, in rows that are passed over too [s]."""
        if record.order is not None:
            raise RecordError(
                f"The column of events {quoted(self.column)} stands in runs that overlap in time, and an event would "
                "step them all. Fit a model for each run."
            )
        rows = slice(record.segments[0].start, record.segments[-1].stop)
        marks = np.asarray(record.columns[self.column][rows], float)
        blank, seconds = np.isnan(marks), record.times.seconds(rows, record.first_stamp())
        wrong = ~(blank | np.isin(marks, (0.0, 1.0)))
        if wrong.any() or blank.sum() > len(marks) / 2:
            row = int(np.argmax(wrong if wrong.any() else blank))
            shown = "a blank" if blank[row] else f"{marks[row]:.6g}"
            raise RecordError(
                f"The column of events {quoted(self.column)} must hold 0 and 1 in every row. Got {shown} at "
                f"{seconds[row]:.6g} s since the record began."
            )
        known = np.where(blank, 0.0, marks)
        begins = np.flatnonzero((known == 1.0) & (np.concatenate(([0.0], known[:-1])) == 0.0))
        return [float(moment) for moment in seconds[begins] if moment > 0]

    def label(self) -> str:
        """``events: 3``."""
        return f"events: {len(getattr(self, 'seconds_', self.times))}"
