"""Stretches of a log without a gap."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Segment(NamedTuple):
    """A stretch without a gap: rows ``start:stop`` in the record's time order."""

    start: int
    stop: int
    run: object = None

    @property
    def n_rows(self) -> int:
        """Number of rows, those passed over included."""
        return self.stop - self.start


class SegmentStart(NamedTuple):
    """How a segment of a new record hangs on one of the fitted record."""

    key: int | None
    """Number of the fitted segment that it belongs to; None for a stretch that hangs on none."""
    segment_zero: float
    """Stamp of that segment's first sample."""
    step: float | None
    """Time since the sample whose state it continues [s]; None where it starts afresh."""


def holes(places: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Stretches of consecutive numbers among sorted ones: the first of each, and the one behind its last."""
    return places[np.diff(places, prepend=-2) != 1], places[np.diff(places, append=-2) != 1] + 1
