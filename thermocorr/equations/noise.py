"""White and Ornstein-Uhlenbeck noise by Whittle's likelihood.

The cosine transform (DCT-II) of each segment is the Karhunen-Loeve transform of a first-order Markov noise as its
correlation goes to one, ends and all (Ahmed, Natarajan & Rao, IEEE Trans. Comput. C-23, 1974; Clarke, IEE Proc. F 128,
1981). In it the covariance of the noise is diagonal to a good approximation: generalised least squares is weighted
least squares there, and its likelihood is Whittle's. The variances of the parts follow from the multiplicative updates
of the Itakura-Saito divergence (Fevotte, Bertin & Durrieu, Neural Comput. 21, 2009), which keep them positive.

Sums of such parts, a factor of three apart, hold flicker noise to within 5 % of power at all frequencies, and a random
walk to 15 % but for its first eight rows, where it falls to a third (2500 and 25 000 rows; see the tests).

Counts, a rounded copy, a value of some rows ago, a running mean, a low pass: each of them follows the reading wherever
it goes, and explains whatever is asked. What tells is the instrument's white noise, at frequencies at which no room
changes any more. A cause that is white itself, by far above the instrument's noise, is in the reading as it is in the
column; a mean of the reading has less of it, the faster the less.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.linalg.blas import dtbsv
from scipy.signal import csd

from .statistics import white_part

RATIO = 3.0
"""Between neighbouring correlation times."""
LONGEST = 1 / 3
"""Longest correlation time, as a share of all rows: beyond, a part looks like a random walk."""
SHORTEST = 0.7
"""Shortest correlation time of `times_down_from` [rows]: less looks white."""
SINGLE = 40
"""Lowest rows of the transform that stand alone: there the power changes from row to row."""
SMALLEST = 1e-12
"""Least variance of a part, in units of the reading's: zero would never grow again."""


@dataclass(frozen=True, eq=False)
class Bands:
    """Cosine transform of segments, gathered in bands of frequency."""

    segment: np.ndarray
    """Number of the segment of each row, shape (n,), rows of a segment side by side and evenly spaced."""
    longest: float | None = None
    """Longest correlation time of the noise, as a share of all rows, see `times_down_from`; None: `times_from_one`."""

    @cached_property
    def pieces(self) -> list[slice]:
        """Rows of each segment."""
        edges = [0, *(np.flatnonzero(np.diff(self.segment)) + 1).tolist(), len(self.segment)]
        return [slice(low, high) for low, high in itertools.pairwise(edges)]

    @cached_property
    def angle(self) -> np.ndarray:
        """Angular frequency of each transformed row [rad per row]."""
        sizes = [piece.stop - piece.start for piece in self.pieces]
        return np.concatenate([np.pi * np.arange(size) / size for size in sizes])

    @cached_property
    def order(self) -> np.ndarray:
        """Rows of the transform from low to high frequency."""
        return np.argsort(self.angle, kind="stable")

    @cached_property
    def starts(self) -> np.ndarray:
        """First index of each band in that order."""
        rank = np.arange(len(self.segment))
        # There are twenty bands to a factor of e in frequency above the single ones.
        high = SINGLE + np.floor(np.log(np.maximum(rank, SINGLE) / SINGLE) * 20).astype(int)
        return np.flatnonzero(np.diff(np.where(rank < SINGLE, rank, high), prepend=-1))

    @cached_property
    def sizes(self) -> np.ndarray:
        """Rows of each band."""
        return np.diff([*self.starts, len(self.segment)])

    @cached_property
    def middle(self) -> np.ndarray:
        """Mean angular frequency of each band [rad per row]."""
        return np.asarray(self.sums(self.angle[self.order]) / self.sizes)

    @cached_property
    def times(self) -> np.ndarray:
        """Correlation times of the wandering parts of the noise [rows], increasing."""
        n = len(self.segment)
        return times_from_one(n) if self.longest is None else times_down_from(self.longest * n)

    @cached_property
    def parts(self) -> np.ndarray:
        """Power of each part in each band; white comes first."""
        kept = np.exp(-1 / self.times)  # correlation of neighbouring rows
        powers = (1 - kept**2) / (1 - 2 * kept * np.cos(self.middle)[:, None] + kept**2)
        return np.column_stack((np.ones(len(self.middle)), powers))

    @cached_property
    def exact_parts(self) -> np.ndarray:
        """`parts` with the exact power of the means of segments."""
        parts, kept = self.parts.copy(), np.exp(-1 / self.times)
        sizes = np.array([piece.stop - piece.start for piece in self.pieces], float)
        lengths = np.concatenate([np.where(np.arange(size) == 0, size, 0.0) for size in sizes])[self.order]
        means = self.sums((lengths > 0).astype(float)) == self.sizes  # bands of nothing but means
        for band in np.flatnonzero(means):
            n = lengths[self.starts[band] : self.starts[band] + self.sizes[band]].mean()
            with np.errstate(under="ignore"):
                parts[band, 1:] = (1 + kept) / (1 - kept) - 2 * kept * (1 - kept**n) / (n * (1 - kept) ** 2)
        return parts

    def sums(self, rows: np.ndarray) -> np.ndarray:
        """Sums over each band of rows in order of frequency."""
        return np.asarray(np.add.reduceat(rows, self.starts, axis=0))

    def forward(self, columns: np.ndarray) -> np.ndarray:
        """Orthonormal cosine transform, in order of frequency."""
        each = np.ascontiguousarray(columns.T)
        if len(self.pieces) == 1:  # stands in order
            return np.asarray(dct(each, axis=1, norm="ortho").T)
        result = np.empty(each.shape)
        for piece in self.pieces:
            result[:, piece] = dct(each[:, piece], axis=1, norm="ortho")
        return np.take(result, self.order, axis=1).T

    def back(self, rows: np.ndarray) -> np.ndarray:
        """Undo `forward`."""
        plain, result = np.empty(rows.shape), np.empty(rows.shape)
        plain[self.order] = rows
        for piece in self.pieces:
            result[piece] = idct(plain[piece], axis=0, norm="ortho")
        return result

    def each_row(self, of_bands: np.ndarray) -> np.ndarray:
        """A value per band at each of its rows."""
        return np.repeat(of_bands, self.sizes)


def times_from_one(n: int) -> np.ndarray:
    """Correlation times from one row up to `LONGEST` [rows]."""
    return np.asarray(RATIO ** np.arange(max(0, int(np.log(LONGEST * n) / np.log(RATIO)) + 1)))


def times_down_from(longest: float) -> np.ndarray:
    """Correlation times from a longest one down to `SHORTEST` [rows], increasing."""
    count = int(np.log(max(longest / SHORTEST, 1.0)) / np.log(RATIO)) + 1
    return np.asarray(longest / RATIO ** np.arange(count - 1, -1, -1))


def fitted_parts(parts: np.ndarray, share: np.ndarray, power: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Variances that maximise Whittle's likelihood, for many records.

    `parts` (array of shape (bands, parts)): `Bands.parts`. `share` (array of shape (bands,)): Rows of each band less
    what a model has taken of them: degrees of freedom. `power` (array of shape (bands, records)): Sum of squares in
    each band. `start` (array of shape (parts, records)): Variances to begin with.
    """
    theta = np.maximum(start, SMALLEST)
    # Sixty multiplicative updates estimate the variances.
    for _ in range(60):
        S = parts @ theta
        theta = np.maximum(theta * (parts.T @ (power / S**2)) / (parts.T @ (share[:, None] / S)), SMALLEST)
    return np.asarray(theta)


def whittle(share: np.ndarray, power: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Log likelihood of sums of squares under powers S."""
    return np.asarray(-0.5 * np.sum(share[:, None] * np.log(S) + power / S, axis=0))


def spans(segment: np.ndarray, seconds: np.ndarray, runs: Sequence[object]) -> np.ndarray:
    """Number of the noise's span at each row.

    A pause is short against what lies before or after it, or against the whole; between runs none is.

    `segment`, `seconds` (arrays of shape (n,)): Number of the segment and time [s] of each row, in the order of time
    within segments. `runs` (sequence): Label of the run of each segment, in the order of `segment`.
    """
    edges = np.flatnonzero(np.diff(segment, prepend=-1))
    first, last = seconds[edges], seconds[[*(edges[1:] - 1), -1]]
    label = [runs[i] for i in segment[edges]]
    # Noise goes on over a pause of a hundredth of the record or less, wherever it lies.
    short, began, ends = 0.01 * float(np.ptp(seconds)), 0, np.zeros(len(segment), int)
    for i in range(1, len(edges)):
        most = max(last[i - 1] - first[began], last[i] - first[i], short)
        if label[i] != label[i - 1] or not 0 <= first[i] - last[i - 1] <= most:
            ends[edges[i]], began = 1, i
    return np.cumsum(ends)


class Kernel(NamedTuple):
    """Inverse covariance of a noise at lag k [rows]."""

    white: float
    sizes: np.ndarray
    ratios: np.ndarray


def inverse_kernel(theta: np.ndarray, times: np.ndarray) -> Kernel:
    """Inverse covariance far from the ends of a record.

    The inverse of white noise under Ornstein-Uhlenbeck parts is white noise less as many decaying exponentials: with
    s = 1 - cos(angle), each part is a/(b + s), so that the power is a rank-one matrix's resolvent, and its inverse
    follows by Sherman & Morrison (Ann. Math. Statist. 21, 1950).

    `theta` (array of shape (1 + parts,)): Variances, the white part first. `times` (array of shape (parts,)):
    Correlation times of the other parts, `Bands.times` [rows].
    """
    kept = np.exp(-1 / times)
    white = max(float(theta[0]), 1e-6 * float(np.sum(theta)))
    b, a = (1 - kept) ** 2 / (2 * kept), theta[1:] * (1 - kept**2) / (2 * kept)
    half = np.sqrt(a / white)
    z, vectors = np.linalg.eigh(np.diag(b) + np.outer(half, half))
    root = np.sqrt(z * (z + 2))
    return Kernel(1 / white, (vectors.T @ half) ** 2 / root, 1 + z - root)


def decaying_sums(columns: np.ndarray, ratio: float) -> np.ndarray:
    """``d[k] = ratio d[k-1] + x[k]`` down each column."""
    sums = np.array(columns, float, order="F")
    if len(sums) < 2:
        return sums
    band = np.full((2, len(sums)), -ratio, order="F")
    for column in sums.T:
        dtbsv(1, band, column, lower=1, diag=1, overwrite_x=1)
    return sums


Floats = NDArray[np.float64]

OF_NOISE = 0.125
"""Share of the reading's white noise that a line of a column leaves of it, below which it was made from the reading."""
WINDOW, STRETCH, STRETCHES = 128, 4096, 16
"""Rows of a window in which spectra are measured, half of it overlapping the next; rows of a stretch of a long record,
and stretches of it, in which they are."""
FEWEST = 512
"""Rows below which spectra are not asked: in seven windows, chance alone makes a mean coherence of a seventh."""
UPPER = 4
"""Part of the frequencies, from zero on, above which they are the upper two octaves."""
WHITE = 1.5
"""Ratio of the powers in the two upper octaves up to which the reading is white there."""
SLOW, FOLLOWS = 64, 0.8
"""Rows of a block, and squared correlation of the means of blocks at which a column follows the reading where it is
slow, too. A quick cause, of which a slow sensor has as much of the noise, is not all that is slow in the reading."""
SAME_SCALE = 1.25
"""Ratio of their standard deviations up to which it shows it on one scale."""


def made_from(column: Floats, reading: Floats) -> bool:
    """True if a column was made from the reading.

    `column`, `reading` (arrays of shape (n,)): In the order of time; rows in which either is missing are passed over.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> cause, noise = rng.normal(size=(2, 2000))
    >>> reading = np.cumsum(cause) + noise
    >>> made_from(np.convolve(reading, np.ones(10) / 10)[:2000], reading), made_from(np.cumsum(cause), reading)
    (True, False)
    """
    if len(column) != len(reading):
        return False
    sound = np.isfinite(column) & np.isfinite(reading)
    column, reading = column[sound], reading[sound]
    if len(column) < 3 or not np.ptp(column) or not np.ptp(reading):
        return False
    return _is_line(column, reading) or _is_smoothed(column, reading)


def shows_the_same(column: Floats, reading: Floats) -> bool:
    """True if a column repeats the reading.

    `column`, `reading` (arrays of shape (n,)): Rows in which either is missing are passed over.

    Examples
    --------
    >>> import numpy as np
    >>> source, one, other = np.random.default_rng(0).normal(size=(3, 1000)) * [[1.0], [0.1], [0.1]]
    >>> shows_the_same(source + one, source + other), shows_the_same(3 * source + one, source + other)
    (True, False)
    """
    sound = np.isfinite(column) & np.isfinite(reading)
    if sound.sum() < 3:
        return False
    column, reading = column[sound], reading[sound]
    spread, own = np.std(reading), np.std(column)
    if not spread / SAME_SCALE < own < SAME_SCALE * spread or abs(np.mean(column) - np.mean(reading)) > spread:
        return False
    # With half of the variance in common, a column may show what the reading shows.
    return bool(np.corrcoef(column, reading)[0, 1] ** 2 > 0.5)


def _is_line(column: Floats, reading: Floats) -> bool:
    """True if a column is the reading, rescaled or rounded."""
    left = 1 - np.corrcoef(reading, column)[0, 1] ** 2
    if left < OF_NOISE and left * np.var(reading) < OF_NOISE * _white(reading):  # counts, a rounded copy
        return True
    # A column that the reading explains to less than this may be a copy of it: its small steps decide.
    if left > 1e-9:
        return False
    steps, own = np.diff(reading), np.diff(column)  # a setpoint has nothing of the reading's noise
    # The smaller half of the reading's steps from row to row are noise.
    small = np.abs(steps) <= np.quantile(np.abs(steps), 0.5)
    if not np.ptp(steps[small]) or not np.ptp(own[small]):
        return False
    # A column whose steps go with nine tenths of these carries the reading's own noise.
    return bool(np.corrcoef(steps[small], own[small])[0, 1] ** 2 > 0.9)


def _white(reading: Floats) -> float:
    """Variance of the white noise in most parts of a reading."""
    # White noise is measured in five parts of the record: a pause, or a jump, is in few of them.
    return float(np.median([white_part([part]) for part in np.array_split(reading, 5) if len(part)]))


def _is_smoothed(column: Floats, reading: Floats) -> bool:
    """True if a column averages or delays the reading.

    By the spectra of their steps: a step has less of what is slow, which would leak into everything.
    """
    if len(column) < FEWEST or not _follows(column, reading):
        return False
    steps, own = (np.diff(_stretches(values), axis=1) for values in (reading, column))
    frequency, power = _spectrum(steps, steps)
    of_column, cross = _spectrum(own, own)[1].real, _spectrum(steps, own)[1]
    upper, low = slice(len(frequency) // UPPER, None), slice(1, len(frequency) // UPPER // UPPER)
    if not _is_white(frequency[upper], power.real[upper]) or not of_column[upper].any():
        return False
    shared = np.abs(cross[upper]) ** 2 / np.maximum(power.real[upper] * of_column[upper], np.finfo(float).tiny)
    # A column whose mean coherence in these octaves is less has noise of its own. A mean of 100 rows has 0.5: the other
    # half is that of the rows that go.
    if shared.mean() < 0.45:
        return False
    slow, fast = (np.abs(cross[part]).sum() / of_column[part].sum() for part in (low, upper))
    together, own_alone, alone = (np.fft.irfft(each) for each in (cross, of_column, power))  # by Wiener-Khinchin
    later = together[1 : WINDOW // 4].max() / np.sqrt(own_alone[0] * alone[0])
    # A column is smoother than what it would cause where the reading's response to it in the upper octaves is twice
    # that below a quarter of their lower end; it is an earlier reading where their steps some rows apart correlate by
    # more than 0.9.
    return bool(fast > 2.0 * slow or later > 0.9)


def _follows(column: Floats, reading: Floats) -> bool:
    """True if a column follows the reading where both are slow."""
    means = [values[: len(values) // SLOW * SLOW].reshape(-1, SLOW).mean(axis=1) for values in (column, reading)]
    return bool(min(map(np.ptp, means)) > 0 and np.corrcoef(*means)[0, 1] ** 2 > FOLLOWS)


def _stretches(values: Floats) -> Floats:
    """Evenly spread stretches of the values, shape (stretches, rows)."""
    if len(values) <= STRETCH * STRETCHES:
        return values[None]
    starts = np.linspace(0, len(values) - STRETCH, STRETCHES).astype(int)
    return np.stack([values[start : start + STRETCH] for start in starts])


def _spectrum(one: Floats, other: Floats) -> tuple[Floats, NDArray[np.complex128]]:
    """Frequencies, and the cross spectrum over all stretches."""
    frequency, each = csd(one, other, nperseg=WINDOW)
    return frequency, np.asarray(each.mean(axis=0), complex)


def _is_white(frequency: Floats, power: Floats) -> bool:
    """True if both octaves hold the same noise."""
    own = power / (2 - 2 * np.cos(2 * np.pi * frequency))
    half = len(own) // 3
    return bool(1 / WHITE < np.mean(own[:half]) / np.mean(own[half:]) < WHITE)
