"""Noise whose size changes in the course of a record."""

from __future__ import annotations

import numpy as np
import pandas as pd

NEARBY = 100
"""Rows over which the size of the noise is measured where it changes with time: known to 7 %."""
UNEVEN = 2.0
"""Largest over smallest size of the noise (95 % and 5 %), above which rows are weighted by it."""
MOST_UNEVEN = 10.0
"""Most that a weight departs from 1 to either side."""


def evenness(residual: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Usual size of the noise over its size near each row; ones unless it clearly changes in the course of the record.

    The size is that of the steps between neighbouring rows, of which the largest count less: a quantised reading moves
    in few of them, and a spike is no noise.
    """
    steps = np.abs(np.diff(residual))[np.diff(segment) == 0]
    jump = np.abs(np.diff(residual, prepend=np.nan))
    jump[np.diff(segment, prepend=segment[0]) != 0] = np.nan
    if len(steps) < 10 * NEARBY or not steps.any():
        return np.ones(len(residual))
    squares = pd.Series(np.minimum(jump, 4 * np.mean(steps)) ** 2)
    size = np.sqrt(squares.rolling(NEARBY, center=True, min_periods=NEARBY // 4).mean().bfill().ffill().to_numpy())
    low, usual, high = np.quantile(size, (0.05, 0.5, 0.95))
    if not high > UNEVEN * low or usual == 0:
        return np.ones(len(residual))
    return np.asarray(1 / np.clip(size / usual, 1 / MOST_UNEVEN, MOST_UNEVEN))
