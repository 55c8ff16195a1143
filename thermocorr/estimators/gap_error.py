"""What is not known of the temperature in gaps, as the bias feels it behind them.

Across a gap the temperature is taken as a straight line. What it did beside that line is still in the lags when the
record goes on, and is forgotten with their time constants. How large it is, the record says where it has no gap.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..equations.lags import Structure, bridge_error
from ..records import Block, Record
from ..records.errors import times_word
from ..records.screen import LeftOut

GAP = 2.5
"""Steps, in usual ones, from which on the temperature between is taken for unknown."""
OFTEN = 0.95
"""Share of the steps, in the first some thousand, that are none: a log that is written on changes has long steps all
the time, in which the temperature is known to have stood still."""
MOST_ROWS = 200_000
"""Rows of a segment that tell how the temperature wanders, at most."""
EVEN = 1e-9
"""Share of a segment's length by which as many usual steps may differ from it: rounding."""
ALIKE = 0.3
"""Share by which as many uneven steps may last longer, or less, than as many usual ones, to be compared with them."""


def error_behind_gaps(
    record: Record, time_constants: np.ndarray, weights: np.ndarray, limit: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation of the bias by what the temperature did in gaps.

    Parameters
    ----------
    record : Record
    time_constants : array of shape (J,)
        Of the lags of the temperature [s].
    weights : array of shape (J,)
        Their coefficients.
    limit : float
        What need not be told, in the unit of the reading.

    Returns
    -------
    rows : array of shape (n,)
        Those of the user's rows in which it is above the limit, in time order.
    error : array of shape (n,)
        In the unit of the reading.
    """
    least, longest = _spans(record) if len(time_constants) and weights.any() else (0.0, 0.0)
    if not longest:
        return np.zeros(0, np.intp), np.zeros(0)
    structure, known = structure_of(record, longest), dict[float, np.ndarray]()
    found = [(np.zeros(0, np.intp), np.zeros(0))]
    covariance, last = np.zeros((len(weights), len(weights))), 0.0
    for block in record.blocks():
        elapsed = block.elapsed
        if block.begins:
            covariance[:], last = 0.0, float(elapsed[0])
        gaps = _gaps(block, least)
        for first, stop in pairwise([*sorted({0, *gaps}), len(block)]):
            if first in gaps:
                h = float(f"{block.steps[first]:.2g}")
                if h not in known:
                    known[h] = bridge_error(structure, h, time_constants)
                decay = np.exp((last - elapsed[first]) / time_constants)
                covariance, last = decay[:, None] * covariance * decay + known[h], elapsed[first]
            if covariance.any():
                left = np.exp((last - elapsed[first:stop, None]) / time_constants) * weights
                error = np.sqrt(np.maximum(np.einsum("ij,ij->i", left @ covariance, left), 0.0))
                told = np.flatnonzero(error > limit)
                found.append((record.rows_at(block.places[first + told]), error[told]))
    return np.concatenate([rows for rows, _ in found]), np.concatenate([error for _, error in found])


def _gaps(block: Block, least: float) -> list[int]:
    """Numbers of a block's rows that stand behind a gap; the first of a segment does not."""
    gaps: list[int] = np.flatnonzero(block.steps > least).tolist()
    return gaps[1:] if block.begins and gaps[:1] == [0] else gaps


def _spans(record: Record) -> tuple[float, float]:
    """The shortest step that is a gap, and the longest one [s]; 0 for that where there is none."""
    usual = record.usual_step()
    even = (record.duration(segment) <= (segment.n_rows - 1) * usual * (1 + EVEN) for segment in record.segments)
    if not len(record.skipped) and all(even):
        return GAP * usual, 0.0
    some = next(record.blocks()).steps[1:]
    least, longest = max(GAP * usual, float(np.quantile(some, OFTEN)) if len(some) else 0.0), 0.0
    for block in record.blocks():
        longest = max(longest, float(block.steps[_gaps(block, least)].max(initial=0.0)))
    return least, longest


def readings_left_out(record: Record, believed: Record) -> list[str]:
    """A sentence on readings that gaps have spoilt; none where there are none, or filled cells may have done it."""
    if believed is record or record.filled:
        return []
    assert record.reading is not None and isinstance(believed.reading, LeftOut)
    count = int(np.isfinite(np.asarray(record.reading[believed.reading.rows], float)).sum())
    return [
        f"The temperature is not known in gaps of the record, and the device goes on to feel what it did there: "
        f"{times_word(count, 'reading')} behind gaps {'is' if count == 1 else 'are'} not learned from. They are "
        "corrected as if it had been a straight line; max_gap=... starts afresh behind longer gaps."
    ]


def structure_of(record: Record, longest: float) -> Structure:
    """Mean square of the temperature's changes over a time, up to the `longest` [s]: its structure function.

    A straight line to zero below the usual step; beyond what the record has, the last value.
    """
    usual = record.usual_step()
    counts = np.unique(np.geomspace(1, max(longest / usual, 2.0), 25).astype(int))
    sums, sizes = np.zeros(len(counts)), np.zeros(len(counts))
    for segment in record.segments:
        rows = record.kept(segment.start, min(segment.stop, segment.start + MOST_ROWS))
        T = np.asarray(record.columns[record.temperature_name][rows], float)
        steps = np.array(record.times.steps(rows))
        steps[:1] = 0.0
        elapsed = np.cumsum(steps)
        for i, k in enumerate(counts.tolist()):
            like = np.abs(elapsed[k:] - elapsed[:-k] - k * usual) <= ALIKE * k * usual
            squares = np.square(T[k:] - T[:-k])[like]
            sums[i], sizes[i] = sums[i] + squares.sum(), sizes[i] + len(squares)
    seen = sizes > 0
    lags = np.concatenate(([0.0], counts[seen] * usual))
    values = np.concatenate(([0.0], sums[seen] / sizes[seen]))
    return lambda lag: np.interp(lag, lags, values)
