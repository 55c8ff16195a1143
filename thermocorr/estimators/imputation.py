"""Missing cells of thermometers: estimated from the others, or an end of the segment.

A thermometer that falls silent is taken from the others: a straight line through each other one and one lag of it, plus
what it last read beyond that, which is forgotten as fast as it was in the fitted record. Only earlier rows are used, so
that a stream fills what a whole record does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..equations.lags import LagState, lag_differences
from ..records import History, Record, Segment, seconds_of
from ..records.errors import quoted, times_word
from ..records.screen import LeftOut, Limits, Screen

RULES = ("estimate", "end")
"""What may be done where a cell is missing: estimate it from other thermometers; or pass over its row and begin a new
segment behind it."""
MOST_ROWS = 20_000
"""Rows, evenly spread, from which a stand-in is learned."""


class Filled(NamedTuple):
    """A column whose missing cells are filled."""

    values: np.ndarray
    errors: np.ndarray
    """Standard deviation of each filled cell, NaN for the others, shape (n,)."""
    state: np.ndarray
    """To go on with the rows that follow."""
    begins: np.ndarray
    """True if a hole before this row ends the segment, shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class StandIn:
    """Imputation of one column's missing cells."""

    column: Any
    others: tuple[Any, ...] = ()
    """Columns that it is estimated from; none where holes end the segment."""
    means: np.ndarray
    """Mean of the column, then of the others."""
    slopes: np.ndarray
    """Change with each other column, and with its lag difference, shape (len(others), 2)."""
    time_constants: np.ndarray
    """Time constants of the lags [s]."""
    spread: float
    """Standard deviation of what the others do not tell."""
    memory: float
    """Time in which that is forgotten [s]."""
    rule: str
    """One of `RULES`."""
    longest: float = np.inf
    """A hole is filled for so long; one that is never filled ends the segment from then on [s]."""
    limits: Limits = field(default_factory=Limits)
    """Sentinel codes and spikes of the column."""
    range: tuple[float, float] = (-np.inf, np.inf)
    """Lowest and highest value that was fitted."""

    @property
    def width(self) -> int:
        """Numbers that it remembers: the value and the lag of each other column, what was beyond them, and when."""
        return 2 * len(self.others) + 2

    def fill(self, given: Mapping[Any, np.ndarray], steps: np.ndarray, state: np.ndarray | None = None) -> Filled:
        """Fill consecutive rows of one segment.

        `given` (mapping of column to array of shape (n,)): NaN where a cell is missing. `steps` (array of shape
        (n,)): Time since the row before [s]; the first counts where there is a `state`. `state` (array, optional): Of
        the rows before; None where a segment begins.
        """
        measured = np.asarray(given[self.column], float)
        before = np.full(self.width, np.nan) if state is None else state
        told, after, reach = self._told(given, steps, before)
        known = np.isfinite(measured)
        last = np.maximum.accumulate(np.where(known, np.arange(len(steps)), -1))
        seconds = np.cumsum(steps) - (steps[0] if state is None else 0.0)
        beyond = np.where(last >= 0, (measured - told)[last], before[-2])
        age = seconds - np.where(last >= 0, seconds[last], -before[-1])
        left = np.exp(-age / self.memory)  # NaN before the first value
        estimate = told + np.nan_to_num(beyond * left)
        error = self.spread * np.sqrt(1.0 - np.nan_to_num(left) ** 2)
        filled = ~known & reach & np.isfinite(estimate) & ~(age > self.longest) & (self.rule == "estimate")
        return Filled(
            np.where(filled, estimate, measured),
            np.where(filled, error, np.nan),
            np.array([*after, beyond[-1], age[-1]]),
            self._begins(known, seconds, before[-1]),
        )

    def _begins(self, known: np.ndarray, seconds: np.ndarray, before: float) -> np.ndarray:
        """Rows with a value behind a hole that ends the segment; `before`: the age of the last value at first [s]."""
        found, rows = np.zeros(len(known), bool), np.flatnonzero(known)
        if self.rule == "end" and len(rows):
            behind_hole = np.diff(rows, prepend=-1) > 1
            behind_hole[0] |= before > 0
            found[rows] = behind_hole & (np.diff(seconds[rows], prepend=-before) > self.longest)
        return found

    def _told(
        self, given: Mapping[Any, np.ndarray], steps: np.ndarray, before: np.ndarray
    ) -> tuple[np.ndarray, list[float], np.ndarray]:
        """Prediction from the other columns, their last values and lags, and where at least one is known."""
        told, after = np.full(len(steps), self.means[0]), []
        reach = np.full(len(steps), not self.others)
        for i, name in enumerate(self.others):
            other = np.asarray(given[name], float)
            reach |= np.isfinite(other)
            held = _held(other, before[2 * i], self.means[1 + i])
            start = None if np.isnan(before[2 * i]) else LagState(before[2 * i + 1 : 2 * i + 2], float(before[2 * i]))
            lag, end = lag_differences(held, steps, self.time_constants[i : i + 1], start)
            told += self.slopes[i, 0] * (held - self.means[1 + i]) + self.slopes[i, 1] * lag[:, 0]
            after += [held[-1], end.lag_difference[0]]
        return told, after, reach


def _held(values: np.ndarray, before: float, otherwise: float) -> np.ndarray:
    """Values, and the last known one where there is none; `otherwise` before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[last], otherwise if np.isnan(before) else before)


def learned_stand_in(record: Record, column: Any, others: tuple[Any, ...], **settings: Any) -> StandIn:
    """A stand-in learned from rows where all are known: each other thermometer has the one lag that leaves least.

    `settings` are further fields of it.
    """
    means = np.array([record.moments(name).mean for name in (column, *others)])
    seconds, columns, lags = _sampled(record, column, others)
    y = columns[:, 0] - means[0]
    chosen = [0] * len(others)

    def design(which: Sequence[int]) -> np.ndarray:
        parts = [(columns[:, 1 + i] - means[1 + i], lags[i][1][:, k]) for i, k in enumerate(which)]
        return np.column_stack([np.zeros(len(y)), *(each for pair in parts for each in pair)])

    def left(which: Sequence[int]) -> float:
        matrix = design(which)
        rest = y - matrix @ np.linalg.lstsq(matrix, y, rcond=1e-9)[0]
        return float(rest @ rest)

    for _ in range(2):
        for i in range(len(others)):
            trials = [[*chosen[:i], k, *chosen[i + 1 :]] for k in range(len(lags[i][0]))]
            chosen = min(trials, key=left)
    matrix = design(chosen)
    slopes = np.linalg.lstsq(matrix, y, rcond=1e-9)[0][1:].reshape(-1, 2)
    beyond = y - matrix[:, 1:] @ slopes.ravel()
    return StandIn(
        column=column,
        others=others,
        means=means,
        slopes=slopes,
        time_constants=np.array([lags[i][0][k] for i, k in enumerate(chosen)]),
        spread=float(beyond.std()),
        memory=_memory(seconds, beyond),
        **settings,
    )


def _sampled(
    record: Record, column: Any, others: tuple[Any, ...]
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Times [s], column and others, and the lags of each other one that are tried: rows evenly spread."""
    stride = max(1, record.n_used // MOST_ROWS)
    span, step = max(record.duration(segment) for segment in record.segments), record.usual_step()
    # Time constants that are tried for the lag of another thermometer, from two steps to a tenth of the record
    taus = np.geomspace(2 * step, max(span / 10, 4 * step), 12)
    seconds, columns = [], []
    lags: list[list[np.ndarray]] = [[] for _ in others]
    states: list[LagState | None] = []
    for block in record.blocks():
        states = [None] * len(others) if block.begins or not states else states
        seconds.append(block.seconds[::stride])
        columns.append(np.column_stack([block[name][::stride] for name in (column, *others)]))
        for i, name in enumerate(others):
            found, states[i] = lag_differences(block[name], block.steps, taus, states[i])
            lags[i].append(found[::stride])
    return np.concatenate(seconds), np.concatenate(columns), [(taus, np.concatenate(each)) for each in lags]


def _memory(seconds: np.ndarray, values: np.ndarray) -> float:
    """Time in which values forget: from the distance at which half of their variance is still predicted [s]."""
    variance, n = float(values @ values) / len(values), len(values)
    step = float(np.median(np.diff(seconds))) if n > 1 else 1.0
    apart, before = 1, (0.0, 1.0)
    while apart < n // 2 and variance:
        rho = float(values[apart:] @ values[:-apart]) / (n - apart) / variance
        if rho < 0.5:  # between two distances, in the logarithm of what is left
            share = np.log(before[1] / 0.5) / np.log(before[1] / max(rho, 1e-3))
            return float((before[0] + share * (apart * step - before[0])) / np.log(2.0))
        apart, before = 2 * apart, (apart * step, rho)
    return max(float(seconds[-1] - seconds[0]), step) if n else step


class FilledRows(NamedTuple):
    """Consecutive rows whose missing cells are filled."""

    values: dict[Any, np.ndarray]
    errors: dict[Any, np.ndarray]
    """Standard deviation of the filled cells of each column, NaN for others."""
    states: list[np.ndarray]
    """To go on with the rows that follow."""
    begins: np.ndarray
    """True if a hole before this row ends the segment, shape (n,)."""


@dataclass(frozen=True)
class Filling:
    """All stand-ins of a model."""

    stand_ins: tuple[StandIn, ...] = ()
    end: tuple[np.ndarray, ...] = ()
    """What each remembers at the end of the fitted record."""

    def before(self, history: History | None, stamp: Any, run: Any) -> tuple[Sequence[np.ndarray] | None, float]:
        """State before the first row, and its age [s]: rows may follow on the fitted record."""
        if history is None or history.kind == "rows" or not self.end:
            return None, 0.0
        fitted = history.record
        step = history.between(stamp, fitted.stamp(fitted.n_rows - 1))
        follows = 0 < step <= (np.inf if history.max_gap is None else history.max_gap)
        return (self.end, step) if follows and run == fitted.segments[-1].run else (None, 0.0)

    def fill(
        self, given: Mapping[Any, np.ndarray], steps: np.ndarray, states: Sequence[np.ndarray] | None = None
    ) -> FilledRows:
        """Fill the missing cells of columns, see `StandIn.fill`."""
        before = [None] * len(self.stand_ins) if states is None else states
        found = {one.column: one.fill(given, steps, state) for one, state in zip(self.stand_ins, before, strict=True)}
        return FilledRows(
            {**given, **{name: filled.values for name, filled in found.items()}},
            {name: filled.errors for name, filled in found.items()},
            [filled.state for filled in found.values()],
            np.logical_or.reduce([filled.begins for filled in found.values()]),
        )

    def screened(self, given: Mapping[Any, np.ndarray], stamp_of: Callable[[int], Any]) -> dict[Any, np.ndarray]:
        """Columns that are filled or fill others, NaN where a cell is none; `stamp_of` gives a row's time stamp."""
        columns = {name: np.array(given[name], float) for name in self.columns}
        for one in self.stand_ins:
            for rows, _ in one.limits.reasons(columns[one.column], stamp_of):
                columns[one.column][rows] = np.nan
        return columns

    def in_record(self, record: Record, history: History | None) -> Record:
        """A record whose missing cells are filled, and those that are codes for none, or end the segment."""
        columns = self.screened(record.columns, record.times.stamp)
        errors = {one.column: np.full(record.n_rows, np.nan) for one in self.stand_ins}
        segments: list[Segment] = []
        for start, stop, run in record.segments:
            segments.append(Segment(start, stop, run))
            rows = record.rows(start, stop)
            given = {name: values[rows] for name, values in columns.items()}
            if all(np.isfinite(values).all() for values in given.values()):
                continue
            states, since = self.before(history, record.stamp(start), run)
            steps = np.concatenate(([since], record.times.steps(rows)[1:]))
            filled = self.fill(given, steps, states)
            for name, each in filled.errors.items():
                columns[name][rows], errors[name][rows] = filled.values[name], each
            edges = [start, *(np.flatnonzero(filled.begins[1:]) + start + 1).tolist(), stop]
            segments[-1:] = [Segment(low, high, run) for low, high in pairwise(edges)]
        gone = {name: each for name, each in errors.items() if np.isfinite(each).any()}
        kept = {name: columns[name] for name in gone}
        if len(segments) > len(record.segments):
            record = replace(record, segments=tuple(segments), known_moments={})
        return replace(record, columns={**record.columns, **kept}, filled=gone) if gone else record

    def at_end_of(self, record: Record) -> Filling:
        """The stand-ins with what they remember at the end of a record whose rows lack nothing, or are filled."""
        start, stop, _ = record.segments[-1]
        rows = record.kept(start, stop)
        given = {name: np.asarray(record.columns[name][rows], float) for name in self.columns}
        for name, errors in record.filled.items():
            given[name] = np.where(np.isfinite(errors[rows]), np.nan, given[name])
        return replace(self, end=tuple(self.fill(given, record.times.steps(rows)).states))

    @property
    def columns(self) -> list[Any]:
        """Columns that are filled, or that fill others."""
        return list(dict.fromkeys(name for one in self.stand_ins for name in (one.column, *one.others)))


def filling_of(
    record: Record, thermometers: Sequence[Any], rules: Mapping[Any, Any] | None, screen: Screen | None
) -> Filling:
    """Stand-ins for a record's columns, learned from it.

    `record` (Record): Rows that lack something are passed over. `thermometers` (sequence of columns): Where there are
    several, each is estimated from the others unless a rule says otherwise. `rules` (mapping of column to rule): One
    of `RULES`, or one and the length of a hole up to which it is filled, or does not end the segment. `screen`
    (Screen, optional): What is refused of each.
    """
    limits = {} if screen is None else screen.inputs
    several = list(thermometers) if len(thermometers) > 1 else []
    wanted = {**dict.fromkeys(several, "estimate"), **(rules or {})}
    stand_ins = []
    for name, given in wanted.items():
        rule, longest = given if isinstance(given, tuple) else (given, None)
        # With fewer known rows nothing is predicted
        if record.n_used < 50:
            continue
        others = [other for other in thermometers if other != name] if rule == "estimate" else []
        limit = seconds_of(longest, "fill") if longest is not None else 0.0 if rule == "end" else np.inf
        stand_in = learned_stand_in(record, name, tuple(others), rule=rule, longest=limit)
        known = record.moments(name)
        stand_ins.append(replace(stand_in, limits=limits.get(name, Limits()), range=(known.low, known.high)))
    return Filling(tuple(stand_ins))


def learned_beside(full: Record, known: Record, notes: Sequence[str]) -> Record:
    """A filled record to learn from: without the readings next to filled cells.

    `full` (Record): Filled. `known` (Record): Its rows that lack nothing, with the readings that are believed.
    `notes` (sequence of str): What was said of those that are not.
    """
    beside = np.zeros(full.n_rows, bool)
    said = []
    for name, errors in full.filled.items():
        filled = np.isfinite(errors)
        beside |= filled
        count = times_word(int(filled.sum()), "cell")
        said.append(
            f"{count} of {quoted(name)} filled, the first in row {int(filled.argmax())}; their readings are "
            "not learned from."
        )
    reading: Any = LeftOut(known.reading, np.flatnonzero(beside)) if known.reading is not None else None
    return replace(full, reading=reading, refused=known.refused, notes=(*full.notes, *notes, *said))


def check_rules(rules: Any, thermometers: Sequence[Any], needed: Sequence[Any]) -> None:
    """ValueError for rules that are none, and for columns that the model does not read."""
    known = [*thermometers, *needed]
    for name, given in ({} if rules is None else rules).items():
        rule = given[0] if isinstance(given, tuple) and len(given) == 2 else given
        if rule not in RULES:
            raise ValueError(
                f"The 'fill' parameter must say {', '.join(map(repr, RULES))} of a column, or (one of these, the "
                f"longest hole). Got {given!r} for {name!r}."
            )
        if name not in known:
            raise ValueError(f"The 'fill' parameter names {name!r}, which the model does not read: {known!r}.")
        if rule == "estimate" and (len(thermometers) < 2 or name not in thermometers):
            raise ValueError(
                f"The 'fill' parameter wants {name!r} estimated: it is no thermometer with others beside it. Pass "
                "temperature=[...], or fill the column before, with pandas' ffill() or interpolate()."
            )
