"""Uncertainties of a stream: of its corrected readings, and of cells that are filled."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..equations import MovingAverage
from ..model import DynamicBiasRegressor
from ..model.uncertainty import ErrorWalk
from ..records import History


class LiveErrors:
    """Standard uncertainties of corrected readings: those of `DynamicBiasRegressor.correct` with ``return_std=True``.

    A model that has searched its time constants carries the lags of the whole spectrum beside its own.

    `model` (DynamicBiasRegressor): Fitted.
    """

    def __init__(self, model: DynamicBiasRegressor):
        self.joint = joint = model._joint_errors()
        self._walk = ErrorWalk(model, joint, removed=True)
        own, history = model.features_.effect_list(), model.features_.history_
        more = [i for i, effect in enumerate(joint.effects) if all(effect is not each for each in own)]
        self.effects = [*own, *(joint.effects[i] for i in more)]
        """Effects of the model, and what its errors need beside them."""
        ends = zip(history.end_states, joint.history.end_states, strict=True)
        self.history: History = replace(
            history, end_states=tuple([*states, *(wide[i] for i in more)] for states, wide in ends)
        )
        """The fitted record, with the states of all these effects."""
        edges = np.cumsum([0, *(effect.n_columns() for effect in self.effects)])
        place = {
            id(effect): range(low, high) for effect, (low, high) in zip(self.effects, pairwise(edges), strict=True)
        }
        self._columns = [column for effect in joint.effects for column in place[id(effect)]]
        self._mean_variances: dict[int, float] = {}

    def variances(self, columns: np.ndarray, seconds: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """Variance of the bias, and of the noise over its usual one, shape (2, n).

        `columns` are those of all `effects`, shape (n, p).
        """
        errors = self._walk.errors(columns[:, self._columns], seconds, bias)
        return np.stack((errors.bias, errors.noise))

    def u(self, variances: np.ndarray, count: int = 1) -> np.ndarray:
        """Standard uncertainty of corrected readings, or of the mean of the last `count`, shape (n,).

        The bias of a mean is taken to be as sure as that of its last reading.
        """
        noise = self.joint.noise.variance if count == 1 else self._mean_variance(count)
        return np.asarray(np.sqrt(np.maximum(variances[0] + noise * variances[1], 0.0)))

    def of_block(
        self, variances: np.ndarray, corrected: np.ndarray, average: MovingAverage | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Standard uncertainties of a block's corrected readings, and of their moving averages, before these go on."""
        variances[:, np.isnan(corrected)] = np.nan
        of_mean = np.full(len(corrected), np.nan)
        if average is not None:
            counts = np.minimum(np.cumsum(np.isfinite(corrected)) + len(average.values), average.count)
            for count in np.unique(counts).tolist():
                of_mean[counts == count] = self.u(variances[:, counts == count], max(count, 1))
        return self.u(variances), of_mean

    def _mean_variance(self, count: int) -> float:
        """Variance of the mean noise of that many readings, a usual step apart."""
        if count not in self._mean_variances:
            noise = replace(self.joint.noise, size_seconds=np.zeros(0), sizes=np.zeros(0))
            self._mean_variances[count] = sum(noise.of_mean(np.arange(count) * self.history.usual_step))
        return self._mean_variances[count]
