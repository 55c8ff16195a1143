"""The effect protocol: a physical cause that turns a record into named columns, state in, state out."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator

from ..records import Block, Record


class Effect(BaseEstimator):
    """A cause that moves the reading: base class of the catalogue and of a user's own effects.

    An own effect needs a constructor that stores its parameters, `names`, and `columns`::

        class FanNoise(Effect):
            kind = "fan_noise"
            def __init__(self, column="fan_rpm"):
                self.column = column
            def inputs(self):
                return [self.column]
            def names(self):
                return [f"{self.column}^2"]
            def columns(self, block, state):
                return block[self.column] ** 2, state

    It then takes part in a model through ``DynamicBiasRegressor(effects=[FanNoise()])``.
    """

    kind: ClassVar[str] = "own"
    """Stable identifier of the physical cause."""
    removed_by_correct: ClassVar[bool] = True
    """False for what the user wants to keep in the corrected reading, such as the drift of a standard."""

    def inputs(self) -> list[Any]:
        """Recorded columns that the effect reads beside the temperature."""
        return []

    def learn(self, record: Record) -> None:
        """Derive what the columns need from the record that is fitted (attributes that end in an underscore)."""

    def names(self) -> list[str]:
        """Names of the columns, known after `learn`."""
        raise NotImplementedError

    def units(self) -> list[str]:
        """Unit of each column; "" where it has none or where nobody knows."""
        return [""] * len(self.names())

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Columns of one block, and the state for the next one.

        Parameters
        ----------
        block : Block
            Consecutive rows of one segment: ``block.temperature``, ``block["humidity"]``, ``block.steps`` [s],
            ``block.elapsed`` [s] since the segment began, ``block.seconds`` [s] since the fitted record began.
        state : object
            What this method returned for the block before; None where a segment begins.

        Returns
        -------
        columns : array of shape (n,) or (n, len(names()))
        state : object
        """
        raise NotImplementedError

    def memory(self) -> float:
        """Longest time constant of the state [s]: how long an unknown start is felt. 0 without a state."""
        return 0.0

    def label(self) -> str:
        """Name of the contribution in tables and plots."""
        return self.kind.replace("_", " ") + "".join(f": {name}" for name in self.inputs())


def time_text(seconds: float) -> str:
    """A time constant in a column's name: ``lag[900 s]``; six digits tell any two apart that a fit can."""
    return f"{seconds:.6g} s"
