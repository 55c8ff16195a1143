"""Effects of other recorded columns: static, and with lags of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..equations import LagState, lag_differences
from ..records import Block, Record
from .protocol import Effect, time_text
from .thermal import column_text, seconds_array


class Covariate(Effect):
    """A recorded column that acts at once: humidity, pressure, supply voltage, a second temperature, ...

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column.
    """

    kind = "covariate"

    def __init__(self, column: Any = None):
        self.column = column

    def inputs(self) -> list[Any]:
        """The column."""
        return [self.column]

    def learn(self, record: Record) -> None:
        """Fix the column's mean, so that U0 stays the reading under usual conditions."""
        self.mean_ = record.moments(self.column).mean

    def names(self) -> list[str]:
        """The column's own name."""
        return [column_text(self.column)]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """The column less its mean."""
        return block[self.column] - self.mean_, state


class LaggedCovariate(Covariate):
    """A recorded column that acts late: moisture uptake, self-heating by power, a second thermal environment.

    Columns are the recorded one (less its mean) and its lag differences, eq. (19) with the column in place of T.
    """

    kind = "lagged_covariate"

    def __init__(self, column: Any = None, time_constants: Sequence[Any] = (3600.0,), hold: str = "first_order"):
        self.column = column
        self.time_constants = time_constants
        self.hold = hold

    def learn(self, record: Record) -> None:
        """Fix the mean; convert time constants to seconds."""
        super().learn(record)
        self.time_constants_ = seconds_array(self.time_constants)

    def names(self) -> list[str]:
        """``humidity``, ``humidity lag[3600 s]``, ..."""
        name = column_text(self.column)
        return [name, *(f"{name} lag[{time_text(tau)}]" for tau in self.time_constants_)]

    def columns(self, block: Block, state: LagState | None) -> tuple[np.ndarray, LagState]:
        """The column and its lag differences."""
        values = block[self.column]
        lagged, state = lag_differences(values, block.steps, self.time_constants_, state, hold=self.hold)
        return np.column_stack((values - self.mean_, lagged)), state

    def memory(self) -> float:
        """The longest time constant [s]."""
        return float(self.time_constants_.max(initial=0.0))
