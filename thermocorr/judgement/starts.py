"""The start of a record and of its segments, as far as a model has it: decays that are no cause."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import InitialTransient
from ..effects.protocol import Effect
from ..equations import decays
from ..estimators.flat import lags_of
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Block, Record
from .levels import BEYOND, FEW_STARTS, MANY_STARTS, STARTS


class OwnStart(Effect):
    """Start-up decays, eq. (18), each segment's in the same columns: from a model's fastest to its slowest, and beyond.

    `transient` (InitialTransient): The model's decays. `slowest` (float): Time constant [s] beyond which a decay
    competes with drift and ageing instead. `which` (slice): Of which segments. `beyond` (float): How far they reach
    beyond, as a factor.
    """

    kind = "own_start"
    of_time_alone = True

    def __init__(
        self, transient: InitialTransient, slowest: float = np.inf, which: slice = slice(None), beyond: float = BEYOND
    ):
        self.transient, self.slowest, self.which, self.beyond = transient, slowest, which, beyond

    def learn(self, record: Record) -> None:
        """Find the decays of each segment that has any in the model."""
        self.transient_ = clone(self.transient)
        self.transient_.learn(record)
        number = STARTS if len(record.segments) > MANY_STARTS else FEW_STARTS
        self.transient_.decays_ = {
            key: np.geomspace(
                own.min() / self.beyond, max(min(own.max() * self.beyond, self.slowest), own.min()), number
            )
            for key, own in self.transient_.decays_.items()
            if key in range(len(record.segments))[self.which]
        }

    def names(self) -> list[str]:
        """Names of the columns, as many as the segment with most decays has."""
        return [f"start {k}" for k in range(max(map(len, self.transient_.decays_.values()), default=0))]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Decays of the block's segment, zeros where it has fewer than others."""
        own = self.transient_.own(block)
        return np.pad(own, ((0, 0), (0, self.n_columns() - own.shape[1]))), None


class Before(Effect):
    """What the parts of a device keep of the time before the record, each as much as the model says of its lag.

    Of another temperature until then, that is the sum of their decays, eq. (18), times the coefficients of the lags. Of
    one that was rising, the slow parts keep more: with rank 2, so many times more as they are slower.

    `time_constants`, `coefficients` (array of shape (J,)): Of the lags [s]. `rank` (int): 1 or 2, the number of
    columns.
    """

    kind = "own_start"
    of_time_alone = True

    def __init__(self, time_constants: np.ndarray, coefficients: np.ndarray, rank: int):
        self.time_constants, self.coefficients, self.rank = time_constants, coefficients, rank

    def learn(self, record: Record) -> None:
        """Nothing depends on the record."""

    def names(self) -> list[str]:
        """Names of the columns."""
        return [f"before {k}" for k in range(self.rank)]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Sums of decays in the first segment, zeros in the others."""
        if block.segment != 0:
            return np.zeros((len(block), self.rank)), None
        slower = (self.time_constants / self.time_constants.max())[:, None] ** np.arange(self.rank)
        return decays(block.elapsed, self.time_constants) @ (self.coefficients[:, None] * slower), None


def starts_of(model: DynamicBiasRegressor, record: Record, slowest: float) -> tuple[list[Effect], list[Effect]]:
    """The start-up decays of a model that are held, and those that compete, none slower than a time constant [s].

    Behind a pause nobody knows what a device keeps of the time before. Whether it was at rest when the record began,
    the record says: an ageing looks like many decays, and what a lag as long as the record keeps like a drift.
    """
    own = [effect for effect in model.features_.effect_list() if isinstance(effect, InitialTransient)]
    if len(record.segments) > MANY_STARTS:
        return [OwnStart(effect) for effect in own], []
    later = [OwnStart(effect, slowest, slice(1, None)) for effect in own if len(record.segments) > 1]
    taus, lags = lags_of(model)
    kept = taus <= slowest
    taus, coefficients = taus[kept], model.coef_[lags][kept]
    before = [Before(taus, coefficients, rank) for rank in (1, 2) if own and len(taus) >= rank]
    return list(later), [*(OwnStart(effect, slowest, slice(1)) for effect in own), *before]
