"""What is printed about a series: moving average, eqs. (9) (26), and reduction in dB."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def moving_average(values: Floats, window: int) -> Floats:
    """Centred moving average over `window` samples, eqs. (9) (26).

    NaN values are left out of the mean. Near the ends the window is cut, so the result has the length of `values`;
    it is NaN where a window holds no value.

    Examples
    --------
    >>> import numpy as np
    >>> moving_average(np.array([0.0, 3.0, 6.0, np.nan]), 3).round(2)
    array([1.5, 3. , 4.5, 6. ])
    """
    n = len(values)
    here = np.isfinite(values)
    offset = values[here].mean() if here.any() else 0.0  # a running sum of small numbers keeps its digits
    total = np.concatenate(([0.0], np.cumsum(np.where(here, values - offset, 0.0))))
    count = np.concatenate(([0], np.cumsum(here)))
    low = np.maximum(np.arange(n) - (window - 1) // 2, 0)
    high = np.minimum(np.arange(n) + window // 2 + 1, n)
    number = count[high] - count[low]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(number > 0, (total[high] - total[low]) / number + offset, np.nan)


def reduction_db(after: float, before: float) -> float:
    """20 log10(std after / std before) [dB]; negative is good, as in the paper's table.

    Examples
    --------
    >>> reduction_db(0.1, 1.0)
    -20.0
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(20.0 * np.log10(np.float64(after) / np.float64(before)))
