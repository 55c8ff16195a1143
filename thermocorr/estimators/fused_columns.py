"""What one compiled pass through a record makes itself, and what is made for it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np

from ..effects import InitialTransient, ThermalLag
from ..effects.protocol import Effect
from ..equations.compiled import is_compiled
from ..records import Record

WIDEST = 32
"""Columns of all segments up to which one pass is the faster way: beyond them the blocks of LAPACK are."""
FEWEST = 1 << 13
"""Rows from which one pass is the faster way: before, what it does once for every stretch takes longer."""
_NUMBERS = 3 << 17
"""Numbers that a block of rows may hold, inputs and columns made for the pass (3 MiB)."""
_NOTHING = np.zeros(0)


class FusedColumns:
    """Columns of ``[1 | Q | U]``: which of them the pass makes, and in which order it has them all.

    Parameters
    ----------
    effects : sequence of Effect
    starts : InitialTransient, optional
        Decays that are taken out of all columns, and get none; `effects` have none then.
    """

    def __init__(self, effects: Sequence[Effect], starts: InitialTransient | None):
        self.effects = effects
        self.first = list(accumulate((effect.n_columns() for effect in effects), initial=1))
        """Where the columns of each effect begin, and the place of the reading behind them all."""
        self.lags = [i for i, effect in enumerate(effects) if _is_lag(effect)]
        self.ready = [i for i, effect in enumerate(effects) if not (_is_lag(effect) or _is_decay(effect))]
        lags: list[Any] = [effects[i] for i in self.lags]
        self.time_constants = np.concatenate([lag.time_constants_ for lag in lags])
        """Time constants of all lags [s]."""
        self.hold = lags[0].hold
        self.hidden = starts is not None
        """Whether start-up decays have no column."""
        own = [(effect, self.first[i]) for i, effect in enumerate(effects) if _is_decay(effect)]
        self._decays: dict[int, list[np.ndarray]] = {}
        self._places: dict[int, list[int]] = {}
        transients: list[tuple[Any, int]] = own if starts is None else [(starts, 0)]
        for transient, first in transients:
            for segment, taus in transient.decays_.items():
                self._decays.setdefault(segment, []).append(taus)
                self._places.setdefault(segment, []).extend(range(first, first + len(taus)))
                first += len(taus)

    def block_rows(self) -> int:
        """Rows of a block: as many as leave the memory small."""
        return max(_NUMBERS // (6 + sum(self.first[i + 1] - self.first[i] for i in self.ready)), 256)

    def shared(self) -> list[int]:
        """Columns that every segment has, in the order of the pass: the 1, lags, those made for it, the reading."""
        both = [*self.lags, *self.ready]
        return [0, *(c for i in both for c in range(self.first[i], self.first[i + 1])), self.first[-1]]

    def decays(self, segment: int) -> tuple[np.ndarray, list[int]]:
        """Decays of a segment, the fastest first [s], and their columns, where they have any."""
        taus = np.concatenate([*self._decays.get(segment, []), _NOTHING])
        order = np.argsort(taus, kind="stable")
        return taus[order], [] if self.hidden else [self._places[segment][k] for k in order.tolist()]


def _is_lag(effect: Any) -> bool:
    return type(effect) is ThermalLag


def _is_decay(effect: Effect) -> bool:
    return type(effect) is InitialTransient


def can_be_fused(record: Record, effects: Sequence[Effect], starts: InitialTransient | None) -> bool:
    """Whether there is compiled code, and it has something to do: many rows, lags of one rule between samples."""
    shared = sum(effect.n_columns() for effect in effects if not _is_decay(effect))
    if not is_compiled() or record.n_used < FEWEST or shared > WIDEST:
        return False
    lags: list[Any] = [effect for effect in effects if _is_lag(effect)]
    both = starts is not None and any(_is_decay(effect) for effect in effects)
    return len({lag.hold for lag in lags}) == 1 and not both
