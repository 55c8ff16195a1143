"""Allan deviation of a record that arrives block by block and is never held as a whole."""

from __future__ import annotations

import numpy as np

from .allan import (
    AllanDeviation,
    CellSums,
    Floats,
    allan_deviation,
    averaging_factors,
    check_confidence,
    deviation_of,
    noise_exponents,
    squared_steps,
)

MOST_CELLS = 1 << 20
"""Cells that are held; a longer record is held in averages over 2, 4, 8, ... of them."""
FINE = 16
"""Averages over fewer held cells than this are compared while the record passes, at every offset."""
FAR = 2.0**62
"""Number of a cell from which it does not matter which one it is: a gap too long for any record lies before it."""
AT_ONCE = 1 << 16
"""Cells that are worked on together."""


class AllanStream:
    """Overlapping Allan deviation of blocks of rows at any times: see `thermocorr.equations.allan`.

    Exactly `allan_deviation` of `regular_cells` for records of up to `most` cells. Beyond that, long averages begin at
    every f-th cell only, f at most a sixteenth of their length: unbiased, and hardly less certain.

    Parameters
    ----------
    sampling_period : float
        Length of a cell [s].
    n_cells : int
        Cells of the record, about: its length over `sampling_period`.
    longest_gap : int
        Cells of a gap beyond which the record is cut into pieces.
    averaging_times : {"octave", "log"}
    confidence : float
    most : int
        Cells that are held.
    """

    def __init__(
        self,
        sampling_period: float,
        n_cells: int,
        longest_gap: int,
        averaging_times: str = "octave",
        confidence: float = 0.95,
        most: int = MOST_CELLS,
    ):
        check_confidence(confidence)
        if not isinstance(averaging_times, str):
            raise ValueError(
                f"The 'averaging_times' parameter must be 'octave' or 'log'. Got {averaging_times!r} instead."
            )
        self.sampling_period, self.longest_gap = sampling_period, longest_gap
        self.averaging_times, self.confidence = averaging_times, confidence
        self.factor = 1
        while n_cells > most * self.factor:
            self.factor *= 2
        fine = averaging_factors(n_cells, 1.0, averaging_times)
        self._fine = fine[fine < FINE * self.factor] if self.factor > 1 else fine[:0]
        self._found = [(0, 0.0)] * len(self._fine)
        self._head: Floats = np.zeros(0)
        self._held: list[list[Floats]] = []
        self._cells: list[Floats] = []
        self._tail: Floats = np.zeros(0)
        self._rest: Floats = np.zeros(0)
        self._at_once = max(AT_ONCE, 8 * FINE * self.factor)
        self._piece: object = None
        self._start = 0.0
        self._open: tuple[int, float, int] | None = None  # cell that may get another reading: number, sum, count

    def add(self, piece: object, seconds: Floats, values: Floats) -> None:
        """Take in rows: what piece of the record they belong to, their increasing times [s] and their readings."""
        if not len(seconds):
            return
        if self._open is None or piece != self._piece:
            self._begin(piece, float(seconds[0]))
        number = self._cell(seconds)
        if self._open is not None and number[0] - self._open[0] > self.longest_gap:
            self._begin(piece, float(seconds[0]))
            number = self._cell(seconds)
        wide = np.flatnonzero(np.diff(number) > self.longest_gap)
        if len(wide):
            cut = int(wide[0]) + 1
            self._put(number[:cut], values[:cut])
            self._begin(piece, float(seconds[cut]))
            self.add(piece, seconds[cut:], values[cut:])
            return
        self._put(number, values)

    def result(self) -> AllanDeviation:
        """The deviation of everything that was added."""
        self._close_cell()
        self._flush(True)
        pieces = [np.concatenate(parts) for parts in self._held if parts]
        if self.factor == 1:
            return allan_deviation(pieces, self.sampling_period, self.averaging_times, self.confidence)
        coarse = allan_deviation(pieces, self.sampling_period * self.factor, self.averaging_times, self.confidence)
        fine = deviation_of(
            self._fine,
            self.sampling_period,
            self._found,
            noise_exponents([CellSums(self._head)], self._fine),
            self.confidence,
        )
        later = coarse.averaging_times >= FINE * self.factor * self.sampling_period * (1 - 1e-9)
        return AllanDeviation(
            **{name: np.concatenate((getattr(fine, name), getattr(coarse, name)[later])) for name in vars(fine)}
        )

    def _cell(self, seconds: Floats) -> np.ndarray:
        """Numbers of the cells that some times lie in, counted from the start of the piece; far ones are cut off."""
        return np.minimum(np.floor((seconds - self._start) / self.sampling_period + 0.5), FAR).astype(np.int64)

    def _begin(self, piece: object, start: float) -> None:
        self._close_cell()
        self._flush(True)
        self._piece, self._start = piece, start
        self._tail, self._rest, self._open = np.zeros(0), np.zeros(0), None
        self._held.append([])

    def _put(self, number: np.ndarray, values: Floats) -> None:
        """Rows to cells: means of the readings of each, NaN for the cells between."""
        first = number[0] if self._open is None else self._open[0]
        known = np.isfinite(values)
        if self._open is not None and number[0] > first and (np.diff(number) == 1).all() and known.all():
            self._close_cell()
            self._cells.append(np.full(int(number[0] - first) - 1, np.nan))
            self._cells.append(np.asarray(values[:-1], float))
            self._open = (int(number[-1]), float(values[-1]), 1)
        else:
            place = number - first
            count = np.bincount(place, known, minlength=int(place[-1]) + 1)
            total = np.bincount(place, np.where(known, values, 0.0), minlength=int(place[-1]) + 1)
            if self._open is not None:
                total[0] += self._open[1]
                count[0] += self._open[2]
            with np.errstate(invalid="ignore", divide="ignore"):
                self._cells.append(np.where(count > 0, total / count, np.nan)[:-1])
            self._open = (int(number[-1]), float(total[-1]), int(count[-1]))
        self._flush()

    def _close_cell(self) -> None:
        if self._open is not None:
            _, total, count = self._open
            self._cells.append(np.array([total / count if count else np.nan]))
            self._open = None

    def _flush(self, everything: bool = False) -> None:
        """Work on the finished cells, once there are enough of them."""
        if not self._cells or (not everything and sum(map(len, self._cells)) < self._at_once):
            return
        cells = np.concatenate(self._cells)
        self._cells = []
        self._compare(cells)
        cells = np.concatenate((self._rest, cells))
        whole = len(cells) // self.factor * self.factor
        self._rest = cells[whole:]
        if whole:
            sums = CellSums(cells[:whole])
            means = cells if self.factor == 1 else sums.means(self.factor, self.factor) + sums.offset
            self._held[-1].append(means)

    def _compare(self, cells: Floats) -> None:
        """Square the differences of short averages that end in these cells."""
        if not len(self._fine):
            return
        if len(self._head) < AT_ONCE:
            self._head = np.concatenate((self._head, cells[: AT_ONCE - len(self._head)]))
        joined = np.concatenate((self._tail, cells))
        for i, m in enumerate(self._fine):
            new = joined[max(len(self._tail) - 2 * int(m) + 1, 0) :]  # each difference once: it ends in a new cell
            n, total = squared_steps([CellSums(new)], int(m))
            self._found[i] = (self._found[i][0] + n, self._found[i][1] + total)
        self._tail = joined[-2 * int(self._fine[-1]) :]
