"""Propagation of input errors to the bias.

Across a gap the temperature is taken as a straight line. How it left that line is still in the lags when the
record goes on, and is forgotten with their time constants: the error of lag j fades as exp(-t/tau_j), eq. (17) with no
input, a covariance C of these errors as ``C_jk exp(-(1/tau_j + 1/tau_k) t)``, and the bias errs by the variance
``w' C w``. How large C is, the record says where it has no gap. Other columns that the device feels late are treated
alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..effects import LaggedCovariate, ThermalLag
from ..effects.protocol import Effect
from ..equations.lags import bridge_error
from ..records import Block, Record, SegmentStart
from ..records.errors import option, times_word
from ..records.history import Gaps, least_gap, longest_gap

SPOILT = 0.3
"""Share of the residuals' standard deviation at which a reading is neither learned from nor judged: it would raise
the variance there by a tenth."""
MOST_SPOILT = 0.1
"""Share of the readings that gaps may cost a fit: the others are learned from, however long the lags remember."""
FORGOTTEN = 0.05
"""Share of the residuals' standard deviation below which a late error is forgotten."""
Felt = tuple[np.ndarray | None, ...]
"""Covariance of what the lags of each column feel of gaps, shape (J, J); None where it is forgotten."""


@dataclass(frozen=True)
class InputLaw:
    """Linear dependence of the bias on the lags of one column."""

    column: Any
    time_constants: np.ndarray
    """[s], shape (J,)."""
    weights: np.ndarray
    """Coefficients of the lags, shape (J,)."""
    least: float
    """An error of all lags together by which the bias would move no further is forgotten."""


def laws_of_inputs(
    effects: Sequence[Effect], coef: np.ndarray, temperature: Any, columns: Iterable[Any], deviation: float
) -> list[InputLaw]:
    """Dependence of the bias on each column's lags.

    `effects` (sequence of Effect): Learned. `coef` (array of shape (n_columns,)). `temperature` (column): The ambient
    temperature. `columns` (iterable of columns). `deviation` (float): Standard deviation of the residuals.
    """
    found = []
    for column in columns:
        taus, weights, at = list[float](), list[float](), 0
        for effect in effects:
            own, at = coef[at : at + effect.n_columns()], at + effect.n_columns()
            late = isinstance(effect, LaggedCovariate) and effect.column == column and effect.power == 1
            if late or (isinstance(effect, ThermalLag) and column == temperature):
                taus += effect.time_constants_.tolist()
                weights += own[len(own) - len(effect.time_constants_) :].tolist()
        if any(weights):
            found.append(InputLaw(column, np.array(taus), np.array(weights), FORGOTTEN * deviation))
    return found


class GapError:
    """Propagates what happened in gaps through a model's lags.

    `laws` (sequence of InputLaw): Of the columns that the device feels late. `gaps` (Gaps): How these wander.
    """

    def __init__(self, laws: Sequence[InputLaw], gaps: Gaps):
        self.laws = laws
        self.least = gaps.least if laws else np.inf
        """Steps above it are gaps [s]."""
        self._structures = [gaps.structure(law.column) for law in laws]
        self._bridges: dict[tuple[int, float], np.ndarray] = {}

    def of_rows(self, steps: np.ndarray, felt: Felt = ()) -> tuple[np.ndarray, Felt]:
        """Variance of the bias by gaps, row by row.

        `steps` (array of shape (n,)): Time since the row before [s]. `felt` (Felt): After the row before; () for
        nothing. Returns variance (array of shape (n,)). Returns felt (Felt): after the last row.
        """
        gaps, variance = np.flatnonzero(steps > self.least), np.zeros(len(steps))
        if not len(gaps) and not felt:
            return variance, ()
        seconds, after = np.cumsum(steps), list[np.ndarray | None]()
        for number, law in enumerate(self.laws):
            C, known = (felt[number] if felt else None), 0.0  # the covariance, and when it is that
            for low, high in pairwise([*([0] if not len(gaps) or gaps[0] else []), *gaps.tolist(), len(steps)]):
                if steps[low] > self.least:
                    bridge = self._bridge(number, float(steps[low]))
                    C, known = bridge + (0.0 if C is None else self._faded(law, C, seconds[low] - known)), seconds[low]
                if C is None:
                    continue
                left = np.exp((known - seconds[low:high, None]) / law.time_constants)
                clear = left @ (np.abs(law.weights) * np.sqrt(np.diag(C))) > law.least
                weighed = left * law.weights
                variance[low:high] += np.where(clear, np.maximum(np.sum(weighed @ C * weighed, axis=1), 0.0), 0.0)
                C = C * np.outer(left[-1], left[-1]) if clear[-1] else None
                known = seconds[high - 1]
            after.append(C)
        return variance, () if all(C is None for C in after) else tuple(after)

    @staticmethod
    def _faded(law: InputLaw, C: np.ndarray, passed: float) -> np.ndarray:
        """A covariance after some time [s]."""
        left = np.exp(-passed / law.time_constants)
        return np.asarray(C * np.outer(left, left))

    def of_block(self, block: Block, felt: dict[int, Felt]) -> np.ndarray:
        """`of_rows` of a block; `felt` continues per segment."""
        steps = block.steps
        if block.begins:
            steps = np.concatenate(([0.0], steps[1:]))
        variance, felt[block.segment] = self.of_rows(steps, felt.get(block.segment, ()))
        return variance

    def of_record(self, record: Record, starts: Mapping[int, SegmentStart]) -> np.ndarray | None:
        """`of_rows` of a record; None where nothing is felt."""
        if not self.laws or not (longest_gap(record, self.least) or _tied_late(starts, self.least)):
            return None
        result, felt = np.zeros(record.n_rows), dict[int, Felt]()
        for block in record.blocks(starts=starts):
            result[block.rows] = self.of_block(block, felt)
        return result

    def _bridge(self, number: int, step: float) -> np.ndarray:
        """Covariance that a gap adds, shape (J, J)."""
        h = float(f"{step:.2g}")  # the same for gaps that are nearly as long
        if (number, h) not in self._bridges:
            taus = self.laws[number].time_constants
            self._bridges[number, h] = bridge_error(self._structures[number], h, taus)
        return self._bridges[number, h]


def error_behind_gaps(record: Record, laws: Iterable[InputLaw], limit: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation of the bias behind a record's gaps.

    `record` (Record). `laws` (iterable of InputLaw): Of the columns that the device feels late; looked at where there
    are gaps. `limit` (float): The least error that counts [unit of the reading]. Returns rows (array of shape (n,)):
    the user's rows above the limit, in time order, and error (array of shape (n,)), in the unit of the reading.
    """
    least = least_gap(record, record.usual_step())
    longest = longest_gap(record, least)
    found = [(np.zeros(0, np.intp), np.zeros(0))]
    if longest and (laws := list(laws)):
        felt, columns = dict[int, Felt](), [law.column for law in laws]
        follow = GapError(laws, Gaps.of(record, columns, least, longest))
        for block in record.blocks():
            error = np.sqrt(follow.of_block(block, felt))
            clear = np.flatnonzero(error > limit)
            found.append((record.rows_at(block.places[clear]), error[clear]))
    return np.concatenate([rows for rows, _ in found]), np.concatenate([error for _, error in found])


def readings_left_out(record: Record, accepted: Record) -> list[str]:
    """Sentence on readings that gaps have spoilt."""
    if accepted is record:
        return []
    assert record.reading is not None and accepted.reading is not None
    count = int((np.isfinite(record.reading) & np.isnan(accepted.reading)).sum())
    if not count:
        return []
    return [
        f"The device still feels what the temperature did in gaps, which is unknown: {times_word(count, 'reading')} "
        f"behind gaps {'is' if count == 1 else 'are'} not learned from. They are corrected as if it had been "
        f"a straight line; {option('max_gap')} starts afresh behind longer gaps."
    ]


def _tied_late(starts: Mapping[int, SegmentStart], least: float) -> bool:
    """True if a segment continues the fitted record behind a gap."""
    return any(start.step is not None and start.step > least for start in starts.values())
