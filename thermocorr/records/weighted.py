"""Readings that do not all count the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from .numbers import numeric_reading
from .screen import LeftOut
from .times import Floats


@dataclass(frozen=True)
class WeightedReading:
    """Readings, and how much each counts in a fit: the y of whatever reads a record."""

    y: Any
    """As the user gave them."""
    weight: Floats
    """Shape (n_rows,); zero for a reading that is not learned from."""

    @property
    def name(self) -> Any:
        """Name of the readings' column, where they have one."""
        return self.y.columns[0] if hasattr(self.y, "columns") else getattr(self.y, "name", None)

    @property
    def attrs(self) -> dict[str, Any]:
        """What is noted of the readings."""
        return dict(getattr(self.y, "attrs", {}))


def reading_of(y: Any, X: Any) -> tuple[NDArray[Any] | None, Floats | None]:
    """Readings as numbers, those without weight left out, and their weights; None where there are none."""
    if not isinstance(y, WeightedReading):
        return None if y is None else numeric_reading(y, X), None
    reading = numeric_reading(y.y, X)
    return cast(Any, LeftOut(reading, np.flatnonzero(y.weight == 0))), y.weight
