"""What the starts of several segments hold: taken out of all that is compared, as the fit of the model takes it out."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import InitialTransient
from ..effects.protocol import Effect
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Block, Record
from .levels import HELD
from .likelihood import orthonormal


class OwnStart(Effect):
    """Start-up decays, eq. (18), each segment's in the same columns.

    Parameters
    ----------
    transient : InitialTransient
        Whose decays.
    """

    kind = "own_start"
    of_time_alone = True

    def __init__(self, transient: InitialTransient):
        self.transient = transient

    def learn(self, record: Record) -> None:
        """Find the decays of each segment."""
        self.transient_ = clone(self.transient)
        self.transient_.learn(record)

    def names(self) -> list[str]:
        """As many as the segment with most decays has."""
        return [f"start {k}" for k in range(max(map(len, self.transient_.decays_.values()), default=0))]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Decays of the block's segment, zeros where it has fewer than others."""
        own = self.transient_.own(block)
        return np.pad(own, ((0, 0), (0, len(self.names()) - own.shape[1]))), None


def starts_of(model: DynamicBiasRegressor, record: Record) -> list[Effect]:
    """The start-up decays of a model of several segments; none for a single one, whose decays are suspects."""
    if len(record.segments) < 2:
        return []
    return [OwnStart(effect) for effect in model.features_.effect_list() if isinstance(effect, InitialTransient)]


class Starts:
    """The directions that start-up decays hold, segment by segment.

    Parameters
    ----------
    columns : array of shape (n, k)
        Decays of each row's own segment.
    segment : array of shape (n,)
        Number of each row's segment.
    """

    def __init__(self, columns: np.ndarray, segment: np.ndarray):
        edges = np.flatnonzero(np.diff(segment, prepend=-1, append=-1))
        parts = [slice(low, high) for low, high in pairwise(edges.tolist())]
        self.parts = [(rows, orthonormal(columns[rows])) for rows in parts if columns[rows].any()]

    def taken_out(self, columns: np.ndarray) -> np.ndarray:
        """Columns, shape (n,) or (n, k), less what the decays hold; they are changed in place.

        Where a segment's decays hold all of a column, zeros are left and not its rounding, which would look like a
        column of its own.
        """
        for rows, Q in self.parts:
            before = np.linalg.norm(columns[rows], axis=0)
            columns[rows] -= Q @ (Q.T @ columns[rows])
            columns[rows] *= np.linalg.norm(columns[rows], axis=0) > HELD * before
        return columns
