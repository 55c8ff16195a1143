"""Time series of a record for the page: every row, or smallest and largest of many rows, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...records.read import is_frame, numeric_reading
from ..displays._timeline import TimeLine

MOST_POINTS = 90_000
"""Points of one line. A record of so many rows is shown whole; of a longer one, the extremes of groups of rows."""

AVERAGES = 400
"""Stretches that the residual is averaged over, to show what its noise hides."""
LEAST = 4
"""Fewest rows of such a stretch."""


@dataclass(frozen=True)
class Traces:
    """Time series of a record, thinned out without hiding a spike."""

    seconds: np.ndarray
    """Place on the time line [s], shape (n,), never decreasing: time since the first row, unless runs overlap or the
    record is mostly gaps, see `thermocorr.judgement.displays._timeline.TimeLine`."""
    columns: dict[str, np.ndarray]
    """Temperature, reading, model, corrected, residual, and recorded columns asked for; NaN where unknown, and between
    segments."""
    rows_per_cell: int
    """1: every row is there. Otherwise each cell of so many rows has two points: its extremes in their order in time,
    at the times of its first and last row."""
    n_rows: int
    flags: dict[str, int]
    """Number of rows that each flag of `DynamicBiasRegressor.flags` stands at."""
    rms: float
    """Of the residual of all rows, in the unit of the reading."""
    average: tuple[np.ndarray, np.ndarray]
    """Means of the residual over short stretches: first and last point of each, shape (m, 2), and mean, shape (m,)."""
    average_rows: int
    """Rows of such a stretch."""

    @classmethod
    def of(
        cls, model: Any, X: Any, y: Any, timeline: TimeLine, beside: tuple[Any, ...] = (), most: int = MOST_POINTS
    ) -> Traces:
        """Run once through a record, block by block.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        timeline : TimeLine
            Of the record.
        beside : tuple
            Recorded columns to show beside what the model makes of the record.
        most : int
            Most points of a line.
        """
        cells = Cells(most)
        flags: dict[str, int] = {}
        n_rows, known, squares = 0, 0, 0.0
        reading = numeric_reading(y, X)
        for block, values in model.evaluated_blocks(X, y):
            zero = block.record.times.between(block.record.first_stamp(), block.zero)
            flagged, counts = np.unique(values["flag"].astype(str), return_counts=True)
            for name, count in zip(flagged, counts, strict=True):
                flags[str(name)] = flags.get(str(name), 0) + int(count)
            columns = {"temperature": block.temperature, "reading": np.asarray(reading[block.rows], float)}
            columns |= {name: values[name] for name in ("model", "corrected", "residual")}
            columns |= {column_key(name): recorded(X, name, block.rows) for name in beside}
            residual = values["residual"][np.isfinite(values["residual"])]
            n_rows, known, squares = n_rows + len(block), known + len(residual), squares + float(residual @ residual)
            cells.add(
                block.segment,
                block.seconds - zero + timeline.shifts[block.segment],
                np.column_stack(list(columns.values())),
            )
        seconds, points = cells.points()
        names = list(columns)
        group = cells.group()
        return cls(
            seconds,
            {name: points[:, i] for i, name in enumerate(names)},
            cells.width,
            n_rows,
            flags,
            float(np.sqrt(squares / known)) if known else float("nan"),
            cells.averages(names.index("residual"), group),
            group * cells.width,
        )


class Cells:
    """Extremes of groups of consecutive rows. Groups double when there are too many, so the memory is bounded."""

    def __init__(self, most: int):
        self.most = most
        self.width = 1
        """Rows of a cell (fewer at the end of a segment)."""
        self._parts: list[tuple[np.ndarray, ...]] = []
        self._count = 0

    def add(self, segment: int, seconds: np.ndarray, values: np.ndarray) -> None:
        """Take the next rows of a segment: times of shape (n,), values of shape (n, k)."""
        starts = np.arange(0, len(seconds), self.width)
        low = np.fmin.reduceat(values, starts, axis=0)
        high = np.fmax.reduceat(values, starts, axis=0)
        cell = np.repeat(np.arange(len(starts)), np.diff([*starts, len(seconds)]))
        place = np.arange(len(seconds))[:, None]
        firsts = [
            np.minimum.reduceat(np.where(values == extreme[cell], place, len(seconds)), starts, axis=0)
            for extreme in (low, high)
        ]
        ends = np.append(starts[1:], len(seconds)) - 1
        known = np.isfinite(values)
        sums = [np.add.reduceat(part, starts, axis=0) for part in (np.where(known, values, 0.0), known.astype(float))]
        part = (np.full(len(starts), segment), seconds[starts], seconds[ends], low, high, firsts[1] < firsts[0], *sums)
        self._parts.append(part)
        self._count += len(starts)
        while self._count > self.most // (1 if self.width == 1 else 2):
            self._double()

    def _double(self) -> None:
        """Merge pairs of neighbours, inside segments as long as these have more than one cell."""
        segment, first, last, low, high, falls, *sums = self._joined()
        begins = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))
        if 2 * len(begins) > len(segment):  # mostly segments of one cell: these may be merged too
            begins = np.zeros(1, int)
        place = np.arange(len(segment)) - np.repeat(begins, np.diff([*begins, len(segment)]))
        starts = np.flatnonzero(place % 2 == 0)
        lengths = np.diff([*starts, len(segment)])
        partner = starts + lengths - 1
        lows, highs = np.fmin(low[starts], low[partner]), np.fmax(high[starts], high[partner])
        low_early, high_early = low[starts] == lows, high[starts] == highs
        order = np.where(low_early == high_early, np.where(low_early, falls[starts], falls[partner]), high_early)
        sums = [np.add.reduceat(part, starts, axis=0) for part in sums]
        self._parts = [(segment[starts], first[starts], last[partner], lows, highs, order, *sums)]
        self._count = len(starts)
        self.width *= 2

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Times of shape (n,) and values of shape (n, k), with a row of NaN between segments."""
        segment, first, last, low, high, falls, *_ = self._joined()
        if self.width == 1:
            seconds, values, per = first, low, 1
        else:
            seconds = np.column_stack((first, last)).ravel()
            values = np.stack((np.where(falls, high, low), np.where(falls, low, high)), axis=1).reshape(
                -1, low.shape[1]
            )
            per = 2
        breaks = (np.flatnonzero(np.diff(segment)) + 1) * per
        gaps = np.full((len(breaks), values.shape[1]), np.nan)
        return np.insert(seconds, breaks, seconds[breaks - 1]), np.insert(values, breaks, gaps, axis=0)

    def group(self, most: int = AVERAGES) -> int:
        """Cells of a stretch to average over."""
        return max(-(-self._count // most), -(-LEAST // self.width))

    def averages(self, column: int, group: int) -> tuple[np.ndarray, np.ndarray]:
        """First and last point (as `points` counts them) and mean of stretches of `group` cells inside segments."""
        segment, *_, total, known = self._joined()
        begins = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))
        place = np.arange(len(segment)) - np.repeat(begins, np.diff([*begins, len(segment)]))
        starts = np.flatnonzero(place % group == 0)
        ends = np.append(starts[1:], len(segment)) - 1
        per = 1 if self.width == 1 else 2
        gaps = np.cumsum(np.diff(segment, prepend=segment[0]) != 0)  # rows of NaN before each cell
        points = np.column_stack((starts * per, ends * per + per - 1)) + gaps[starts][:, None]
        sums, counts = (np.add.reduceat(part[:, column], starts) for part in (total, known))
        return points[counts > 0], sums[counts > 0] / counts[counts > 0]

    def _joined(self) -> list[np.ndarray]:
        """Segment, first and last time, low, high, whether it falls, sum and number of known values of each cell."""
        self._parts = [tuple(np.concatenate(part) for part in zip(*self._parts, strict=True))]
        return list(self._parts[0])


def recorded(X: Any, name: Any, rows: Any) -> np.ndarray:
    """Some rows of a recorded column."""
    if not is_frame(X):
        return np.asarray(X[rows, name], float)
    column = X[name]
    return np.asarray(column.iloc[rows] if hasattr(column, "iloc") else column[rows], float)


def column_key(name: Any) -> str:
    """Key of a recorded column, apart from those of the model's own."""
    return f"column {name}"
