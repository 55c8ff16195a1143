"""What is not known of the temperature in gaps, as the bias feels it behind them.

Across a gap the temperature is taken as a straight line. What it did beside that line is still in the lags when the
record goes on, and is forgotten with their time constants. How large it is, the record says where it has no gap. Other
columns that the device feels late are treated alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ..equations.lags import bridge_error
from ..records import Block, Record, SegmentStart
from ..records.errors import times_word
from ..records.gaps import Gaps, least_gap, longest_gap
from ..records.screen import LeftOut
from .input_law import InputLaw

Felt = tuple[np.ndarray | None, ...]
"""Covariance of what the lags of each column feel of gaps; None where it is forgotten."""


class GapError:
    """Propagates what happened in gaps through a model's lags.

    Parameters
    ----------
    laws : sequence of InputLaw
        Of the columns that the device feels late.
    gaps : Gaps
        How these wander.
    """

    def __init__(self, laws: Sequence[InputLaw], gaps: Gaps):
        self.laws = [law for law in laws if law.weights.any()]
        self.least = gaps.least if self.laws else np.inf
        """Steps above it are gaps [s]."""
        self._structures = [gaps.structure(law.column) for law in self.laws]
        self._bridges: dict[tuple[int, float], np.ndarray] = {}

    def of_rows(self, steps: np.ndarray, felt: Felt = ()) -> tuple[np.ndarray, Felt]:
        """Variance of the bias in consecutive rows by the gaps between them, and before.

        Parameters
        ----------
        steps : array of shape (n,)
            Time since the row before [s].
        felt : Felt
            After the row before; () for nothing.

        Returns
        -------
        variance : array of shape (n,)
        felt : Felt
            After the last row.
        """
        variance, gaps = np.zeros(len(steps)), set(np.flatnonzero(steps > self.least).tolist())
        if not gaps and not felt:
            return variance, ()
        elapsed, pieces = np.cumsum(steps), list(pairwise([*sorted({0, *gaps}), len(steps)]))
        after = []
        for number, law in enumerate(self.laws):
            covariance, last = felt[number] if felt else None, 0.0
            for first, stop in pieces:
                if first in gaps:
                    behind = self._bridge(number, float(steps[first]))
                    covariance, last = behind + _faded(law, covariance, elapsed[first] - last), elapsed[first]
                if covariance is not None:
                    found, told = _variance(law, covariance, elapsed[first:stop] - last)
                    variance[first:stop] += found
                    covariance = covariance if told else None
            after.append(None if covariance is None else _faded(law, covariance, elapsed[-1] - last))
        return variance, tuple(after) if any(each is not None for each in after) else ()

    def of_block(self, block: Block, felt: dict[int, Felt]) -> np.ndarray:
        """`of_rows` of a block; `felt`, by the number of the segment, goes on."""
        steps = block.steps
        if block.begins:
            steps = np.concatenate(([0.0], steps[1:]))
        variance, felt[block.segment] = self.of_rows(steps, felt.get(block.segment, ()))
        return variance

    def of_record(self, record: Record, starts: Mapping[int, SegmentStart]) -> np.ndarray | None:
        """`of_rows` of all rows of a record, shape (n_rows,); None where nothing is felt."""
        if not self.laws or not (longest_gap(record, self.least) or _tied_late(starts, self.least)):
            return None
        result, felt = np.zeros(record.n_rows), dict[int, Felt]()
        for block in record.blocks(starts=starts):
            result[block.rows] = self.of_block(block, felt)
        return result

    def _bridge(self, number: int, step: float) -> np.ndarray:
        h = float(f"{step:.2g}")  # the same for gaps that are nearly as long
        if (number, h) not in self._bridges:
            taus = self.laws[number].time_constants
            self._bridges[number, h] = bridge_error(self._structures[number], h, taus)
        return self._bridges[number, h]


def error_behind_gaps(record: Record, laws: Sequence[InputLaw], limit: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation of the bias by what happened in the gaps of a record that a model is fitted to.

    Parameters
    ----------
    record : Record
    laws : sequence of InputLaw
        Of the columns that the device feels late.
    limit : float
        What need not be told, in the unit of the reading.

    Returns
    -------
    rows : array of shape (n,)
        Those of the user's rows in which it is above the limit, in time order.
    error : array of shape (n,)
        In the unit of the reading.
    """
    least = least_gap(record, record.usual_step())
    longest = longest_gap(record, least)
    found = [(np.zeros(0, np.intp), np.zeros(0))]
    if longest and (laws := [law for law in laws if law.weights.any()]):
        felt, columns = dict[int, Felt](), [law.column for law in laws]
        follow = GapError(laws, Gaps.of(record, columns, least, longest))
        for block in record.blocks():
            error = np.sqrt(follow.of_block(block, felt))
            told = np.flatnonzero(error > limit)
            found.append((record.rows_at(block.places[told]), error[told]))
    return np.concatenate([rows for rows, _ in found]), np.concatenate([error for _, error in found])


def readings_left_out(record: Record, believed: Record) -> list[str]:
    """A sentence on readings that gaps have spoilt; none where there are none, or filled cells may have done it."""
    if believed is record or record.filled:
        return []
    assert record.reading is not None and isinstance(believed.reading, LeftOut)
    count = int(np.isfinite(np.asarray(record.reading[believed.reading.rows], float)).sum())
    if not count:
        return []
    return [
        f"The temperature is not known in gaps of the record, and the device goes on to feel what it did there: "
        f"{times_word(count, 'reading')} behind gaps {'is' if count == 1 else 'are'} not learned from. They are "
        "corrected as if it had been a straight line; max_gap=... starts afresh behind longer gaps."
    ]


def _faded(law: InputLaw, covariance: np.ndarray | None, elapsed: float) -> Any:
    """A covariance after a while; 0 for none."""
    if covariance is None:
        return 0.0
    decay = np.exp(-elapsed / law.time_constants)
    return decay[:, None] * covariance * decay


def _variance(law: InputLaw, covariance: np.ndarray, elapsed: np.ndarray) -> tuple[np.ndarray, bool]:
    """Variance of the bias at times after the covariance was such, and whether it is felt to the last of them."""
    weights = np.exp(-elapsed[:, None] / law.time_constants) * law.weights
    sizes = np.sqrt(np.maximum(np.diag(covariance), 0.0))  # rounding may make them less
    most = np.abs(weights) @ sizes  # if all lags erred together
    felt = int(np.count_nonzero(most > law.least))
    variance = np.zeros(len(elapsed))
    variance[:felt] = np.maximum(np.einsum("ij,ij->i", weights[:felt] @ covariance, weights[:felt]), 0.0)
    return variance, felt == len(elapsed)


def _tied_late(starts: Mapping[int, SegmentStart], least: float) -> bool:
    """Whether a segment follows on the fitted record after a gap."""
    return any(start.step is not None and start.step > least for start in starts.values())
