"""Recorded columns against copies of themselves moved in time, and traces of the thermometers' errors.

A few slow swings go with a few others by chance, whatever noise is assumed. So a column's effect is made of copies of
the column, too, moved in time and turned round, beside the effect itself. What they gain in log likelihood is what
such swings gain of a record that has nothing to do with them: half a unit for each column where the noise is as it
seems, and ten times as much where the record has structure that no cause explains. Evidence is divided by it, as
geneticists do where relatives are taken for strangers (genomic control: Devlin & Roeder, Biometrics 55, 1999; series
that are correlated with themselves: Ebisuzaki, Journal of Climate 10, 1997). What helps more on data that were not
learned from than any copy does is still a cause, though not a proven one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects.protocol import Effect
from ..records import Record
from ..records.history import Thinned
from .blocks import averaged_copies
from .levels import COPIES, FINE, INFLATION, LEAST_MOVED
from .likelihood import Comparison
from .out_of_sample import OutOfSample
from .pool import Pool


def together(thermometers: pd.DataFrame) -> float:
    """Standard deviation of what the errors of all thermometers make wander in the reading, in its unit."""
    return float(np.sqrt((thermometers["wandering"] ** 2).sum())) if len(thermometers) else 0.0


AT_ONCE = 1 << 22
"""Rows of all copies that are walked through together."""
GOLDEN = (5**0.5 - 1) / 2
"""Shares of the record, multiples of which are spread evenly and meet no period."""


@dataclass(frozen=True, kw_only=True)
class Copies:
    """What copies of an effect's columns make of a record, beside the effect itself."""

    inflation: float
    """Gain of the copies in log likelihood over what noise that is as it seems would give them."""
    help: float
    """The most that one of them helps on later stretches [dB]."""

    @classmethod
    def of(cls, pool: Pool, judged: Comparison, held: OutOfSample, number: int, effect: Effect) -> Copies:
        """Copies of an effect of recorded columns; `number` is its own among the explanations of the comparison."""
        records, columns = moved(pool.record, effect), []
        while together := _columns_of(islice(records, max(1, AT_ONCE // pool.record.n_rows)), effect):
            columns += [pool.rows.weighed(part, out=part) for part in together]
        other, first = judged.copy(), len(judged.explanations)
        other.add(columns)
        which = range(first, len(other.explanations))
        gains, width = other.gained_beside(number, which), sum(map(other.width, which))
        helped = max(worth.both for worth in held.worth([pool.coarse(part) for part in columns]))
        return cls(inflation=float(2 * gains.sum() / max(width, 1)), help=helped)

    @property
    def excess(self) -> float:
        """What evidence is divided by."""
        return max(1.0, self.inflation / INFLATION)


def _columns_of(records: Iterable[Record], effect: Effect) -> list[np.ndarray]:
    """Averaged columns of an effect in each of some records, which learns each of them."""
    copies = [(record, clone(effect)) for record in records]
    for record, copied in copies:
        copied.learn(record)
    return averaged_copies(copies, FINE) if copies else []


def moved(record: Record, effect: Effect) -> Iterator[Record]:
    """The record with the columns of an effect moved in time, what is moved beyond the end coming in at the beginning.

    Every second copy is turned round. Rows in which a cell is missing are no part of the record, and keep theirs.
    """
    names = [name for name in effect.inputs() if name in record.columns and name != record.temperature_name]
    whole = {name: np.asarray(record.columns[name], float) for name in names}
    known = np.logical_and.reduce([np.isfinite(column) for column in whole.values()])
    if isinstance(record, Thinned):
        record = replace(record, exact={})
    every = known.all() and record.n_used == record.n_rows  # the same numbers in another order
    stays = {of: moments for of, moments in record.known_moments.items() if every or of[0] not in names}
    for k in range(1, COPIES + 1):
        rows = round((LEAST_MOVED + (1 - 2 * LEAST_MOVED) * (k * GOLDEN % 1)) * np.count_nonzero(known))
        columns = {name: _rolled(column, known, rows, -1 if k % 2 else 1) for name, column in whole.items()}
        yield replace(record, columns={**record.columns, **columns}, known_moments=dict(stays))
        del columns  # before those of the next one are there


def _rolled(column: np.ndarray, known: np.ndarray, rows: int, way: int) -> np.ndarray:
    """A column whose `known` rows are moved by so many, turned round where `way` is -1."""
    if known.all():
        return np.roll(column, rows)[::way]
    copy = column.copy()
    copy[known] = np.roll(column[known], rows)[::way]
    return copy
