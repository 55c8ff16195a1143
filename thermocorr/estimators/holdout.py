"""Residuals on blocks of time that a model has not seen."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from sklearn.base import clone

from ..records import RecordError
from ..records.errors import check_int, said_once
from ..records.record import where_read
from .heteroscedasticity import believed_readings
from .progress import Progress, reporting
from .run_levels import unlearned


def time_blocks(reading: np.ndarray, n_blocks: int) -> list[slice]:
    """Contiguous blocks of nearly equal numbers of rows, in the order of the rows.

    Where readings, shape (n_rows,), hold less than half of the rows, the blocks are those of that part.
    """
    first, stop = where_read(reading, len(reading), slice)
    n_rows = stop - first
    # Rows below which a block of time says nothing
    count = min(n_blocks, max(n_rows // 8, 2))
    return [slice(first + low, first + high) for low, high in pairwise(n_rows * k // count for k in range(count + 1))]


@said_once()
def held_out_residuals(model: Any, X: Any, y: Any, *, n_blocks: int = 5, progress: Progress = None) -> np.ndarray:
    """Residuals of each block of time under a model that was fitted, time constants and all, without its readings.

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
    reading = believed_readings(model, X, y)
    with reporting(progress, len(time_blocks(reading, n_blocks))) as tell:
        return residuals_of_blocks(model, X, reading, n_blocks, tell)


def residuals_of_blocks(
    model: Any, X: Any, reading: np.ndarray, n_blocks: int, tell: Callable[[str], None]
) -> np.ndarray:
    """`held_out_residuals` of believed readings."""
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
    """Rows of a left-out block that still feel a start-up whose decay columns had no readings to learn from."""
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
