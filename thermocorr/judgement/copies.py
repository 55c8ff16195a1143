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

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import Covariate, Hysteresis
from ..effects.protocol import Effect
from ..records import Record
from ..records.history import Thinned
from .blocks import averaged_copies
from .choice import Cause, Tried
from .levels import (
    BETWEEN_ROWS,
    CHANGES,
    COPIES,
    FINE,
    FOLLOWS,
    GAIN,
    INFLATION,
    LEAST_MOVED,
    LITTLE,
    NEAR_ROWS,
    OF_THERMOMETER,
    OUTDONE,
    PLAY,
    SHARP,
    TINY,
)
from .likelihood import Comparison
from .pool import Pool
from .worth import HeldOut, Worth


def together(thermometers: pd.DataFrame) -> float:
    """Standard deviation of what the errors of all thermometers make wander in the reading, in its unit."""
    return float(np.sqrt((thermometers["wandering"] ** 2).sum())) if len(thermometers) else 0.0


def is_between_rows(cause: Cause, pool: Pool) -> bool:
    """Whether a cause is a trace of what the temperature did between its rows.

    It needs nothing but the temperature, as does all that it cannot be told from, and is no lead or delay of many rows;
    it explains no more than that may make, and helps little. Where the temperature turns as sharply as it moves, it may
    help more; and what helps nowhere at all, and does not look ahead, may be what a jump makes.
    """
    effects = [t.explanation.effect for t in (cause.tried, *cause.alike)]
    near = NEAR_ROWS * pool.record.usual_step()
    if not all(effect.of_temperature_alone and effect.moves_by() <= near for effect in effects):
        return False
    helped, between, (curve, jump) = cause.tried.worth.both, pool.between_rows, BETWEEN_ROWS
    sharp = between.turning > SHARP
    most = jump if helped < TINY and sharp and not effects[0].foresees else curve
    return helped < (GAIN if sharp else LITTLE) and cause.size <= most * between.curve


class Imitations:
    """What of a pool's explanations may be traces of the thermometers' errors."""

    def __init__(self, pool: Pool):
        self.pool = pool

    def taken_out(self, tried: Sequence[Tried], found: Sequence[Cause], left: float) -> Sequence[Tried]:
        """What was tried, less what may be a trace and does not help.

        That is so where a thermometer's noise is a cause already, or an effect of the model; or where it has evidence
        and the errors make as much as is `left`: the standard deviation of what wanders, in the unit of the reading.
        Where they cannot make that, the noise is no cause, and taken out itself.
        """
        known = self._known(found)
        if not known and not any(_noisy(t) and (t.score > 0 or t.worth.both >= GAIN) for t in tried):
            return tried
        if not self._suffice(found, left):
            return [t for t in tried if not _noisy(t)]
        least = [self._least(t) for t in tried]
        return [
            t for t, needed in zip(tried, least, strict=True) if t.worth.both >= needed or (_noisy(t) and not known)
        ]

    def behind(self, best: Tried, rivals: Sequence[Tried], found: Sequence[Cause], left: float) -> Tried:
        """The noise of the thermometer, where it is as good a cause as what may be a trace of it; else the cause."""
        if not best.explanation.effect.thermal_rank or not self._suffice(found, left):
            return best
        return next((t for t in rivals if _noisy(t)), best)

    def _known(self, found: Sequence[Cause]) -> bool:
        own = (effect for _, effect in self.pool.model.features_.further_effects())
        return any(effect.of_thermometer for effect in own) or any(_noisy(cause.tried) for cause in found)

    def _suffice(self, found: Sequence[Cause], left: float) -> bool:
        """Whether the thermometers' errors are known to act, or make as much as is left."""
        made = together(self.pool.thermometers)
        return self._known(found) or (made > 0 and left <= OF_THERMOMETER * made)

    def _least(self, t: Tried) -> float:
        """Help [dB] above which it is no artefact of the thermometer: any for a recorded column, else much."""
        effect, column = t.explanation.effect, t.key[1]
        if isinstance(effect, Hysteresis) and len(self.pool.thermometers):
            first = self.pool.thermometers.iloc[0]
            own = effect.width <= max(PLAY[0] * first["noise"], PLAY[1] * first["resolution"])
            return np.inf if own else -np.inf
        if effect.thermal_rank or column in self._followers:
            return GAIN
        return -np.inf if column is None else 0.0

    @cached_property
    def _followers(self) -> set[Any]:
        """Recorded columns that change as the temperature does: they may know it better."""
        last = {e.key[1]: e for e in self.pool.explanations if e.key[0] == Covariate.kind}
        plain = {e.key[1]: e.columns for e in self.pool.with_columns(list(last.values()))}
        T = self.pool.rows.weighed(self.pool.temperature)
        return {name for name, columns in plain.items() if _follows(columns[:, 0], T)}


def _noisy(t: Tried) -> bool:
    return t.explanation.effect.of_thermometer


def _follows(values: np.ndarray, temperature: np.ndarray) -> bool:
    """Whether two series change together, over a few rows or over many."""
    for rows in CHANGES:
        one, other = values[rows:] - values[:-rows], temperature[rows:] - temperature[:-rows]
        size = float(np.sqrt((one @ one) * (other @ other)))
        if abs(float(one @ other)) > FOLLOWS * size:
            return True
    return False


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
    """The most that one of them helps, on later stretches and on held-out blocks alike [dB]."""
    outdone: bool = False
    """Whether they were outdone by the effect with some parameters or other: a question to the column."""

    @classmethod
    def of(cls, pool: Pool, judged: Comparison, held: HeldOut, number: int, effect: Effect) -> Copies:
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

    def outdone_by(self, worth: Worth) -> bool:
        """Whether data that were not learned from tell the effect from its copies."""
        return self.outdone or worth.both >= max(GAIN, OUTDONE * self.help)


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
