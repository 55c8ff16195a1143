"""What a worker does with one part of a distributed record."""

from __future__ import annotations

import ctypes
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
import pandas as pd

from ..effects.expressions import Lag, Previous, TraceError, Word, traced
from ..effects.protocol import Effect, refuse_foresight
from ..effects.signals import BlockSignals
from ..equations import LagState, TriangularFactor, lags_at_end
from ..equations.spikes import Scanned, scan_stretch
from ..equations.statistics import Moments
from ..equations.usual import Usual
from ..estimators.fitting import a_reading, swept_on
from ..estimators.fused import Begun
from ..estimators.threads import one_blas_thread
from ..records import BLOCK_ROWS, Block, Layout, ParquetLog, Record, RecordError, Segment, SegmentStart, read_record
from ..records.screen import LeftOut

Part = Any
"""A `ParquetLog` or a DataFrame."""


FORGOTTEN = 46.0
"""Time constants after which a lag has forgotten its start: exp(-46) is below 1e-20."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Names of glibc's malloc.h."""
LARGEST_KEPT = 16 * 2**20
"""Largest array whose memory is kept [bytes]: larger than any of a block."""
KEPT_RECORDS = 64
"""Parts whose records a worker keeps, so as not to validate them again for every question."""
_validated: dict[tuple[str, int], Record] = {}


class Row(dict[object, np.ndarray]):
    """One row of a record, as effects see a block."""

    def __init__(self, values: dict[object, float], temperature_name: object):
        super().__init__({name: np.array([value]) for name, value in values.items()})
        self.temperature = self[temperature_name]


@dataclass(frozen=True)
class Signal:
    """A word of an effect's formula whose state depends on inputs alone: lags, or the value before."""

    effect: Effect
    number: int
    """Number of the word among those of the effect's formula."""

    @classmethod
    def of(cls, effect: Effect) -> list[Signal]:
        """The words of an effect's formula; none where it has none, or where one of them depends on more."""
        try:
            expression = traced(effect)
        except TraceError:
            return []
        plain = all(isinstance(w, Lag | Previous) and expression.of_inputs(w.value) for w in expression.words)
        return [cls(effect, number) for number in range(len(expression.words))] if plain else []

    @cached_property
    def word(self) -> Word:
        """The word itself."""
        return traced(self.effect).words[self.number]

    @property
    def lag(self) -> Lag:
        """The word as lags; the value before is the last input of lags that are none."""
        return self.word if isinstance(self.word, Lag) else Lag(self.word.value, (), "first_order", None)

    @property
    def time_constants(self) -> np.ndarray:
        """Time constants of the lags [s]."""
        return np.array(self.lag.time_constants)

    def values(self, block: Block | Row) -> np.ndarray:
        """What the word follows, shape (n,)."""
        value = traced(self.effect).value(self.word.value, BlockSignals(block, None))  # type: ignore[arg-type]
        return np.asarray(value, float)

    def state(self, lags: LagState) -> Any:
        """State of the word."""
        return lags if isinstance(self.word, Lag) else lags.temperature


@dataclass(frozen=True, kw_only=True)
class Look:
    """What is known of a part after a first look."""

    record: Record
    """The record without columns, and with the times of its first and last row only."""
    first_stamp: float
    last_stamp: float
    first: dict[object, float]
    """First value of each column."""
    last: dict[object, float]
    a_reading: float | None
    """A reading, near all the others; None where there is none."""


@dataclass(frozen=True)
class Task:
    """How to read a part as a record."""

    layout: Layout
    reading: str | None
    needed: tuple[Any, ...]
    number: int
    """Number of the part in the log."""
    token: str
    """Name of the log, by which a worker finds a part that it has validated before."""
    skipped: tuple[int, ...] = ()
    """Rows of the part that are passed over."""
    left_out: tuple[int, ...] = ()
    """Rows of the part whose readings are left out."""

    def record(self, part: Part, first_row: int = 0) -> Record:
        """The part as a record of one segment."""
        key = (self.token, self.number)
        if key not in _validated:
            while len(_validated) >= KEPT_RECORDS:
                _validated.pop(next(iter(_validated)))
            _validated[key] = self._read(part)
        record = _validated[key]
        if record.times.ticks is None:
            record = replace(record, times=replace(record.times, first_row=first_row))
        return record

    @contextmanager
    def named(self) -> Iterator[None]:
        """Say in which part something is wrong that is found within; columns are looked at when they are read."""
        try:
            yield
        except RecordError as error:
            raise RecordError(f"Part {self.number} of the log: {error}") from None

    def _read(self, part: Part) -> Record:
        y = None if self.reading is None else part[self.reading]
        with self.named():
            record = read_record(part, self.layout, y=y, needed=self.needed, quiet=True)
        if len(record.segments) != 1 or record.n_used != record.n_rows or record.order is not None:
            raise RecordError(
                f"Part {self.number} of the log is not one segment: {' '.join(record.notes) or 'it has a gap.'} A "
                "distributed log is one stretch: fill missing temperatures first, fit longer stretches as devices of a "
                "fleet, or fit in one process."
            )
        if self.left_out:
            record = replace(record, reading=LeftOut(record.reading, np.array(self.left_out)))  # type: ignore[arg-type]
        return replace(record, skipped=np.array(self.skipped, np.intp), known_moments={})


def look(part: Part, task: Task) -> Look:
    """Times, moments, first and last values of a part."""
    keep_freed_memory()
    record = task.record(part)
    n = record.n_rows
    times = record.times
    if times.ticks is not None:
        times = replace(times, n=2, ticks=np.array([times.ticks[0], times.ticks[n - 1]]))
    first, last = ({name: float(column[end]) for name, column in record.columns.items()} for end in (0, n - 1))
    with task.named():
        reading = None if record.reading is None else a_reading(record)
    return Look(
        record=Record(times, record.temperature_name, {}, record.segments, notes=record.notes),
        first_stamp=record.stamp(0),
        last_stamp=record.stamp(n - 1),
        first=first,
        last=last,
        a_reading=reading,
    )


def moments_of(part: Part, task: Task, column: Any, power: int) -> Moments:
    """Moments of a column of a part, or of a power of it; of its readings where `column` is None."""
    record = task.record(part)
    with task.named():
        return record.reading_moments() if column is None else record.moments(column, power)


def scan_part(part: Part, task: Task, what: str, usual: Usual, before: np.ndarray, behind: np.ndarray) -> Scanned:
    """Codes and peaks of a part's temperature or reading; values `before` and `behind` it are its neighbours."""
    record = task.record(part)
    with task.named():
        return _scan(record, what, usual, before, behind)


def _scan(record: Record, what: str, usual: Usual, before: np.ndarray, behind: np.ndarray) -> Scanned:
    column: Any = record.reading if what == "reading" else record.columns[record.temperature_name]
    n = record.n_rows

    def read(low: int, high: int) -> np.ndarray:
        inside = np.asarray(column[max(low, 0) : min(high, n)], float)
        return np.concatenate((before[len(before) + min(low, 0) :], inside, behind[: max(high - n, 0)]))

    return Scanned.together(scan_stretch(read, 0, n, -len(before), n + len(behind), usual))


def ends_from_rest(part: Part, task: Task, signals: Sequence[Signal]) -> list[LagState]:
    """State of each signal's lags at the end of a part, had they been at rest at its first sample.

    Only the rows are read that the slowest lag still feels at the end.
    """
    record = task.record(part)
    slowest = max(signal.lag.memory for signal in signals)
    first = _first_felt(record, FORGOTTEN * slowest)
    states = [LagState(np.zeros(len(signal.time_constants)), np.nan) for signal in signals]
    for number, block in enumerate(replace(record, segments=(Segment(first, record.n_rows),)).blocks()):
        for i, signal in enumerate(signals):
            values = signal.values(block)
            state = states[i] if number else LagState(states[i].lag_difference, float(values[0]))
            states[i] = lags_at_end(values, block.steps, signal.time_constants, state, hold=signal.lag.hold)  # type: ignore[arg-type]
    return states


def _first_felt(record: Record, seconds: float) -> int:
    """First row of the last block that begins more than so many seconds before the end; 0 where none does."""
    starts = range(0, record.n_rows, BLOCK_ROWS)
    last = record.stamp(record.n_rows - 1)
    forgotten = bisect_right(starts, -seconds, key=lambda row: record.times.between(record.stamp(row), last))
    return starts[max(forgotten - 1, 0)]


@cache
def keep_freed_memory() -> None:
    """Let a worker use the memory of one block again for the next, instead of returning it to the system each time.

    Dask's workers give freed memory back at once (MALLOC_TRIM_THRESHOLD_, which also stops glibc from raising the size
    from which it maps memory anew): fresh pages for every block cost more than the arithmetic on them. Without glibc
    nothing is done.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT)
    mallopt(M_TRIM_THRESHOLD, 2 * LARGEST_KEPT)


def sweep_part(
    part: Part,
    task: Task,
    effects: Sequence[Effect],
    states: list[Any],
    start: SegmentStart,
    zero: float,
    first_row: int,
    edges: np.ndarray,
    n_used: int,
    offset: float,
) -> tuple[dict[int, TriangularFactor], list[Any]]:
    """Factors of a part's rows, by the number of their stretch, and the states at its end."""
    refuse_foresight(effects, "a part of the log")
    keep_freed_memory()
    record = task.record(part, first_row)
    with one_blas_thread():
        chunks, ends = swept_on(record, effects, edges - first_row, offset, Begun(zero, start, states), n_used)
    for effect, known, state in zip(effects, states, ends, strict=True):
        if task.number and state is not None and known is None:
            raise RecordError(
                f"The effect {effect.label()!r} carries a state that is no plain lag's, so a part of the log cannot be "
                "worked on before the parts that stand before it. Fit this model in one process."
            )
    return {i: chunk for i, chunk in enumerate(chunks) if chunk.n_rows}, ends


def rows_of(part: Part, name: Any, rows: Any, as_ticks: bool, task: Task | None) -> np.ndarray:
    """Some rows of a column, or of the times."""
    if as_ticks:
        assert task is not None
        ticks = task.record(part).times.ticks
        assert ticks is not None  # rows without times have no ticks to ask for
        return np.asarray(ticks[rows])
    values = part[name]
    return np.asarray(values.iloc[rows] if isinstance(values, pd.Series) else values[rows])


def names_of(part: Part) -> list[Any]:
    """Columns of a part."""
    return list(part.columns)


def opened(part: Any) -> Part:
    """A path as a `ParquetLog`; everything else as it is."""
    return ParquetLog(part) if isinstance(part, str) or hasattr(part, "__fspath__") else part
