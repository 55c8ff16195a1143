"""What is not known of the temperature in gaps, as the bias feels it behind them.

Across a gap the temperature is taken as a straight line. What it did beside that line is still in the lags when the
record goes on, and is forgotten with their time constants. How large it is, the record says where it has no gap. Other
columns that the device feels late are treated alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..equations.lags import bridge_error
from ..records import Block, Record, SegmentStart
from ..records.errors import times_word
from ..records.gaps import Gaps, least_gap, longest_gap
from ..records.screen import LeftOut
from .fading import Fading
from .input_law import InputLaw

Felt = tuple[np.ndarray | None, ...]
"""What the lags of each column feel of gaps, as a row of `Fading`; None where it is forgotten."""
MANY = 0.1
"""Share of the readings that gaps have spoilt, above which it is told beside their number."""


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
        self._fadings = [Fading(law) for law in self.laws]
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
        gaps = np.flatnonzero(steps > self.least)
        if not len(gaps) and not felt:
            return np.zeros(len(steps)), ()
        variance, elapsed, after = np.zeros(len(steps)), np.cumsum(steps), []
        lengths, of_gap = np.unique(steps[gaps], return_inverse=True)
        for number, fading in enumerate(self._fadings):
            bridges = [self._bridge(number, step) for step in lengths.tolist()]
            added = np.reshape(bridges, (-1, fading.width))[of_gap]
            found, left = fading.of_rows(elapsed, gaps, added, felt[number] if felt else None)
            variance += found
            after.append(left)
        return variance, _unless_forgotten(after)

    def of_row(self, step: float, felt: Felt = ()) -> tuple[float, Felt]:
        """`of_rows` of a single row, in a tenth of the time."""
        is_gap = step > self.least
        if not is_gap and not felt:
            return 0.0, ()
        variance, after = 0.0, []
        for number, fading in enumerate(self._fadings):
            row = felt[number] if felt else None
            if row is not None:
                row = fading.faded(row, step)
            if is_gap:
                added = self._bridge(number, step)
                row = added if row is None else added + row
            found = None if row is None else fading.variance(row)
            variance += found or 0.0
            after.append(None if found is None else row)
        return variance, _unless_forgotten(after)

    def plain(self, felt: Felt) -> tuple[tuple[float, ...] | None, ...]:
        """What is felt as plain numbers: the covariance of each column's lags, row by row."""
        pairs = zip(felt, self._fadings, strict=False)
        return tuple(None if row is None else tuple(one.covariance(row).ravel().tolist()) for row, one in pairs)

    def taken_up(self, plain: Sequence[Sequence[float] | None]) -> Felt:
        """What is felt, of the numbers that `plain` has said."""
        pairs = zip(plain, self._fadings, self.laws, strict=False)
        return tuple(
            None if each is None else one.row(np.reshape(each, 2 * [len(law.weights)])) for each, one, law in pairs
        )

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
        """What a gap adds, as a row of `Fading`; not to be written to."""
        h = float(f"{step:.2g}")  # the same for gaps that are nearly as long
        if (number, h) not in self._bridges:
            taus = self.laws[number].time_constants
            self._bridges[number, h] = self._fadings[number].row(bridge_error(self._structures[number], h, taus))
        return self._bridges[number, h]


def error_behind_gaps(record: Record, laws: Iterable[InputLaw], limit: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation of the bias by what happened in the gaps of a record that a model is fitted to.

    Parameters
    ----------
    record : Record
    laws : iterable of InputLaw
        Of the columns that the device feels late; looked at where there are gaps.
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
    known = record.reading_moments().n
    share = f", {100 * count / known:.0f} % of all," if count > MANY * known else ""
    return [
        f"The temperature is not known in gaps of the record, and the device goes on to feel what it did there: "
        f"{times_word(count, 'reading')} behind gaps{share} {'is' if count == 1 else 'are'} not learned from. They are "
        "corrected as if it had been a straight line; max_gap=... starts afresh behind longer gaps."
    ]


def _unless_forgotten(felt: list[np.ndarray | None]) -> Felt:
    """() where nothing is felt of any column."""
    for each in felt:
        if each is not None:
            return tuple(felt)
    return ()


def _tied_late(starts: Mapping[int, SegmentStart], least: float) -> bool:
    """Whether a segment follows on the fitted record after a gap."""
    return any(start.step is not None and start.step > least for start in starts.values())
