"""Everything that may explain a record, in one pool: columns of each explanation, fine and coarse."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ..effects import StaticPolynomial
from ..effects.protocol import Effect
from ..equations.spikes import spikes
from ..estimators.evenness import evenness
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.thermometer_errors import thermometer_errors
from ..records import Record, RecordError
from ..records.thinned import Thinned
from .base import slowest_of_base, thermal_base
from .blocks import Averages, averaged, spans
from .levels import COARSE, FEWEST, FINE, MOST_EMPTY, ROUNDING
from .likelihood import orthonormal
from .starts import Starts, starts_of

Key = tuple[str, Any]


@dataclass(frozen=True, eq=False)
class Explanation:
    """An effect with its columns, averaged over short stretches of time."""

    effect: Effect
    columns: np.ndarray = field(repr=False)
    """Shape (n, k)."""
    in_model: bool = False
    """Whether the model has it already: slow lags that the base of the judgement does without."""

    @property
    def key(self) -> Key:
        """Kind and column; what the model has already is a kind of its own."""
        return ("in the model", None) if self.in_model else key_of(self.effect)


class Pool:
    """A record, the base that explanations are judged beside, and the explanations."""

    def __init__(self, model: DynamicBiasRegressor, record: Record, candidates: Sequence[Effect]):
        self.model, self.record = model, record
        self.kinds = {effect.kind for _, effect in model.features_.further_effects()}
        """Kinds of the model's further effects."""
        slowest = slowest_of_base(record)
        base, slow = thermal_base(model, record, slowest)
        candidates = [e for e in candidates if not (e.kind == "thermal_lag" and max(e.time_constants) <= slowest)]
        own = starts_of(model, record)
        for effect in (*own, *base, *slow, *candidates):
            effect.learn(record)
        self.data: Averages = averaged(record, [*own, *base, *slow, *candidates], FINE)
        if len(self.data.reading) < FEWEST:
            raise RecordError(
                f"The record is too short to judge: {len(self.data.reading)} readings, and {FEWEST} are "
                "needed. Record longer."
            )
        self.span = spans(self.data, record)
        """Number of the span of each row, over which noise goes on, shape (n,)."""
        decays, columns = self.data.columns[: len(own)], self.data.columns[len(own) :]
        rounding = ROUNDING * float(np.median(np.abs(self.data.reading)))
        self.spikes = spikes(self.data.reading, rounding)
        """Rows that are no readings, shape (n,), booleans."""
        self.weight = np.ones(len(self.spikes))
        """Less than 1 where the noise is larger than usual; readings and columns are multiplied by it, shape (n,)."""
        self.starts = self._starts(decays)
        self.spikes |= spikes(self._left_beside(columns[: len(base)]), rounding)
        left = self._left_beside(columns[: len(base)])
        self.exact = bool(np.sqrt(np.mean(left**2)) <= rounding)
        """Whether the base leaves nothing of the reading but rounding."""
        self.weight *= evenness(left, self.span)
        self.starts = self._starts(decays)
        self.base = np.column_stack([self.constant, *map(self.weighed, columns[: len(base)])])
        """Columns of the base, shape (n, p); the constant first."""
        self.reading = self.weighed(self.data.reading)
        columns = [self.weighed(part) for part in columns[len(base) :]]
        self.explanations = [Explanation(e, c, True) for e, c in zip(slow, columns[: len(slow)], strict=True)]
        self.explanations += [Explanation(e, c) for e, c in zip(candidates, columns[len(slow) :], strict=True)]

    def _left_beside(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """What least squares leaves of the reading."""
        Q = orthonormal(np.column_stack([self.constant, *map(self.weighed, columns)]))
        reading = self.weighed(self.data.reading)
        return np.asarray(reading - Q @ (Q.T @ reading))

    def _starts(self, decays: Sequence[np.ndarray]) -> Starts:
        """What start-up decays hold of weighted rows."""
        together = np.column_stack([np.zeros((len(self.weight), 0)), *decays])
        return Starts(together * self.weight[:, None], self.data.segment)

    @property
    def constant(self) -> np.ndarray:
        """The constant, as columns are judged, shape (n,)."""
        return self.starts.taken_out(self.weight.copy())

    def weighed(self, columns: np.ndarray) -> np.ndarray:
        """Columns, shape (n,) or (n, k), as they are judged: straight over spikes, weighted, less what starts hold.

        The same is done to reading and columns, so that noise that wanders has no holes. They lose their means first,
        to which digits would be lost.
        """
        return self.starts.taken_out(self._weighted(columns))

    def _weighted(self, columns: np.ndarray) -> np.ndarray:
        """Columns without their means, straight over spikes, times the rows' weights."""
        if not self.spikes.any():
            centred = columns - columns.mean(axis=0)
            return centred if (self.weight == 1).all() else np.asarray((centred.T * self.weight).T)
        centred = columns - columns[~self.spikes].mean(axis=0)
        rows, kept = np.flatnonzero(self.spikes), np.flatnonzero(~self.spikes)
        place = np.searchsorted(kept, rows)
        low, high = kept[np.maximum(place - 1, 0)], kept[np.minimum(place, len(kept) - 1)]
        share = np.clip((rows - low) / np.maximum(high - low, 1), 0.0, 1.0)
        centred[rows] = (centred[low].T * (1 - share) + centred[high].T * share).T
        return np.asarray((centred.T * self.weight).T)

    def beside(self, base: np.ndarray, explanations: Sequence[Explanation]) -> Pool:
        """A pool of this record with another base and other explanations."""
        other = copy(self)
        other.base, other.explanations = base, list(explanations)
        return other

    def of(self, effects: Sequence[Effect]) -> list[Explanation]:
        """Explanations by further effects, which learn the record first."""
        for effect in effects:
            effect.learn(self.record)
        columns = averaged(self.record, effects, FINE).columns
        return [Explanation(e, self.weighed(c)) for e, c in zip(effects, columns, strict=True)]

    @cached_property
    def thermometers(self) -> pd.DataFrame:
        """What the errors of the thermometers make in the reading, see `thermocorr.thermometer_errors`.

        Empty for averages, which hide them.
        """
        hidden = isinstance(self.record, Thinned)
        return pd.DataFrame() if hidden else thermometer_errors(self.model, self.record)

    @cached_property
    def temperature(self) -> np.ndarray:
        """Temperature less its mean over the record, averaged, shape (n,)."""
        static = StaticPolynomial(1)
        static.learn(self.record)
        return np.asarray(averaged(self.record, [static], FINE).columns[0][:, 0])

    @cached_property
    def spacing(self) -> float:
        """Usual time from one averaged row to the next [s]."""
        return float(np.median(self.data.steps)) if len(self.data.steps) else 1.0

    def lapse(self, rows: int) -> float:
        """Usual time from an averaged row to the one so many rows later [s]; steps need not be even."""
        same = self.data.segment[rows:] == self.data.segment[:-rows]
        return float(np.median((self.data.seconds[rows:] - self.data.seconds[:-rows])[same]))

    @cached_property
    def place(self) -> np.ndarray:
        """Where each averaged row lies on an even grid, in whole steps; its number where pauses are too long."""
        place = np.rint((self.data.seconds - self.data.seconds.min()) / self.spacing).astype(int)
        return place if place.max() < MOST_EMPTY * len(place) else np.arange(len(place))

    def coarse(self, columns: np.ndarray) -> np.ndarray:
        """Averages of some neighbouring rows, as data not learned from are judged on."""
        size = max(1, len(columns) // COARSE)
        rows = len(columns) // size
        return np.asarray(columns[: rows * size].reshape(rows, size, *columns.shape[1:]).mean(axis=1))


def key_of(effect: Effect) -> Key:
    """Kind and column of an effect."""
    inputs = effect.inputs()
    return effect.kind, inputs[0] if inputs else None
