"""The stream of a live corrector, by samples or blocks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import mul
from typing import Any, NamedTuple

import numpy as np

from ..effects.stream import Sample, Walked, needed_columns, states_before, stepper_of, walk
from ..model import DynamicBiasRegressor
from ..model.input_errors import Felt
from ..records import Record, Segment, SegmentStart
from ..records.gate import EMPTY, JUMP, Doubt, Gate
from ..records.read import GAP_STEPS
from ..records.record import Flags
from .clock import Clock
from .samples import LiveErrors
from .state import StreamState

SUSPECT_GAPS = 1000.0
"""A step of more than so many gaps is more likely a damaged time: hours for a log with a step of a second."""
REASONS = (
    "suspect time", JUMP, "no reading", "washout", "doubtful input", "behind gap", "outside fitted range",
    "gap",
)  # fmt: skip
"""Reasons for distrust that leave a number, the weightiest first."""
SUSPECT, JUMPED, NO_READING, WASHOUT, DOUBTFUL, BEHIND, OUTSIDE, GAP = (1 << bit for bit in range(len(REASONS)))
FLAGS = tuple(tuple(r for bit, r in enumerate(REASONS) if mask >> bit & 1) for mask in range(1 << len(REASONS)))
BACKWARD, STALE = ("backward time",), ("stale time",)
NONE: dict[Any, Any] = {}


class Advanced(NamedTuple):
    """Result of a stream for one sample."""

    bias: float
    flags: tuple[str, ...]
    counts: bool
    """True if its corrected reading may move a tracked reference."""
    variances: np.ndarray | None = None
    """What `LiveErrors.variances` says of it, shape (2, 1); None unless asked for, and where there is no trust."""


class Stream:
    """A stream: its state, and how it goes on.

    `model` (DynamicBiasRegressor). `continues` (bool): Whether the stream may continue or repeat the fitted record.
    `errors` (LiveErrors, optional): Where uncertainties are asked for.
    """

    def __init__(self, model: DynamicBiasRegressor, continues: bool, errors: LiveErrors | None = None):
        features = model.features_
        self.model, self.continues = model, continues
        self.history = history = features.history_ if errors is None else errors.history
        self.effects = features.effect_list() if errors is None else errors.effects
        self.errors = errors
        self.temperature = temperature = history.record.temperature_name
        self.gap_error = model._gap_error()
        self.inputs = [column for column in needed_columns(self.effects) if column != temperature]
        self._steppers, self._others = (
            [stepper_of(effect, history.record.times, history.zero, temperature) for effect in self.effects]
            for _ in range(2)
        )
        edges = np.cumsum([0, *(effect.n_columns() for effect in self.effects)]).tolist()
        coef = np.zeros(edges[-1])
        coef[: len(model.coef_)] = model.coef_
        removed = [effect.removed_by_correct for effect in features.effect_list()]
        counted = [*removed, *(False for _ in self.effects[len(removed) :])]
        self._coefficients = [
            (coef[low:high] * removed).tolist() for (low, high), removed in zip(pairwise(edges), counted, strict=True)
        ]
        self._edges = edges
        self._level = model._removed_level
        self._ranges = model._learned_ranges().tolist() + [[-math.inf, math.inf]] * (len(self.effects) - len(removed))
        self._low, self._high = model.reading_.temperature_range
        self._unknown = model.reading_.temperature_gaps
        self._washout, self._deviation = model.washout_, model.residual_std_
        self._max_gap = math.inf if history.max_gap is None else history.max_gap
        motions = {} if history.screen is None else {c: one.motion for c, one in history.screen.inputs.items()}
        self._gates = [
            (column, Gate(motion, self._max_gap)) for column, motion in motions.items() if motion is not None
        ]
        self._doubts = Doubt(len(self._gates), self._deviation, self._washout)
        self.gap = GAP_STEPS * history.usual_step if history.max_gap is None else history.max_gap
        self.reset()

    def reset(self) -> None:
        """Forget the stream: the next sample is taken as the first."""
        self.clock = Clock(self.history)
        self._sample = Sample()
        self.put(StreamState())

    def state(self) -> StreamState:
        """All that is remembered of the samples so far."""
        is_open = self._open
        states = tuple(stepper.state() for stepper in self._steppers) if is_open else ()
        key, zero = (self._sample.key, self._sample.segment_zero) if is_open else (None, 0)
        return StreamState(
            last=self.last,
            run=self._run,
            seen=tuple(self._seen),
            open=is_open,
            key=key,
            segment_zero=zero,
            states=states,
            behind_gap=tuple(None if C is None else tuple(C.ravel().tolist()) for C in self._behind_gap),
            gates=tuple(gate.state() for _, gate in self._gates),
            gated=self._gated,
            doubts=self._doubts.state() if is_open and self._has_twin else None,
            twin=tuple(stepper.state() for stepper in self._others) if is_open and self._has_twin else None,
        )

    def put(self, state: StreamState) -> None:
        """Go on where `state` was taken."""
        self.last: Any = state.last
        self._run, self._seen = state.run, list(state.seen)
        self._open, self._until = state.open, -math.inf
        self._behind_gap: Felt = tuple(
            None if C is None else np.reshape(C, 2 * [len(law.weights)])
            for C, law in zip(state.behind_gap, self.gap_error.laws, strict=False)
        )
        for (_, gate), known in zip(self._gates, state.gates or [EMPTY] * len(self._gates), strict=True):
            gate.put(known)
        self._gated, self._has_twin = state.gated, state.twin is not None
        self._doubts.put(state.doubts)
        if state.open:
            self._take_up(state.key, state.segment_zero, state.states)
            for stepper, known in zip(self._others, state.twin or (), strict=False):
                stepper.start(known)

    def step_to(self, stamp: Any, run: Any) -> float:
        """Time since the last sample of the run [s]."""
        return math.inf if self.last is None or run != self._run else self.clock.between(stamp, self.last)

    def returns_behind(self, before: StreamState, stamp: Any, run: Any) -> bool:
        """True if a sample shows that the last time was false."""
        if run != self._run or not stamp < self.last:
            return False
        if before.last is None or before.run != run:  # the first of its run, unless it follows closely on the fit
            key = self._sample.key if self._open else None
            return key is None or self.history.step_before(key, self.last) > self.gap
        return bool(stamp > before.last)

    # ------------------------------------------------------------------------------------------------- one by one

    def advance(self, stamp: Any, run: Any, values: dict[Any, float], known: bool) -> Advanced:
        """Go on by one sample that lacks no input.

        `known` says whether it has a reading.
        """
        sample, clock = self._sample, self.clock
        step = self.step_to(stamp, run)
        if step <= 0.0:
            return Advanced(math.nan, STALE if step == 0.0 else BACKWARD, False)
        seconds = clock.between(stamp, self.history.zero)
        values, twins, held, accepted = self._judged(values, seconds, run)
        goes_on = self._open and step <= self._max_gap and step < math.inf
        self.last, self._run = stamp, run
        T = values[self.temperature]
        since = step
        if goes_on:
            sample.begins, sample.step = False, step
        else:
            self._behind_gap, self._has_twin = (), False
            self._doubts.put()
            since = self._begin(stamp, run, values)
            step = since if step == math.inf else step
        unknown = 0.0
        if since > self.gap_error.least or self._behind_gap:
            variance, self._behind_gap = self.gap_error.of_rows(np.array([since]), self._behind_gap)
            unknown = float(variance[0])
        sample.stamp, sample.seconds = stamp, seconds
        sample.elapsed = elapsed = clock.between(stamp, sample.segment_zero)
        if elapsed > self._until:
            self._settle(elapsed)
        if twins and not self._has_twin:
            for stepper, other in zip(self._steppers, self._others, strict=True):
                other.start(stepper.state())
        self._has_twin = self._has_twin or bool(twins)
        doubt = 0.0
        row, bias = self._stepped(self._steps, values)
        if self._has_twin:
            doubt = self._doubt(bias, {**values, **twins}, twins, accepted, seconds)
        mask = (0 if known else NO_READING) | (JUMPED if held else 0)
        if sample.key is None and elapsed < self._washout:
            mask |= WASHOUT
        if not self._low <= T <= self._high or any(low < T < high for low, high in self._unknown):
            mask |= OUTSIDE
        for first, stop, low, high in self._guarded:
            if not low <= sum(map(mul, row[first:stop], self._weights[first:stop])) <= high:
                mask |= OUTSIDE
        if doubt > self._deviation:
            mask |= DOUBTFUL
        if unknown > self._deviation**2:
            mask |= BEHIND
        if bias - bias != 0.0:  # far outside: powers of it are no numbers
            bias, mask = math.nan, mask | OUTSIDE
        if step > self.gap:
            mask |= GAP if step <= SUSPECT_GAPS * self.gap else SUSPECT
        if self.errors is None or mask & (NO_READING | WASHOUT) or bias != bias:
            return Advanced(bias, FLAGS[mask], not mask & ~GAP)
        columns = np.zeros((1, self._edges[-1]))
        columns[0, self._active] = row
        found = self.errors.variances(columns, np.array([sample.seconds]), np.array([bias]))
        found[0] += doubt * doubt + unknown
        return Advanced(bias, FLAGS[mask], not mask & ~GAP, found)

    def _judged(
        self, values: dict[Any, float], seconds: float, run: Any
    ) -> tuple[dict[Any, float], dict[Any, float], bool, dict[Any, bool]]:
        """Inputs, twins of doubted ones, and their states."""
        if run != self._gated:
            self._forget_inputs(run)
        twins, held, accepted = NONE, False, NONE
        for column, gate in self._gates:
            if (said := gate.one(values[column], seconds)) is None:
                continue
            held, values = held or said.held, {**values, column: said.value}
            if said.twin == said.twin:
                twins = {**twins, column: said.twin}
            if said.accepted:
                accepted = {**accepted, column: True}
        return values, twins, held, accepted

    def _forget_inputs(self, run: Any) -> None:
        self._gated = run
        for _, gate in self._gates:
            gate.put(EMPTY)

    def _stepped(self, steps: Sequence[Any], values: dict[Any, float]) -> tuple[list[float], float]:
        """Columns at a sample, and the bias."""
        sample, row = self._sample, list[float]()
        sample.temperature, sample.values = values[self.temperature], values
        try:
            for advance in steps:
                row += advance(sample)
            return row, sum(map(mul, row, self._weights)) + self._level
        except (ArithmeticError, ValueError):
            return row, math.nan

    def _doubt(self, bias: float, others: dict[Any, float], twins: Any, accepted: Any, seconds: float) -> float:
        """Change of the bias by doubtful inputs."""
        _, found = self._stepped(self._other_steps, others)
        doubted, sure = (np.array([[column in each for column, _ in self._gates]]) for each in (twins, accepted))
        doubt = self._doubts.rows(doubted, sure, np.array([bias - found]), np.array([seconds]))
        self._has_twin = not self._doubts.over()
        return float(doubt[0])

    def _settle(self, elapsed: float) -> None:
        """Drop effects that are over: decayed starts."""
        key = self._sample.key
        active = [i for i, stepper in enumerate(self._steppers) if stepper.over(key) >= elapsed]
        self._steps, self._other_steps = ([each[i].step for i in active] for each in (self._steppers, self._others))
        self._weights = [weight for i in active for weight in self._coefficients[i]]
        self._active = [column for i in active for column in range(self._edges[i], self._edges[i + 1])]
        self._guarded, at = [], 0
        for i in active:
            first, at = at, at + self._edges[i + 1] - self._edges[i]
            if self._ranges[i][0] > -math.inf:
                self._guarded.append((first, at, *self._ranges[i]))
        self._until = min((self._steppers[i].over(key) for i in active), default=math.inf)

    def _begin(self, stamp: Any, run: Any, values: Any) -> float:
        """Start a segment; returns the step it continues [s]."""
        start, states = self._tied(stamp, run, values)
        key, zero, step = (None, stamp, None) if start is None else start
        self._take_up(key, zero, states)
        self._sample.begins = step is None
        self._sample.step = 1.0 if step is None else step
        self._open, self._until = True, -math.inf
        return 0.0 if step is None else step

    def _take_up(self, key: int | None, segment_zero: Any, states: Any) -> None:
        self._sample.key, self._sample.segment_zero = key, segment_zero
        for stepper, state in zip(self._steppers, states, strict=True):
            stepper.start(state)

    def _tied(self, stamp: Any, run: Any, values: Any) -> tuple[SegmentStart | None, list[Any]]:
        """The fitted states that a segment continues."""
        first = run not in self._seen
        if first:
            self._seen.append(run)
        tied = self.history.tie(stamp, run, values, first) if self.continues else None
        nothing: list[Any] = [None] * len(self.effects)
        if tied is None:
            return None, nothing
        start, replay = tied
        if start.step is None or start.key is None:
            return start, nothing
        return start, states_before(self.effects, self.history, start.key, replay)

    # -------------------------------------------------------------------------------------------------- in blocks

    def advance_block(self, stamps: np.ndarray, run: Any, values: Any, reading: np.ndarray) -> AdvancedBlock:
        """Advance by many complete samples of one run."""
        out = AdvancedBlock.empty(len(stamps))
        same_run = self.last is not None and run == self._run
        before = np.maximum.accumulate(np.concatenate(([self.last if same_run else stamps[0]], stamps)))[:-1]
        late = stamps <= before
        late[0] &= same_run  # the first of a run has none before it
        out.flags[late] = np.where(stamps[late] == before[late], STALE[0], BACKWARD[0])
        rows = np.flatnonzero(~late)
        values, twins, held, accepted = self._judged_rows(rows, stamps, run, values)
        if not len(rows):
            return out
        kept: Any = slice(None) if len(rows) == len(stamps) else rows
        here = stamps[kept]
        values = {name: column[kept] for name, column in values.items()}
        steps = np.empty(len(rows))
        steps[0] = self.step_to(here[0].item(), run)
        steps[1:] = self.clock.between(here[1:], here[:-1])
        fresh = steps > self._max_gap
        fresh[0] |= not (self._open and same_run)
        self.last, self._run = here[-1].item(), run
        record, starts, states = self._record(here, steps, values, fresh, run)
        twins, accepted = ({name: column[kept] for name, column in each.items()} for each in (twins, accepted))
        others = (
            self._other_record(record, states, twins, bool(fresh[0]))
            if twins or (self._has_twin and not fresh[0])
            else None
        )
        walked: list[list[Walked]] = [[], []]

        def noted(number: int, record: Record, states: dict[int, list[Any]]) -> Iterator[Walked]:
            for step in walk(self.effects, record, zero=self.history.zero, starts=starts, states=states):
                walked[number][:] = [step]
                yield step

        measured, behind = reading[kept], {} if fresh[0] else {0: self._behind_gap}
        doubted, sure = np.zeros((2, len(here), len(self._gates)), bool)
        for number, (column, _) in enumerate(self._gates):
            if column in twins:
                doubted[:, number] = np.isfinite(twins[column])
            if column in accepted:
                sure[:, number] = accepted[column]
        with np.errstate(over="ignore", invalid="ignore"):  # powers of a temperature far outside: a flag says it
            other_blocks = None if others is None else self.model._weighed(noted(1, *others))
            for block, parts in self.model._weighed(noted(0, record, states)):
                into = rows[block.rows]
                bias = self.model._removed_part(parts)
                flags = self.model._block_flags(block, measured[block.rows], parts)
                flags[held[into]] = JUMP
                doubt = np.zeros(len(bias))
                if other_blocks is not None:
                    if fresh[block.start] and block.start == record.segments[block.segment].start:
                        self._doubts.put()
                    difference = bias - self.model._removed_part(next(other_blocks)[1])
                    doubt = self._doubts.rows(doubted[block.rows], sure[block.rows], difference, block.seconds)
                flags[flags.are("", "outside fitted range") & (doubt > self._deviation)] = "doubtful input"
                unknown = self.gap_error.of_block(block, behind)
                self.model._mark_behind_gaps(flags, unknown)
                absurd = ~np.isfinite(bias)
                bias[absurd], flags[absurd & flags.are("")] = np.nan, "outside fitted range"
                flags[flags.are("") & (steps[block.rows] > self.gap)] = "gap"
                flags[steps[block.rows] > SUSPECT_GAPS * self.gap] = "suspect time"
                out.bias[into], out.flags[into] = bias, flags
                if self.errors is not None:
                    found = self.errors.variances(walked[0][0].columns, block.seconds, bias)
                    found[0] += doubt**2 + unknown
                    unsure = np.isnan(measured[block.rows]) | flags.are("no reading")
                    found[:, unsure | self.model._in_washout(block)] = np.nan
                    out.variances[:, into] = found
        end = walked[0][0]
        self._open, self._until, self._behind_gap = True, -math.inf, behind[end.block.segment]
        self._take_up(end.block.segment_key, end.block.segment_zero, end.states)
        self._has_twin = others is not None and not self._doubts.over()
        for stepper, known in zip(self._others, walked[1][0].states if self._has_twin else (), strict=False):
            stepper.start(known)
        return out

    def _judged_rows(
        self, rows: np.ndarray, stamps: np.ndarray, run: Any, values: dict[Any, np.ndarray]
    ) -> tuple[dict[Any, np.ndarray], dict[Any, np.ndarray], np.ndarray, dict[Any, np.ndarray]]:
        """`_judged` of some of many rows."""
        twins: dict[Any, np.ndarray] = {}
        accepted: dict[Any, np.ndarray] = {}
        values, held = dict(values), np.zeros(len(stamps), bool)
        if len(rows) and run != self._gated:
            self._forget_inputs(run)
        for column, gate in self._gates:
            seconds = self.clock.between(stamps[rows], self.history.zero)
            said = gate.many(values[column][rows], seconds) if len(rows) else None
            if said is None:
                continue
            held[rows] |= said.held
            values[column] = values[column].copy()
            values[column][rows] = said.value
            doubted = np.isfinite(said.twin)
            if doubted.any():
                twins.setdefault(column, np.full(len(stamps), np.nan))[rows[doubted]] = said.twin[doubted]
            if said.accepted.any():
                accepted.setdefault(column, np.zeros(len(stamps), bool))[rows] |= said.accepted
        return values, twins, held, accepted

    def _other_record(
        self, record: Record, states: dict[int, list[Any]], twins: dict[Any, np.ndarray], fresh: bool
    ) -> tuple[Record, dict[int, list[Any]]]:
        """The record with doubted inputs replaced by twins."""
        columns = {c: np.where(np.isnan(twin), record.columns[c], twin) for c, twin in twins.items()}
        if self._has_twin and not fresh:
            states = {**states, 0: [stepper.state() for stepper in self._others]}
        return replace(record, columns={**record.columns, **columns}), states

    def next_doubt(self, stamps: np.ndarray, run: Any) -> int:
        """Number of a row whose time the next one refutes.

        The count of rows where there is none. The last row has none behind it.
        """
        same_run = self.last is not None and run == self._run
        before = np.maximum.accumulate(stamps)[:-1]
        before = np.maximum(before, self.last) if same_run else before
        steps = np.concatenate(([self.step_to(stamps[0].item(), run)], self.clock.between(stamps[1:], before)))
        jumps = np.flatnonzero(steps > self.gap)
        confirmed = stamps[np.minimum(jumps + 1, len(stamps) - 1)] > stamps[jumps]
        doubted = jumps[~confirmed]
        return int(doubted[0]) if len(doubted) else len(stamps)

    def _record(
        self, here: Any, steps: Any, values: Any, fresh: Any, run: Any
    ) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """A record of these rows, with its start states."""
        edges = [0, *(np.flatnonzero(fresh[1:]) + 1).tolist()]
        segments, starts, states = [], {}, {}
        for number, (start, stop) in enumerate(pairwise([*edges, len(here)])):
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
        return Record(self.clock.times(here), self.temperature, values, tuple(segments)), starts, states


class AdvancedBlock(NamedTuple):
    """Result of a stream for many samples."""

    bias: np.ndarray
    flags: Flags
    variances: np.ndarray
    """What `LiveErrors.variances` says, shape (2, n)."""

    @classmethod
    def empty(cls, n: int) -> AdvancedBlock:
        """No biases and no flags yet."""
        return cls(np.full(n, np.nan), Flags(n), np.full((2, n), np.nan))
