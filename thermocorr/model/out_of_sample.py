"""Errors on data that a model has not seen.

The record is cut into pieces of equal numbers of rows. Later stretches are predicted from all that came before them,
and blocks from all the rest, by a ridge on the columns of the user's own model. Everything follows from the cross
products of the pieces. A jump is asked of the stretches behind it, once the first readings there have shown its level.

What an effect is worth is asked of averages, of neighbouring readings and of whole pieces: users average, and an effect
of a fifth of the noise is the largest error of a mean of a hundred. Errors that are printed are those of readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_solve
from sklearn.base import clone

from ..records import RecordError
from ..records.errors import check_int, said_once
from ..records.record import where_read
from .heteroscedasticity import accepted_readings
from .progress import Progress, reporting
from .runs import unlearned

PIECES = 80
"""Pieces of equal numbers of rows that the record is cut into."""
FIRST, AHEAD = 32, 8
"""Pieces that the first forecast is learned from, and pieces that each predicts: six stretches of the later part."""
FEWEST_STRETCHES = 3
"""Later stretches below which nothing is confirmed."""
BLOCK = 16
"""Pieces of each of the five blocks that are held out."""
RIDGE = 1e-6
"""Penalty in the forecasts, for columns of unit variance. At 1e-3 the lags of the base are bent so far on simulated
devices that a true drift makes forecasts worse; on measured records any from 1e-6 to 1e-3 gives much the same."""
GAIN = 0.5
"""Mean fall of the squared error on later stretches [dB] at which an effect is worth adding."""

BLOCKS = tuple(
    ([j for j in range(PIECES) if not i <= j < i + BLOCK], range(i, i + BLOCK)) for i in range(0, PIECES, BLOCK)
)
"""Pieces to learn from, and blocks that are held out."""


FORECASTS = {f"from {10 * s // 8} %": (range(s), range(s, min(round(s / 0.7), PIECES))) for s in (32, 40, 48, 56)}
"""Longer forecasts: from a share of the rows, as far ahead as the last 30 % of them lie behind the first 70 %."""
LONGEST = "from 70 %"


def later_pieces(moment: float | None) -> list[tuple[range, range]]:
    """Pieces to learn from, and later pieces to be predicted.

    Behind a `moment` (share of the rows), a quarter of what is left tells the level, and stretches are so short that
    there are `FEWEST_STRETCHES` of them, if as many pieces are left.
    """
    first, ahead = FIRST, AHEAD
    if moment is not None:
        begins = int(np.ceil(moment * PIECES))
        first = begins + max(1, (PIECES - begins) // 4)
        ahead = max(1, min(AHEAD, (PIECES - first) // FEWEST_STRETCHES))
    return [(range(stop), range(stop, min(stop + ahead, PIECES))) for stop in range(first, PIECES, ahead)]


class Falls(NamedTuple):
    """Fall of the squared error, a mean of logarithms [dB]."""

    each: tuple[float, ...]
    """On each later stretch."""
    later: float
    """Mean of these; NaN where there are none."""
    blocks: float
    """Mean on blocks of time that are held out."""

    @classmethod
    def of(cls, later: np.ndarray, blocks: np.ndarray) -> Falls:
        """From ratios of squared errors, per stretch and block."""
        falls = 10 * np.log10(later)
        mean = float(falls.mean()) if len(falls) else np.nan
        return cls(each=tuple(falls.tolist()), later=mean, blocks=float(10 * np.log10(blocks).mean()))

    def adds(self, twice: bool) -> bool:
        """True if later stretches gain `GAIN`, and blocks lose nothing.

        What is asked `twice` must fall there by as much.
        """
        most = 2 * sum(fall > 0 for fall in self.each) > len(self.each) >= FEWEST_STRETCHES
        return self.later >= GAIN and most and self.blocks >= (GAIN if twice else -GAIN)


class Worth(NamedTuple):
    """Fall of the squared error of averages on unseen data."""

    short: Falls
    """Of averages of neighbouring readings."""
    long: Falls
    """Of averages of whole pieces, an eightieth of the record."""

    @property
    def rank(self) -> float:
        """Sort key: the fall on later stretches, or blocks."""
        return self.short.blocks if np.isnan(self.short.later) else self.short.later

    @property
    def both(self) -> float:
        """The lesser of the falls on stretches and blocks."""
        return min(self.short.later, self.short.blocks)

    @property
    def clearest(self) -> Falls:
        """Of the averages that show it best."""
        return max(self, key=lambda falls: np.nan_to_num(min(falls.later, falls.blocks), nan=-np.inf))

    def adds(self, evenly: bool = False, twice: bool = False) -> bool:
        """True if averages of either length are predicted better.

        What must help `evenly` may cost short averages on no stretch more than half of what it gains in all. What is
        asked `twice`, as it has a date, memory or a period, must gain on held-out blocks as well.
        """
        even = not evenly or min(self.short.each, default=0.0) >= -max(self.short.later, 0.0) / 2
        return even and any(falls.adds(twice) for falls in self)


class OutOfSample:
    """A model, and what further columns are worth given it.

    `reading` (array of shape (n,)). `base` (array of shape (n, p)): Columns of the model; column 0 is the constant.
    `unseen` (float): Mean square of single readings that their averages do not show.
    """

    def __init__(self, reading: np.ndarray, base: np.ndarray, unseen: float = 0.0):
        self.reading, self.base, self.unseen = reading, base, unseen
        self.edges = np.linspace(0, len(base), PIECES + 1).astype(int)
        self.sizes = np.diff(self.edges)
        self.products = Products(
            base=self._in_pieces(base, base),
            reading=self._in_pieces(base, reading[:, None])[..., 0],
            squares=np.array([float(reading[a:b] @ reading[a:b]) for a, b in pairwise(self.edges)]),
        )
        self._folds: dict[tuple[int, int, int], Fold] = {}

    @cached_property
    def means(self) -> Products:
        """Cross products of the pieces' means."""
        return self.products.of_means(self.products.base[:, 0], self.products.reading[:, 0], self.sizes)

    def _in_pieces(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Cross products in each piece."""
        return np.stack([one[a:b].T @ other[a:b] for a, b in pairwise(self.edges)])

    def with_columns(self, columns: np.ndarray) -> OutOfSample:
        """Take more columns into the model."""
        return OutOfSample(self.reading, np.column_stack((self.base, columns)), self.unseen)

    def fold(self, learn: Sequence[int], test: range) -> Fold:
        """The model learned from some pieces and tested on others."""
        key = len(learn), test.start, test.stop
        if key not in self._folds:
            self._folds[key] = Fold(self.products, self.means, learn, test)
        return self._folds[key]

    def worth(self, explanations: Sequence[np.ndarray], moment: float | None = None) -> list[Worth]:
        """Out-of-sample gain of each explanation behind its `moment`."""
        found: list[Worth | None] = [None] * len(explanations)
        later = [self.fold(*pieces) for pieces in later_pieces(moment)]
        blocks = [self.fold(*pieces) for pieces in BLOCKS]
        for width in {columns.shape[1] for columns in explanations}:
            which = [i for i, columns in enumerate(explanations) if columns.shape[1] == width]
            together = np.column_stack([explanations[i] for i in which])
            each = together.reshape(len(together), len(which), width).transpose(1, 0, 2)
            products = Products(
                base=self._in_pieces(self.base, together),
                reading=self._in_pieces(together, self.reading[:, None])[..., 0],
                squares=np.stack([each[:, a:b].swapaxes(1, 2) @ each[:, a:b] for a, b in pairwise(self.edges)]),
            )
            sums = np.stack([each[:, a:b].sum(axis=1) for a, b in pairwise(self.edges)])
            means = products.of_means(self.products.base[:, 0], self.products.reading[:, 0], self.sizes, sums)
            before = [np.array([fold.errors for fold in folds]).reshape(-1, 2) for folds in (later, blocks)]
            after = [
                np.array([fold.errors_with(products, means) for fold in folds]).reshape(-1, 2, len(which))
                for folds in (later, blocks)
            ]
            for k, i in enumerate(which):
                ratios = [b / a[..., k] for b, a in zip(before, after, strict=True)]
                found[i] = Worth(*(Falls.of(*(ratio[:, scale] for ratio in ratios)) for scale in (0, 1)))
        return [each for each in found if each is not None]

    def most_helpful(self, columns: np.ndarray) -> int:
        """Index of the column that lowers the later error most."""
        products = Products(
            base=self._in_pieces(self.base, columns),
            reading=self._in_pieces(columns, self.reading[:, None])[..., 0],
            squares=np.stack([np.sum(columns[a:b] ** 2, axis=0)[:, None, None] for a, b in pairwise(self.edges)]),
        )
        after = [self.fold(*pieces).errors_with(products)[0] for pieces in later_pieces(None)]
        return int(np.argmin(np.sum(np.log(after), axis=0)))

    def errors(self, moment: float | None = None) -> np.ndarray:
        """Mean square errors of averages per later stretch, (stretches, 2)."""
        return self._errors(later_pieces(moment))

    def _errors(self, folds: Sequence[tuple[Sequence[int], range]]) -> np.ndarray:
        return np.array([np.array(self.fold(*f).errors) / self.sizes[list(f[1])].sum() for f in folds]).reshape(-1, 2)

    def reading_errors(self, moment: float | None = None) -> np.ndarray:
        """Mean square error of readings per later stretch, (stretches,)."""
        return self.errors(moment)[:, 0] + self.unseen

    def forecast_errors(self, moment: float | None = None) -> dict[str, float]:
        """Mean square error of each of `FORECASTS`, or NaN."""
        begins = 4 + (moment or 0.0) * PIECES  # a forecast that knows of the moment begins four pieces behind it
        return {
            name: float(self._errors([pieces])[0, 0] + self.unseen) if len(pieces[0]) >= begins else np.nan
            for name, pieces in FORECASTS.items()
        }

    def later_rms(self, moment: float | None = None) -> float:
        """Rms error on later stretches, geometric mean; NaN for none."""
        return float(np.sqrt(geometric_mean(self.reading_errors(moment))))

    @property
    def held_out_rms(self) -> float:
        """Rms error on held-out blocks, geometric mean."""
        return float(np.sqrt(geometric_mean(self._errors(BLOCKS)[:, 0] + self.unseen)))

    def against(self, other: OutOfSample, moment: float | None = None) -> Worth:
        """Out-of-sample gain of another model over this one."""
        later, blocks = (self._errors(folds) / other._errors(folds) for folds in (later_pieces(moment), BLOCKS))
        return Worth(*(Falls.of(later[:, scale], blocks[:, scale]) for scale in (0, 1)))


def geometric_mean(values: np.ndarray) -> float:
    """Of positive values; NaN of none."""
    return float(np.exp(np.mean(np.log(values)))) if len(values) else np.nan


class Products(NamedTuple):
    """Cross products of some columns in each piece."""

    base: np.ndarray
    """With the columns of the base."""
    reading: np.ndarray
    """With the reading."""
    squares: np.ndarray
    """Squares of the reading, where the columns are the base; else products of the columns of each explanation."""

    def over(self, pieces: Sequence[int]) -> Products:
        """Sums over some pieces."""
        return Products(*(part[list(pieces)].sum(axis=0) for part in self))

    def of_means(
        self, base: np.ndarray, reading: np.ndarray, sizes: np.ndarray, sums: np.ndarray | None = None
    ) -> Products:
        """The same of the means of each piece.

        `base`, `reading`: Sums of the base's columns and of the reading in each piece. `sizes`: Rows of each piece.
        `sums` (array of shape (pieces, explanations, width)): Of explanations; None for the base itself.
        """
        own = base if sums is None else sums.reshape(len(sums), -1)
        mean = own / sizes[:, None]
        squares = reading**2 / sizes
        if sums is not None:
            squares = sums[..., None] * sums[..., None, :] / sizes[:, None, None, None]
        return Products(base=base[:, :, None] * mean[:, None], reading=mean * reading[:, None], squares=squares)


class Fold:
    """A ridge on some pieces, tested on others by cross products.

    Columns are scaled to unit variance where they are learned, and lose their means there. `means` (Products): Of the
    means of the pieces, on which it is tested as well.
    """

    def __init__(self, products: Products, means: Products, learn: Sequence[int], test: Sequence[int]):
        A, b, _ = products.over(learn)
        self.learn, self.test = learn, test
        self.A, self.constant = A, A[0] / A[0, 0]  # what each column has of the constant
        centred = A - np.outer(A[0], self.constant)
        self.scale = _scale(np.diag(centred)[1:], np.diag(A)[1:])
        normed = centred[1:, 1:] * self.scale[:, None] * self.scale + RIDGE * np.eye(len(A) - 1)
        self.half = np.linalg.cholesky(normed)
        self.b, self.coef = b, self._coefficients(b[:, None])[:, 0]
        self.tested = [self._tested(each.over(test)) for each in (products, means)]

    def _tested(self, tested: Products) -> _Tested:
        missed = tested.reading - tested.base @ self.coef
        error = float(tested.squares - self.coef @ (tested.reading + missed))
        return _Tested(base=tested.base, missed=missed, error=max(error, 1e-300))

    @property
    def errors(self) -> tuple[float, float]:
        """Squared errors of short and of long averages."""
        short, long = self.tested
        return short.error, long.error

    def _coefficients(self, moments: np.ndarray) -> np.ndarray:
        """Coefficients for columns with these moments, (p, columns)."""
        centred = moments[1:] - np.outer(self.constant[1:], moments[0])
        inner = self.scale[:, None] * centred
        if len(inner):  # old releases of SciPy refuse what is empty
            inner = self.scale[:, None] * cho_solve((self.half, True), inner)
        return np.vstack(((moments[0] - self.A[0, 1:] @ inner) / self.A[0, 0], inner))

    def errors_with(self, products: Products, *means: Products) -> np.ndarray:
        """Squared errors with each explanation, (2, explanations)."""
        base, reading, squares = products.over(self.learn)
        count, width = squares.shape[:2]
        made = self._coefficients(base)  # of the explanation by the base
        size = np.diagonal(squares, axis1=1, axis2=2).ravel()
        variance = size - base[0] ** 2 / self.A[0, 0]
        scale = _scale(variance, size)
        own = squares - _each(base, made, count)
        own = own * _each(scale[None], scale[None], count)
        own[:, range(width), range(width)] += RIDGE
        moment = reading - made.T @ self.b
        coef = np.linalg.solve(own, (scale * moment).reshape(count, width, 1)) * scale.reshape(count, width, 1)
        found = []
        for known, tested in zip(self.tested, (products, *means), strict=False):
            base, reading, squares = tested.over(self.test)
            missed = reading - base.T @ self.coef - made.T @ known.missed
            rest = base - known.base @ made
            own = squares - _each(base, made, count) - _each(made, rest, count)
            moments = 2 * missed.reshape(coef.shape) - own @ coef
            found.append(np.maximum(known.error - np.sum(coef * moments, axis=1)[:, 0], 1e-300))
        return np.array(found)


class _Tested(NamedTuple):
    """Cross products of a base with tested readings."""

    base: np.ndarray
    missed: np.ndarray
    error: float


def _scale(variance: np.ndarray, square: np.ndarray) -> np.ndarray:
    """One over the standard deviation of columns, or 0."""
    # The coefficient of a column that varies less is not learned: a variance is a difference of sums with sixteen
    # digits, and its rounding has to stay far below `RIDGE`. At 1e-11 a matrix was not positive definite.
    alive = variance > 1e-8 * np.maximum(square, 1e-300)
    return np.where(alive, 1 / np.sqrt(np.where(alive, variance, 1.0)), 0.0)


def _each(one: np.ndarray, other: np.ndarray, count: int) -> np.ndarray:
    """Products of each explanation's columns."""
    one, other = (part.reshape(len(part), count, -1).transpose(1, 0, 2) for part in (one, other))
    return np.asarray(one.swapaxes(1, 2) @ other)


def time_blocks(reading: np.ndarray, n_blocks: int) -> list[slice]:
    """Contiguous blocks of nearly equal numbers of rows.

    Where readings, shape (n_rows,), hold less than half of the rows, the blocks are those of that part.
    """
    first, stop = where_read(reading, len(reading), slice)
    n_rows = stop - first
    # A block of fewer than eight rows says nothing.
    count = min(n_blocks, max(n_rows // 8, 2))
    return [slice(first + low, first + high) for low, high in pairwise(n_rows * k // count for k in range(count + 1))]


@said_once()
def held_out_residuals(model: Any, X: Any, y: Any, *, n_blocks: int = 5, progress: Progress = None) -> np.ndarray:
    """Residuals of each block, predicted by a fit without it.

    The lags run through the whole record (temperature is known everywhere), so no block starts with unknown states.
    Rows that the model flags (no reading, a refused one, washout of an unknown start) are NaN.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Cloned for each block.
    X, y : as for `DynamicBiasRegressor.fit`
    n_blocks : int, default 5
        Number of blocks, 2 or more.
    progress : callable or True, optional
        Called with a line of text before each fit; True draws a bar (extra "progress").

    Returns
    -------
    array of shape (n_rows,)
        Measured minus modelled reading, in the unit of y.

    Examples
    --------
    >>> import numpy as np
    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.validation import held_out_residuals
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(4000, seed=1)
    >>> model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
    >>> residuals = held_out_residuals(model, record[["temperature"]], record["reading"])
    >>> print(f"{np.nanstd(residuals):.1f} ppm, noise {record.attrs['noise']:.1f} ppm")
    0.2 ppm, noise 0.2 ppm
    """
    check_int("held_out_residuals", "n_blocks", n_blocks, 2)
    reading = accepted_readings(model, X, y)
    with reporting(progress, len(time_blocks(reading, n_blocks))) as tell:
        return residuals_of_blocks(model, X, reading, n_blocks, tell)


def residuals_of_blocks(
    model: Any, X: Any, reading: np.ndarray, n_blocks: int, tell: Callable[[str], None]
) -> np.ndarray:
    """`held_out_residuals` of accepted readings."""
    result = np.full(len(reading), np.nan)
    blocks = time_blocks(reading, n_blocks)
    for number, block in enumerate(blocks):
        tell(f"held-out block {number + 1} of {len(blocks)}")
        known = reading.copy()
        known[block] = np.nan
        if np.isfinite(known).any():
            try:
                fitted = clone(model).fit(X, known)
            except RecordError as error:
                counts = " of ".join(f"{np.isfinite(values).sum()}" for values in (known, reading))
                raise RecordError(
                    f"{counts} readings are outside of held-out block {number + 1} of {len(blocks)}. {error}"
                ) from None
            missed = reading[block] - fitted.predict(X)[block]
            result[block] = np.where(unlearned(fitted, X, known)[block], np.nan, missed)
            result[block][_unknown_start(fitted, block, len(reading))] = np.nan
    return result


def _unknown_start(fitted: Any, block: slice, n_rows: int) -> np.ndarray:
    """Rows of a held-out block that feel an unlearned start."""
    record = fitted.features_.history_.record
    washed = np.zeros(block.stop - block.start, bool)
    elapsed_rows = int(np.ceil(fitted.washout_ / max(fitted.features_.history_.usual_step, 1e-12)))
    stride = n_rows / max(record.n_rows, 1)
    for segment in record.segments:
        start = round(segment.start * stride)
        if block.start <= start < block.stop:
            length = min(elapsed_rows, (block.stop - start) // 2)
            washed[start - block.start : start - block.start + length] = True
    return washed
