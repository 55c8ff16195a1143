"""Errors of every row: of coefficients, noise and sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...effects.expressions import follows_temperature
from ...effects.signals import DelayState
from ...effects.stream import Walked, resume, walk
from ...equations import LagState
from ...records import Block, Record
from ...records.units import difference_unit
from .declared import Sensor
from .joint import JointErrors, NoiseModel

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


@dataclass(frozen=True, kw_only=True)
class RowErrors:
    """Variances in the rows of one block, in the unit of the reading squared unless said, shape (n,) each."""

    level: np.ndarray
    """The bias: what all rows of a record like the fitted one share."""
    coefficients: np.ndarray
    """The bias: the rest of what the coefficients make, and the distance of the fit from the best estimate."""
    extrapolation: np.ndarray
    """The bias, outside the fitted temperatures; those inside the device, as its lags have them, included."""
    noise: np.ndarray
    """Variance of the noise, over that of `NoiseModel.variance`."""
    shared: np.ndarray
    """Covariance of the bias with the wandering noise of its own row: above 0 shortly after the fitted record."""
    columns: np.ndarray
    """What the coefficients are multiplied by, shape (n, 1 + p): for covariances between rows."""

    @property
    def bias(self) -> np.ndarray:
        """Variance of the bias, or of the modelled reading, without noise."""
        return np.asarray(self.level + self.coefficients + self.extrapolation)

    def of_readings(self, noise: NoiseModel) -> np.ndarray:
        """Variance of a corrected reading, or of one to come, noise included."""
        return np.asarray(np.maximum(self.bias + noise.variance * self.noise - 2 * self.shared, 0.0))


class ErrorWalk:
    """Walks through a record with a model and its joint errors.

    `model` (DynamicBiasRegressor): Fitted. `joint` (JointErrors): Of that model. `removed` (bool): Errors of the bias
    that `correct` removes; else of the modelled reading, U0 and all effects.
    """

    def __init__(self, model: Any, joint: JointErrors, removed: bool):
        self.model, self.joint, self.removed = model, joint, removed
        kept = [effect.removed_by_correct or not removed for effect in joint.effects for _ in effect.names()]
        self.used = np.array([not removed, *kept])
        shared = joint.mean[self.used] @ joint.half[self.used]
        size = float(np.linalg.norm(shared))
        self.level = shared / size if size > 0 else shared
        self.through = np.column_stack((joint.half, joint.half @ self.level, joint.coef))
        """What columns are multiplied by: directions of their covariance, what all rows share, the best estimate."""

    def blocks(self, record: Record) -> Iterator[tuple[Block, np.ndarray, RowErrors]]:
        """Each block with the value that the model gives (the bias, or the modelled reading), and its errors."""
        model, joint = self.model, self.joint
        own, starts, states = model.features_.resume(record)
        walked: list[Walked] = []

        def noted() -> Iterator[Walked]:
            for step in model.features_.walk_resumed(own, starts, states):
                walked[:] = [step]
                yield step

        wide: Iterator[Walked] = iter(())
        if not joint.own:
            kept, begun, known = resume(joint.effects, joint.history, record)
            wide = walk(joint.effects, kept, zero=joint.history.zero, starts=begun, states=known)
        parts = [effect.removed_by_correct or not self.removed for effect in model.features_.effect_list()]
        constant = 0.0 if self.removed else model.intercept_
        for block, contributions in model.weighed(noted()):
            value = contributions[:, parts].sum(axis=1) + constant
            columns = next(wide, walked[0]).columns
            yield block, value, self.errors(columns, block.seconds, block.temperature, value, block.segment_key)

    def errors(
        self, columns: np.ndarray, seconds: np.ndarray, temperature: np.ndarray, value: np.ndarray, key: int | None
    ) -> RowErrors:
        """Errors of rows from their columns, shape (n, p), of the effects of the joint errors.

        `columns` (array of shape (n, p)). `seconds` (array of shape (n,)): Since the fitted record began [s].
        `temperature` (array of shape (n,)). `value` (array of shape (n,)): What the model gives. `key` (int or None):
        Fitted segment that the rows belong to.
        """
        joint, beyond = self.joint, self.joint.beyond
        low, high = self.model.temperature_range_
        outside = (temperature < low) | (temperature > high)
        Z = np.empty((len(columns), 1 + columns.shape[1]), order="F")
        Z[:, 0], Z[:, 1:] = 1.0, columns
        Z[:, ~self.used] = 0.0
        through = Z @ self.through
        level, distance = through[:, -2] ** 2, through[:, -1] - value
        rest = np.maximum(np.einsum("ij,ij->i", through[:, :-2], through[:, :-2]) - level, 0.0)
        return RowErrors(
            level=level,
            coefficients=rest + distance**2 + joint.representation,
            extrapolation=np.zeros(len(columns)) if beyond is None else beyond.variance(columns, outside),
            noise=joint.noise.size(seconds) ** 2,
            shared=np.einsum("ij,ij->i", Z @ joint.last, joint.fading(seconds, key)),
            columns=Z,
        )
