"""Columns that stand for a fitted model in the bins of its record: its own, or those of a whole spectrum."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone

from ...effects import InitialTransient
from ...effects.protocol import Effect
from ...effects.thermal import ThermalLag
from ...records import History
from ..binned import Binned, binned_columns
from ..time_constants.columns import MOST_SEGMENTS

SPECTRUM_SHARE = 1 / 8
"""Longest time constant that may be there unseen, as a share of the longest segment: slower bodies are noise."""
BEYOND_CHOSEN = 1.3
"""It is at least this many times the longest one chosen."""


@dataclass(frozen=True, kw_only=True)
class Basis:
    """Effects, and their columns in the bins of the record."""

    effects: list[Effect]
    history: History
    """The fitted record's, with the states of these effects at its end."""
    own: bool
    """Whether these are the model's own effects."""
    columns: np.ndarray
    """Means of the columns that have an error, 1 first, shape (bins, p)."""
    free: np.ndarray
    """Where these stand among the intercept and all columns, shape (p,)."""
    width: int
    """The intercept and all columns."""
    reading: np.ndarray
    """Means of the readings, shape (bins,); the starts of many segments are taken out."""
    offset: float
    """What was taken off the readings."""
    segment: np.ndarray
    begins: np.ndarray
    count: np.ndarray
    rows: int
    """Rows of a bin."""

    def lags(self) -> np.ndarray:
        """Which of the columns are lags, shape (p,)."""
        lags = np.array([False, *(isinstance(e, ThermalLag) for e in self.effects for _ in e.names())])
        return np.asarray(lags[self.free])

    def bin_seconds(self) -> float:
        """Usual time from bin to bin [s]."""
        steps = np.diff(self.begins)[np.diff(self.segment) == 0]
        return float(np.median(steps)) if len(steps) else self.history.usual_step


def basis_of(model: Any, bins: Binned, offset: float) -> Basis:
    """The basis of a fitted model, from the bins of its record and what was taken off the readings there."""
    effects, history, grid = model.features_.effect_list(), model.features_.history_, _spectrum(model)
    if bins.columns is not None:
        means, own = bins.columns, True
    else:
        effects, own = [_with_times(effect, grid, history) for effect in effects], not len(grid)
        means, ends = binned_columns(effects, history, bins)
        history = replace(history, end_states=tuple(ends))
    columns = np.column_stack((np.ones(len(means)), means))
    free, starts = np.arange(columns.shape[1]), np.zeros(len(columns))
    if len(history.record.segments) > MOST_SEGMENTS:  # their starts have no say on the rest
        decays = np.array([False, *(isinstance(e, InitialTransient) for e in effects for _ in e.names())])
        fitted = np.array([isinstance(e, InitialTransient) for e in model.features_.effect_list() for _ in e.names()])
        free, starts = np.flatnonzero(~decays), columns[:, decays] @ model.coef_[fitted]
    known = bins.count >= bins.width / 2
    return Basis(
        effects=effects, history=history, own=own, columns=columns[known][:, free], free=free, width=columns.shape[1],
        reading=(bins.reading - starts)[known], offset=offset, segment=bins.segment[known],
        begins=bins.begins[known], count=bins.count[known], rows=bins.width,
    )  # fmt: skip


def _spectrum(model: Any) -> np.ndarray:
    """Time constants that may be there, for a model that has searched its own [s]; empty for others."""
    choice, record = model.search_, model.features_.history_.record
    if choice is None or choice.reference is None or model.products or not len(choice.time_constants):
        return np.zeros(0)
    span = max(record.duration(segment) for segment in record.segments)
    longest = max(SPECTRUM_SHARE * span, BEYOND_CHOSEN * choice.time_constants.max())
    return np.asarray(choice.grid[choice.grid <= longest])


def _with_times(effect: Effect, grid: np.ndarray, history: History) -> Effect:
    """A lag with all time constants of a grid; other effects, and all where there is no grid, as they are."""
    if not (len(grid) and isinstance(effect, ThermalLag)):
        return effect
    wide: Effect = clone(effect).set_params(time_constants=grid)
    wide.learn(history.record)
    return wide
