"""Times of a stream that are numbers: which are Unix times is told by most of its first ones, as a file's by all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.epochs import EPOCHS, LARGEST_SECONDS, SEVERAL, unix_unit
from ..records.grammar import number

FIRST = 5
"""Times that are asked at most: what most of them are, all are."""


class CountedTimes:
    """Unix times in ms, us or ns among the times of a stream, told by their size.

    A stream does not wait: the times decide that have come, so the first one for itself, until `FIRST` have come. Where
    several lie there already, they are asked together before the first is read, see `foresee`.

    Parameters
    ----------
    kind : str
        Kind of the times that are wanted, see `Times.kind`.
    """

    def __init__(self, kind: str):
        self.kind = kind
        self.unit: str | None = None
        """"ms", "us" or "ns"; None for times that are no such numbers, and before the first one."""
        self._first: list[float] = []
        self._kinds: Counter[str] = Counter()
        """How many of the first times are Unix times in "ms", "us", "ns", how many seconds ("s"), or neither ("")."""
        self._looked_at = 0

    def foresee(self, cells: Iterable[str]) -> None:
        """Let the first times of a stream decide together, if they are several, before one of them is read.

        Parameters
        ----------
        cells : iterable of str
        """
        counts = [count for cell in cells if (count := _count(cell)) is not None][:FIRST]
        if len(counts) < SEVERAL:
            return
        self._first, self._kinds = [], Counter()
        for count in counts:
            self._decide(count)
        self._looked_at = FIRST

    def read(self, cell: str) -> Any:
        """The time in a cell: a date, in seconds [s] where these are wanted; the cell as it stands for any other time.

        Parameters
        ----------
        cell : str

        Raises
        ------
        RecordError
            For a number that is no Unix time in the unit that most of the first ones have.
        """
        if not self._first and self._looked_at >= FIRST:  # dates
            return cell
        count = _count(cell)
        if self._looked_at < FIRST:
            self._looked_at += 1
            if count is not None:
                self._decide(count)
        if count is None or self.unit is None:  # a false time among seconds is found by those around it
            return cell
        if _kind_of(count) != self.unit:
            raise RecordError(
                f"the time is {cell.strip()[:60]}, and most of the first ones are Unix times in {self.unit}"
            )
        if self.kind == "seconds":
            return count / EPOCHS[self.unit]
        zone = "UTC" if self.kind == "datetime with time zone" else None
        exact: Any = int(cell) if cell.isdecimal() else count
        return pd.Timestamp(exact, unit=self.unit, tz=zone)

    def _decide(self, count: float) -> None:
        """Add one to the first times; of kinds that come alike often, Unix times go before others."""
        self._first.append(count)
        self._kinds[_kind_of(count)] += 1
        found = max(self._kinds, key=lambda kind: (self._kinds[kind], kind in EPOCHS))
        self.unit = found if found in EPOCHS else None

    def check(self, name: str) -> None:
        """Refuse times of which most do not tell what all are.

        Parameters
        ----------
        name : str
            Their column.

        Raises
        ------
        RecordError
            Where of the first `SEVERAL` or more no more than half are of one kind, or are no times at all.
        """
        found = self.unit or "s"
        if len(self._first) < SEVERAL or 2 * self._kinds[found] > len(self._first):
            return
        begin = ", ".join(f"{one:.10g}" for one in self._first)
        raise RecordError(
            f"The times in {name} begin with {begin}: most are no seconds, and no Unix times of one unit and of this "
            "century. Are the first rows damaged? Begin behind them, or write dates."
        )


def _count(cell: str) -> float | None:
    """The number in a cell; None for a date, and for what is none: whoever needs a time of a kind says so."""
    try:
        count = number(cell, "the time")
    except RecordError:
        return None
    return None if np.isnan(count) else count


def _kind_of(count: float) -> str:
    """What a number is by its size: a Unix time in "ms", "us" or "ns", seconds of any origin ("s"), or neither ("")."""
    return unix_unit(count, count) or ("s" if count < LARGEST_SECONDS else "")
