"""Records spread over several processes or machines (extra "dask"): the same fit and search, in parallel in time.

A `DistributedLog` stands for X. Each part of the record is looked at alone (times, moments); then its lags run from
rest, which gives their true end by linearity, for a lag forgets its start as exp(-t/tau). So every part learns the
state in which it starts, and sweeps its rows into factors, which merge to those of the whole record: equal to the fit
in one process to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import pairwise
from typing import Any
from uuid import uuid4

import numpy as np

from ..effects.protocol import Effect
from ..effects.signals import joined
from ..equations import LagState, TriangularFactor, lag_differences
from ..equations.spikes import HALO, Scanned
from ..equations.statistics import Moments
from ..equations.usual import Usual
from ..estimators.fitting import Swept
from ..records import Layout, Log, ParquetLog, Record, RecordError, Segment, SegmentStart
from ..records.errors import listing, quoted
from ..records.times import Times
from .parts import (
    Look,
    Part,
    Row,
    Signal,
    Task,
    ends_from_rest,
    look,
    moments_of,
    names_of,
    opened,
    rows_of,
    scan_part,
    sweep_part,
)


class DistributedLog(Log):
    """A log in parts that the processes of a Dask cluster work on: the X of every estimator.

    Parameters
    ----------
    client : dask.distributed.Client
        On one machine ``Client(LocalCluster(n_workers=2, threads_per_worker=1))``.
    parts : ParquetLog, dask.dataframe.DataFrame, or sequence of ParquetLog, DataFrame or path
        One record in time order, without runs or missing temperatures. A `ParquetLog` is cut at its row groups; every
        worker must be able to read its files.
    n_parts : int, optional
        Parts to cut a `ParquetLog` into; by default two for each thread of the cluster.

    Raises
    ------
    RecordError
        For a part that is not one segment, or does not follow the one before it in time; the message names it.

    Examples
    --------
    Under ``if __name__ == "__main__":``, for the workers are processes of their own::

        with LocalCluster(n_workers=2, threads_per_worker=1) as cluster, Client(cluster) as client:
            log = DistributedLog(client, ParquetLog("log.parquet"))
            model = DynamicBiasRegressor("temperature").fit(log, log["reading"])
    """

    def __init__(self, client: Any, parts: Any, n_parts: int | None = None):
        self.client = client
        if isinstance(parts, ParquetLog):
            parts = parts.parts(n_parts or 2 * max(sum(client.nthreads().values()), 1))
        elif hasattr(parts, "to_delayed"):
            parts = client.compute(list(client.persist(parts).to_delayed()))
        self.parts: list[Part] = [opened(part) for part in parts]
        if not self.parts:
            raise RecordError("The log has no parts. Check the list of its files.")
        self._columns: list[str] = self.each(names_of, parts=[0])[0]
        self.lengths = self.each(len)

    def each(self, function: Callable[..., Any], *arguments: Any, parts: Sequence[int] | None = None) -> list[Any]:
        """``function(part, *arguments)`` for each part, by the workers; a list among the arguments has one item each.

        Dask repeats what a lost worker had to do.
        """
        numbers = range(len(self.parts)) if parts is None else parts
        futures = [
            self.client.submit(
                function,
                self.parts[number],
                *(item[at] if isinstance(item, list) else item for item in arguments),
                pure=False,
            )
            for at, number in enumerate(numbers)
        ]
        answers: list[Any] = self.client.gather(futures)
        return answers

    @property
    def columns(self) -> list[str]:
        """Names of the columns, the index left out."""
        return self._columns

    def __len__(self) -> int:
        return int(sum(self.lengths))

    def __getitem__(self, name: Any) -> RemoteColumn:
        if name not in self.columns:
            raise RecordError(f"There is no column {quoted(name)} in the log. Its columns are {listing(self.columns)}.")
        return RemoteColumn(self, name)

    def to_record(self, layout: Layout, y: Any, needed: Any) -> DistributedRecord:
        """The validated record, after every part has been looked at by a worker."""
        if layout.run is not None:
            raise RecordError("A distributed log is one run. Fit the runs as devices of a fleet, or in one process.")
        if y is not None and not isinstance(y, RemoteColumn):
            raise RecordError("The readings of a distributed log are one of its columns. Pass log['reading'] as y.")
        reading = None if y is None else y.name
        token = uuid4().hex
        tasks = [Task(layout, reading, tuple(needed), number, token) for number in range(len(self.parts))]
        looks: list[Look] = self.each(look, tasks)
        for number in range(1, len(looks)):
            if looks[number].record.times.ticks is not None:
                before, here = looks[number - 1], looks[number]
                if here.first_stamp <= before.last_stamp:
                    raise RecordError(
                        f"Part {number} of the log begins at {here.record.times.label(0)}, before the end of part "
                        f"{number - 1} at {before.record.times.label(1)}. Give the parts in time order, without "
                        "overlap."
                    )
        return DistributedRecord.of(self, tasks, looks)


class RemoteColumn:
    """A column whose rows are fetched from the workers when it is sliced."""

    ndim = 1

    def __init__(self, log: DistributedLog, name: Any, ticks_of: Sequence[Task] | None = None):
        self.log, self.name, self._ticks_of = log, name, ticks_of

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, rows: Any) -> Any:
        """Rows of the column: a number, a slice, or row numbers in any order."""
        if isinstance(rows, int | np.integer):
            return self[np.array([rows])][0]
        wanted = self._numbers(rows)
        if (wanted[1:] <= wanted[:-1]).any():
            wanted, places = np.unique(wanted, return_inverse=True)
            return self[wanted][places]
        edges = np.cumsum([0, *self.log.lengths])
        numbers = np.unique(np.searchsorted(edges, wanted, side="right") - 1).tolist()
        local = [wanted[(wanted >= edges[i]) & (wanted < edges[i + 1])] - edges[i] for i in numbers]
        as_ticks = self._ticks_of is not None
        tasks: list[Task | None] = [self._ticks_of[i] if self._ticks_of is not None else None for i in numbers]
        found = self.log.each(_rows, self.name, [_Rows(rows) for rows in local], as_ticks, tasks, parts=numbers)
        return np.concatenate(found) if found else np.zeros(0)

    def _numbers(self, rows: Any) -> np.ndarray:
        return np.arange(*rows.indices(len(self))) if isinstance(rows, slice) else np.asarray(rows)

    def stretches(self, rows: Sequence[Any]) -> list[np.ndarray]:
        """Several stretches in one request to the workers."""
        numbers = [self._numbers(some) for some in rows]
        return np.split(self[np.concatenate(numbers)], np.cumsum([len(some) for some in numbers])[:-1])


@dataclass(frozen=True)
class _Rows:
    """Row numbers of one part."""

    rows: np.ndarray


def _rows(part: Part, name: Any, rows: _Rows, as_ticks: bool, task: Task | None) -> np.ndarray:
    return rows_of(part, name, rows.rows, as_ticks, task)


@dataclass(frozen=True)
class DistributedRecord(Record):
    """A record of one segment whose rows the workers hold."""

    log: DistributedLog = field(repr=False, kw_only=True)
    tasks: tuple[Task, ...] = ()
    looks: tuple[Look, ...] = ()

    @classmethod
    def of(cls, log: DistributedLog, tasks: Sequence[Task], looks: Sequence[Look]) -> DistributedRecord:
        """Put together what the parts have shown."""
        first, n = looks[0].record, len(log)
        ticks: Any = None if first.times.ticks is None else RemoteColumn(log, None, tasks)
        times = Times(n, first.times.kind, ticks, first.times.per_second, first.times.period)
        columns: dict[object, Any] = {name: RemoteColumn(log, name) for name in looks[0].first}
        reading: Any = None if tasks[0].reading is None else RemoteColumn(log, tasks[0].reading)
        notes = tuple(dict.fromkeys(note for part in looks for note in part.record.notes))
        segments = (Segment(0, n),)
        return cls(
            times=times,
            temperature_name=first.temperature_name,
            columns=columns,
            segments=segments,
            reading=reading,
            notes=notes,
            log=log,
            tasks=tuple(tasks),
            looks=tuple(looks),
        )

    def stamp(self, k: int) -> float:
        """Absolute time of a row; those at the ends of parts are known, others are fetched."""
        if self.times.ticks is None:
            return super().stamp(k)
        for part, low, high in zip(self.looks, self._starts[:-1], self._starts[1:], strict=True):
            if k in (low, high - 1):
                return part.first_stamp if k == low else part.last_stamp
        return super().stamp(k)

    def _looked_at(self, column: Any, power: int) -> Moments:
        name = None if column is self.reading else column.name
        parts: list[Moments] = self.log.each(moments_of, list(self.tasks), name, power)
        return reduce(Moments.merged, parts)

    def scanned(self, what: str, usual: Usual) -> Scanned:
        """Codes and peaks of the temperature or the reading, found by the workers; a part knows its neighbours."""
        column: Any = self.reading if what == "reading" else self.columns[self.temperature_name]
        edges, n = self._starts, len(self.log)
        sides = [(max(edge - HALO, 0), edge, min(edge + HALO, n)) for edge in edges]
        near = column.stretches([slice(*ends) for side in sides for ends in pairwise(side)])
        before, behind = near[0:-2:2], near[3::2]
        parts = self.log.each(scan_part, list(self.tasks), what, usual, before, behind)
        return Scanned.together(part.moved(edge) for part, edge in zip(parts, edges, strict=False))

    def told(self) -> DistributedRecord:
        """A record whose workers know what is refused."""
        edges = np.array(self._starts)
        gone = np.concatenate([found.rows for found in self.refused if found.what == "temperature"] or [self.skipped])
        at_end = gone[np.isin(gone, np.concatenate((edges[:-1], edges[1:] - 1)))]
        if len(at_end) or len(self.segments) > 1:
            row = int(at_end[0]) if len(at_end) else self.segments[0].stop
            raise RecordError(
                f"The temperature in row {row} is refused as a spike or a sentinel, and a part of a distributed log "
                "neither begins nor ends there, nor has a gap. Cut the log elsewhere (n_parts), fill the temperature "
                "first, or pass screen=False."
            )
        left = [found.rows for found in self.refused if found.what == "reading"]
        readings, token = np.sort(np.concatenate([np.zeros(0, np.intp), *left])), uuid4().hex
        tasks = [
            replace(task, skipped=_inside(gone, low, high), left_out=_inside(readings, low, high), token=token)
            for task, low, high in zip(self.tasks, edges[:-1], edges[1:], strict=True)
        ]
        record = DistributedRecord.of(self.log, tasks, self.log.each(look, tasks))
        return replace(record, reading=self.reading, notes=self.notes, skipped=self.skipped, refused=self.refused)

    def sweep_effects(self, effects: Sequence[Effect], edges: np.ndarray) -> Swept:
        """Factors of ``[1 | Q | U]`` for each stretch between two `edges`, swept by the workers."""
        states = self._start_states(effects)
        zero, lengths = self.first_stamp(), self.log.lengths
        starts = [SegmentStart(0, zero, None if i == 0 else step) for i, step in enumerate(self._steps())]
        offset = next((part.a_reading for part in self.looks if part.a_reading is not None), 0.0)
        results = self.log.each(
            sweep_part,
            list(self.tasks),
            tuple(effects),
            [tuple(part) for part in states],
            starts,
            zero,
            self._starts[:-1],
            edges,
            sum(lengths),
            offset,
        )
        width = 2 + sum(effect.n_columns() for effect in effects)
        chunks = [TriangularFactor(width) for _ in edges[1:]]
        for found, _ in results:
            for i, chunk in found.items():
                chunks[i].merge(chunk)
        return Swept(chunks, [results[-1][1]], offset)

    @property
    def _starts(self) -> list[int]:
        return [int(edge) for edge in np.cumsum([0, *self.log.lengths])]

    def _steps(self) -> list[float]:
        """Time from the last row of the part before to the first row of each part [s]."""
        if self.times.ticks is None:
            return [self.times.period] * len(self.looks)
        before = [self.looks[0].first_stamp, *(part.last_stamp for part in self.looks[:-1])]
        return [self.times.between(part.first_stamp, last) for part, last in zip(self.looks, before, strict=True)]

    def _start_states(self, effects: Sequence[Effect]) -> list[list[Any]]:
        """State of each effect before each part; None where it begins, or has none."""
        signals = [Signal.of(effect) for effect in effects]
        every = [signal for of_effect in signals for signal in of_effect]
        if not every:
            return [[None] * len(effects) for _ in self.looks]
        before: list[LagState | None] = [None] * len(every)
        states: list[list[Any]] = [[None] * len(effects)]
        rest = self.log.each(ends_from_rest, list(self.tasks), tuple(every))
        for part, step, ends in zip(self.looks[:-1], self._steps(), rest, strict=False):
            row, length = Row(part.first, self.temperature_name), self.times.between(part.last_stamp, part.first_stamp)
            for i, (signal, end) in enumerate(zip(every, ends, strict=True)):
                first = _after_first(signal, float(signal.values(row)[0]), before[i], step)
                left = np.exp(-length / signal.time_constants) * first  # a lag forgets its start
                before[i] = LagState(end.lag_difference + left, end.temperature)
            known = (signal.state(lags) for signal, lags in zip(every, before, strict=True) if lags is not None)
            states.append([joined([next(known) for _ in of_effect]) for of_effect in signals])
        return states


def _inside(rows: np.ndarray, low: int, high: int) -> tuple[int, ...]:
    """Rows ``low:high`` of some, counted from `low`."""
    return tuple(int(row - low) for row in np.sort(rows) if low <= row < high)


def _after_first(signal: Signal, value: float, state: LagState | None, step: float) -> np.ndarray:
    """Lag differences at the first sample of a part."""
    if state is None:
        start = signal.lag.start
        return np.full(len(signal.time_constants), 0.0 if start is None else start - value)
    after = lag_differences(np.array([value]), np.array([step]), signal.time_constants, state, hold=signal.lag.hold)[1]  # type: ignore[arg-type]
    return after.lag_difference
