"""Long records in a few thousand cells of time: lowest, mean and highest value of each, so that no spike is lost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from .timeline import TimeLine

N_CELLS = 2000
"""Cells over the whole axis: about two for each pixel of a picture."""


class Cells:
    """Values that arrive in time order, block by block, and what is kept of them.

    Parameters
    ----------
    timeline : TimeLine
    names : sequence of str
        Names of the values.
    n_rows : int
        Rows that will come.
    n_cells : int
    """

    def __init__(self, timeline: TimeLine, names: Sequence[str], n_rows: int, n_cells: int = N_CELLS):
        self.timeline, self.names = timeline, list(names)
        self.whole = n_rows <= 2 * n_cells
        self.n_cells = n_cells
        self.width = max(timeline.span, 1e-300) / n_cells
        self._parts: list[tuple[np.ndarray, ...]] = []
        self._seen = 0

    def add(self, segment: int, seconds: np.ndarray, values: np.ndarray) -> None:
        """Take in rows of one segment: times [s], shape (n,), and values, shape (n, k); NaN for missing ones."""
        if self.whole:
            number = self._seen + np.arange(len(seconds))
        else:
            number = ((seconds + self.timeline.shifts[segment]) // self.width).astype(np.intp)
            number = np.minimum(number, self.n_cells - 1)  # the last row ends the last cell
        self._seen += len(seconds)
        starts = np.flatnonzero(np.diff(number, prepend=-1 - number[0]))
        known = np.isfinite(values)
        self._parts.append(
            (
                np.full(len(starts), segment),
                number[starts],
                np.diff(starts, append=len(number)).astype(float),
                np.add.reduceat(seconds, starts),
                np.add.reduceat(known.astype(float), starts),
                np.add.reduceat(np.where(known, values, 0.0), starts),
                np.fmin.reduceat(values, starts),
                np.fmax.reduceat(values, starts),
            )
        )

    def frame(self) -> pd.DataFrame:
        """One row per cell: segment, seconds (mean), n, and of each value its mean, ``_low`` and ``_high``."""
        segment, number, n, seconds, known, total, low, high = (
            np.concatenate(column) for column in zip(*self._parts, strict=True)
        )
        starts = np.flatnonzero((np.diff(segment, prepend=-1) != 0) | (np.diff(number, prepend=-1) != 0))
        n, seconds, known, total = (np.add.reduceat(column, starts) for column in (n, seconds, known, total))
        low, high = np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.clip(total / known, low, high)  # a sum's last digit must not lead outside
        columns = {"segment": segment[starts], "seconds": seconds / n, "n": n.astype(int)}
        for k, name in enumerate(self.names):
            columns |= {name: mean[:, k], f"{name}_low": low[:, k], f"{name}_high": high[:, k]}
        return pd.DataFrame(columns)


def cells_of(
    timeline: TimeLine,
    names: Sequence[str],
    n_rows: int,
    parts: Iterable[tuple[int, np.ndarray, np.ndarray]],
    n_cells: int = N_CELLS,
) -> pd.DataFrame:
    """Cells of parts (segment, seconds, values) as a frame whose first column is the time."""
    cells = Cells(timeline, names, n_rows, n_cells)
    for segment, seconds, values in parts:
        cells.add(segment, seconds, values)
    frame = cells.frame()
    frame.insert(0, "time", timeline.times(frame["seconds"].to_numpy()))
    return frame


def places(frame: pd.DataFrame, timeline: TimeLine) -> np.ndarray:
    """Place of each cell on the axis [s]."""
    return np.asarray(frame["seconds"].to_numpy() + timeline.shifts[frame["segment"].to_numpy()])


def with_breaks(frame: pd.DataFrame, timeline: TimeLine) -> tuple[np.ndarray, pd.DataFrame]:
    """Axis values and cells, with a row of NaN where a line must not be drawn: between segments and over gaps."""
    where = places(frame, timeline)
    steps = np.diff(where)
    usual = np.median(steps) if len(steps) else 0.0
    apart = (np.diff(frame["segment"].to_numpy()) != 0) | (steps > max(2.5 * usual, 10 * timeline.usual_step))
    breaks = np.flatnonzero(apart) + 1
    numbers = frame.drop(columns="time")
    spaced = pd.DataFrame(np.insert(numbers.to_numpy(float), breaks, np.nan, axis=0), columns=numbers.columns)
    return np.insert(timeline.on_axis(where), breaks, np.nan), spaced
