"""Where in a record its readings are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROWS_AT_ONCE = 8192
"""Readings that are looked at together."""


def where_read(reading: Any, n: int, rows: Callable[[int, int], Any]) -> tuple[int, int]:
    """Positions of the first reading and behind the last one; those of the whole record where these hold half of it.

    A week of readings may stand beside a year of temperature: by the year, all of it would be one moment.

    `reading` (array of shape (n,), or None). `n` (int): Rows. `rows` (callable): The user's rows of a stretch in the
    order of time, from its start and stop.
    """
    if reading is None:
        return 0, n
    starts = range(0, n, ROWS_AT_ONCE)
    first, last = next(_known(reading, n, rows, starts), None), next(_known(reading, n, rows, reversed(starts)), None)
    if first is None or last is None:
        return 0, n
    low, high = int(first[0]), int(last[-1]) + 1
    return (low, high) if 2 * (high - low) < n else (0, n)


def _known(reading: Any, n: int, rows: Callable[[int, int], Any], starts: Iterable[int]) -> Iterator[NDArray[np.intp]]:
    """Positions of the readings, block by block, of blocks that have any."""
    for start in starts:
        known = np.flatnonzero(np.isfinite(np.asarray(reading[rows(start, min(start + ROWS_AT_ONCE, n))], float)))
        if len(known):
            yield start + known
