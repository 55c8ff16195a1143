"""Curves of millions of rows in pieces: smallest and largest of each pixel, so that no spike is lost."""

from __future__ import annotations

import contextlib
import hashlib
import threading
from collections import OrderedDict
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

CELL = 64
"""Rows of a cell, whose extremes are kept."""
PIECES = 1600
"""Pixels that a piece is made for, unless asked for more."""
MOST_PIECES = 8000
BINS = 60
"""Bins of a cloud of points, each with its mean."""


class Store:
    """Arrays in a folder, each under a name that only equal arrays share."""

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)

    def put(self, array: np.ndarray) -> str:
        """Keep an array of floats; returns its name."""
        values = np.ascontiguousarray(array, "<f8")
        name = hashlib.blake2b(values.tobytes(), digest_size=16).hexdigest()
        path = self.folder / f"{name}.npy"
        if not path.exists():
            draft = path.with_suffix(".draft")
            with draft.open("wb") as file:
                np.save(file, values)
            draft.replace(path)
        return name

    def get(self, name: str) -> np.ndarray:
        """An array by its name, as the file has it: nothing is read before it is looked at."""
        path = self.folder / f"{name}.npy"
        return np.asarray(np.load(path, mmap_mode="r"))

    def keep(self, names: Collection[str]) -> None:
        """Remove all arrays but some."""
        wanted = set(names)
        for path in self.folder.glob("*.npy"):
            if path.stem not in wanted:
                with contextlib.suppress(OSError):  # still open, where open files cannot be removed
                    path.unlink()


class TileCells(NamedTuple):
    """Extremes of every `CELL` rows of a curve."""

    low: np.ndarray
    high: np.ndarray
    falls: np.ndarray
    """True if the first value is above the last one."""

    @classmethod
    def of(cls, values: np.ndarray, starts: np.ndarray) -> TileCells:
        """Extremes of groups of rows that begin at `starts`, the last one at the end."""
        ends = np.append(starts[1:], len(values)) - 1
        return cls(np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts), values[starts] > values[ends])

    def grouped(self, starts: np.ndarray) -> TileCells:
        """Extremes of groups of cells."""
        ends = np.append(starts[1:], len(self.low)) - 1
        low, high = np.fmin.reduceat(self.low, starts), np.fmax.reduceat(self.high, starts)
        return TileCells(low, high, self.low[starts] > self.high[ends])

    def points(self) -> np.ndarray:
        """Two values for each group, in the order that joins it with its neighbours."""
        first, second = np.where(self.falls, self.high, self.low), np.where(self.falls, self.low, self.high)
        return np.column_stack((first, second)).ravel()


class Piece(NamedTuple):
    """A stretch of some curves as it is drawn."""

    place: np.ndarray
    curves: list[np.ndarray]
    """Each beside `place`; NaN between segments, and where nothing is known."""
    rows: int
    """Rows of the record in it."""
    rows_per_point: int
    means: dict[str, np.ndarray]
    """Means over stretches, each held over all points of its stretch; empty where the rows are too few."""
    mean_rows: int
    """Rows of such a stretch."""


class Tiles:
    """Pieces of curves in a store. Cells of what was looked at are kept, in bounded memory."""

    def __init__(self, store: Store, most: int = 64):
        self.store = store
        self.most = most
        self._cells: OrderedDict[str, TileCells] = OrderedDict()
        self._lock = threading.Lock()

    def piece(
        self,
        place: str,
        begins: str,
        curves: Sequence[str],
        low: float,
        high: float,
        n: int = PIECES,
        averaged: Sequence[str] = (),
    ) -> Piece:
        """Curves between two places.

        `place`, `begins` (str): Names, in the store, of the places of all rows (never decreasing) and of the rows at
        which segments begin. `curves` (sequence of str): Names of what is to be drawn. `low`, `high` (float): From
        where to where; a row more at either side is taken, so that lines reach the edge. `n` (int): Pixels.
        `averaged` (sequence of str): Names of curves whose means over stretches are wanted too.
        """
        x = self.store.get(place)
        first = max(int(np.searchsorted(x, low, "left")) - 1, 0)
        stop = max(min(int(np.searchsorted(x, high, "right")) + 1, len(x)), first + 1)
        n = int(np.clip(n, 50, MOST_PIECES))
        breaks = self.store.get(begins).astype(int)
        breaks = breaks[(breaks > first) & (breaks < stop)]
        width = -(-(stop - first) // n)
        if width >= CELL:
            width = width // CELL * CELL
            first, stop = first // CELL * CELL, min(-(-stop // CELL) * CELL, len(x))
        if stop - first <= 2 * n:
            width, starts = 1, np.arange(first, stop)
            drawn = [np.array(self.store.get(name)[first:stop]) for name in curves]
            places, at, per = np.array(x[first:stop]), breaks - first, 1
        else:
            starts = np.arange(first, stop, width)
            if len(breaks) <= n // 2 and width < CELL:
                starts = np.union1d(starts, breaks)
            drawn = [self._extremes(name, starts, stop, width).points() for name in curves]
            places = np.column_stack((x[starts], x[np.append(starts[1:], stop) - 1])).ravel()
            at = np.searchsorted(starts, breaks) if len(breaks) <= n // 2 else np.zeros(0, int)
            at, per = 2 * np.unique(at[at < len(starts)]), 2
        # Stretches that are averaged over, to show what noise hides
        # Fewest rows of such a stretch
        each = max(-(-(stop - first) // 240), 8 * width)
        means = [_held(np.array(self.store.get(c)[first:stop]), each, starts - first, per) for c in averaged]
        names = [*averaged] if stop - first >= 4 * each else []
        if len(at):  # a point without a value before each segment, so that no line joins two of them
            drawn, means = ([np.insert(curve, at, np.nan) for curve in part] for part in (drawn, means))
            places = np.insert(places, at, places[np.maximum(at - 1, 0)])
        return Piece(
            place=places,
            curves=drawn,
            rows=stop - first,
            rows_per_point=width,
            means=dict(zip(names, means, strict=False)),
            mean_rows=each,
        )

    def _extremes(self, name: str, starts: np.ndarray, stop: int, width: int) -> TileCells:
        """Extremes of groups of rows that begin at `starts`."""
        if width < CELL:
            return TileCells.of(np.array(self.store.get(name)[starts[0] : stop]), starts - starts[0])
        part = TileCells(*(column[starts[0] // CELL : -(-stop // CELL)] for column in self._cells_of(name)))
        return part.grouped((starts - starts[0]) // CELL)

    def _cells_of(self, name: str) -> TileCells:
        with self._lock:
            found = self._cells.get(name)
        if found is None:
            values = self.store.get(name)
            found = TileCells.of(np.array(values), np.arange(0, len(values), CELL))
        with self._lock:
            self._cells[name] = found
            self._cells.move_to_end(name)
            while len(self._cells) > self.most:
                self._cells.popitem(last=False)
        return found

    def cloud(self, across: str, up: str) -> dict[str, np.ndarray]:
        """One curve over another: some points, and the mean in bins of equal width of all rows.

        Returns dict of arrays: x, y (points); center, mean, error (of the mean, as if values were independent), count
        (bins with rows).
        """
        x, y = self.store.get(across), self.store.get(up)
        known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        if not len(known):
            return {name: np.zeros(0) for name in ("x", "y", "center", "mean", "error", "count")}
        x, y = np.array(x[known]), np.array(y[known])
        # Points of a cloud that are drawn
        shown = np.unique(np.linspace(0, len(x) - 1, min(len(x), 4000)).astype(int))
        low, high = float(x.min()), float(x.max())
        number = np.minimum(((x - low) / max(high - low, 1e-300) * BINS).astype(int), BINS - 1)
        count, total = np.bincount(number, minlength=BINS), np.bincount(number, y, BINS)
        squares = np.bincount(number, y * y, BINS)
        filled = count > 0
        mean = total[filled] / count[filled]
        variance = np.maximum(squares[filled] / count[filled] - mean**2, 0.0)
        center = np.bincount(number, x, BINS)[filled] / count[filled]
        error = np.sqrt(variance / count[filled])
        return {"x": x[shown], "y": y[shown], "center": center, "mean": mean, "error": error, "count": count[filled]}


def _held(values: np.ndarray, each: int, starts: np.ndarray, per: int) -> np.ndarray:
    """Mean of every `each` values, at all points of groups that begin at `starts`, `per` points a group."""
    cuts = np.arange(0, len(values), each)
    known = np.isfinite(values)
    count = np.add.reduceat(known.astype(float), cuts)
    total = np.add.reduceat(np.where(known, values, 0.0), cuts)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return np.repeat(mean[starts // each], per)
