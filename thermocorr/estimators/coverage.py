"""Temperatures that a record covers, and powers of the static law, eq. (3), that these determine.

A row can lie between the lowest and the highest temperature and still be far from any of them, as between two plateaus:
a hidden extrapolation. Its leverage in the static law is larger there than that of any row of the record (Montgomery,
Peck & Vining, Introduction to Linear Regression Analysis, section 3.8).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from ..records import Record

BINS = 100
"""Parts of the range of temperatures; what a part holds counts as its middle."""
FARTHER = 10.0
"""Leverage between the temperatures of a record, over the largest at any of them, from which a law is not determined:
there, it is more than three times as uncertain as wherever the record has been."""


class Coverage(NamedTuple):
    """Range of the temperatures, its gaps, and the degree of the static law that they determine."""

    degree: int
    """The highest power of the static law that they do, at most the one that is wanted."""
    gaps: tuple[tuple[float, float], ...]
    """Stretches between them in which one power more, by which the law could be checked, would not be known."""

    @classmethod
    def of(cls, record: Record, degree: int) -> Coverage:
        """Of the temperatures of a record, in one pass."""
        name = record.temperature_name
        moments = record.moments(name)
        edges = np.linspace(moments.low, moments.high, BINS + 1)
        if degree < 1 or not moments.low < moments.high:
            return cls(degree, ())
        counts = np.zeros(BINS, int)
        for values in record.chunks(record.columns[name]):
            counts += np.histogram(values, edges)[0]
        empty = counts == 0
        if not empty.any():
            return cls(degree, ())
        while degree > 1 and _leverage(counts, degree)[empty].max() > FARTHER:
            degree -= 1
        unknown = empty & (_leverage(counts, degree + 1) > FARTHER)
        ends = np.flatnonzero(np.diff(unknown, prepend=False, append=False)).reshape(-1, 2)
        return cls(degree, tuple((float(edges[low]), float(edges[high])) for low, high in ends))


def _leverage(counts: np.ndarray, degree: int) -> np.ndarray:
    """Leverage of each bin's middle in a law of that degree, over the largest of those that hold rows, shape (BINS,).

    Infinite where the bins that hold rows do not determine the law.
    """
    middle = (np.arange(BINS) + 0.5) / (BINS / 2) - 1
    basis = legendre.legvander(middle, degree)
    rows = np.sqrt(counts)[:, None] * basis
    half = np.asarray(np.linalg.qr(rows, mode="r"))
    sizes = np.abs(np.diag(half))
    if not sizes.min() > 1e-9 * sizes.max():
        return np.where(counts > 0, 1.0, np.inf)
    found = np.sum(np.linalg.solve(half.T, basis.T) ** 2, axis=0)
    return np.asarray(found / found[counts > 0].max())
