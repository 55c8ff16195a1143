"""Columns of many effects, averaged over short stretches of time: what diagnosis works on.

Averages commute with linear least squares: a model of the readings is a model of their averages, with the same
coefficients and fewer, quieter rows.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..effects.protocol import Effect
from ..effects.stream import own_starts
from ..records import BLOCK_ROWS, Record

STRETCHES = 2500
"""Stretches that a record is averaged over: enough for slow causes, few enough for hundreds of candidates."""

NEAR = 100
"""Stretches over which the size of the noise is measured."""
UNEVEN = 2.0
"""Largest over smallest size of the noise, above which the noise counts as changing with time."""


@dataclass(frozen=True, kw_only=True)
class Averages:
    """Averages over stretches of time, none of which crosses from one segment into the next."""

    reading: np.ndarray
    """Shape (n,)."""
    columns: list[np.ndarray]
    """One array of shape (n, width) for each effect."""
    counts: np.ndarray
    """Readings in each stretch."""
    segment: np.ndarray
    """Number of the segment of each stretch."""
    seconds: np.ndarray
    """Middle of each stretch [s]."""
    weight: np.ndarray
    """Shape (n,) or (1,): 1, or less where the noise is larger than usual. Reading and columns have been multiplied
    by it, so it is also the column of the constant."""


def averaged(
    record: Record, effects: Sequence[Effect], n_stretches: int = STRETCHES, *, weight: np.ndarray | None = None
) -> Averages:
    """Average the readings and all effects' columns over stretches of equal numbers of rows.

    Rows without a reading are left out of the averages, columns and all. Effects must have learned the record. Where
    the noise clearly changes in the course of the record, readings and columns are divided by its relative size:
    weighted least squares. `weight` gives the weights where they are known.
    """
    assert record.reading is not None
    width = max(1, -(-record.n_used // n_stretches))
    size = max(width, BLOCK_ROWS // width * width)
    widths = [len(effect.names()) for effect in effects]
    parts: list[list[np.ndarray]] = [[] for _ in effects]
    readings, counts, segments, seconds, jumps = [], [], [], [], []
    states: list[Any] = []
    for block in record.blocks(size, starts=own_starts(record)):
        if block.start == record.segments[block.segment].start:
            states = [None] * len(effects)
        reading = np.asarray(record.reading[block.rows], float)
        known = np.isfinite(reading)
        starts = np.arange(0, len(block), width)
        count = np.add.reduceat(known.astype(float), starts)
        kept = count > 0
        share = np.where(known, 1.0, 0.0)
        readings.append((np.add.reduceat(np.where(known, reading, 0.0), starts) / np.maximum(count, 1))[kept])
        seconds.append((np.add.reduceat(block.seconds * share, starts) / np.maximum(count, 1))[kept])
        counts.append(count[kept])
        segments.append(np.full(int(kept.sum()), block.segment))
        if weight is None:
            jumps.append(_jumps(reading, starts)[kept])
        for i, effect in enumerate(effects):
            columns, states[i] = effect.columns(block, states[i])
            columns = np.asarray(columns).reshape(len(block), widths[i])
            if not known.all():
                columns = columns * share[:, None]
            parts[i].append((np.add.reduceat(columns, starts, axis=0) / np.maximum(count, 1)[:, None])[kept])
    counted = np.concatenate(counts)
    if weight is None:
        weight = 1 / _unevenness(np.concatenate(jumps))
    return Averages(
        reading=np.concatenate(readings) * weight,
        columns=[np.concatenate(part) * weight[:, None] for part in parts],
        counts=counted,
        segment=np.concatenate(segments),
        seconds=np.concatenate(seconds),
        weight=weight,
    )


def _jumps(reading: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Mean size of the steps between neighbouring readings of each stretch; NaN where there are none."""
    jump = np.abs(np.diff(reading, prepend=np.nan))
    known = np.isfinite(jump)
    counts = np.add.reduceat(known.astype(float), starts)
    sums = np.add.reduceat(np.where(known, jump, 0.0), starts)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _unevenness(jumps: np.ndarray) -> np.ndarray:
    """Size of the noise near each stretch over its usual one; 1 unless it clearly changes."""
    level = pd.Series(jumps).rolling(NEAR, center=True, min_periods=NEAR // 4).median().bfill().ffill().to_numpy()
    if len(level) < 10 * NEAR or not np.all(level > 0):
        return np.ones(len(jumps))
    low, usual, high = np.quantile(level, (0.05, 0.5, 0.95))
    return level / usual if high > UNEVEN * low else np.ones(len(jumps))


def filled(record: Record, used: Collection[Any], most_missing: float = 0.05) -> Record:
    """The record with short holes in suspect columns filled by straight lines; columns with more missing left out.

    Columns that are `used`, the temperature among them, stay as they are: where one is missing, a segment has ended.
    """
    columns = {}
    for name, values in record.columns.items():
        numbers = np.asarray(values, float)
        missing = np.isnan(numbers)
        if name in used or not missing.any():
            columns[name] = values
        elif missing.mean() <= most_missing:
            rows = np.arange(len(numbers))
            columns[name] = np.interp(rows, rows[~missing], numbers[~missing])
    return replace(record, columns=columns, known_moments={})
