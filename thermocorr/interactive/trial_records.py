"""Built-in records to try the workbench on: in most of them something is hidden."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import pandas as pd

from ..datasets import load_voltage_reference, make_record


class TrialRecord(NamedTuple):
    """A built-in record."""

    title: str
    make: partial[pd.DataFrame]

    @property
    def loader(self) -> str:
        """Name of the function in `thermocorr.datasets` that makes it."""
        return self.make.func.__name__

    def code(self) -> str:
        """What makes it, as Python."""
        given = [*map(repr, self.make.args), *(f"{name}={value!r}" for name, value in self.make.keywords.items())]
        return f"{self.loader}({', '.join(given)})"


def _simulated(title: str, seed: int, **effects: float) -> TrialRecord:
    return TrialRecord(title, partial(make_record, 20_000, effects=effects, seed=seed))


FIRST = "the built-in voltage reference with a hidden effect"
SAMPLES = {
    FIRST: TrialRecord("voltage reference, two weeks", partial(load_voltage_reference, hidden="moisture")),
    "simulated device 1": _simulated("simulated device 1", 11, hysteresis=1.5),
    "simulated device 2": _simulated("simulated device 2", 12, step=1.0, lagged_covariate=1.5),
    "simulated device 3": _simulated("simulated device 3", 13, covariate=0.0),
    "simulated device 4": _simulated("simulated device 4", 14, drift=1.0, interaction=1.0),
}
"""Name -> record. What is hidden is for the diagnosis to find; in one of them it is nothing."""
