"""Variances of what a fitted model says of each row, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...effects.stream import Walked, resume, walk
from ...records import Block, Record
from .joint import JointErrors
from .noise_model import NoiseModel


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

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted.
    joint : JointErrors
        Of that model.
    removed : bool
        Errors of the bias that `correct` removes; else of the modelled reading, U0 and all effects.
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

        Parameters
        ----------
        columns : array of shape (n, p)
        seconds : array of shape (n,)
            Since the fitted record began [s].
        temperature : array of shape (n,)
        value : array of shape (n,)
            What the model gives.
        key : int or None
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
