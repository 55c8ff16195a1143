"""Readings that do not all count the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
