"""Folds in time, and the columns swept in them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise
from math import comb
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np

from ..effects import InitialTransient, ThermalLag
from ..effects.covariates import ColumnLags
from ..effects.protocol import Effect
from ..effects.stream import equal_edges
from ..equations import TriangularFactor
from ..equations.subsets import Fold, fold_of, set_errors
from ..records import Record, Segment
from ..records.history import MOST_FOLDED
from .features import DiffusiveFeatures
from .fitting import Swept, sweep_effects
from .spectrum import DECAY_SHARE, GridLayout, grown

MOST_SEGMENTS = 8
"""With more segments, each has a few decays of its own that are taken out, not one for each time constant tried."""


@dataclass(frozen=True)
class LagColumns:
    """Lags and decays for a list of time constants."""

    lag: ThermalLag
    further: list[ColumnLags]
    """Lags of the thermometers beyond the first."""
    transient: InitialTransient
    starts: InitialTransient
    """Decays that are fitted and taken out of everything: where there are many segments, or several thermometers that
    share them, in place of `transient`."""
    layout: GridLayout
    decays: list[tuple[int, int, float]]
    """Column, segment and time constant of each decay."""

    @classmethod
    def of(cls, features: DiffusiveFeatures, record: Record, time_constants: np.ndarray) -> LagColumns:
        """Lags and decays behind the columns of `features`.

        Each thermometer has lags of all the time constants.
        """
        taus = time_constants.tolist()
        lag = ThermalLag(taus, features.hold)
        columns = features.thermometers().further
        further = [ColumnLags(column, taus, features.hold) for column in columns]
        fitted, many = features.initial_state == "fit", bool(further) or len(record.segments) > MOST_SEGMENTS
        transient = InitialTransient(taus, DECAY_SHARE if fitted and not many else 0.0)
        span = record.longest_read()
        # Decays of neighbouring time constants are much alike: four do, the fastest of two sampling steps.
        few = np.geomspace(2.0 * record.usual_step(), max(span, record.usual_step()), 4)
        starts = InitialTransient(few.tolist(), DECAY_SHARE if fitted and many else 0.0)
        for effect in (lag, *further, transient, starts):
            effect.learn(record)
        n_free = 1 + sum(effect.n_columns() for effect in features.effect_list())
        grid = np.tile(time_constants, 1 + len(further))
        owned: list[list[int]] = [[] for _ in grid]
        decays = []
        for key, taus in transient.decays_.items():
            for offset, tau in enumerate(taus):
                column = n_free + len(time_constants) + transient.first_column_[key] + offset
                owned[int(np.searchsorted(time_constants, tau))].append(column)
                decays.append((column, key, float(tau)))
        deviations = [record.moments(name).std or 1.0 for name in (record.temperature_name, *columns)]
        layout = GridLayout(grid, span, n_free, owned, deviations)
        return cls(lag=lag, further=further, transient=transient, starts=starts, layout=layout, decays=decays)

    def dead(self, record: Record, folds: TimeFolds) -> list[list[int]]:
        """Decays too slow for what each fold learns from."""
        if not self.decays:
            return [[] for _ in range(len(folds))]
        result = []
        for f in range(len(folds)):
            limits = self.transient.longest([folds.learned_duration(f, record, segment) for segment in record.segments])
            result.append([column for column, key, tau in self.decays if tau > limits[key]])
        return result

    @property
    def taken_out(self) -> InitialTransient | None:
        """`starts`, where they are used."""
        return self.starts if self.starts.decays_ else None

    def swept(self, record: Record, effects: Sequence[Effect], edges: np.ndarray) -> Swept:
        """Factors of ``[1 | Q | U]`` for the stretches between `edges`."""
        return sweep_effects(record, effects, edges, self.taken_out)


Ranges = list[tuple[int, int]]


class Sides(NamedTuple):
    """A fold's number, and the factors of its two sides."""

    fold: int
    learned: TriangularFactor
    tested: TriangularFactor


@dataclass(frozen=True)
class TimeFolds:
    """Stretches of a record, and those of each fold."""

    edges: np.ndarray
    """Positions in time order that cut the record, ends included."""
    learned: tuple[list[int], ...]
    """``learned[f]``: stretches that fold f learns from."""
    tested: tuple[list[int], ...]

    def __len__(self) -> int:
        return len(self.learned)

    def sides(self, chunks: Sequence[TriangularFactor], n_free: int) -> list[Sides]:
        """Factors that each fold learns from and tests on.

        What one fold learns from and the next one too, as in forward chaining, is merged once.
        """
        found: list[Sides] = []
        before, so_far = list[int](), TriangularFactor(chunks[0].r.shape[1])
        for f, (learn, test) in enumerate(zip(self.learned, self.tested, strict=True)):
            if not (learn and test):
                continue
            longer = learn[: len(before)] == before
            learned = TriangularFactor.merged(
                [so_far, *(chunks[i] for i in learn[len(before) :])] if longer else [chunks[i] for i in learn]
            )
            before, so_far = learn, learned
            tested = TriangularFactor.merged([chunks[i] for i in test])
            if learned.n_rows > n_free and tested.n_rows:
                found.append(Sides(f, learned, tested))
        return found

    def learned_duration(self, fold: int, record: Record, segment: Segment) -> float:
        """First to last learned row of a segment [s]."""
        inside = [
            (max(int(self.edges[i]), segment.start), min(int(self.edges[i + 1]), segment.stop))
            for i in self.learned[fold]
        ]
        rows = [k for low, high in inside if low < high for k in (low, high - 1)]
        return record.times.between(record.stamp(max(rows)), record.stamp(min(rows))) if rows else 0.0


def folds_in_time(record: Record, cv: Any = 5) -> TimeFolds:
    """Cut a record for cross-validation.

    `record` (Record). `cv` (int, splitter or iterable of (train, test) rows): An int is forward chaining with that
    many tests, the rows of ``TimeSeriesSplit(cv)`` (of the part that has readings, where these hold less than half of
    the record). A splitter of scikit-learn is given the runs' labels as groups. Its folds must be made of whole
    stretches of time. `With an int`, `learned rows within 1 % of the longest segment of a test are left out`, `and
    tested rows that close`. `behind the start of a run of which nothing was learned.`.
    """
    if isinstance(cv, Integral) and not isinstance(cv, bool):
        # A hundredth of the record is left out between training and test, as washout.
        gap = round(0.01 * record.longest_read() / record.usual_step())
        pairs = [_washed(record, learned, tested, gap) for learned, tested in _forward(record, int(cv))]
    else:
        pairs = _of_splitter(record, cv)
    ends = [end for pair in pairs for side in pair for stretch in side for end in stretch]
    edges = np.unique(np.concatenate((equal_edges(record), np.array(ends, np.intp))))
    stretches = [tuple(_stretches(edges, side) for side in pair) for pair in pairs]
    return TimeFolds(edges, tuple(pair[0] for pair in stretches), tuple(pair[1] for pair in stretches))


def _forward(record: Record, n_splits: int) -> list[tuple[Ranges, Ranges]]:
    low, high = record.read_places
    n = high - low
    if not 2 <= n_splits < n:
        raise ValueError(
            f"The 'cv' parameter must be a number of folds from 2 to {n - 1} for {n} rows. Got {n_splits} instead."
        )
    size = n // (n_splits + 1)
    starts = [high - (n_splits - i) * size for i in range(n_splits)]
    return [([(low, start)], [(start, start + size)]) for start in starts]


def _of_splitter(record: Record, cv: Any) -> list[tuple[Ranges, Ranges]]:
    if hasattr(cv, "split") and not isinstance(cv, str):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The groups parameter is ignored")
            splits: Iterable[Any] = list(cv.split(np.zeros((record.n_rows, 1)), None, _run_labels(record)))
    elif isinstance(cv, Iterable) and not isinstance(cv, str):
        splits = cv
    else:
        raise ValueError(
            f"The 'cv' parameter must be a number of folds, a splitter such as TimeSeriesSplit(5), or pairs of row "
            f"numbers. Got {cv!r} instead."
        )
    position = None
    if record.order is not None:
        position = np.empty(record.n_rows, np.intp)
        position[record.order] = np.arange(record.n_rows)
    pairs = []
    for learned, tested in splits:
        sides = [_ranges(np.asarray(side) if position is None else position[side]) for side in (learned, tested)]
        count = len(sides[0]) + len(sides[1])
        if count > MOST_FOLDED:
            raise ValueError(
                f"The folds of {cv!r} cut the record into {count} pieces: their rows are shuffled, so that training "
                "and test share neighbours in time. Use whole stretches: TimeSeriesSplit, KFold without shuffling, or "
                "LeaveOneGroupOut with run=..."
            )
        pairs.append((sides[0], sides[1]))
    return pairs


def _run_labels(record: Record) -> np.ndarray | None:
    """Run of each row, -1 outside; None without runs."""
    names = list(dict.fromkeys(segment.run for segment in record.segments))
    if names == [None]:
        return None
    labels = np.full(record.n_rows, -1)
    for segment in record.segments:
        labels[record.rows(segment.start, segment.stop)] = names.index(segment.run)
    return labels


def _ranges(rows: np.ndarray) -> Ranges:
    """Row numbers as stretches start:stop."""
    rows = np.flatnonzero(rows) if rows.dtype == bool else rows
    steps = np.diff(rows)
    if (steps < 0).any():
        rows = np.sort(rows)
        steps = np.diff(rows)
    cuts = np.flatnonzero(steps != 1) + 1
    return [(int(rows[low]), int(rows[high - 1]) + 1) for low, high in pairwise([0, *cuts, len(rows)]) if low < high]


def _washed(record: Record, learned: Ranges, tested: Ranges, gap: int) -> tuple[Ranges, Ranges]:
    if gap:
        for start, stop in tested:
            learned = _without(learned, start - gap, stop + gap)
        for segment in record.segments:
            if not any(low < segment.stop and segment.start < high for low, high in learned):
                tested = _without(tested, segment.start, min(segment.start + gap, segment.stop))
    return learned, tested


def _without(ranges: Ranges, start: int, stop: int) -> Ranges:
    """Stretches less the rows start:stop."""
    kept = [piece for low, high in ranges for piece in ((low, min(high, start)), (max(low, stop), high))]
    return [(low, high) for low, high in kept if low < high]


def _stretches(edges: np.ndarray, ranges: Ranges) -> list[int]:
    first = [np.searchsorted(edges, low) for low, _ in ranges]
    last = [np.searchsorted(edges, high) for _, high in ranges]
    return [i for low, high in zip(first, last, strict=True) for i in range(int(low), int(high))]


Set = tuple[int, ...]
NEGLIGIBLE = 5e-4
"""A time constant that lowers the loss by less than this share is not worth having."""


class CrossValidation:
    """Errors of sets of grid members, each computed once.

    `chunks` (list of TriangularFactor): Factors of the stretches that `folds` is made of. `folds` (TimeFolds).
    `layout` (GridLayout): Which column is what. `dead` (list of lists of int): ``dead[f]`` are columns that fold f
    must not use.
    """

    def __init__(
        self, chunks: Sequence[TriangularFactor], folds: TimeFolds, layout: GridLayout, dead: Sequence[Sequence[int]]
    ):
        self.chunks, self.folds, self.layout, self.dead = chunks, folds, layout, dead
        self.losses: dict[tuple[float, Set], np.ndarray] = {}
        """Root mean squared error in each fold of every (penalty, set) tried so far."""
        self._prepared: dict[float, list[Fold]] = {}
        width = max((len(layout.columns([i])) for i in range(len(layout.grid))), default=1)
        self.groups = np.full((len(layout.grid), width), -1)
        for i in range(len(layout.grid)):
            columns = layout.columns([i])
            self.groups[i, : len(columns)] = np.array(columns) - layout.n_free

    def score_sets(self, sets: Sequence[Set], alpha: float) -> np.ndarray:
        """Losses of sets, shape (n_sets, n_folds)."""
        self.try_sets(sets, alpha)
        return np.array([self.losses[alpha, members] for members in sets])

    def try_sets(self, sets: Sequence[Set], alpha: float) -> None:
        """Put the losses of sets into `losses`."""
        new: dict[int, list[Set]] = {}
        for members in sets:
            if (alpha, members) not in self.losses:
                new.setdefault(len(members), []).append(members)
        for count, group in new.items():
            columns = self.groups[np.array(group, np.intp).reshape(len(group), count)].reshape(len(group), -1)
            losses = np.sqrt(set_errors(self.prepared(alpha), columns))
            self.losses.update(((alpha, members), loss) for members, loss in zip(group, losses, strict=True))

    @cached_property
    def sides(self) -> list[Sides]:
        """Training and test factors of each fold."""
        return self.folds.sides(self.chunks, self.layout.n_free)

    def prepared(self, alpha: float) -> list[Fold]:
        """The folds for one ridge penalty."""
        if alpha not in self._prepared:
            n_free = self.layout.n_free
            self._prepared[alpha] = [fold_of(s.learned, s.tested, n_free, alpha, self.dead[s.fold]) for s in self.sides]
        return self._prepared[alpha]

    def greedy(self, candidates: Sequence[int], max_count: int, alpha: float) -> list[Set]:
        """Best set of each size, by forward steps and exchanges."""

        def best(sets: set[Set]) -> tuple[Set, float]:
            ordered = sorted(sets)
            losses = self.score_sets(ordered, alpha).mean(axis=1)
            return ordered[int(losses.argmin())], float(losses.min())

        path: list[Set] = []
        for _ in range(1, min(max_count, len(candidates)) + 1):
            path.append(grown(path[-1] if path else (), candidates, best))
        return path

    def exhaustive(self, candidates: Sequence[int], max_count: int, alpha: float) -> list[Set]:
        """Best set of each size among all sets."""
        members = np.array(candidates)
        path: list[Set] = []
        for size in range(1, min(max_count, len(members)) + 1):
            sets = members[np.array(list(combinations(range(len(members)), size)))]
            losses = np.sqrt(set_errors(self.prepared(alpha), self.groups[sets].reshape(len(sets), -1)))
            order = np.argsort(losses.mean(axis=1), kind="stable")[:200]  # of each size
            self.losses.update(((alpha, tuple(sets[i].tolist())), losses[i]) for i in order)
            path.append(tuple(sets[order[0]].tolist()))
        return path


def count_sets(n_candidates: int, max_count: int) -> int:
    """Number of sets of 1 to `max_count` of `n_candidates`."""
    return sum(comb(n_candidates, k) for k in range(1, max_count + 1))


def no_worse(losses: np.ndarray, best: np.ndarray) -> bool:
    """True within one standard error of the least loss.

    The difference is taken fold by fold (Breiman et al. 1984, section 3.4.3, on paired folds): what all folds share
    says nothing about it.
    """
    difference = losses - best
    error = float(difference.std(ddof=1)) / np.sqrt(len(difference)) if len(difference) > 1 else 0.0
    return float(difference.mean()) <= max(error, NEGLIGIBLE * float(best.mean()))


def fewest(losses: Sequence[np.ndarray]) -> int:
    """Index of the smallest set that is no worse."""
    best = int(np.argmin([float(loss.mean()) for loss in losses]))
    return next(i for i, loss in enumerate(losses) if i == best or no_worse(loss, losses[best]))
