"""Times of a stream that are numbers: which are Unix times is told from the first of them, as a file's from all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.epochs import EPOCHS, LARGEST_SECONDS, SEVERAL, unix_unit
from ..records.grammar import number


class CountedTimes:
    """Unix times in ms, us or ns among the times of a stream, told by their size.

    A stream does not wait for its second row: the first time decides, and the first `SEVERAL` must agree with it.

    Parameters
    ----------
    kind : str
        Kind of the times that are wanted, see `Times.kind`.
    """

    def __init__(self, kind: str):
        self.kind = kind
        self.unit: str | None = None
        """"ms", "us" or "ns"; None for times that are no such numbers, and before the first one."""
        self._looked_at = 0
        self._first: list[float] = []

    def read(self, cell: str) -> Any:
        """The time in a cell: a date, in seconds [s] where these are wanted; the cell as it stands for any other time.

        Parameters
        ----------
        cell : str
        """
        if self.unit is None and self._looked_at >= SEVERAL:
            return cell
        self._looked_at += 1
        try:
            count = number(cell, "the time")
        except RecordError:  # a date, or what is none: whoever needs a time of a kind says so
            return cell
        if np.isnan(count):
            return cell
        if not self._first:
            found = unix_unit(count, count)
            self.unit = found if found in EPOCHS else None
        if len(self._first) < SEVERAL:
            self._first.append(count)
        if self.unit is None:
            return cell
        if self.kind == "seconds":
            return count / EPOCHS[self.unit]
        zone = "UTC" if self.kind == "datetime with time zone" else None
        exact: Any = int(cell) if cell.isdecimal() else count
        try:
            return pd.Timestamp(exact, unit=self.unit, tz=zone)
        except (ValueError, ArithmeticError):  # beyond the dates of pandas
            return cell

    def check(self, name: str) -> None:
        """Refuse times of which the first does not tell what the others are.

        Parameters
        ----------
        name : str
            Their column.

        Raises
        ------
        RecordError
            Where the first `SEVERAL` are not all Unix times of one unit, and are no seconds.
        """
        if len(self._first) < SEVERAL:
            return
        found = unix_unit(min(self._first), max(self._first))
        if self.unit == (found if found in EPOCHS else None) and (
            self.unit is not None or np.median(self._first) < LARGEST_SECONDS
        ):
            return
        begin = ", ".join(f"{one:.10g}" for one in self._first)
        raise RecordError(
            f"The times in {name} begin with {begin}: no seconds, and no Unix times of one unit and of this century. "
            "Is the first row damaged? Begin behind it, or write dates."
        )
