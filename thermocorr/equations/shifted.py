"""Values between the rows of an even series."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def shifted(values: NDArray[np.float64], first: float, n: int) -> NDArray[np.float64]:
    """Values at rows ``first, first + 1, ...``, n of them, on straight lines between whole rows.

    Before all rows stands the value of the first, behind all that of the last.

    `values` (array of shape (m,), m > 0): At rows 0, 1, ..., m - 1. `first` (float): May lie between two rows, and
    before or behind all. `n` (int). Returns array of shape (n,).

    Examples
    --------
    >>> import numpy as np
    >>> shifted(np.array([0.0, 10.0, 30.0]), -0.5, 4)
    array([ 0.,  5., 20., 30.])
    """
    m = len(values)
    low = min(max(math.floor(first), -n - 1), m)
    part, high = first - math.floor(first), low + n + 1
    inside = values[max(low, 0) : max(min(high, m), 0)]
    if low < 0 or high > m:
        before, behind = max(min(-low, n + 1), 0), max(min(high - m, n + 1), 0)
        inside = np.concatenate((np.full(before, values[0]), inside, np.full(behind, values[-1])))
    earlier = inside[:n]
    return earlier + part * (inside[1:] - earlier) if part else earlier.copy()
