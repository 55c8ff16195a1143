"""Effects that are planted by columns of their own: a user's, and kinds that the simulation has no formula for."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import pandas as pd

from ..records import Layout, read_record
from ._planted import Run
from ._propagate import Array


def of_own_columns(effect: Any, runs: Sequence[Run], rng: np.random.Generator) -> list[Array]:
    """Sum of an effect's columns, each of the same size and of either sign, at every sample of each run.

    Parameters
    ----------
    effect : Effect
        It learns the runs as it learns a record.
    runs : sequence of Run
    rng : Generator
        Draws the signs.
    """
    frames = [
        pd.DataFrame({**run.columns, "began": run.began + run.time, "number": number})
        for number, run in enumerate(runs)
    ]
    layout = Layout("temperature", "began", run="number")
    record = read_record(pd.concat(frames), layout, needed=list(runs[0].columns), quiet=True)
    effect = deepcopy(effect)
    effect.learn(record)
    parts, state = [], None
    for block in record.blocks():
        columns, state = effect.columns(block, None if block.begins else state)
        parts.append(np.asarray(columns, float).reshape(len(block), -1))
    columns = np.concatenate(parts)
    sizes = np.sqrt(np.mean((columns - columns.mean(axis=0)) ** 2, axis=0))
    signs = rng.choice((-1.0, 1.0), len(sizes)) / np.where(sizes > 0, sizes, np.inf)
    return np.split(columns @ signs, np.cumsum([len(run.time) for run in runs])[:-1])
