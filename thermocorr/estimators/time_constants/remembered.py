"""Factors of a record's stretches, kept for further searches in the same record with some of its readings left out."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from ...effects import InitialTransient
from ...effects.protocol import Effect
from ...equations import TriangularFactor
from ...records import Record
from ..fitting import reading_offset, sweep_effects

PICKLING = (pickle.PicklingError, AttributeError, TypeError)
"""What is raised for effects that cannot be pickled, such as one that holds a function of a notebook's cell."""


@dataclass
class _Stretch:
    """Readings of a stretch, and its factors with these."""

    reading: np.ndarray
    factor: TriangularFactor
    offset: float
    """What was taken off the readings."""

    def with_offset(self, offset: float) -> TriangularFactor:
        """A copy of the factor with another one."""
        copied = TriangularFactor(self.factor.r.shape[1])
        copied.r[:], copied.n_rows = self.factor.r, self.factor.n_rows
        copied.r[:, -1] += (self.offset - offset) * copied.r[:, 0]
        return copied


@dataclass
class Sweeps:
    """What several searches in one record have swept: models of it that each leave out other readings.

    A stretch whose readings are those of an earlier search, with the same columns, is not swept again.
    """

    _known: dict[bytes, list[list[_Stretch]]] = field(default_factory=dict)

    def chunks(
        self, record: Record, effects: Sequence[Effect], edges: np.ndarray, starts: InitialTransient | None
    ) -> list[TriangularFactor]:
        """Factors of the stretches between `edges`, as `sweep_effects` gives them."""
        columns = [column for column in record.columns.values() if isinstance(column, np.ndarray)]
        learned = [(id(type(effect)), vars(effect)) for effect in (*effects, starts) if effect is not None]
        try:
            key = digest(learned, columns, edges, record.skipped)
        except PICKLING:
            key = b""
        apart = len(columns) < len(record.columns) or record.weight is not None or hasattr(record, "sweep_effects")
        if apart or not key:
            return list(sweep_effects(record, effects, edges, starts).chunks)
        offset = reading_offset(record)
        known = self._known.setdefault(key, [[] for _ in edges[1:]])
        assert record.reading is not None
        own = [np.array(record.reading[record.rows(low, high)], float) for low, high in pairwise(edges.tolist())]
        none = TriangularFactor(2 + sum(effect.n_columns() for effect in effects))
        found = [
            _found(reading, stretches) if np.isfinite(reading).any() else _Stretch(reading, none, offset)
            for reading, stretches in zip(own, known, strict=True)
        ]
        if any(stretch is None for stretch in found):
            made = list(sweep_effects(record, effects, edges, starts).chunks)
            for reading, factor, stretches in zip(own, made, known, strict=True):
                if _found(reading, stretches) is None:
                    stretches.append(_Stretch(reading, factor, offset))
            return made
        return [stretch.with_offset(offset) for stretch in found if stretch is not None]


def _found(reading: np.ndarray, stretches: Sequence[_Stretch]) -> _Stretch | None:
    return next((each for each in stretches if np.array_equal(each.reading, reading, equal_nan=True)), None)


def digest(*parts: Any) -> bytes:
    """A short name for anything that can be pickled, the same for the same."""
    return hashlib.blake2b(pickle.dumps(parts)).digest()
