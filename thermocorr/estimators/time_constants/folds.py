"""Folds in time: which stretches of a record are learned from and which are tested."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np

from ...equations import TriangularFactor
from ...records import Record, Segment
from ..cutting import equal_edges

MAX_STRETCHES = 400
"""More stretches than this are not blocks in time but shuffled rows."""
WASHOUT_SHARE = 0.01
"""Washout between training and test, as a share of the record."""

Ranges = list[tuple[int, int]]


class Sides(NamedTuple):
    """A fold's number, and the factors of its two sides."""

    fold: int
    learned: TriangularFactor
    tested: TriangularFactor


@dataclass(frozen=True)
class TimeFolds:
    """A record cut into stretches, and the stretches that each fold learns from and tests on."""

    edges: np.ndarray
    """Positions in time order that cut the record, ends included."""
    learned: tuple[list[int], ...]
    """``learned[f]``: stretches that fold f learns from."""
    tested: tuple[list[int], ...]

    def __len__(self) -> int:
        return len(self.learned)

    def sides(self, chunks: Sequence[TriangularFactor], n_free: int) -> list[Sides]:
        """Factors of what each fold learns from and tests on; folds without readings on a side are left out.

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
        """First to last learned row of a segment [s], 0 where there is none."""
        inside = [
            (max(int(self.edges[i]), segment.start), min(int(self.edges[i + 1]), segment.stop))
            for i in self.learned[fold]
        ]
        rows = [k for low, high in inside if low < high for k in (low, high - 1)]
        return record.times.between(record.stamp(max(rows)), record.stamp(min(rows))) if rows else 0.0


def folds_in_time(record: Record, cv: Any = 5) -> TimeFolds:
    """Cut a record for cross-validation.

    Parameters
    ----------
    record : Record
    cv : int, splitter or iterable of (train, test) rows
        An int is forward chaining with that many tests, the rows of ``TimeSeriesSplit(cv)`` (of the part that has
        readings, where these hold less than half of the record). A splitter of
        scikit-learn is given the runs' labels as groups. Its folds must be made of whole stretches of time.

    With an int, learned rows within 1 % of the longest segment of a test are left out, and tested rows that close
    behind the start of a run of which nothing was learned.
    """
    if isinstance(cv, Integral) and not isinstance(cv, bool):
        gap = round(WASHOUT_SHARE * record.longest_read() / record.usual_step())
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
        if count > MAX_STRETCHES:
            raise ValueError(
                f"The folds of {cv!r} cut the record into {count} pieces: their rows are shuffled, so that training "
                "and test share neighbours in time. Use whole stretches: TimeSeriesSplit, KFold without shuffling, or "
                "LeaveOneGroupOut with run=..."
            )
        pairs.append((sides[0], sides[1]))
    return pairs


def _run_labels(record: Record) -> np.ndarray | None:
    """Number of the run of each of the user's rows, -1 outside any; None for a record without runs."""
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
