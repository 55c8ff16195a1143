"""Gaps in a record: from which step on nobody knows what was between two rows, and how far columns wander meanwhile."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..equations.lags import Structure
from .errors import option
from .hints import Column, Positive, Sizes
from .numbers import span_text
from .record import Block, Record
from .times import Floats

GAP = 2.5
"""Steps, in usual ones, from which what was between is taken for unknown."""
MOST_ROWS = 200_000
"""Rows of a segment that tell how columns wander, at most."""


@dataclass(frozen=True)
class Gaps:
    """Knowledge of gaps from a record, for it and for later rows."""

    least: Positive
    """Steps above it are gaps [s]."""
    lags: Sizes = field(default_factory=lambda: np.zeros(1))
    """Times [s], 0 first, increasing, shape (k,)."""
    squares: dict[Column, Sizes] = field(default_factory=dict)
    """Mean square of each column's changes over these times, shape (k,): its structure function."""

    def __post_init__(self) -> None:
        """Refuse times and squares that do not belong together."""
        shapes = {np.shape(each) for each in (self.lags, *self.squares.values())}
        if len(shapes) > 1 or np.ndim(self.lags) != 1 or self.lags[:1] != [0.0] or (np.diff(self.lags) <= 0).any():
            raise ValueError("times of gaps are 0 first and increase, and each column has as many squares")

    @classmethod
    def of(cls, record: Record, columns: Collection[Any], least: float, longest: float | None = None) -> Gaps:
        """Learn from a record how its columns wander over times up to the `longest` [s]."""
        usual = record.usual_step()
        if longest is None:
            # Share of the longest segment over which changes are looked at, where no longest gap is known
            longest = (1 / 3) * record.duration(record.longest())
        # Times over which changes are looked at, evenly spaced on a logarithmic scale
        counts = np.unique(np.geomspace(1, max(longest / usual, 2.0), 25).astype(int))
        sums, sizes = np.zeros((len(columns), len(counts))), np.zeros(len(counts))
        for segment in record.segments:
            rows = record.kept(segment.start, min(segment.stop, segment.start + MOST_ROWS))
            values = [np.asarray(record.columns[name][rows], float) for name in columns]
            steps = np.array(record.times.steps(rows))
            steps[:1] = 0.0
            elapsed = np.cumsum(steps)
            for i, k in enumerate(counts.tolist()):
                # Share by which as many uneven steps may last longer, or less, than as many usual ones, to be compared
                # with them
                like = np.abs(elapsed[k:] - elapsed[:-k] - k * usual) <= 0.3 * k * usual
                sums[:, i] += [np.square(column[k:] - column[:-k])[like].sum() for column in values]
                sizes[i] += np.count_nonzero(like)
        seen = sizes > 0
        means = np.column_stack((np.zeros(len(columns)), sums[:, seen] / sizes[seen]))
        return cls(least, np.concatenate(([0.0], counts[seen] * usual)), dict(zip(columns, means, strict=True)))

    def structure(self, column: Any) -> Structure:
        """Mean square of a column's changes as a function of time [s].

        Between two times of the record a power of time, which is what noise (0), a random walk (1) and a smooth
        temperature (2) have; a straight line to zero below the usual step, the last value beyond.
        """
        known = (self.lags > 0) & (self.squares[column] > 0)
        if not known.any():
            return lambda lag: np.zeros_like(lag, float)
        lags, squares = self.lags[known], self.squares[column][known]
        log_lags, log_squares, first = np.log(lags), np.log(squares), lags[0]

        def structure(lag: Floats) -> Floats:
            power = np.exp(np.interp(np.log(np.maximum(lag, first)), log_lags, log_squares))
            return np.asarray(power * np.minimum(np.asarray(lag) / first, 1.0))

        return structure


def least_gap(record: Record, usual_step: float, stride: int = 1) -> float:
    """Steps above it are gaps [s], in a log of which every so many rows are kept."""
    if _is_even(record):
        return GAP * usual_step
    some = next(record.blocks()).steps[1:]
    # Share of the steps, in the first some thousand, that are none: a log that is written on changes has long steps all
    # the time, in which the temperature is known to have stood still
    return max(GAP * usual_step, float(np.quantile(some, 0.95)) / stride if len(some) else 0.0)


def longest_gap(record: Record, least: float) -> float:
    """The longest step that is a gap [s]; 0 where there is none."""
    if _is_even(record):
        return record.usual_step() if record.usual_step() > least else 0.0
    if record.order is None and not len(record.skipped) and record.times.longest_between_rows <= least:
        return 0.0
    return max(float(block.steps[gap_rows(block, least)].max(initial=0.0)) for block in record.blocks())


def gap_rows(block: Block, least: float) -> np.ndarray:
    """Numbers of a block's rows that stand behind a gap; the first of a segment does not."""
    rows = np.flatnonzero(block.steps > least)
    return rows[rows > 0] if block.begins else rows


def _is_even(record: Record) -> bool:
    """True if steps can be told to be alike without a look at each."""
    usual = record.usual_step()
    # Share of a segment's length by which as many usual steps may differ from it: rounding
    return not len(record.skipped) and all(
        record.duration(segment) <= (segment.n_rows - 1) * usual * (1 + 1e-9) for segment in record.segments
    )


def rows_apart(record: Record) -> str:
    """In words, the rows before or behind a gap that is longer than all the rest of their segment; "" for none.

    They stretch all that counts by a segment's length: is their time damaged?
    """
    segment = max(record.segments, key=record.duration)
    places = record.kept_places(segment.start, segment.stop)
    steps = np.array(record.times.steps(record.rows_at(places)))
    if len(steps) < 2:
        return ""
    steps[0] = 0.0
    at, usual = int(steps.argmax()), record.usual_step()
    longest, rest = float(steps[at]), record.duration(segment) - float(steps[at])
    if longest <= max(rest, GAP * usual):
        return ""
    behind = len(places) - at <= at
    some = [record.row(int(places[k])) for k in ((at, len(places) - 1) if behind else (0, at - 1))]
    one = some[0] == some[1]
    before, after = (record.row(int(places[k])) for k in (at - 1, at))
    return (
        f"{f'Row {some[0]} stands' if one else f'Rows {some[0]} to {some[1]} stand'} far apart from the others: "
        f"{record.times.label(after)} in row {after} follows {record.times.label(before)} in row {before} after "
        f"{span_text(longest)}, and all the others lie within {span_text(rest)}. "
        f"{'Is its time' if one else 'Are their times'} damaged? Mend {'it' if one else 'them'}, or leave "
        f"{'the row' if one else 'the rows'} out; if not, pass {option('max_gap', f'{3 * usual:.5g}')} to start a new "
        "segment there."
    )
