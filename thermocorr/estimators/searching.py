"""The one pass that turns a record into the factors that `search` works on."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..effects import InitialTransient, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..records import Record
from .features import DiffusiveFeatures
from .fitting import block_rows, require_rows, sweep
from .reading import Reading, check_plausible
from .search import (
    MIN_ROWS,
    N_BLOCKS,
    PENALTIES,
    GridLayout,
    TimeConstantChoice,
    log_grid,
    search_time_constants,
    spread,
)

MAX_DECAY_SEGMENTS = 8
"""With more segments than this the search leaves start-up decays out."""


def choose_from_record(
    features: DiffusiveFeatures, X: Any, y: Any, count: int | None, decay_share: float
) -> TimeConstantChoice:
    """Search time constants for a record.

    Parameters
    ----------
    features : DiffusiveFeatures
        The model without lags: static law and further effects, which take part unpenalised.
    X, y : as for `DynamicBiasRegressor.fit`
    count : int or None
        How many to choose; None leaves it open.
    decay_share : float
        Decay columns for time constants up to this share of their segment.
    """
    record = features.learn(X, y)
    reading = Reading.of(X, y, record)
    static = features.effect_list()
    n_static = sum(len(effect.names()) for effect in static)
    require_rows(reading.n_readings, n_static)
    check_plausible(record, reading)
    span = max(record.duration(segment) for segment in record.segments)
    grid = log_grid(record.usual_step(), span)
    if reading.n_readings < MIN_ROWS:
        wanted = count if count is not None else 3
        fitting = max(1, min(wanted, (reading.n_readings - n_static - 2) // 4))
        return TimeConstantChoice(
            spread(grid, span, fitting), PENALTIES[2], grid, 1 / 3, PENALTIES[2], np.zeros((0, 0, 0))
        )
    effects, layout = _grid_effects(features, record, static, n_static, grid, span, decay_share)
    steps = walk(effects, record, starts=own_starts(record), size=block_rows(record.n_used, N_BLOCKS), extra=1)
    blocks = sweep(record, steps, N_BLOCKS).chunks
    return search_time_constants(blocks, layout, temperature_std(record), count)


def _grid_effects(
    features: DiffusiveFeatures,
    record: Record,
    static: list[Effect],
    n_static: int,
    grid: np.ndarray,
    span: float,
    decay_share: float,
) -> tuple[list[Effect], GridLayout]:
    """Effects of the whole grid, learned, and which of their columns is what."""
    lag = ThermalLag(grid, features.hold)
    transient = InitialTransient(grid, decay_share if len(record.segments) <= MAX_DECAY_SEGMENTS else 0.0)
    for effect in (lag, transient):
        effect.learn(record)
    n_free = 1 + n_static
    first = n_free + len(grid)
    decays: list[list[int]] = [[] for _ in grid]
    for key, taus in transient.decays_.items():
        at = first + transient.first_column_[key]
        for offset, tau in enumerate(taus):
            decays[int(np.searchsorted(grid, tau))].append(at + offset)
    return [*static, lag, transient], GridLayout(grid, span, n_free, decays)


def temperature_std(record: Record) -> float:
    """Standard deviation of the temperature over the rows inside segments [K]."""
    count, mean, squares = 0, 0.0, 0.0
    for block in record.blocks():
        T = block.temperature
        shift, total = float(T.mean()) - mean, count + len(T)
        squares += float(T.var()) * len(T) + shift**2 * count * len(T) / total
        mean += shift * len(T) / total
        count = total
    return float(np.sqrt(squares / count))
