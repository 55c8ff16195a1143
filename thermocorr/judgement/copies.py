"""Whether what is left follows a recorded column, or would follow any other that swings as slowly.

A few slow swings go with a few others by chance, whatever noise is assumed. So a column's effect is made of copies of
the column, too, moved in time and turned round, beside the effect itself. What they gain in log likelihood is what
such swings gain of a record that has nothing to do with them: half a unit for each column where the noise is as it
seems, and ten times as much where the record has structure that no cause explains. Evidence is divided by it, as
geneticists do where relatives are taken for strangers (genomic control: Devlin & Roeder, Biometrics 55, 1999; series
that are correlated with themselves: Ebisuzaki, Journal of Climate 10, 1997).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from sklearn.base import clone

from ..effects.protocol import Effect
from ..records import Record
from ..records.thinned import Thinned
from .blocks import averaged
from .levels import COPIES, FINE, LEAST_MOVED
from .likelihood import Comparison
from .pool import Pool

GOLDEN = (5**0.5 - 1) / 2
"""Shares of the record, multiples of which are spread evenly and meet no period."""


def inflation(pool: Pool, judged: Comparison, number: int, effect: Effect) -> float:
    """What copies of an effect's columns gain beside it, over what noise that is as it seems would give them.

    Parameters
    ----------
    pool : Pool
    judged : Comparison
    number : int
        Of the effect, among the explanations of the comparison.
    effect : Effect
        Of recorded columns.
    """
    columns = []
    for record in moved(pool.record, effect):
        copied = clone(effect)
        copied.learn(record)
        columns.append(pool.rows.weighed(averaged(record, [copied], FINE).columns[0]))
    gains, widths = judged.gained_beside(number, columns)
    return float(2 * gains.sum() / max(widths.sum(), 1))


def moved(record: Record, effect: Effect) -> Iterator[Record]:
    """The record with the columns of an effect moved in time, what is moved beyond the end coming in at the beginning.

    Every second copy is turned round.
    """
    names = [name for name in effect.inputs() if name in record.columns and name != record.temperature_name]
    n = record.n_rows
    for k in range(1, COPIES + 1):
        rows = round((LEAST_MOVED + (1 - 2 * LEAST_MOVED) * (k * GOLDEN % 1)) * n)
        columns = {name: np.roll(np.asarray(record.columns[name]), rows)[:: -1 if k % 2 else 1] for name in names}
        other = replace(record, columns={**record.columns, **columns}, known_moments={})
        yield replace(other, exact={}) if isinstance(other, Thinned) else other
