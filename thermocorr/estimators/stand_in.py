"""What takes the place of a thermometer's missing cells: an estimate from the other thermometers.

A thermometer that falls silent is taken from the others: a straight line through each other one and one lag of it, plus
what it last read beyond that, which is forgotten as fast as it was in the fitted record. Only earlier rows are used, so
that a stream fills what a whole record does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..equations.lags import LagState, lag_differences
from ..records import Record
from ..records.screen import Limits

RULES = ("estimate", "end")
"""What may be done where a cell is missing: estimate it from other thermometers; or pass over its row and begin a new
segment behind it."""
CANDIDATES = 12
"""Time constants that are tried for the lag of another thermometer, from two steps to a tenth of the record."""
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
    """Whether a hole before this row ends the segment, shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class StandIn:
    """What takes the place of one column's missing cells."""

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

    def fill(
        self,
        given: Mapping[Any, np.ndarray],
        steps: np.ndarray,
        state: np.ndarray | None = None,
    ) -> Filled:
        """Fill consecutive rows of one segment.

        Parameters
        ----------
        given : mapping of column to array of shape (n,)
            NaN where a cell is missing.
        steps : array of shape (n,)
            Time since the row before [s]; the first counts where there is a `state`.
        state : array, optional
            Of the rows before; None where a segment begins.
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
        """What the others say, the last value and lag of each, and where at least one of them is known."""
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
    taus = np.geomspace(2 * step, max(span / 10, 4 * step), CANDIDATES)
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
    """Time in which values forget: from the distance at which half of their variance is still foretold [s]."""
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
