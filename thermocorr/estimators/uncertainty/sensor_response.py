"""What the thermometer's errors do to the bias."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...effects.expressions import follows_temperature
from ...effects.signals import DelayState
from ...equations import LagState
from ...records import Record
from ...records.units import difference_unit
from .declared import Sensor

KELVIN = {"degF": 1.8}
"""Degrees of a thermometer's unit in a kelvin, where that is not 1."""
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
    kelvin = KELVIN.get(difference_unit(model.reading_.temperature_unit), 1.0)
    slope = kelvin * _moved(model, record, np.full(n, h), since_learning=True) / h
    fixed = (slope * sensor.offset) ** 2
    if sensor.own_noise:
        signs = np.random.default_rng(0).choice([-h, h], n)  # white, as the noise is: lags average it
        own = own + float(np.nanmean(_moved(model, record, signs) ** 2)) * (kelvin / h * sensor.own_noise) ** 2
    if sensor.time_constant:
        own = own + (slope / kelvin * _rate(record) * sensor.time_constant) ** 2
    return fixed, own


def _moved(model: Any, record: Record, change: np.ndarray, since_learning: bool = False) -> np.ndarray:
    """Change of the bias in each row when the temperature changes, shape (n,); NaN in rows that are passed over.

    A change `since_learning` was there before the first row: lags have settled to it.
    """
    features = model.features_
    kept, starts, states = features.resume(record)
    T = np.asarray(kept.columns[kept.temperature_name][:], float) + change
    moved = replace(kept, columns={**kept.columns, kept.temperature_name: T}, known_moments={})
    result = np.full(record.n_rows, np.nan)
    later = states
    if since_learning:
        follow = [follows_temperature(effect) for effect in features.effect_list()]
        later = {
            key: [_settled(state, change[0]) if f else state for state, f in zip(own, follow, strict=True)]
            for key, own in states.items()
        }
    before = model.weighed(features.walk_resumed(kept, starts, states))
    after = model.weighed(features.walk_resumed(moved, starts, later))
    for (block, old), (_, new) in zip(before, after, strict=True):
        result[block.rows] = model.removed_part(new - old)
    return result


def _settled(state: Any, change: float) -> Any:
    """State of an effect that follows the temperature, after this has been higher for long."""
    if isinstance(state, LagState):
        return state._replace(temperature=state.temperature + change)
    if isinstance(state, DelayState):
        return state._replace(temperature=state.temperature + change)
    return tuple(_settled(one, change) for one in state) if type(state) is tuple else state


def _rate(record: Record) -> np.ndarray:
    """Rate of change of the temperature in each row [K/s]."""
    result = np.zeros(record.n_rows)
    for block in record.blocks():
        result[block.rows] = np.gradient(block.temperature, block.seconds) if len(block) > 1 else np.nan
    return result
