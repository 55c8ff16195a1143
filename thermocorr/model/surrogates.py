"""Recorded columns moved in time: what slow swings explain by chance.

A few slow swings go with a few others whatever noise is assumed, so a column must outdo such copies of itself
(Ebisuzaki, Journal of Climate 10, 1997).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..records import Record

LEAST_MOVED = 0.05
"""Least move of a copy, as a share of the record."""


def moved(record: Record, names: Collection[Any]) -> Iterator[Record]:
    """The record with columns moved in time, end around.

    Every second copy is reversed. Rows in which a cell is missing are no part of the record, and keep theirs.
    """
    whole = {name: np.asarray(record.columns[name], float) for name in names}
    rows = (np.arange(record.n_rows) if record.order is None else record.order)[: record.n_used]
    rows = rows[np.logical_and.reduce([np.isfinite(column[rows]) for column in whole.values()])]
    every = len(rows) == record.n_rows  # the same numbers in another order
    stays = {of: moments for of, moments in record.known_moments.items() if every or of[0] not in names}
    # A column is compared with 39 copies of it.
    for k in range(1, 40):
        # Multiples of the golden ratio are spread evenly and meet no period.
        move = round((LEAST_MOVED + (1 - 2 * LEAST_MOVED) * (k * ((5**0.5 - 1) / 2) % 1)) * len(rows))
        columns = {name: column.copy() for name, column in whole.items()}
        for column in columns.values():
            column[rows] = np.roll(column[rows], move)[:: -1 if k % 2 else 1]
        yield replace(record, columns={**record.columns, **columns}, known_moments=dict(stays))
        del columns  # before those of the next one are there
