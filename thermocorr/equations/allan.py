"""Allan deviation of a record.

Sources: W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), chapter 5. The
readings take the place of the fractional frequency y.

Gaps and missing readings: readings are first averaged into regular cells of one sampling step (`regular_cells`); cells
without a reading are NaN. An average over m cells counts where at least `COVERAGE` of its cells are known, and is the
mean of these; so a gap is left out, and readings on both sides of it meet at long averaging times only. Nothing is
interpolated. Pieces (separate runs) never share an average.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AllanDeviation:
    """Overlapping Allan deviation, one element per averaging time."""

    averaging_times: Floats
    """[s]."""
    deviation: Floats
    """In the unit of the readings."""
    low: Floats
    """Lower end of the confidence interval."""
    high: Floats
    degrees_of_freedom: Floats
    """Equivalent ones of the chi-squared distribution of the Allan variance."""
    noise_exponent: NDArray[np.int_]
    """Power of the frequency in the spectral density: 0 white noise, -1 flicker noise, -2 random walk."""
    n: NDArray[np.int_]
    """Differences of neighbouring averages that were squared."""


def allan_deviation(
    values: Floats | Sequence[Floats],
    sampling_period: float = 1.0,
    averaging_times: str | Sequence[float] | Floats = "octave",
    confidence: float = 0.95,
) -> AllanDeviation:
    """Overlapping Allan deviation, Riley (2008) section 5.2.4, with confidence intervals.

    One pass over cumulative sums for each averaging time: O(N) operations whatever its length.

    Parameters
    ----------
    values : array of shape (n,), or several arrays
        Readings `sampling_period` apart; NaN where there is none. Several arrays are separate pieces.
    sampling_period : float
        [s].
    averaging_times : {"octave", "log"} or sequence of float
        Factors of 2 from one another, or eight per factor of 10 (rounded to whole cells); or the times themselves [s].
    confidence : float
        Probability of the interval from `low` to `high`.

    Returns
    -------
    AllanDeviation
        Averaging times at which nothing can be compared are left out.

    Raises
    ------
    ValueError
        For fewer than three readings, averaging times that are shorter than the sampling period, a sampling period
        that is not positive, or a confidence that is not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> found = allan_deviation(np.random.default_rng(0).normal(size=4096), sampling_period=10.0)
    >>> found.averaging_times[:3].tolist()
    [10.0, 20.0, 40.0]
    >>> bool(abs(found.deviation[2] - 0.5) < 0.05)  # white noise: 1/sqrt(4)
    True
    """
    check_confidence(confidence)
    several = len(values) > 0 and np.ndim(values[0]) > 0
    pieces = [np.asarray(piece, float) for piece in (values if several else [values])]
    longest = max(len(piece) for piece in pieces)
    if sum(int(np.isfinite(piece).sum()) for piece in pieces) < 3:
        raise ValueError("An Allan deviation needs at least 3 readings.")
    factors = averaging_factors(longest, sampling_period, averaging_times)
    sums = [CellSums(piece) for piece in pieces]
    found = [squared_steps(sums, int(m)) for m in factors]
    return deviation_of(factors, sampling_period, found, noise_exponents(sums, factors), confidence)


def check_confidence(confidence: float) -> None:
    """Raise ValueError unless a probability lies between 0 and 1."""
    if not (isinstance(confidence, Real) and 0 < confidence < 1):
        raise ValueError(
            f"The 'confidence' parameter must be a float in the range (0.0, 1.0). Got {confidence!r} instead."
        )


def deviation_of(
    factors: NDArray[np.int_],
    sampling_period: float,
    found: Sequence[tuple[int, float]],
    exponents: NDArray[np.int_],
    confidence: float,
) -> AllanDeviation:
    """Deviations with chi-squared intervals, Riley (2008) sections 5.2.4 and 5.3.2.

    ``found[i]`` is what `squared_steps` gives for averages over ``factors[i]`` cells.
    """
    kept = [i for i, (count, _) in enumerate(found) if count]
    factors, exponents = factors[kept], exponents[kept]
    n = np.array([found[i][0] for i in kept], np.int_)
    variance = np.array([found[i][1] / (2.0 * found[i][0]) for i in kept])
    # n differences are what a record of n + 2 m phases without a gap would have given
    freedom = np.array(
        [edf_overlapping(int(k) + 2 * int(m), int(m), int(a)) for k, m, a in zip(n, factors, exponents, strict=True)]
    )
    tails = (1 - confidence) / 2
    low = np.sqrt(variance * freedom / stats.chi2.ppf(1 - tails, freedom))
    high = np.sqrt(variance * freedom / stats.chi2.ppf(tails, freedom))
    times = np.asarray(factors * sampling_period, np.float64)
    return AllanDeviation(
        averaging_times=times,
        deviation=np.sqrt(variance),
        low=low,
        high=high,
        degrees_of_freedom=freedom,
        noise_exponent=exponents,
        n=n,
    )


def averaging_factors(
    n: int, sampling_period: float, averaging_times: str | Sequence[float] | Floats
) -> NDArray[np.int_]:
    """Cells of each average, increasing, for a record of `n` cells."""
    if not (isinstance(sampling_period, Real) and 0 < sampling_period < np.inf):
        raise ValueError(
            f"The 'sampling_period' parameter must be a positive time [s]. Got {sampling_period!r} instead."
        )
    if isinstance(averaging_times, str):
        if averaging_times not in ("octave", "log"):
            raise ValueError(
                "The 'averaging_times' parameter must be 'octave', 'log' or times in seconds. "
                f"Got {averaging_times!r} instead."
            )
        # Beyond a quarter of the record the deviation is hardly known.
        most = max(1, int(n * (1 / 4)))
        if averaging_times == "octave":
            return 2 ** np.arange(int(np.log2(most)) + 1)
        return np.unique(np.round(10 ** np.arange(0, np.log10(most) + 1e-9, 1 / 8)).astype(np.int_))
    factors = np.unique(np.round(np.atleast_1d(np.asarray(averaging_times, float)) / sampling_period)).astype(np.int_)
    if len(factors) == 0 or factors[0] < 1:
        raise ValueError(f"Averaging times must be at least the sampling period of {sampling_period:.6g} s.")
    return factors


class CellSums:
    """Cumulative sums of a piece, behind every average."""

    def __init__(self, values: Floats):
        known = np.isfinite(values)
        self.whole = bool(known.all())
        self.offset = float(values[known].mean()) if known.any() else 0.0
        centred = values - self.offset  # a running sum of small numbers keeps its digits
        self.total = np.concatenate(([0.0], np.cumsum(centred if self.whole else np.where(known, centred, 0.0))))
        self.count = None if self.whole else np.concatenate(([0], np.cumsum(known)))

    def __len__(self) -> int:
        return len(self.total) - 1

    def means(self, m: int, stride: int = 1) -> Floats:
        """Averages over m cells, NaN where too few are known."""
        if len(self) < m:
            return np.zeros(0)
        total = self.total[m::stride] - self.total[:-m:stride][: len(self.total[m::stride])]
        if self.count is None:
            return total / m
        count = self.count[m::stride] - self.count[:-m:stride][: len(total)]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(count >= max(2 * m / 3, 1), total / count, np.nan)


def squared_steps(sums: Sequence[CellSums], m: int) -> tuple[int, float]:
    """Sum of squared differences of neighbouring averages, per offset."""
    n, total = 0, 0.0
    for piece in sums:
        means = piece.means(m)
        steps = means[m:] - means[:-m]
        if not piece.whole:
            steps = steps[np.isfinite(steps)]
        n += len(steps)
        total += float(steps @ steps)
    return n, total


def noise_exponents(sums: Sequence[CellSums], factors: Iterable[int]) -> NDArray[np.int_]:
    """Power-law exponent of the noise, Riley (2008) 5.5.3.

    Never above 0: what looks like phase noise in readings is mostly something periodic whose averages alternate (days,
    air conditioning), and the degrees of freedom of phase noise would make it look far too certain.
    """
    exponents: list[int] = []
    for m in factors:
        averages = [piece.means(int(m), int(m)) for piece in sums]
        # Thirty averages show the kind of noise; with fewer, it is that of the averaging time before.
        enough = max((int(np.isfinite(a).sum()) for a in averages), default=0) >= 30
        exponents.append(min(noise_exponent(averages), 0) if enough else (exponents[-1] if exponents else 0))
    return np.array(exponents, np.int_)


def noise_exponent(averages: Sequence[Floats]) -> int:
    """Exponent of the spectral density, from -2 to 2.

    r1 / (1 + r1) is half of the (negative) exponent of what is left after d differences.
    """
    series = [a - np.nanmean(a) for a in averages if np.isfinite(a).sum() > 2]
    for d in range(3):
        offset = sum(np.nansum(a) for a in series) / max(sum(np.isfinite(a).sum() for a in series), 1)
        series = [a - offset for a in series]
        power = sum(float(np.nansum(a * a)) for a in series)
        if power == 0:
            return 0
        r1 = sum(float(np.nansum(a[1:] * a[:-1])) for a in series) / power
        delta = r1 / (1 + r1)
        if delta < 0.25 or d == 2:
            break
        series = [np.diff(a) for a in series]
    return int(np.clip(np.round(-2 * (delta + d)), -2, 2))


def edf_overlapping(n: int, m: int, exponent: int) -> float:
    """Equivalent degrees of freedom, Riley (2008) section 5.4.1, table 5.

    `n` (int): Phases: readings plus one. `m` (int): Readings of one average. `exponent` (int): 0 white, -1
    flicker, -2 random-walk noise of the readings.
    """
    if exponent == 0:
        found = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    elif exponent == -1:
        # printed without the square, which would leave one degree of freedom where m = 2 has 0.6 n
        found = 2 * (n - 2) ** 2 / (2.3 * n - 4.9) if m == 1 else 5 * n**2 / (4 * m * (n + 3 * m))
    else:
        found = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / max((n - 3) ** 2, 1)
    return float(max(found, 1.0)) if np.isfinite(found) else 1.0


def regular_cells(
    piece: NDArray[np.int_], seconds: Floats, values: Floats, sampling_period: float, longest_gap: int
) -> list[Floats]:
    """Mean reading of each cell, for each piece of a record.

    `piece` (array of shape (n,)): Number of the piece of each row. `seconds`, `values` (arrays of shape (n,)): Times,
    increasing in a piece [s], and readings. `longest_gap` (int): Cells beyond which a gap begins another piece.
    """
    cuts = (np.diff(piece) != 0) | (np.diff(seconds) > longest_gap * sampling_period)
    found = []
    for rows in np.split(np.arange(len(seconds)), np.flatnonzero(cuts) + 1):
        cell = np.floor((seconds[rows] - seconds[rows[0]]) / sampling_period + 0.5).astype(int)
        known = np.isfinite(values[rows])
        count = np.bincount(cell, known)
        total = np.bincount(cell, np.where(known, values[rows], 0.0))
        found.append(np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0))
    return found
