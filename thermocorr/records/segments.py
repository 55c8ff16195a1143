"""Stretches of a record: segments, gaps and flags of rows."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .hints import Counted, RunLabel


class Segment(NamedTuple):
    """A stretch without a gap: rows ``start:stop`` in the record's time order."""

    start: Counted
    stop: Counted
    run: RunLabel = None

    @property
    def n_rows(self) -> int:
        """Number of rows, those passed over included."""
        return self.stop - self.start


class SegmentStart(NamedTuple):
    """Relation of a new segment to one of the fitted record."""

    key: int | None
    """Number of the fitted segment that it belongs to; None for a stretch that hangs on none."""
    segment_zero: float
    """Stamp of that segment's first sample."""
    step: float | None
    """Time since the sample whose state it continues [s]; None where it starts afresh."""


def holes(places: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Stretches of consecutive numbers among sorted ones: the first of each, and the one behind its last."""
    return places[np.diff(places, prepend=-2) != 1], places[np.diff(places, append=-2) != 1] + 1


class Flags:
    """One flag for each of many rows.

    `n` (int): Rows. `flag` (str): That of all of them, to begin with.
    """

    def __init__(self, n: int, flag: str = ""):
        self.codes = np.zeros(n, np.int8)
        self.names = [flag]

    def __len__(self) -> int:
        return len(self.codes)

    def __iter__(self) -> Iterator[str]:
        return iter(self.tolist())

    def __setitem__(self, rows: Any, flag: str | Flags | np.ndarray) -> None:
        if isinstance(flag, np.ndarray):
            names, codes = np.unique(flag.astype(str), return_inverse=True)
            self.codes[rows] = self._codes_of(names.tolist())[codes]
        elif isinstance(flag, Flags):
            known = self._codes_of(flag.names)
            self.codes[rows] = known[0] if len(known) == 1 else known[flag.codes]
        else:
            self.codes[rows] = self._codes_of([flag])[0]

    def _codes_of(self, names: list[str]) -> np.ndarray:
        self.names += [name for name in dict.fromkeys(names) if name not in self.names]
        return np.array([self.names.index(name) for name in names], np.int8)

    def are(self, *flags: str) -> np.ndarray:
        """True if each row has one of these flags, shape (n,)."""
        found = np.zeros(len(self), bool)
        for flag in flags:
            if flag in self.names:
                found |= self.codes == self.names.index(flag)
        return found

    def counts(self) -> dict[str, int]:
        """Number of rows with each flag that occurs."""
        counted = np.bincount(self.codes, minlength=len(self.names)).tolist()
        return {name: count for name, count in zip(self.names, counted, strict=True) if count}

    def texts(self) -> np.ndarray:
        """An array of texts, shape (n,)."""
        return np.asarray(np.array(self.names, dtype=object)[self.codes])

    def tolist(self) -> list[str]:
        """A list of texts."""
        found: list[str] = self.texts().tolist()
        return found

    def column(self) -> Any:
        """A column of a DataFrame."""
        return _texts(tuple(self.names)).take(self.codes.astype(np.intp))


@lru_cache(maxsize=64)
def _texts(names: tuple[str, ...]) -> Any:
    """An array of pandas' own texts: to make one takes longer than to correct a few samples."""
    return pd.Series(names).array
