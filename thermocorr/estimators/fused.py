"""One compiled pass from readings to factors: bins, columns, lags.

A fit needs the factor of all rows alone; standard errors need those of the stretches, too.

What `thermocorr.estimators.fitting.sweep_effects` gives, to rounding, where numba is installed. Columns of all other
effects are made block by block as ever, and read by the same pass.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, groupby
from typing import Any, NamedTuple, overload

import numpy as np

from ..effects import InitialTransient, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import own_starts, pieces, walk
from ..equations import LagState, TriangularFactor
from ..equations.compiled import is_compiled, read_only
from ..equations.lags import FELT, factors_of_two_steps
from ..equations.leastsquares import WIDE, BorderedFactor, Crossed, Preconditioned
from ..records import Block, History, Record
from ..records.history import HISTORY_ROWS


@dataclass(frozen=True, kw_only=True)
class Binned:
    """Averages over stretches of equal numbers of rows, none across a segment's end."""

    segment: np.ndarray
    """Number of the segment, shape (n,)."""
    begins: np.ndarray
    """Time of the first row since the record began [s], shape (n,)."""
    count: np.ndarray
    """Rows with a reading, shape (n,)."""
    reading: np.ndarray
    """Mean of the readings; 0 where there are none."""
    width: int
    """Rows of a bin."""
    known: np.ndarray | None = None
    """Which rows of the history have a reading, as packed bits; None where all have one."""
    columns: np.ndarray | None = None
    """Means of the model's columns, shape (n, p); None where the history holds every row to make them from."""

    def ordered(self, columns: Sequence[int]) -> Binned:
        """The columns in another order."""
        return self if self.columns is None else replace(self, columns=self.columns[:, list(columns)])


class Binning:
    """Gathers `Binned`, block by block."""

    def __init__(self, record: Record):
        self.whole = record.n_used <= HISTORY_ROWS
        # Bins of a longer record, whose columns must be averaged while it is at hand
        # Bins of a record that its history keeps whole; noise that forgets within a bin is taken for white there
        self.width = max(1, -(-record.n_used // ((1 << 13) if self.whole else (1 << 12))))
        sizes = [-(-(segment.stop - segment.start) // self.width) for segment in record.segments]
        self.first = np.cumsum([0, *sizes])
        self.starts = np.array([segment.start for segment in record.segments])
        self.sums, self.count = np.zeros(self.first[-1]), np.zeros(self.first[-1])
        self.begins = np.full(self.first[-1], np.inf)
        self.columns: np.ndarray | None = None
        lengths = [segment.stop - segment.start for segment in record.segments]
        self.before = np.cumsum([0, *lengths])
        self.known = np.ones(self.before[-1] if self.whole else 0, bool)

    def take(self, block: Block, columns: np.ndarray, reading: np.ndarray) -> None:
        """Columns of the model and readings of a block's rows, NaN where there is no reading."""
        bins, at = self.bins(block)
        known = np.isfinite(reading)
        all_known = bool(known.all())
        sums = np.add.reduceat(reading if all_known else np.where(known, reading, 0.0), at)
        means = None
        if not self.whole:
            means = np.add.reduceat(columns if all_known else columns * known[:, None], at, axis=0)
        self.add(block, bins, at, None if all_known else known, sums, means)

    def add(
        self,
        block: Block,
        bins: slice | np.ndarray,
        at: np.ndarray,
        known: np.ndarray | None,
        readings: np.ndarray,
        columns: np.ndarray | None,
    ) -> None:
        """Sums over the bins of a block, which begin at its rows `at`; `known` says which rows have a reading."""
        self.sums[bins] += readings
        self.count[bins] += (
            np.diff(at, append=len(block)) if known is None else np.add.reduceat(known.astype(float), at)
        )
        self.begins[bins] = np.minimum(self.begins[bins], block.seconds_at(at))
        if self.whole and known is not None:
            self.known[self.before[block.segment] + block.places - self.starts[block.segment]] = known
        elif columns is not None:
            if self.columns is None:
                self.columns = np.zeros((len(self.sums), columns.shape[1]))
            self.columns[bins] += columns

    def bins(self, block: Block) -> tuple[slice | np.ndarray, np.ndarray]:
        """Numbers of the bins that a block's rows fall into, and the first of its rows in each."""
        first, low = int(self.first[block.segment]), block.start - int(self.starts[block.segment])
        if block.is_whole:
            begin, end = low // self.width, (low + len(block) - 1) // self.width + 1
            at = np.arange(begin * self.width - low, end * self.width - low, self.width)
            at[0] = 0
            return slice(first + begin, first + end), at
        bins = first + (block.places - self.starts[block.segment]) // self.width
        at = np.flatnonzero(np.diff(bins, prepend=-1))
        return bins[at], at

    def binned(self) -> Binned:
        """All that was gathered; bins whose rows were all passed over are left out."""
        seen = np.isfinite(self.begins)
        segment = np.repeat(np.arange(len(self.starts), dtype=np.int32), np.diff(self.first))
        count = np.maximum(self.count[seen], 1.0)
        return Binned(
            segment=segment[seen],
            begins=self.begins[seen],
            count=self.count[seen].astype(np.float32),  # a model is kept with these: half the size is enough
            reading=self.sums[seen] / count,
            width=self.width,
            known=None if self.known.all() else np.packbits(self.known),
            columns=None if self.columns is None else self.columns[seen] / count[:, None],
        )


def binned_columns(effects: Sequence[Effect], history: History, bins: Binned) -> tuple[np.ndarray, list[list[object]]]:
    """Means of effects' columns in the bins of a history that keeps every row, and their states at segments' ends.

    Rows without a reading do not count.
    """
    record = history.record
    known = None if bins.known is None else np.unpackbits(bins.known, count=record.n_rows).astype(bool)
    means = np.zeros((len(bins.begins), sum(effect.n_columns() for effect in effects)))
    count = np.zeros(len(bins.begins))
    edges = np.searchsorted(bins.segment, np.arange(len(record.segments) + 1))
    ends: list[list[object]] = []
    for block, columns, states in walk(effects, record, starts=own_starts(record)):
        low, high = edges[block.segment], edges[block.segment + 1]
        at = low + np.maximum(np.searchsorted(bins.begins[low:high], block.seconds, side="right") - 1, 0)
        first = np.flatnonzero(np.diff(at, prepend=-1))
        counts = np.ones(len(at)) if known is None else known[block.places].astype(float)
        means[at[first]] += np.add.reduceat(columns if known is None else columns * counts[:, None], first, axis=0)
        count[at[first]] += np.add.reduceat(counts, first)
        if block.stop == record.segments[block.segment].stop:
            ends.append(list(states))
    return means / np.maximum(count, 1.0)[:, None], ends


FEWEST = 1 << 13
"""Rows from which one pass is the faster way: before, what it does once for every stretch takes longer."""
_NO_COLUMNS = np.zeros(0)


class FusedColumns:
    """Columns of ``[1 | Q | U]``: which of them the pass makes, and in which order it has them all.

    `effects` (sequence of Effect). `starts` (InitialTransient, optional): Decays that are taken out of all columns,
    and get none; `effects` have none then.
    """

    def __init__(self, effects: Sequence[Effect], starts: InitialTransient | None):
        self.effects = effects
        self.first = list(accumulate((effect.n_columns() for effect in effects), initial=1))
        """Where the columns of each effect begin, and the place of the reading behind them all."""
        self.lags = [i for i, effect in enumerate(effects) if _is_lag(effect)]
        self.ready = [i for i, effect in enumerate(effects) if not (_is_lag(effect) or _is_decay(effect))]
        lags: list[Any] = [effects[i] for i in self.lags]
        self.time_constants = np.concatenate([lag.time_constants_ for lag in lags])
        """Time constants of all lags [s]."""
        self.hold = lags[0].hold
        self.hidden = starts is not None
        """True if start-up decays have no column."""
        own = [(effect, self.first[i]) for i, effect in enumerate(effects) if _is_decay(effect)]
        self._decays: dict[int, list[np.ndarray]] = {}
        self._places: dict[int, list[int]] = {}
        transients: list[tuple[Any, int]] = own if starts is None else [(starts, 0)]
        for transient, first in transients:
            for segment, taus in transient.decays_.items():
                self._decays.setdefault(segment, []).append(taus)
                self._places.setdefault(segment, []).extend(range(first, first + len(taus)))
                first += len(taus)

    def block_rows(self) -> int:
        """Rows of a block: as many as leave the memory small."""
        # Numbers that a block of rows may hold, inputs and columns made for the pass (3 MiB)
        return max((3 << 17) // (6 + sum(self.first[i + 1] - self.first[i] for i in self.ready)), 256)

    def shared(self) -> list[int]:
        """Columns that every segment has, in the order of the pass: the 1, lags, those made for it, the reading."""
        both = [*self.lags, *self.ready]
        return [0, *(c for i in both for c in range(self.first[i], self.first[i + 1])), self.first[-1]]

    def decays(self, segment: int) -> tuple[np.ndarray, list[int]]:
        """Decays of a segment, the fastest first [s], and their columns, where they have any."""
        taus = np.concatenate([*self._decays.get(segment, []), _NO_COLUMNS])
        order = np.argsort(taus, kind="stable")
        return taus[order], [] if self.hidden else [self._places[segment][k] for k in order.tolist()]


def _is_lag(effect: Any) -> bool:
    return type(effect) is ThermalLag


def _is_decay(effect: Effect) -> bool:
    return type(effect) is InitialTransient


def can_be_fused(record: Record, effects: Sequence[Effect], starts: InitialTransient | None) -> bool:
    """True if there is compiled code, and it has something to do: many rows, lags of one rule between samples."""
    shared = sum(effect.n_columns() for effect in effects if not _is_decay(effect))
    # Most columns of all segments for one pass: with more, the blocks of LAPACK are faster
    if not is_compiled() or record.n_used < FEWEST or shared > 32:
        return False
    lags: list[Any] = [effect for effect in effects if _is_lag(effect)]
    both = starts is not None and any(_is_decay(effect) for effect in effects)
    return len({lag.hold for lag in lags}) == 1 and not both


class _OfSegment(NamedTuple):
    """Contribution of one segment to a stretch."""

    columns: list[int]
    """Where the columns of the cross products stand in ``[1 | Q | U]``; those before the first are hidden."""
    n_hidden: int
    """Leading columns whose share in the others is left out."""
    crossed: list[Crossed]

    def factors(self) -> list[tuple[list[int], np.ndarray]]:
        """Matrices and their columns: the sums of the matrices' cross products are those of the rows."""
        made = [crossed.factor() for crossed in self.crossed]
        if self.n_hidden:  # what the decays can explain is left out
            n_columns = self.n_hidden + len(self.columns)
            wide = _stacked(n_columns, [(range(n_columns)[-factor.shape[1] :], factor) for factor in made])
            made = [TriangularFactor(n_columns).update(wide).behind(self.n_hidden).r]
        return [(self.columns[len(self.columns) - factor.shape[1] :], factor) for factor in made]


class FusedFactors(Sequence[TriangularFactor]):
    """Factors of ``[1 | Q | U]``, one for each stretch, made of cross products when they are asked for.

    `width` (int): Columns of ``[1 | Q | U]``. `n_stretches` (int). `shared` (sequence of int): Numbers of the columns
    that all segments share.
    """

    def __init__(self, width: int, n_stretches: int, shared: Sequence[int]):
        self.width, self._shared = width, shared
        self.n_rows = [0] * n_stretches
        """Rows with a reading in each stretch."""
        self._of_stretches: list[list[_OfSegment]] = [[] for _ in range(n_stretches)]
        self._of_all: list[tuple[list[int], np.ndarray]] | None = []
        self._made: list[TriangularFactor] | None = None
        self._segments: list[_OfSegment] = []

    def add(self, columns: list[int], n_hidden: int, gathered: Sequence[tuple[int, Crossed]]) -> None:
        """Take in cross products of one segment, with the number of the stretch that each belongs to, in time order."""
        for stretch, some in groupby(gathered, key=lambda one: one[0]):
            self._of_stretches[stretch].append(_OfSegment(columns, n_hidden, list(_joined(c for _, c in some))))
        if n_hidden or self.width > WIDE:  # left out in each stretch apart; or decays of runs, which hardly meet
            self._of_all = None
            self._segments.append(_OfSegment(columns, n_hidden, list(_joined(c for _, c in gathered))))
        elif self._of_all is not None:
            self._of_all += _OfSegment(columns, 0, list(_joined(c for _, c in gathered))).factors()

    def total(self) -> TriangularFactor | None:
        """Factor of all rows; None where only those of the stretches tell."""
        if self._of_all is None:
            return None
        return TriangularFactor.standing_for(_stacked(self.width, self._of_all), sum(self.n_rows))

    def bordered(self) -> BorderedFactor | None:
        """Factor with one block of decays per segment and shared columns; None where there is one segment."""
        if self._of_all is not None or any(each.n_hidden for each in self._segments):
            return None
        segments = []
        for columns, _, crossed in self._segments:
            factors = [each.factor() for each in crossed]
            places = [range(len(columns))[-factor.shape[1] :] for factor in factors]
            matrix = _stacked(len(columns), list(zip(places, factors, strict=True)))
            segments.append((columns[: len(columns) - len(self._shared)], matrix))
        self._segments = []
        return BorderedFactor.of(self._shared, segments, sum(self.n_rows))

    def __len__(self) -> int:
        return len(self.n_rows)

    @overload
    def __getitem__(self, which: int) -> TriangularFactor: ...
    @overload
    def __getitem__(self, which: slice) -> list[TriangularFactor]: ...
    def __getitem__(self, which: int | slice) -> TriangularFactor | list[TriangularFactor]:
        if self._made is None:
            parts = [[pair for part in parts for pair in part.factors()] for parts in self._of_stretches]
            stacked = [_stacked(self.width, pairs) for pairs in parts]
            self._made = [TriangularFactor.standing_for(m, n) for m, n in zip(stacked, self.n_rows, strict=True)]
            self._of_stretches = []
        return self._made[which]


def _stacked(n_columns: int, parts: Sequence[tuple[Sequence[int], np.ndarray]]) -> np.ndarray:
    """Matrices, each of some of the columns, one above the other."""
    rows, at = np.zeros((sum(len(part) for _, part in parts), n_columns), order="F"), 0
    for columns, part in parts:
        rows[at : at + len(part), columns] = part
        at += len(part)
    return rows


def _joined(parts: Iterable[Crossed]) -> Iterator[Crossed]:
    """Cross products in the coordinates of one triangle are added up."""
    for _, alike in groupby(parts, key=lambda part: id(part.triangle)):
        first, *others = alike
        products = [part.product for part in (first, *others) if part.product is not None]
        yield first._replace(product=sum(products[1:], products[0])) if products else first


_NOTHING = np.zeros(0)


class FusedSweep:
    """One pass through a record that is being fitted.

    `record` (Record). `columns` (FusedColumns). `edges` (array of int): Positions in time order that cut the record
    into stretches, ends included. `offset` (float): Subtracted from every reading.
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
                # Rows that tell the coordinates of the others at first: their columns are written down
                done, left = _cut(parts, max(self._n_known, 2048))
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
