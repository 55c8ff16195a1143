"""The thermal part that every suspect is judged beside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sklearn.base import clone

from ..effects import LagProducts, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Record
from .levels import APART, FASTEST, FEWEST_SAMPLES, LAGS, SLOWEST


@dataclass(frozen=True)
class ThermalBase:
    """The base: what the model has, with lags of its own in the place of the model's slow ones."""

    effects: list[Effect]
    """Static law, fast and middle lags, the model's further effects."""
    slow: list[Effect]
    """The model's slow lags, which compete with drift and ageing."""
    slowest: float
    """Time constant of the slowest lag [s]."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, record: Record) -> ThermalBase:
        """Unlearned effects, for this record or its averages."""
        slowest, own = _slowest(record), np.asarray(model.time_constants_, float)
        grid = np.geomspace(FASTEST * record.usual_step(), slowest, LAGS)
        further = [clone(effect) for _, effect in model.features_.further_effects()]
        if model.products_:
            further += [clone(effect) for effect in model.features_.effect_list() if isinstance(effect, LagProducts)]
        static = StaticPolynomial(model.degree, model.reference_temperature)
        taus = np.unique(np.concatenate((grid, own[own <= slowest])))
        taus = taus[np.concatenate(([True], np.diff(np.log(taus)) > APART))]
        slow: list[Effect] = [ThermalLag([tau]) for tau in own[own > slowest]]
        return cls([static, ThermalLag(taus.tolist()), *further], slow, slowest)


def _slowest(record: Record) -> float:
    """Time constant of the slowest lag of the base [s]: a share of all segments together, none longer than a segment.

    It is at least a few samples long, however short the segments.
    """
    together = sum(record.read_duration(segment) for segment in record.segments)
    return max(min(SLOWEST * together, record.longest_read()), FEWEST_SAMPLES * record.usual_step())
