"""Numbers that are Unix times by their size: one judgement for files and for data in memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError
from .grammar import number

UNIX = (9.4e8, 2.6e9)
"""Unix times in seconds, 1999 to 2052."""
EPOCHS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
"""Unit of Unix times -> how many are a second."""
LARGEST_SECONDS = 1e10
"""Numbers from here on are no seconds of a log: 300 years."""
SEVERAL = 3
"""Times that are judged together at least: a single one, of a sample that just came, may be damaged."""


def unix_unit(low: float, high: float) -> str | None:
    """Unit of numbers between two limits that can only be Unix times, "s", "ms", "us" or "ns"; None for others.

    Examples
    --------
    >>> unix_unit(1.7e12, 1.8e12), unix_unit(0.0, 1.7e12)
    ('ms', None)
    """
    units = {"s": 1.0, **EPOCHS}
    return next((unit for unit, n in units.items() if UNIX[0] * n <= low and high < UNIX[1] * n), None)


def unix_time(cell: str, kind: str) -> tuple[str, Any]:
    """Unit and time of a cell that is a Unix time in ms, us or ns by its size; ``("", cell)`` for any other.

    Parameters
    ----------
    cell : str
    kind : str
        Kind of the times that are wanted, see `Times.kind`: seconds [s], or dates.
    """
    try:
        count = number(cell, "the time")
    except RecordError:  # a date
        return "", cell
    unit = unix_unit(count, count)
    if unit not in EPOCHS:
        return "", cell
    if kind == "seconds":
        return unit, count / EPOCHS[unit]
    exact: Any = int(cell) if cell.isdecimal() else count
    return unit, pd.Timestamp(exact, unit=unit, tz="UTC" if kind == "datetime with time zone" else None)


def refuse_no_seconds(numbers: NDArray[np.float64], where: str, first_row: int = 0) -> None:
    """Raise RecordError for times that are taken as seconds and can be none: Unix times in another unit, and others.

    Parameters
    ----------
    numbers : array of shape (n_rows,)
    where : str
        What they are, in words.
    first_row : int
        Number of the first of them in its log.
    """
    if len(numbers) < SEVERAL:
        return
    begins = f"{where} is {numbers[0]:.0f} in row {first_row}, and so on:"
    unit = unix_unit(float(numbers.min()), float(numbers.max()))
    if unit in EPOCHS:
        raise RecordError(
            f"{begins} these are Unix times in {unit}, and numbers are taken as seconds. Make dates of them with "
            f"pandas.to_datetime(..., unit={unit!r})."
        )
    if np.median(numbers) >= LARGEST_SECONDS:  # one damaged time is none of these
        raise RecordError(
            f"{begins} no seconds, and no Unix times of this century. Make dates, spans or seconds of them."
        )
