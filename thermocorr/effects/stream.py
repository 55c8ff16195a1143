"""Effects walked through a record, block by block.

A block of one row costs a hundred times what its arithmetic costs. So the expression that an effect's `signals` says is
written as a Python function of one sample, a line for each operation, with an object for each word that remembers; its
states are those of `Effect.columns`. An effect with `columns` of its own is run by blocks of one row.

Blocks fit the cache; stretches of time, which have factors of their own, are cut from them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..equations import LagState
from ..records import BLOCK_ROWS, Block, History, Record, Segment, SegmentStart
from ..records.times import Times
from .expressions import Decays, Delayed, Lag, Node, Play, Previous, Traced, TraceError, Word, traced
from .protocol import Effect
from .signals import DelayState, joined, parted


class Walked(NamedTuple):
    """Columns of one block."""

    block: Block
    columns: np.ndarray
    """Shape (n, p), Fortran order; the walk does not touch it again."""
    states: list[Any]
    """State of each effect after the block."""


def own_starts(record: Record) -> dict[int, SegmentStart]:
    """Starts of a fitted record: each segment its own."""
    return {key: SegmentStart(key, record.stamp(segment.start), None) for key, segment in enumerate(record.segments)}


def walk(
    effects: Sequence[Effect],
    record: Record,
    *,
    zero: float | None = None,
    starts: dict[int, SegmentStart] | None = None,
    states: dict[int, list[Any]] | None = None,
    size: int = BLOCK_ROWS,
    front: int = 0,
    extra: int = 0,
) -> Iterator[Walked]:
    """Columns of all effects, block by block in time order.

    `effects` (sequence of Effect): Learned effects. `record` (Record): What to walk through. `zero`, `starts` (see
    `Record.blocks`): How the record hangs on the fitted one. `states` (dict of segment number -> list of states):
    Where to start; segments that are not in it start afresh. `size` (int): Rows of a block. `front`, `extra` (int):
    Free columns to leave before and behind the effects' own.
    """
    widths = [effect.n_columns() for effect in effects]
    width = sum(widths)
    current: list[Any] = []
    for block in record.blocks(size, zero, starts):
        if block.start == record.segments[block.segment].start:
            current = list((states or {}).get(block.segment) or [None] * len(effects))
        columns = np.empty((len(block), front + width + extra), order="F")
        at = front
        for i, (effect, n_columns) in enumerate(zip(effects, widths, strict=True)):
            current[i] = effect.fill(block, current[i], columns[:, at : at + n_columns])
            at += n_columns
        yield Walked(block, columns, current)


def needed_columns(effects: Sequence[Effect]) -> list[Any]:
    """Recorded columns that the effects read besides the temperature."""
    return list(dict.fromkeys(name for effect in effects for name in effect.inputs()))


def resume(
    effects: Sequence[Effect], history: History, record: Record
) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
    """Tie a new record to the fitted one, and resume states."""
    record, starts, replay = history.locate(record)
    states: dict[int, list[Any]] = {}
    for number, row in replay.items():
        key = starts[number].key
        assert key is not None  # it hangs on a fitted segment
        states[number] = states_before(effects, history, key, row)
    return record, starts, states


def states_before(effects: Sequence[Effect], history: History, key: int, row: int | None) -> list[Any]:
    """States after the fitted rows before `row`."""
    return list(history.end_states[key]) if row is None else _replay(effects, history, key, row)


def _replay(effects: Sequence[Effect], history: History, key: int, row: int) -> list[Any]:
    """States after the fitted rows before `row`, replayed."""
    kept = history.record
    segment = kept.segments[key]
    part = Record(
        kept.times,
        kept.temperature_name,
        kept.columns,
        (Segment(segment.start, row, segment.run),),
        skipped=kept.skipped[kept.skipped < row],
    )
    start = {0: SegmentStart(key, kept.stamp(segment.start), None)}
    states: list[Any] = []
    for step in walk(effects, part, zero=history.zero, starts=start):
        states = step.states
    return states


_FORGOTTEN = 46.0
"""Time constants after which a start-up decay is zero: exp(-46) is below 1e-20."""


class Sample:
    """One sample: the counterpart of a `Block` of one row."""

    __slots__ = ("begins", "elapsed", "key", "seconds", "segment_zero", "stamp", "step", "temperature", "values")

    def __init__(self) -> None:
        self.begins = True
        """True where a segment begins without a known state."""
        self.step = 1.0
        """Time since the sample before [s]; 1 where `begins`."""
        self.temperature = math.nan
        self.values: Mapping[Any, float] = {}
        """All needed columns, the temperature among them."""
        self.seconds = 0.0
        """Time since the fitted record began [s]."""
        self.elapsed = 0.0
        """Time since the segment began [s]."""
        self.key: int | None = None
        """Fitted segment that the sample belongs to."""
        self.stamp: float = 0
        self.segment_zero: float = 0


@dataclass(frozen=True)
class Stepper:
    """One effect, one sample at a time."""

    step: Callable[[Sample], Sequence[float]]
    """The effect's columns at the next sample."""
    start: Callable[[Any], None]
    """Takes over a state of `Effect.columns`; None where a segment begins."""
    state: Callable[[], Any]
    """The state after the last sample, as `Effect.columns` would return it; None before the first."""
    over: Callable[[int | None], float] = lambda key: math.inf
    """Time in a segment (one that belongs to the fitted one `key`) after which all columns are zero [s]."""


def stepper_of(effect: Effect, times: Times, zero: float, temperature_name: object) -> Stepper:
    """The stepper of a learned effect.

    `effect` (Effect). `times` (Times): Of the fitted record: what a stamp means. `zero` (float): Stamp of the first
    fitted row. `temperature_name` (str or int).
    """
    try:
        expression = traced(effect)
    except TraceError:
        return _by_blocks(effect, times, zero, temperature_name)
    words = [STEPPED[type(word)](word) for word in expression.words]

    def start(state: Any) -> None:
        states = parted(state) or [None] * len(words)
        for word, one in zip(words, states, strict=True):
            word.start(one)

    def state() -> Any:
        states = [word.state() for word in words]
        return None if None in states[:1] else joined(states)

    return Stepper(_compiled(expression, words, times.between(zero, 0)), start, state, _over(expression))


def _over(expression: Traced) -> Callable[[int | None], float]:
    """Time after which start-up decays are zero."""
    asked = {column.arguments[0] for column in expression.columns if _is_item(column)}
    word = asked.pop().detail[1] if len(asked) == 1 and all(map(_is_item, expression.columns)) else None
    if not isinstance(word, Decays):
        return lambda key: math.inf
    ends = {key: _FORGOTTEN * max(taus) for key, taus in word.of_segments if taus}
    return lambda key: -1.0 if key is None else ends.get(key, -1.0)


def _is_item(column: Any) -> bool:
    return isinstance(column, Node) and column.operator == "item"


# ------------------------------------------------------------------------------------------ an expression as a function

_INPUTS = {"T": "temperature", "seconds": "seconds", "elapsed": "elapsed", "step": "step"}
_CALLED = {
    "exp": math.exp, "log": math.log, "log1p": math.log1p, "sqrt": math.sqrt, "sin": math.sin, "cos": math.cos,
    "maximum": max, "minimum": min,
}  # fmt: skip


def _compiled(expression: Traced, words: Sequence[Any], zero_seconds: float) -> Callable[[Sample], Sequence[float]]:
    """The function ``step(sample)``, compiled from safe text."""
    names: dict[str, Any] = {**_CALLED, "inf": math.inf, "nan": math.nan}
    lines, own = [], iter(words)

    def text(value: Any) -> str:
        return f"v{value.number}" if isinstance(value, Node) else f"({value!r})"

    def given(name: str, value: Any) -> str:
        names[name] = value
        return name

    for node in expression.nodes:
        op, args, own_name = node.operator, [text(argument) for argument in node.arguments], f"n{node.number}"
        if op in _INPUTS:
            said = f"sample.{_INPUTS[op]}"
        elif op == "column":
            said = f"sample.values[{given(own_name, node.detail)}]"
        elif op == "angle":
            rate, began = 2.0 * math.pi / node.detail, float(zero_seconds % node.detail)
            said = f"{rate!r} * ({began!r} + sample.seconds)"
        elif op == "word":
            word = node.detail[1]
            step = _decays(word) if isinstance(word, Decays) else next(own).step
            more = {Lag: ", sample.step", Delayed: ", sample.elapsed"}.get(type(word), "")
            said = f"{given(own_name, step)}({'sample.key, sample.elapsed' if not args else args[0] + more})"
        elif op == "item":
            said = f"{args[0]}[{node.detail}]"
        elif op == "neg":
            said = f"-{args[0]}"
        elif op == "**":
            said = f"{args[0]} ** {node.detail}"
        elif op == "where":
            said = f"{args[1]} if {args[0]} else {args[2]}"
        elif op in _CALLED:
            said = f"{op}({', '.join(args)})"
        else:
            said = f"{args[0]} {op} {args[1]}"
        lines.append(f"    v{node.number} = {said}")
    columns = "".join(f"{text(column)}, " for column in expression.columns)
    code = "\n".join(["def step(sample):", *_without_unused(lines, expression), f"    return ({columns})"])
    exec(compile(code, "<signals>", "exec"), names)
    return names["step"]  # type: ignore[no-any-return]


def _without_unused(lines: list[str], expression: Traced) -> list[str]:
    """Only lines of nodes that a column or a word needs."""
    needed = {column.number for column in expression.columns if isinstance(column, Node)}
    for node in reversed(expression.nodes):
        if node.number in needed or node.operator == "word":
            needed |= {node.number, *(arg.number for arg in node.arguments if isinstance(arg, Node))}
    return [lines[number] for number in sorted(needed)]


# ------------------------------------------------------------------------------------------------ words that remember


def decay_and_gain_of_step(step: float, time_constant: float, first_order: bool) -> tuple[float, float]:
    """Factors of a single step, in plain floats."""
    ratio = step / time_constant
    if ratio < 0.1:
        half = 0.5 * ratio
        square = half * half
        top = 105.0 + 10.0 * square
        gain = top / (half * top + (square + 45.0) * square + 105.0)
        decay = 1.0 - ratio * gain
    else:
        decay = math.exp(-ratio)
        gain = (1.0 - decay) / ratio
    return decay, gain if first_order else 1.0


class SteppedLag:
    """Lag differences, eqs. (19) (25), from sample to sample."""

    def __init__(self, word: Lag):
        self.time_constants = word.time_constants
        self.first_order = word.hold == "first_order"
        self.known: dict[float, list[tuple[float, float]]] = {}
        self.start(None)

    def start(self, state: LagState | None) -> None:
        """Take over a state; None where a segment begins."""
        if state is None:
            self.differences, self.last = [0.0] * len(self.time_constants), None
        else:
            self.differences, self.last = np.asarray(state.lag_difference, float).tolist(), float(state.temperature)

    def state(self) -> LagState | None:
        """The state after the last sample."""
        return None if self.last is None else LagState(np.array(self.differences), self.last)

    def step(self, value: float, step: float) -> list[float]:
        """Lag differences at the next sample, as a new list."""
        last, self.last = self.last, value
        if last is None:
            return self.differences
        factors = self.known.get(step)
        if factors is None:
            factors = [decay_and_gain_of_step(step, tau, self.first_order) for tau in self.time_constants]
            # A clock that jitters does not fill the memory with decays: 64 different steps are remembered.
            if len(self.known) < 64:
                self.known[step] = factors
        change = value - last
        # d_next = a d - g (T_next - T): eq. (25) for d = lagged - T
        self.differences = [a * d - g * change for (a, g), d in zip(factors, self.differences)]  # noqa: B905
        return self.differences


class SteppedNumber:
    """A word whose state is one number: the last value."""

    def __init__(self, word: Word):
        self.last: float | None = None

    def start(self, state: float | None) -> None:
        """Take over a state; None where a segment begins."""
        self.last = state

    def state(self) -> float | None:
        """The state after the last sample."""
        return self.last

    def step(self, value: float) -> float:
        """The value before."""
        before, self.last = self.last, value
        return value if before is None else before


class SteppedPlay(SteppedNumber):
    """The play operator; its state is the follower's position."""

    def __init__(self, word: Play):
        super().__init__(word)
        self.half = word.width / 2

    def step(self, value: float) -> float:
        """Position of the play operator."""
        last = self.last
        self.last = value if last is None else min(max(last, value - self.half), value + self.half)
        return self.last


class SteppedDelay:
    """A value of a while ago."""

    def __init__(self, word: Delayed):
        self.delay = word.delay
        self.samples: deque[tuple[float, float]] = deque()  # of the last `delay` seconds, and one before them

    def start(self, state: DelayState | None) -> None:
        """Take over a state; None where a segment begins."""
        self.samples.clear()
        if state is not None:
            self.samples.extend(zip(state.elapsed.tolist(), state.temperature.tolist(), strict=True))

    def state(self) -> DelayState | None:
        """The state after the last sample."""
        if not self.samples:
            return None
        elapsed, values = zip(*self.samples, strict=True)
        return DelayState(np.array(elapsed), np.array(values))

    def step(self, value: float, elapsed: float) -> float:
        """The delayed value, interpolated between samples."""
        samples, then = self.samples, elapsed - self.delay
        samples.append((elapsed, value))
        while len(samples) > 1 and samples[1][0] <= then:
            samples.popleft()
        t0, v0 = samples[0]
        if then <= t0 or len(samples) == 1:
            return v0
        t1, v1 = samples[1]
        return (v1 - v0) / (t1 - t0) * (then - t0) + v0


STEPPED: dict[type[Word], Callable[[Any], Any]] = {
    Lag: SteppedLag, Previous: SteppedNumber, Play: SteppedPlay, Delayed: SteppedDelay,
}  # fmt: skip
"""Word -> what runs it from sample to sample."""


def _decays(word: Decays) -> Callable[[int | None, float], list[float]]:
    """Decays at one sample, eq. (18), zeros for other segments."""
    places, at = {}, 0
    for key, taus in word.of_segments:
        places[key] = (at, taus)
        at += len(taus)
    zeros = [0.0] * at

    def step(key: int | None, elapsed: float) -> list[float]:
        columns = zeros.copy()
        first, taus = places.get(key, (0, ()))  # type: ignore[arg-type]
        for i, tau in enumerate(taus, first):
            exponent = elapsed / -tau
            columns[i] = math.exp(exponent) if exponent >= -_FORGOTTEN else 0.0  # eq. (18)
        return columns

    return step


# ------------------------------------------------------------------------------------------------- any other effect


def _by_blocks(effect: Effect, times: Times, zero: float, temperature_name: object) -> Stepper:
    """Any effect by blocks of one row."""
    now: Any = None
    divisor = 1_000_000_000 // times.per_second if times.kind not in ("rows", "seconds") else 1
    dtype = float if times.kind == "seconds" else np.int64

    def step(sample: Sample) -> list[float]:
        nonlocal now
        stamp = sample.stamp if times.kind == "seconds" else sample.stamp // divisor
        one = replace(times, n=1, ticks=np.array([stamp], dtype))
        columns: dict[Any, Any] = {name: np.array([value]) for name, value in sample.values.items()}
        record = Record(one, temperature_name, columns, (Segment(0, 1),))
        steps = np.array([sample.step])
        block = Block(
            record=record,
            segment=0,
            start=0,
            stop=1,
            begins=sample.begins,
            steps=steps,
            zero=zero,
            segment_zero=sample.segment_zero,
            segment_key=sample.key,
        )
        part, now = effect.columns(block, now)
        return np.asarray(part, float).ravel().tolist()

    def start(state: Any) -> None:
        nonlocal now
        now = state

    return Stepper(step, start, lambda: now)


N_CHUNKS = 20
"""Stretches of time whose factors are kept apart for standard errors."""


def block_rows(n_used: int, n_chunks: int = N_CHUNKS) -> int:
    """Rows of a block for about `n_chunks` in a record."""
    return int(np.clip(-(-n_used // n_chunks), 2048, BLOCK_ROWS))


def equal_edges(record: Record, n_chunks: int = N_CHUNKS) -> np.ndarray:
    """Positions that cut a record into equal numbers of rows.

    Where readings hold less than half of the record, that part is cut, see `Record.read_places`.
    """
    starts = np.array([segment.start for segment in record.segments])
    before = np.cumsum([0, *(segment.n_rows for segment in record.segments)])
    low, high = record.read_places
    first, last = 0, record.n_used
    if (low, high) != (0, record.n_rows):
        own = np.clip(np.searchsorted(starts, (low, high - 1), side="right") - 1, 0, None)
        first, last = (before[own] + (low, high) - starts[own]).tolist()
    wanted = np.unique(first + np.arange(1, n_chunks) * (last - first) // n_chunks)
    segment = np.searchsorted(before, wanted, side="right") - 1
    return np.unique(np.concatenate(([0], starts[segment] + wanted - before[segment], [record.n_rows])))


def pieces(edges: np.ndarray, block: Block) -> Iterator[tuple[int, slice]]:
    """Pieces between `edges` that a block touches, and their rows."""
    first, last = np.searchsorted(edges, (block.start, block.stop - 1), side="right").tolist()
    ends = block.first_from(edges[first - 1 : last + 1]).tolist()
    for chunk, (low, high) in enumerate(pairwise(ends), start=first - 1):
        if low < high:
            yield chunk, slice(low, high)
