"""Where in a record its readings are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .record import Record

ROWS_AT_ONCE = 8192
"""Readings that are looked at together."""


def where_read(record: Record) -> tuple[int, int]:
    """Positions of the first reading and behind the last one; those of the whole record where these hold half of it.

    A week of readings may stand beside a year of temperature: cut by the year, all of it would be one stretch.
    """
    n, blocks = record.n_rows, range(0, record.n_rows, ROWS_AT_ONCE)
    first, last = next(_known(record, blocks), None), next(_known(record, reversed(blocks)), None)
    if first is None or last is None:
        return 0, n
    low, high = int(first[0]), int(last[-1]) + 1
    return (low, high) if 2 * (high - low) < n else (0, n)


def _known(record: Record, starts: Iterable[int]) -> Iterator[NDArray[np.intp]]:
    """Positions of the readings, block by block, of blocks that have any."""
    reading = record.reading
    if reading is None:
        return
    for start in starts:
        stop = min(start + ROWS_AT_ONCE, record.n_rows)
        known = np.flatnonzero(np.isfinite(np.asarray(reading[record.rows(start, stop)], float)))
        if len(known):
            yield start + known
