"""What the thermometer's errors do to the bias."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...records import Record
from .declared import Sensor

STEP = 1e-4
"""Temperature by which the bias is differentiated, as a share of the fitted range: far above rounding."""


def sensor_variance(model: Any, record: Record, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the bias in each row, from an offset of the thermometer (shared by all rows) and from the rest.

    The bias is differentiated by walking through the record once more, the temperature a little higher: every effect
    that uses it has its say.
    """
    n = record.n_rows
    fixed, own = np.zeros(n), np.zeros(n)
    if not (sensor.offset or sensor.own_noise or sensor.time_constant):
        return fixed, own
    low, high = model.temperature_range_
    h = STEP * (high - low)
    slope = _moved(model, record, np.full(n, h)) / h
    fixed = (slope * sensor.offset) ** 2
    if sensor.own_noise:
        signs = np.random.default_rng(0).choice([-h, h], n)  # white, as the noise is: lags average it
        own = own + float(np.nanmean(_moved(model, record, signs) ** 2)) / h**2 * sensor.own_noise**2
    if sensor.time_constant:
        own = own + (slope * _rate(record) * sensor.time_constant) ** 2
    return fixed, own


def _moved(model: Any, record: Record, change: np.ndarray) -> np.ndarray:
    """Change of the bias in each row when the temperature changes, shape (n,); NaN in rows that are passed over."""
    features = model.features_
    kept, starts, states = features.resume(record)
    T = np.asarray(kept.columns[kept.temperature_name][:], float) + change
    moved = replace(kept, columns={**kept.columns, kept.temperature_name: T}, known_moments={})
    removed = [effect.removed_by_correct for effect in features.effect_list()]
    result = np.full(record.n_rows, np.nan)
    walks = (model.weighed(features.walk_resumed(each, starts, states)) for each in (kept, moved))
    for (block, before), (_, after) in zip(*walks, strict=True):
        result[block.rows] = (after - before)[:, removed].sum(axis=1)
    return result


def _rate(record: Record) -> np.ndarray:
    """Rate of change of the temperature in each row [K/s]."""
    result = np.zeros(record.n_rows)
    for block in record.blocks():
        if len(block) > 1:
            result[block.rows] = np.gradient(block.temperature, block.seconds)
    return result
