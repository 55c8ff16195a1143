"""Type hints that say what a value in a file may be: it is written, read and checked by them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd

LARGEST = 1e40
"""A number beyond this is no measurement. Squares and cubes of smaller ones stay within double precision."""


class Check(NamedTuple):
    """A condition on a value, and the words for it."""

    holds: Callable[[Any], bool]
    wanted: str


def within(low: float, high: float) -> Check:
    """Limits of a number, or of all numbers of an array; NaN is within none."""

    def holds(value: Any) -> bool:
        return bool(np.all((np.asarray(value) >= low) & (np.asarray(value) <= high)))

    return Check(holds, f"a number from {low:g} to {high:g}")


def _is_label(value: Any) -> bool:
    if type(value) is tuple:
        return all(map(_is_label, value))
    return value is None or (isinstance(value, bool | int | float | str | date | pd.Timedelta) and bool(value == value))


LEAST = 5e-324
Number = Annotated[float, within(-LARGEST, LARGEST)]
Size = Annotated[float, within(0.0, LARGEST)]
Positive = Annotated[float, within(LEAST, LARGEST)]
Variance = Annotated[float, within(0.0, LARGEST**2)]
Large = Annotated[float, within(-1e300, 1e300)]
"""A sum or power of measurements."""
Loose = Annotated[float, Check(lambda value: True, "a number")]
"""Any number, infinities and NaN too."""
Counted = Annotated[int, within(0, 1 << 53)]
"""A number of rows: one that can go on counting."""
Vector = Annotated[np.ndarray, within(-(LARGEST**2), LARGEST**2)]
Sizes = Annotated[np.ndarray, within(0.0, LARGEST**2)]
Stamp = int | float
"""A time on the clock of a record, see `thermocorr.records.times.Times`."""
RunLabel = Annotated[Any, Check(_is_label, "a label (text, a number, a date)")]
Column = Annotated[
    Any, Check(lambda value: isinstance(value, str) or (type(value) is int and value >= 0), "the name of a column")
]
