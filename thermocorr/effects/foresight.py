"""Rows that come after a block: what the kinds that look ahead share."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..records import Block


def rows_until(block: Block, ahead: float) -> Any:
    """Rows of a block and of what follows it in its segment, until at least `ahead` seconds beyond its last row."""
    record, until, stop = block.record, block.elapsed[-1] + ahead, block.stop
    last = record.segments[block.segment].stop
    while stop < last and not _reaches(block, record.kept(block.stop, stop), until):
        stop = min(stop + max(64, (stop - block.start) // 4), last)
    return record.kept(block.start, stop)


def _reaches(block: Block, rows: Any, until: float) -> bool:
    """Whether the last of some rows is late enough; none are not."""
    some = rows.stop > rows.start if isinstance(rows, slice) else len(rows) > 0
    return some and elapsed(block, last_of(rows))[0] >= until


def last_of(rows: Any) -> Any:
    """The last of some rows, as rows."""
    return slice(rows.stop - 1, rows.stop) if isinstance(rows, slice) else rows[-1:]


def segment_end(block: Block) -> float:
    """Seconds from the beginning of a block's segment to its last row."""
    stop = block.record.segments[block.segment].stop
    return float(elapsed(block, block.record.rows(stop - 1, stop))[0])


def parts_of(rows: Any, size: int) -> list[Any]:
    """Rows in parts of at most `size`: what lies far ahead need not be in memory at once."""
    if isinstance(rows, slice):
        return [slice(low, min(low + size, rows.stop)) for low in range(rows.start, rows.stop, size)]
    return [rows[low : low + size] for low in range(0, len(rows), size)]


def elapsed(block: Block, rows: Any) -> np.ndarray:
    """Seconds of rows since the segment of a block began."""
    return np.asarray(block.record.times.seconds(rows, block.segment_zero))


def temperatures(block: Block, rows: Any) -> np.ndarray:
    """Temperatures of rows of a block's record."""
    return np.asarray(block.record.columns[block.record.temperature_name][rows], float)
