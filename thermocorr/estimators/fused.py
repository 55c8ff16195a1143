"""A record swept in one compiled pass: lags and start-up decays are never written down, only their cross products.

What `thermocorr.estimators.fitting.sweep_effects` gives, to rounding, where numba is installed. Columns of all other
effects are made block by block as ever, and read by the same pass.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..effects.stream import own_starts
from ..equations import LagState
from ..equations.compiled import read_only
from ..equations.lags import FELT, factors_of_two_steps
from ..equations.preconditioned import Crossed, Preconditioned
from ..records import Block, Record
from .binned import Binning
from .cutting import pieces
from .fused_columns import FusedColumns
from .fused_factors import FusedFactors

ALONE = 2048
"""Rows that tell the coordinates of the others at first: their columns are written down."""
_NOTHING = np.zeros(0)


class FusedSweep:
    """One pass through a record that is being fitted.

    Parameters
    ----------
    record : Record
    columns : FusedColumns
    edges : array of int
        Positions in time order that cut the record into stretches, ends included.
    offset : float
        Subtracted from every reading.
    """

    def __init__(self, record: Record, columns: FusedColumns, edges: np.ndarray, offset: float):
        from ..equations import kernels

        self.end_states: list[list[Any]] = []
        """States of the effects at the end of each segment."""
        self.binning = Binning(record)
        self._kernels, self._record, self._columns, self._edges, self._offset = kernels, record, columns, edges, offset
        self._shared = columns.shared()
        self._coordinates = Preconditioned(len(self._shared))
        self._decays, self._places = columns.decays(-1)
        self._gathered: list[tuple[int, Crossed]] = []
        self._n_known = 0  # rows of the segment so far
        self.chunks = FusedFactors(columns.first[-1] + 1, len(edges) - 1, self._shared)
        """Factors of ``[1 | Q | U]``, one for each stretch."""
        for block in record.blocks(columns.block_rows(), None, own_starts(record)):
            if block.start == record.segments[block.segment].start:
                self._begin(block)
            self._take(block)
            if block.stop == record.segments[block.segment].stop:
                self._end()

    def _begin(self, block: Block) -> None:
        """A new segment: bodies at rest, decays of its own."""
        n_old = len(self._decays)
        self._decays, self._places = self._columns.decays(block.segment)
        self._coordinates.begin(len(self._decays), n_old)
        self._n_known = 0
        self._states: list[Any] = [None] * len(self._columns.effects)
        self._lags, self._temperature = np.zeros(len(self._columns.time_constants)), block.temperature[:1].copy()

    def _take(self, block: Block) -> None:
        assert self._record.reading is not None
        reading = read_only(np.ascontiguousarray(self._record.reading[block.rows], float))
        known = np.isfinite(reading) if np.isnan(reading.sum()) else None
        weight = _NOTHING if self._record.weight is None else np.sqrt(self._record.weight[block.rows])
        bins, begins = self.binning.bins(block)
        rows = self._kernels.Rows(
            temperature=read_only(block.temperature),
            steps=block.steps,
            reading=reading,
            offset=self._offset,
            root_weight=weight,
            ready=self._ready(block).T,
            parts=begins,
            bins=begins,
        )
        sums = np.zeros((len(begins), 1 if self.binning.whole else len(self._decays) + len(self._shared)))
        parts = list(pieces(self._edges, block))
        for chunk, part in parts:
            self.chunks.n_rows[chunk] += part.stop - part.start if known is None else int(known[part].sum())
        while parts:
            done, left = parts, parts[:0]
            crossed = [] if self._coordinates.knows_nothing else self._crossed(block, rows, done, sums)
            if not crossed:  # as many rows as are known tell of the others, mostly
                done, left = _cut(parts, max(self._n_known, ALONE))
                crossed = self._crossed(block, rows, done, sums, reflected=True)
            self._gathered += zip((chunk for chunk, _ in done), crossed, strict=True)
            self._n_known += done[-1][1].stop - done[0][1].start
            parts = left
        self.binning.add(block, bins, begins, known, sums[:, -1], self._binned(sums))

    def _ready(self, block: Block) -> np.ndarray:
        """Columns of all effects but lags and decays, shape (n, K)."""
        first, ready = self._columns.first, self._columns.ready
        widths = [first[i + 1] - first[i] for i in ready]
        columns, at = np.empty((len(block), sum(widths)), order="F"), 0
        for i, width in zip(ready, widths, strict=True):
            effect = self._columns.effects[i]
            self._states[i] = effect.fill(block, self._states[i], columns[:, at : at + width])
            at += width
        return columns

    def _crossed(
        self, block: Block, rows: Any, parts: list[tuple[int, slice]], sums: np.ndarray, reflected: bool = False
    ) -> list[Crossed]:
        """Cross products of parts of a block; the lags go on, and `sums` over the block's bins grow.

        An empty list, and nothing has gone on, where the rows must be `reflected`: the pass ends there.
        """
        some = slice(parts[0][1].start, parts[-1][1].stop)
        elapsed = block.elapsed_at(some.start)
        dead = int(np.searchsorted(self._decays, elapsed / FELT))
        first, last = np.searchsorted(rows.bins, (some.start, some.stop - 1), side="right").tolist()
        inside = [slice(part.start - some.start, part.stop - some.start) for _, part in parts]
        rows = rows._replace(parts=np.array([part.start for part in inside]))
        if some.stop - some.start < len(block):
            rows = rows._replace(
                temperature=rows.temperature[some],
                steps=rows.steps[some],
                reading=rows.reading[some],
                root_weight=rows.root_weight[some],
                ready=rows.ready[:, some].copy(),
                bins=np.maximum(rows.bins[first - 1 : last] - some.start, 0),
            )
        bodies = self._bodies(rows.steps, block.even_step is not None, self._decays[dead:], elapsed)
        one_pass = self._kernels.Pass(rows, bodies, 1 if self.binning.whole else 0)
        if reflected:
            columns = one_pass.columns()
            crossed = [self._coordinates.reflect(dead, columns[part].copy(order="F")) for part in inside]
        else:
            crossed = self._coordinates.take(dead, one_pass.crossed)
        if crossed:
            self._lags, self._temperature = one_pass.bodies.lags, one_pass.bodies.temperature
            sums[first - 1 : last, -one_pass.sums.shape[1] :] += one_pass.sums
        return crossed

    def _bodies(self, steps: np.ndarray, even: bool, decays: np.ndarray, elapsed: float) -> Any:
        taus = np.concatenate((decays, self._columns.time_constants))
        hold = self._columns.hold
        decay, gain = factors_of_two_steps(float(steps[0]), float(steps[-1]), tuple(taus.tolist()), hold)
        return self._kernels.Bodies(
            rates=1.0 / taus,
            first_order=hold == "first_order",
            regular=even or len(steps) < 2 or bool((steps[1:] == steps[1]).all()),
            factors=np.stack((decay[0], gain[0], decay[1], gain[1])),
            decays=np.exp(-elapsed / decays),
            lags=self._lags,
            temperature=self._temperature,
        )

    def _binned(self, sums: np.ndarray) -> np.ndarray | None:
        """Sums of the model's columns in the order of its effects; None where nobody asks for them."""
        if self.binning.whole:
            return None
        columns = np.zeros((len(sums), self._columns.first[-1] + 1))
        columns[:, self._places] = sums[:, : len(self._places)]
        columns[:, self._shared] = sums[:, len(self._decays) :]
        return columns[:, 1:-1]

    def _end(self) -> None:
        """Keep the states at the end of a segment; add what it has given to the factors of its stretches."""
        states, at = list(self._states), 0
        for i in self._columns.lags:
            n_lags = self._columns.first[i + 1] - self._columns.first[i]
            states[i] = LagState(self._lags[at : at + n_lags].copy(), float(self._temperature[0]))
            at += n_lags
        self.end_states.append(states)
        n_hidden = len(self._decays) - len(self._places)
        self.chunks.add([*self._places, *self._shared], n_hidden, self._gathered)
        self._gathered = []


def _cut(parts: list[tuple[int, slice]], n_rows: int) -> tuple[list[tuple[int, slice]], list[tuple[int, slice]]]:
    """The first rows of consecutive parts of a block, and the others."""
    middle = parts[0][1].start + n_rows
    first = [(chunk, slice(rows.start, min(rows.stop, middle))) for chunk, rows in parts if rows.start < middle]
    others = [(chunk, slice(max(rows.start, middle), rows.stop)) for chunk, rows in parts if rows.stop > middle]
    return first, others
