"""Propagation of input errors to the bias: gaps, the time between rows.

The error of lag j behind a gap is forgotten as exp(-t/tau_j), eq. (17) with no input, so a covariance C of these errors
fades as ``C_jk exp(-(1/tau_j + 1/tau_k) t)``, number by number, and the bias errs by the variance ``w' C w``. No matrix
products are needed: C is kept as one row of J (J + 1)/2 numbers, its diagonal first.

Across a gap the temperature is taken as a straight line. What it did beside that line is still in the lags when the
record goes on, and is forgotten with their time constants. How large it is, the record says where it has no gap. Other
columns that the device feels late are treated alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..effects import Covariate, StaticPolynomial, ThermalLag
from ..effects.expressions import reads_temperature
from ..effects.protocol import Effect
from ..equations.lags import bridge_error
from ..records import Block, Record, SegmentStart
from ..records.errors import option, times_word
from ..records.gaps import Gaps, least_gap, longest_gap


@dataclass(frozen=True)
class InputLaw:
    """Linear dependence of the bias on one column and its lags."""

    column: Any
    powers: tuple[tuple[int, float, float], ...]
    """Power, coefficient and origin of each static term."""
    time_constants: np.ndarray
    weights: np.ndarray
    """Time constants [s] and coefficients of the lags."""
    least: float
    """What the bias need not be told of."""
    known: bool
    """False where some other effect reads the column."""

    def slope(self, value: float) -> float:
        """Change of the static law with the column."""
        if np.isnan(value):
            return 0.0
        return sum(power * weight * (value - origin) ** (power - 1) for power, weight, origin in self.powers)


def law_of_inputs(
    effects: Sequence[Effect], coef: np.ndarray, temperature: Any, columns: Sequence[Any], deviation: float
) -> list[InputLaw]:
    """Linear dependence of the bias on each of some columns.

    `effects` (sequence of Effect): Learned. `coef` (array of shape (n_columns,)). `temperature` (column): The ambient
    temperature. `columns` (sequence of columns). `deviation` (float): Standard deviation of the residuals, beside
    which late errors are forgotten.
    """
    edges = np.cumsum([0, *(effect.n_columns() for effect in effects)])
    parts = [(effect, coef[low:high]) for effect, low, high in zip(effects, edges, edges[1:], strict=False)]
    # Share of the residuals' standard deviation below which a late error is forgotten
    return [_law(column, parts, temperature, 0.05 * deviation) for column in columns]


def _law(column: Any, parts: Sequence[tuple[Effect, np.ndarray]], temperature: Any, least: float) -> InputLaw:
    powers: list[tuple[int, float, float]] = []
    taus, weights, known = [], [], True
    for effect, coef in parts:
        if isinstance(effect, StaticPolynomial) and column == temperature:
            powers += [
                (power, float(weight), float(effect.reference_temperature_))
                for power, weight in zip(effect.powers(), coef, strict=True)
            ]
        elif isinstance(effect, ThermalLag) and column == temperature:
            taus += effect.time_constants_.tolist()
            weights += coef.tolist()
        elif isinstance(effect, Covariate) and effect.column == column:
            powers.append((effect.power, float(coef[0]), 0.0))
            if len(coef) > 1 and effect.power == 1:
                taus += list(getattr(effect, "time_constants_", ()))
                weights += coef[1:].tolist()
            known &= len(coef) == 1 or effect.power == 1
        elif column in effect.inputs() or (column == temperature and reads_temperature(effect)):
            known = known and not coef.any()
    return InputLaw(
        column=column,
        powers=tuple(powers),
        time_constants=np.array(taus, float),
        weights=np.array(weights, float),
        least=least,
        known=known,
    )


SPOILT = 0.3
"""Share of the residuals' standard deviation from which a reading is neither learned from nor judged: it would raise
the variance there by a tenth."""


class Fading:
    """Covariances of what the lags of a column feel, as rows of numbers.

    What is felt is forgotten when the bias would move by no more than `InputLaw.least` if all lags erred together by
    their standard deviations: ``sum_j |w_j| sqrt(C_jj) <= least``. A row, a block and a whole record ask alike.

    `law` (InputLaw): How the bias depends on the column.
    """

    def __init__(self, law: InputLaw):
        self.law, self._n = law, len(law.weights)
        above = np.triu_indices(self._n, 1)
        self._places = tuple(np.concatenate((np.arange(self._n), one)) for one in above)
        first, second = self._places
        self.width = len(first)
        """Numbers of a row."""
        self._rates = -1.0 / law.time_constants[first] - 1.0 / law.time_constants[second]
        self._products = law.weights[first] * law.weights[second] * np.where(first == second, 1.0, 2.0)
        self._sizes = np.abs(law.weights)
        self._known: dict[float, np.ndarray] = {}

    def row(self, covariance: np.ndarray) -> np.ndarray:
        """A covariance of shape (J, J) as a row; rounding may have made variances less than 0."""
        row = covariance[self._places]
        row[: self._n] = np.maximum(row[: self._n], 0.0)
        return row

    def covariance(self, row: np.ndarray) -> np.ndarray:
        """The covariance that a row stands for, shape (J, J)."""
        full, (first, second) = np.empty((self._n, self._n)), self._places
        full[first, second] = full[second, first] = row
        return full

    # ------------------------------------------------------------------------------------------------- one by one

    def faded(self, row: np.ndarray, step: float) -> np.ndarray:
        """Covariance after some time [s]."""
        decay = self._known.get(step)
        if decay is None:
            decay = np.exp(self._rates * step)
            # Different steps whose decays are remembered; a clock that jitters does not fill the memory
            if len(self._known) < 64:
                self._known[step] = decay
        return np.asarray(row * decay)

    def variance(self, row: np.ndarray) -> float | None:
        """Variance of the bias; None where it is forgotten."""
        if self._sizes.dot(np.sqrt(row[: self._n])) <= self.law.least:
            return None
        return max(float(self._products.dot(row)), 0.0)

    # -------------------------------------------------------------------------------------------------- in blocks

    def of_rows(
        self, elapsed: np.ndarray, gaps: np.ndarray, bridges: np.ndarray, felt: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Variance of the bias in consecutive rows, and what is felt after the last of them.

        `elapsed` (array of shape (n,)): Time since the row before these [s]. `gaps` (array of shape (m,)): Numbers of
        the rows behind a gap. `bridges` (array of shape (m, J (J + 1)/2)): What each gap adds. `felt` (row,
        optional): After the row before these; None for nothing.
        """
        first, begun, rows = gaps, elapsed[gaps], bridges
        if felt is not None and gaps[:1].tolist() == [0]:
            rows[0] += self.faded(felt, float(begun[0]))
        elif felt is not None:
            first, begun, rows = np.append(0, gaps), np.append(0.0, begun), np.vstack((felt, bridges))
        variance = np.zeros(len(elapsed))
        if not len(first):
            return variance, None
        told = self._chained(rows, begun, elapsed[np.append(first[1:], len(elapsed)) - 1])
        counts = np.diff(np.append(first, len(elapsed)))
        variance[first[0] :] = self._between(rows, counts, elapsed[first[0] :] - begun.repeat(counts))
        return variance, rows[-1] * np.exp(self._rates * (elapsed[-1] - begun[-1])) if told else None

    def _chained(self, rows: np.ndarray, begun: np.ndarray, last: np.ndarray) -> bool:
        """Add to what each gap adds what is still felt of those before it; whether the last one is felt to the end.

        `begun` and `last` are the times of the first and the last row behind each gap [s].
        """
        passed = np.exp(np.diff(begun, prepend=begun[0])[:, None] * self._rates)
        left = np.exp((begun - last)[:, None] / self.law.time_constants) * self._sizes
        n, least, before, told = self._n, self.law.least, rows[0], False
        alone = np.einsum("ij,ij->i", left, np.sqrt(rows[:, :n])) > least  # the more so beside what was felt before
        for row, decay, share, sure in zip(rows, passed, left, alone.tolist(), strict=True):
            if told:
                decay *= before
                row += decay
            told = sure or share.dot(np.sqrt(row[:n])) > least
            before = row
        return bool(told)

    def _between(self, rows: np.ndarray, counts: np.ndarray, since: np.ndarray) -> np.ndarray:
        """Variance of the bias in so many rows behind each gap, at times [s] since it was over."""
        decays = np.exp(np.multiply.outer(-1.0 / self.law.time_constants, since))
        most, variance, at = np.zeros(len(since)), np.zeros(len(since)), self._n
        sizes, products = np.sqrt(rows[:, : self._n]) * self._sizes, rows * self._products
        for j, decay in enumerate(decays):
            most += sizes[:, j].repeat(counts) * decay
            inner = products[:, j].repeat(counts) * decay
            for other in decays[j + 1 :]:
                inner += products[:, at].repeat(counts) * other
                at += 1
            variance += inner * decay
        return np.where(most > self.law.least, np.maximum(variance, 0.0), 0.0)


Felt = tuple[np.ndarray | None, ...]
"""What the lags of each column feel of gaps, as a row of `Fading`; None where it is forgotten."""
MOST_SPOILT = 0.1
"""Share of the readings that gaps may cost a fit: the others are learned from, however long the lags remember."""


class GapError:
    """Propagates what happened in gaps through a model's lags.

    `laws` (sequence of InputLaw): Of the columns that the device feels late. `gaps` (Gaps): How these wander.
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

        `steps` (array of shape (n,)): Time since the row before [s]. `felt` (Felt): After the row before; () for
        nothing. Returns variance (array of shape (n,)). Returns felt (Felt): after the last row.
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
        """Covariance of each column's lags as plain numbers, row by row."""
        pairs = zip(felt, self._fadings, strict=False)
        return tuple(None if row is None else tuple(one.covariance(row).ravel().tolist()) for row, one in pairs)

    def taken_up(self, plain: Sequence[Sequence[float] | None]) -> Felt:
        """Covariance from the numbers of `plain`."""
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
        """Covariance that a gap adds, as a read-only row of `Fading`."""
        h = float(f"{step:.2g}")  # the same for gaps that are nearly as long
        if (number, h) not in self._bridges:
            taus = self.laws[number].time_constants
            self._bridges[number, h] = self._fadings[number].row(bridge_error(self._structures[number], h, taus))
        return self._bridges[number, h]


def error_behind_gaps(record: Record, laws: Iterable[InputLaw], limit: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation of the bias by what happened in the gaps of a record that a model is fitted to.

    `record` (Record). `laws` (iterable of InputLaw): Of the columns that the device feels late; looked at where there
    are gaps. `limit` (float): What need not be told, in the unit of the reading. Returns rows (array of shape (n,)):
    those of the user's rows in which it is above the limit, in time order. Returns error (array of shape (n,)): in
    the unit of the reading.
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
    """A sentence on readings that gaps have spoilt; none where there are none."""
    if believed is record:
        return []
    assert record.reading is not None and believed.reading is not None
    count = int((np.isfinite(record.reading) & np.isnan(believed.reading)).sum())
    if not count:
        return []
    return [
        f"The temperature is not known in gaps of the record, and the device goes on to feel what it did there: "
        f"{times_word(count, 'reading')} behind gaps {'is' if count == 1 else 'are'} not learned from. They are "
        f"corrected as if it had been a straight line; {option('max_gap')} starts afresh behind longer gaps."
    ]


def _unless_forgotten(felt: list[np.ndarray | None]) -> Felt:
    """() where nothing is felt of any column."""
    for each in felt:
        if each is not None:
            return tuple(felt)
    return ()


def _tied_late(starts: Mapping[int, SegmentStart], least: float) -> bool:
    """True if a segment follows on the fitted record after a gap."""
    return any(start.step is not None and start.step > least for start in starts.values())
