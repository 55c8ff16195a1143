"""Sizes of blocks and stretches: blocks fit the cache, stretches have factors of their own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..records import BLOCK_ROWS, Block, Record

N_CHUNKS = 20
"""Stretches of time whose factors are kept apart for standard errors."""


def block_rows(n_used: int, n_chunks: int = N_CHUNKS) -> int:
    """Rows of a block such that a record has about `n_chunks` of them, or full blocks where it is long."""
    return int(np.clip(-(-n_used // n_chunks), 2048, BLOCK_ROWS))


def equal_edges(record: Record, n_chunks: int = N_CHUNKS) -> np.ndarray:
    """Positions in time order that cut a record into stretches of equal numbers of used rows, ends included.

    Where readings hold less than half of the record, that part is cut, see `Record.read_places`.
    """
    starts = np.array([segment.start for segment in record.segments])
    before = np.cumsum([0, *(segment.n_rows for segment in record.segments)])
    low, high = record.read_places
    first, last = 0, record.n_used
    if (low, high) != (0, record.n_rows):
        own = np.clip(np.searchsorted(starts, (low, high - 1), side="right") - 1, 0, None)
        first, last = (before[own] + (low, high) - starts[own]).tolist()
    wanted = np.unique(first + np.arange(1, n_chunks) * (last - first) // n_chunks)
    segment = np.searchsorted(before, wanted, side="right") - 1
    return np.unique(np.concatenate(([0], starts[segment] + wanted - before[segment], [record.n_rows])))


def pieces(edges: np.ndarray, block: Block) -> Iterator[tuple[int, slice]]:
    """The stretches between `edges` that the rows of a block fall into, and which of the rows each has."""
    first, last = np.searchsorted(edges, (block.start, block.stop - 1), side="right").tolist()
    ends = block.first_from(edges[first - 1 : last + 1]).tolist()
    for chunk, (low, high) in enumerate(pairwise(ends), start=first - 1):
        if low < high:
            yield chunk, slice(low, high)
