"""Everything that may explain a record, in one pool: columns of each explanation, fine and coarse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import Disturbance, InitialTransient, SeveralSteps, StaticPolynomial, Step, ThermalLag
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.thermometers import resolution_of, thermometer_errors
from ..records import Record, RecordError
from ..records.history import Thinned
from .blocks import Averages, averaged, averaged_columns, spans, sums_of
from .directions import orthonormal, visible
from .judged_rows import JudgedRows
from .levels import BATCH, COARSE, FEWEST, FINE, MOST_EMPTY, SHORTEST_START, START_TOLD
from .likelihood import Comparison
from .out_of_sample import OutOfSample
from .residual import ThermalBase
from .starts import OwnStart, starts_of

Key = tuple[str, Any]


@dataclass(frozen=True, eq=False)
class Explanation:
    """An effect with its columns, averaged over short stretches of time."""

    effect: Effect
    columns: np.ndarray = field(repr=False)
    """Shape (n, k), or (0, k) where they are not kept: see `Pool.with_columns`."""
    in_model: bool = False
    """Whether the model has it already: slow lags and the start, which the base of the judgement does without."""

    def forgotten(self) -> Explanation:
        """The explanation without its columns; with them where it is a model's start, which is not made anew."""
        return self if self.effect.kind == OwnStart.kind else replace(self, columns=self.columns[:0].copy())

    @property
    def key(self) -> Key:
        """Kind and column; what the model has already is a kind of its own."""
        return ("in the model", None) if self.in_model else key_of(self.effect)

    @property
    def is_start(self) -> bool:
        """Whether it is the start of the record, as far as the model has it."""
        return self.in_model and self.effect.of_time_alone

    @cached_property
    def n_tuned(self) -> int:
        """Numbers among its parameters that are moved to where it explains most."""
        tuned = self.effect.info.tuned if self.effect.info else ()
        values = [getattr(self.effect, name) for name in tuned]
        return sum(np.size(value) for value in values if value is not None)

    @cached_property
    def law(self) -> tuple[Key, str]:
        """Kind and column, and every parameter that is not tuned: a column late and its square late are two laws."""
        tuned = self.effect.info.tuned if self.effect.info else ()
        given = self.effect.get_params(deep=False)
        return self.key, str(sorted((k, v) for k, v in given.items() if k not in tuned))


def of_first_rows(effect: Effect, step: float) -> bool:
    """Whether a start is over so soon, with so long a step [s], that it could be a large first reading."""
    return isinstance(effect, InitialTransient) and _times(effect).min(initial=np.inf) < SHORTEST_START * step


def _times(effect: ThermalLag | InitialTransient) -> np.ndarray:
    return seconds_array(effect.time_constants)


class Pool:
    """A record, the base that explanations are judged beside, and the explanations."""

    def __init__(
        self,
        model: DynamicBiasRegressor,
        record: Record,
        thermal: ThermalBase,
        candidates: Sequence[Effect],
        felt_in_gaps: float = 0.0,
    ):
        self.model, self.record = model, record
        self.felt_in_gaps = felt_in_gaps
        """Sum over the readings of what the temperature may have done to them in gaps, in the unit of y squared."""
        base, slow, least = thermal.effects, thermal.slow, thermal.slowest
        step = record.usual_step()
        candidates = [e for e in candidates if not (isinstance(e, ThermalLag) and _times(e).max(initial=0.0) <= least)]
        candidates = [e for e in candidates if not of_first_rows(e, step)]
        own, first = starts_of(model, record, thermal.slowest)
        self._started_by = thermal.slowest if first else 0.0
        for effect in (*own, *first, *base, *slow):
            effect.learn(record)
        self.data: Averages = averaged(record, [*own, *base, *first, *slow], FINE)
        if len(self.data.reading) < FEWEST:
            gone = ", ".join(sorted({refused.reason for refused in record.refused if refused.what == "reading"}))
            raise RecordError(
                f"The record is too short to judge: {len(self.data.reading)} readings, and {FEWEST} are "
                f"needed{f', beside what was left out ({gone})' if gone else ''}. Record longer."
            )
        self.span = spans(self.data, record)
        """Number of the span of each row, over which noise goes on, shape (n,)."""
        decays, columns = self.data.columns[: len(own)], self.data.columns[len(own) :]
        self.rows = JudgedRows(self.data, decays, columns[: len(base)], self.span)
        self.base = np.column_stack([self.rows.constant, *map(self.rows.weighed, columns[: len(base)])])
        """Columns of the base, shape (n, p); the constant first."""
        self.reading = self.rows.weighed(self.data.reading)
        self.data = self.rows.data = replace(self.data, columns=[])
        columns = columns[len(base) :]
        columns[: len(first)] = [orthonormal(part, START_TOLD) for part in columns[: len(first)]]
        columns = [self.rows.weighed(part) for part in columns]
        known = [Explanation(*each, True) for each in zip([*first, *slow], columns, strict=True) if each[1].size]
        self.explanations = [*known, *self.unmade(candidates)]
        """Most of them without their columns, which are more than all else in memory together: see `groups`."""
        self.start = [e.columns for e in known if isinstance(e.effect, OwnStart)]
        """What the start of the record may be in the model, each of shape (n, k)."""

    def _has(self, effect: Effect) -> bool:
        """Whether the model has an effect already: a decay of the start of the record that is no slow one."""
        return isinstance(effect, InitialTransient) and _times(effect).max(initial=0.0) <= self._started_by

    def compared(self, base: np.ndarray) -> Comparison:
        """The record beside columns of a base, shape (n, p)."""
        return Comparison(self.reading, visible(base, self.reading), self.span, self.rows.starts.spread)

    def beside(self, base: np.ndarray, explanations: Sequence[Explanation]) -> Pool:
        """A pool of this record with another base and other explanations."""
        other = copy(self)
        other.base, other.explanations = base, list(explanations)
        return other

    def of(self, effects: Sequence[Effect]) -> list[Explanation]:
        """Explanations by further effects, which learn the record first."""
        return self.with_columns(self.unmade(effects))

    def unmade(self, effects: Sequence[Effect]) -> list[Explanation]:
        """Explanations by further effects, which learn the record first, without their columns."""
        for effect in effects:
            effect.learn(self.record)
        return [Explanation(e, np.zeros((0, e.n_columns())), self._has(e)) for e in effects if e.n_columns()]

    def _columns(self, effects: Sequence[Effect]) -> list[np.ndarray]:
        """Columns of effects that have learned the record, as they are judged."""
        return [self.rows.weighed(part, out=part) for part in averaged_columns(self.record, effects, FINE)]

    def groups(self) -> Iterator[list[Explanation]]:
        """The explanations with their columns, a few at a time: all of them at once would be held in memory twice."""
        for first in range(0, len(self.explanations), BATCH):
            yield self.with_columns(self.explanations[first : first + BATCH])

    def with_columns(self, explanations: Sequence[Explanation]) -> list[Explanation]:
        """Explanations with their columns, which are made, or made anew, where they have none."""
        made = iter(self._columns([e.effect for e in explanations if not len(e.columns)]))
        return [e if len(e.columns) else replace(e, columns=next(made)) for e in explanations]

    @cached_property
    def thermometers(self) -> pd.DataFrame:
        """What the errors of the thermometers make in the reading, see `thermocorr.thermometer_errors`.

        Empty for averages, which hide them.
        """
        hidden = isinstance(self.record, Thinned)
        return pd.DataFrame() if hidden else thermometer_errors(self.model, self.record)

    @cached_property
    def rounding(self) -> float:
        """Step of the reading, to which it is rounded; 0 where it has none, and for averages, which hide it."""
        if isinstance(self.record, Thinned) or self.record.reading is None or self.data.counts.max() > 1:
            return 0.0
        rows = [self.record.kept(segment.start, segment.stop) for segment in self.record.segments]
        parts = [np.asarray(self.record.reading[each], float) for each in rows]
        return resolution_of([part[np.isfinite(part)] for part in parts])

    @cached_property
    def temperature(self) -> np.ndarray:
        """Temperature less its mean over the record, averaged, shape (n,)."""
        static = StaticPolynomial(1)
        static.learn(self.record)
        return np.asarray(averaged_columns(self.record, [static], FINE)[0][:, 0])

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

    @cached_property
    def own(self) -> np.ndarray:
        """Columns of the model but for its decays, and the constant, as they are judged, shape (n, p)."""
        effects = [clone(e) for e in self.model.features_.effect_list() if not isinstance(e, InitialTransient)]
        for effect in effects:
            effect.learn(self.record)
        return np.column_stack([self.rows.constant, *self._columns(effects)])

    @cached_property
    def out_of_sample(self) -> OutOfSample:
        """Errors of the model on data that it was not learned from."""
        Q = orthonormal(self.own)
        left = self.reading - Q @ (Q.T @ self.reading)
        hidden = float(np.mean(left**2) - np.mean(self.coarse(left[:, None]) ** 2))
        white = float(np.mean(np.diff(left) ** 2)) / 2  # of which the averages of several readings hide the rest
        hidden += white * (float(np.median(self.data.counts)) - 1)
        return OutOfSample(self.coarse(self.reading[:, None])[:, 0], self.coarse(self.own), max(hidden, 0.0))

    def moment(self, effect: Effect) -> float | None:
        """Share of the rows before the last moment at which an effect begins or ends; None for one without."""
        if not isinstance(effect, Step | SeveralSteps | Disturbance):
            return None
        return float(np.mean(self.data.seconds < np.max(effect.seconds_)))

    def coarse(self, columns: np.ndarray) -> np.ndarray:
        """Averages of some neighbouring rows of columns, shape (n, k), as data not learned from are judged on."""
        size = max(1, len(columns) // COARSE)
        return sums_of(columns[: len(columns) // size * size], size) / size


def key_of(effect: Effect) -> Key:
    """Kind and column of an effect."""
    inputs = effect.inputs()
    return effect.kind, inputs[0] if inputs else None
