"""Rows as they are judged: straight over spikes, weighted by their noise, less what the starts of segments hold."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.sparse import block_diag

from ..equations.spikes import spikes
from ..estimators.screening import evenness
from .blocks import Averages
from .directions import orthonormal
from .levels import FAR, FEW, FEW_HELD, GROUPS, HELD, MANY_STARTS, ROBUST, ROUNDING, START_HELD


class Starts:
    """The directions that start-up decays hold, segment by segment.

    `columns` (array of shape (n, k)): Decays of each row's own segment. `segment` (array of shape (n,)): Number of
    each row's segment.
    """

    def __init__(self, columns: np.ndarray, segment: np.ndarray):
        edges = np.flatnonzero(np.diff(segment, prepend=-1, append=-1))
        least = START_HELD if len(edges) - 1 > MANY_STARTS else FEW_HELD
        parts = [slice(low, high) for low, high in pairwise(edges.tolist())]
        held = [
            orthonormal(columns[rows], least) if columns[rows].any() else np.zeros((rows.stop - rows.start, 0))
            for rows in parts
        ]
        self.first, self.lengths = edges[:-1], np.diff(edges)
        groups, most = min(len(held), GROUPS), max((Q.shape[1] for Q in held), default=0)
        self.spread = np.zeros((len(segment), groups * most))
        """All directions once more, those of segments far from one another in common columns, shape (n, k)."""
        for i, (rows, Q) in enumerate(zip(parts, held, strict=True)):
            self.spread[rows, i % groups * most :][:, : Q.shape[1]] = Q
        self.basis = block_diag(held, format="csr") if any(Q.shape[1] for Q in held) else None
        """Directions of all segments side by side, shape (n, all of them); None where nothing is held."""

    def taken_out(self, columns: np.ndarray) -> np.ndarray:
        """Columns, shape (n,) or (n, k), less what the decays hold; they are changed in place.

        Where a segment's decays hold all of a column, zeros are left and not its rounding, which would look like a
        column of its own.
        """
        if self.basis is not None:
            before = np.add.reduceat(columns**2, self.first, axis=0)
            columns -= self.basis @ (self.basis.T @ columns)
            left = np.add.reduceat(columns**2, self.first, axis=0) > HELD**2 * before
            if not left.all():
                columns *= np.repeat(left, self.lengths, axis=0)
        return columns


class JudgedRows:
    """What averaged rows are worth, and what is done to every column before it is compared.

    `data` (Averages). `decays` (sequence of arrays of shape (n, k)): Start-up decays, see `starts_of`. `base`
    (sequence of arrays of shape (n, k)): Columns that are judged beside: spikes and noise are those of what they
    leave. `span` (array of shape (n,)): Number of the span over which noise goes on.
    """

    def __init__(self, data: Averages, decays: Sequence[np.ndarray], base: Sequence[np.ndarray], span: np.ndarray):
        self.data = data
        rounding = ROUNDING * float(np.median(np.abs(data.reading)))
        self.spikes = spikes(data.reading, rounding)
        """Rows that are no readings, shape (n,), booleans."""
        self.left_out = self.spikes
        """Spikes, and rows that stand out as nothing but a glitch does, shape (n,), booleans."""
        self.weight = np.ones(len(self.spikes))
        """Less than 1 where the noise is larger than usual; readings and columns are multiplied by it, shape (n,)."""
        self.starts = self._starts(decays)
        self.left_out = self.spikes = self.spikes | spikes(self._left_beside(base), rounding)
        left = self._left_beside(base)
        self.exact = bool(np.sqrt(np.mean(left**2)) <= rounding)
        """Whether the base leaves nothing of the reading but rounding."""
        self.weight *= evenness(left, span)
        self.starts = self._starts(decays)
        self.left_out = self.spikes | _outstanding(self._left_beside(base))

    def _left_beside(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """What least squares leaves of the reading."""
        Q = orthonormal(np.column_stack([self.constant, *map(self.weighed, columns)]))
        reading = self.weighed(self.data.reading)
        return np.asarray(reading - Q @ (Q.T @ reading))

    def _starts(self, decays: Sequence[np.ndarray]) -> Starts:
        """What start-up decays hold of weighted rows."""
        together = np.column_stack([np.zeros((len(self.weight), 0)), *decays])
        return Starts(together * self.weight[:, None], self.data.segment)

    @property
    def constant(self) -> np.ndarray:
        """The constant, as columns are judged, shape (n,)."""
        return self.starts.taken_out(self.weight.copy())

    def weighed(self, columns: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Columns, shape (n,) or (n, k), as they are judged: straight over spikes, weighted, less what starts hold.

        The same is done to reading and columns, so that noise that wanders has no holes. They lose their means first,
        to which digits would be lost. They are written to `out`, which may be the columns themselves.
        """
        return self.starts.taken_out(self._weighted(columns, out))

    def _weighted(self, columns: np.ndarray, out: np.ndarray | None) -> np.ndarray:
        """Columns without their means, straight over spikes, times the rows' weights."""
        known = ~self.left_out
        centred = np.subtract(columns, (columns if known.all() else columns[known]).mean(axis=0), out=out)
        if not known.all():
            rows, kept = np.flatnonzero(self.left_out), np.flatnonzero(known)
            place = np.searchsorted(kept, rows)
            low, high = kept[np.maximum(place - 1, 0)], kept[np.minimum(place, len(kept) - 1)]
            share = np.clip((rows - low) / np.maximum(high - low, 1), 0.0, 1.0)
            centred[rows] = (centred[low].T * (1 - share) + centred[high].T * share).T
        by_row = centred.T
        by_row *= self.weight
        return np.asarray(centred)


def _outstanding(left: np.ndarray) -> np.ndarray:
    """Rows so far from their neighbours that no noise of one size makes them: glitches among many, heavy tails.

    None where many rows are: a quantised noise has few values.
    """
    apart = np.abs(left - pd.Series(left).rolling(5, center=True, min_periods=1).median().to_numpy())
    far: np.ndarray = apart > FAR * ROBUST * float(np.median(apart))
    return far if far.mean() <= FEW else np.zeros(len(far), bool)
