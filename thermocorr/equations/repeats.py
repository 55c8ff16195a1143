"""Numbers that stand in many rows and are no reading of each: repeated ones, and the ends of an instrument's range.

A logger that asks more often than its instrument measures writes readings down more than once: such a record has fewer
readings than rows, and several rows share the noise of one. What is written down again is equal to the last digit, and
the next value is many digits away; readings that are merely coarse stand still as well, but move on by a digit or two.
At the end of its range an instrument shows one number again and again, though noise goes on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

OFTEN = 0.15
"""Share of the readings that stand in more than one row, from which they may be repeated: those of white noise of 1.9
digits do as often, and move on by two digits or less in two of three steps."""
FEW_DIGITS = 2.5
"""Size of a step [digits] up to which it is one of coarse readings."""
COARSE = 0.5
"""Share of such steps, of those before and after what stands still, from which readings are coarse."""
FEWEST = 30
"""Readings that stand in more than one row, below which nothing is said."""
DIFFERENT = 30
"""Different numbers among these readings, below which they are states or setpoints."""
FINE = 0.5
"""Share of the readings that are different numbers, from which one is hardly ever met twice."""
MET = 10
"""Rows with the largest or smallest reading, below which it is no end of a range."""
FEW_VISITS = 3
"""Times that it is met anew at least: noise goes on at the end of a range, and not where a device is at rest."""
MORE_OFTEN = 4.0
"""Times as often as any other reading that the end of a range is met."""


def repeated(values: Floats) -> Booleans:
    """Which of consecutive readings are equal to the one before, shape (n,), booleans."""
    found = np.zeros(len(values), bool)
    found[1:] = values[1:] == values[:-1]
    return found


def is_repeated(values: Floats) -> bool:
    """Whether readings are written down more than once each.

    Parameters
    ----------
    values : array of shape (n,)
        Consecutive readings, NaN where there is none, or rows were not looked at.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> is_repeated(np.repeat(noise, 3)), is_repeated(noise), is_repeated(noise.round())
    (True, False, False)
    """
    again = repeated(values)
    if np.count_nonzero(again) < FEWEST:
        return False
    first = np.flatnonzero(~again)
    shown, stands = values[first], np.diff(first, append=len(values)) > 1
    if stands.sum() < max(FEWEST, OFTEN * len(shown)) or len(np.unique(shown[stands])) < DIFFERENT:
        return False
    beside = np.abs(np.diff(shown))[stands[1:] | stands[:-1]]
    digit = np.diff(np.unique(shown[np.isfinite(shown)])).min()
    return bool(np.mean(beside[np.isfinite(beside)] <= FEW_DIGITS * digit) < COARSE)


def ends_of_range(values: Floats) -> tuple[float, ...]:
    """The largest or smallest of the readings, where it is met far more often than any other: they are clipped there.

    Parameters
    ----------
    values : array of shape (n,)
        Consecutive readings, NaN where there is none, or rows were not looked at.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> ends_of_range(np.minimum(noise, 1.0)), ends_of_range(noise), ends_of_range(np.sign(noise))
    ((1.0,), (), ())
    """
    known = np.isfinite(values)
    every, changed = values[known], values[known & ~repeated(values)]
    if not len(every) or max(np.sum(every == every.min()), np.sum(every == every.max())) < MET:
        return ()
    different, visits = np.unique(changed, return_counts=True)
    if len(different) < DIFFERENT:
        return ()
    rows = np.unique(every, return_counts=True)[1]
    times = rows if len(different) > FINE * visits[1:-1].sum() else visits  # a coarse reading stands still anywhere
    clipped = (times >= max(MET, MORE_OFTEN * times[1:-1].max())) & (visits >= FEW_VISITS)
    return tuple(float(different[end]) for end in (0, -1) if clipped[end])
