"""Everything that may explain a record, in one pool.

Rows are judged straight over spikes, weighted by their noise, less what the starts of segments hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy.sparse import block_diag
from sklearn.base import clone

from ..effects import (
    Disturbance,
    Hysteresis,
    InitialTransient,
    Periodic,
    SeveralSteps,
    StaticPolynomial,
    Step,
    ThermalLag,
)
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..equations import decays
from ..equations.outliers import spikes
from ..model.averages import COARSE, Averages, averaged, averaged_columns, spans, sums_of
from ..model.heteroscedasticity import evenness
from ..model.out_of_sample import OutOfSample
from ..model.regressor import DynamicBiasRegressor
from ..model.runs import is_level
from ..model.thermometers import resolution_of, thermometer_errors
from ..records import Block, Record, RecordError
from .data import ThermalBase
from .levels import BATCH, BEYOND, FAR, FEW, FEWEST, FINE, SHORTEST_START, START_HELD, STARTS
from .score import Comparison, orthonormal, visible


class Starts:
    """The directions that start-up decays hold, segment by segment.

    `columns` (array of shape (n, k)): Decays of each row's own segment. `segment` (array of shape (n,)): Number of
    each row's segment.
    """

    def __init__(self, columns: np.ndarray, segment: np.ndarray):
        edges = np.flatnonzero(np.diff(segment, prepend=-1, append=-1))
        parts = [slice(low, high) for low, high in pairwise(edges.tolist())]
        held = [
            orthonormal(columns[rows], START_HELD) if columns[rows].any() else np.zeros((rows.stop - rows.start, 0))
            for rows in parts
        ]
        self.first, self.lengths = edges[:-1], np.diff(edges)
        # Every sixteenth segment is in one group: what its directions share with those of a segment so far away is next
        # to nothing.
        groups, most = min(len(held), 16), max((Q.shape[1] for Q in held), default=0)
        self.spread = np.zeros((len(segment), groups * most))
        """All directions once more, those of segments far from one another in common columns, shape (n, k)."""
        for i, (rows, Q) in enumerate(zip(parts, held, strict=True)):
            self.spread[rows, i % groups * most :][:, : Q.shape[1]] = Q
        self.basis = block_diag(held, format="csr") if any(Q.shape[1] for Q in held) else None
        """Directions of all segments side by side, shape (n, all of them); None where nothing is held."""

    def taken_out(self, columns: np.ndarray) -> np.ndarray:
        """Columns less their decays, changed in place.

        Where a segment's decays hold all of a column, zeros are left and not its rounding, which would look like a
        column of its own.
        """
        if self.basis is not None:
            before = np.add.reduceat(columns**2, self.first, axis=0)
            columns -= self.basis @ (self.basis.T @ columns)
            # Less than 1e-9 of a column in a segment is rounding error.
            left = np.add.reduceat(columns**2, self.first, axis=0) > 1e-9**2 * before
            if not left.all():
                columns *= np.repeat(left, self.lengths, axis=0)
        return columns


class JudgedRows:
    """Weights and transform of averaged rows.

    `data` (Averages). `decays` (sequence of arrays of shape (n, k)): Start-up decays, see `starts_of`. `base`
    (sequence of arrays of shape (n, k)): Columns that are judged given: spikes and noise are those of what they
    leave. `span` (array of shape (n,)): Number of the span over which noise goes on.
    """

    def __init__(self, data: Averages, decays: Sequence[np.ndarray], base: Sequence[np.ndarray], span: np.ndarray):
        self.data = data
        # What the base leaves of the reading is arithmetic below this: nothing is looked for.
        rounding = 1e-14 * float(np.median(np.abs(data.reading)))
        self.spikes = spikes(data.reading, rounding)
        """Rows that are no readings, shape (n,), booleans."""
        self.left_out = self.spikes
        """Spikes, and rows that stand out as nothing but a glitch does, shape (n,), booleans."""
        self.weight = np.ones(len(self.spikes))
        """Less than 1 where the noise is larger than usual; readings and columns are multiplied by it, shape (n,)."""
        self.starts = self._starts(decays)
        self.left_out = self.spikes = self.spikes | spikes(self._left_beside(base), rounding)
        left = self._left_beside(base)
        self.exact = bool(np.sqrt(np.mean(left**2)) <= rounding)
        """True if the base leaves nothing of the reading but rounding."""
        self.weight *= evenness(left, span)
        self.starts = self._starts(decays)
        self.left_out = self.spikes | _outstanding(self._left_beside(base))

    def _left_beside(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Least-squares residual of the reading."""
        Q = orthonormal(np.column_stack([self.constant, *map(self.weighed, columns)]))
        reading = self.weighed(self.data.reading)
        return np.asarray(reading - Q @ (Q.T @ reading))

    def _starts(self, decays: Sequence[np.ndarray]) -> Starts:
        """Projection of weighted rows on start-up decays."""
        together = np.column_stack([np.zeros((len(self.weight), 0)), *decays])
        return Starts(together * self.weight[:, None], self.data.segment)

    @property
    def constant(self) -> np.ndarray:
        """The constant, as columns are judged, shape (n,)."""
        return self.starts.taken_out(self.weight.copy())

    def weighed(self, columns: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Columns as they are judged: weighted, transformed.

        The same is done to reading and columns, so that noise that wanders has no holes. They lose their means first,
        to which digits would be lost. They are written to `out`, which may be the columns themselves.
        """
        return self.starts.taken_out(self._weighted(columns, out))

    def _weighted(self, columns: np.ndarray, out: np.ndarray | None) -> np.ndarray:
        """Columns without their means, straight over spikes, times the rows' weights."""
        known = ~self.left_out
        centred = np.subtract(columns, (columns if known.all() else columns[known]).mean(axis=0), out=out)
        if not known.all():
            rows, kept = np.flatnonzero(self.left_out), np.flatnonzero(known)
            place = np.searchsorted(kept, rows)
            low, high = kept[np.maximum(place - 1, 0)], kept[np.minimum(place, len(kept) - 1)]
            share = np.clip((rows - low) / np.maximum(high - low, 1), 0.0, 1.0)
            centred[rows] = (centred[low].T * (1 - share) + centred[high].T * share).T
        by_row = centred.T
        by_row *= self.weight
        return np.asarray(centred)


def _outstanding(left: np.ndarray) -> np.ndarray:
    """Rows far from neighbours: glitches, heavy tails.

    None where many rows are: a quantised noise has few values.
    """
    apart = np.abs(left - pd.Series(left).rolling(5, center=True, min_periods=1).median().to_numpy())
    deviation = 1.4826 * float(np.median(apart))  # of normal numbers
    far: np.ndarray = apart > FAR * deviation
    return far if far.mean() <= FEW else np.zeros(len(far), bool)


class OwnStart(Effect):
    """Start-up decays, eq. (18), segments sharing columns.

    `transient` (InitialTransient): The model's decays. `slowest` (float): Time constant [s] beyond which a decay
    competes with drift and ageing instead. `which` (slice): Of which segments. `beyond` (float): How far they reach
    beyond, as a factor.
    """

    kind = "own_start"
    of_time_alone = True

    def __init__(
        self, transient: InitialTransient, slowest: float = np.inf, which: slice = slice(None), beyond: float = BEYOND
    ):
        self.transient, self.slowest, self.which, self.beyond = transient, slowest, which, beyond

    def learn(self, record: Record) -> None:
        """Find the decays of each segment."""
        self.transient_ = clone(self.transient)
        self.transient_.learn(record)
        self.transient_.decays_ = {
            key: np.geomspace(
                own.min() / self.beyond, max(min(own.max() * self.beyond, self.slowest), own.min()), STARTS
            )
            for key, own in self.transient_.decays_.items()
            if key in range(len(record.segments))[self.which]
        }

    def names(self) -> list[str]:
        """Names of the columns, for the most decays."""
        return [f"start {k}" for k in range(max(map(len, self.transient_.decays_.values()), default=0))]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Decays of the block's segment, else zeros."""
        own = self.transient_.own(block)
        return np.pad(own, ((0, 0), (0, self.n_columns() - own.shape[1]))), None


class Before(Effect):
    """Heat from before the record, by the lags' coefficients.

    Of another temperature until then, that is the sum of their decays, eq. (18), times the coefficients of the lags. Of
    one that was rising, the slow parts keep more: with rank 2, in proportion to their time constants.

    `time_constants`, `coefficients` (array of shape (J,)): Of the lags [s]. `rank` (int): 1 or 2, the number of
    columns.
    """

    kind = "own_start"
    of_time_alone = True

    def __init__(self, time_constants: np.ndarray, coefficients: np.ndarray, rank: int):
        self.time_constants, self.coefficients, self.rank = time_constants, coefficients, rank

    def learn(self, record: Record) -> None:
        """Nothing depends on the record."""

    def names(self) -> list[str]:
        """Names of the columns."""
        return [f"before {k}" for k in range(self.rank)]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Sums of decays in the first segment, zeros in the others."""
        if block.segment != 0:
            return np.zeros((len(block), self.rank)), None
        slower = (self.time_constants / self.time_constants.max())[:, None] ** np.arange(self.rank)
        return decays(block.elapsed, self.time_constants) @ (self.coefficients[:, None] * slower), None


def starts_of(model: DynamicBiasRegressor, record: Record, slowest: float) -> tuple[list[Effect], list[Effect]]:
    """A model's decays: those held, and those that compete.

    Behind a pause nobody knows what a device keeps of the time before. Whether it was at rest when the record began,
    the record says: an ageing looks like many decays, and what a lag as long as the record keeps like a drift.
    """
    own = [effect for effect in model.features_.effect_list() if isinstance(effect, InitialTransient)]
    later = [OwnStart(effect, slowest, slice(1, None)) for effect in own if len(record.segments) > 1]
    lags = model.features_.first_of(ThermalLag)[1]
    kept = model.time_constants_ <= slowest
    taus, coefficients = model.time_constants_[kept], model.coef_[lags][kept]
    before = [Before(taus, coefficients, rank) for rank in (1, 2) if own and len(taus) >= rank]
    return list(later), [*(OwnStart(effect, slowest, slice(1)) for effect in own), *before]


Key = tuple[str, Any]


@dataclass(frozen=True, eq=False)
class Explanation:
    """An effect with its columns, averaged over short stretches of time."""

    effect: Effect
    columns: np.ndarray = field(repr=False)
    """Shape (n, k), or (0, k) where they are not kept: see `Pool.with_columns`."""
    in_model: bool = False
    """True if the model has it already: slow lags and the start, which the base of the judgement does without."""

    def forgotten(self) -> Explanation:
        """The explanation without its columns."""
        return self if self.effect.kind == OwnStart.kind else replace(self, columns=self.columns[:0].copy())

    @property
    def key(self) -> Key:
        """Kind and column; the model's own kinds differ."""
        return ("in the model", None) if self.in_model else key_of(self.effect)

    @property
    def is_start(self) -> bool:
        """True if it is the start of the record."""
        return self.in_model and self.effect.of_time_alone

    @cached_property
    def n_tuned(self) -> int:
        """Number of tuned parameters."""
        tuned = self.effect.info.tuned if self.effect.info else ()
        values = [getattr(self.effect, name) for name in tuned]
        return sum(np.size(value) for value in values if value is not None)

    @cached_property
    def law(self) -> tuple[Key, str]:
        """Kind, column and untuned parameters."""
        tuned = self.effect.info.tuned if self.effect.info else ()
        given = self.effect.get_params(deep=False)
        return self.key, str(sorted((k, v) for k, v in given.items() if k not in tuned))


def helps_evenly(effect: Effect) -> bool:
    """True if an effect must help evenly."""
    return effect.is_product or isinstance(effect, Hysteresis)


def passes_twice(effect: Effect) -> bool:
    """True if an effect needs held-out blocks too."""
    return isinstance(effect, Step | SeveralSteps | Disturbance | Hysteresis | Periodic)


def of_first_rows(effect: Effect, step: float) -> bool:
    """True if a start could be a large first reading."""
    return isinstance(effect, InitialTransient) and _times(effect).min(initial=np.inf) < SHORTEST_START * step


def _times(effect: ThermalLag | InitialTransient) -> np.ndarray:
    return seconds_array(effect.time_constants)


class Pool:
    """A record, its base, and the explanations."""

    def __init__(self, model: DynamicBiasRegressor, record: Record, thermal: ThermalBase, candidates: Sequence[Effect]):
        self.model, self.record = model, record
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
                f"needed{f', besides what was left out ({gone})' if gone else ''}. Record longer."
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
        columns[: len(first)] = [orthonormal(part, START_HELD) for part in columns[: len(first)]]
        columns = [self.rows.weighed(part) for part in columns]
        known = [Explanation(*each, True) for each in zip([*first, *slow], columns, strict=True) if each[1].size]
        self.explanations = [*known, *self.unmade(candidates)]
        """Most of them without their columns, which are more than all else in memory together: see `groups`."""
        self.start = [e.columns for e in known if isinstance(e.effect, OwnStart)]
        """What the start of the record may be in the model, each of shape (n, k)."""

    def _has(self, effect: Effect) -> bool:
        """True if the model has an effect already."""
        return isinstance(effect, InitialTransient) and _times(effect).max(initial=0.0) <= self._started_by

    def compared(self, base: np.ndarray) -> Comparison:
        """The record given columns of a base, shape (n, p)."""
        return Comparison(self.reading, visible(base, self.reading), self.span, self.rows.starts.spread)

    def given(self, base: np.ndarray, explanations: Sequence[Explanation]) -> Pool:
        """A pool of this record with another base and other explanations."""
        other = copy(self)
        other.base, other.explanations = base, list(explanations)
        return other

    def of(self, effects: Sequence[Effect]) -> list[Explanation]:
        """Explanations by further effects, which learn the record first."""
        return self.with_columns(self.unmade(effects))

    def unmade(self, effects: Sequence[Effect]) -> list[Explanation]:
        """Explanations by further effects, learned, without columns."""
        for effect in effects:
            effect.learn(self.record)
        return [Explanation(e, np.zeros((0, e.n_columns())), self._has(e)) for e in effects if e.n_columns()]

    def _columns(self, effects: Sequence[Effect]) -> list[np.ndarray]:
        """Columns of learned effects, as they are judged."""
        return [self.rows.weighed(part, out=part) for part in averaged_columns(self.record, effects, FINE)]

    def groups(self) -> Iterator[list[Explanation]]:
        """The explanations with columns, a few at a time."""
        for first in range(0, len(self.explanations), BATCH):
            yield self.with_columns(self.explanations[first : first + BATCH])

    def with_columns(self, explanations: Sequence[Explanation]) -> list[Explanation]:
        """Explanations with their columns made."""
        made = iter(self._columns([e.effect for e in explanations if not len(e.columns)]))
        return [e if len(e.columns) else replace(e, columns=next(made)) for e in explanations]

    @cached_property
    def thermometers(self) -> pd.DataFrame:
        """Effect of thermometer errors on the reading, see `thermocorr.validation.thermometer_errors`."""
        return thermometer_errors(self.model, self.record)

    @cached_property
    def rounding(self) -> float:
        """Rounding step of the reading; 0 for none."""
        if self.record.reading is None or self.data.counts.max() > 1:
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

    def swings(self, width: float) -> int:
        """Number of turns of the temperature beyond a width [K]."""
        turns, way, far = 0, 0, self.temperature[0]
        for value in self.temperature.tolist():
            if way * (value - far) > 0 or (way == 0 and abs(value - far) > width):
                way, far = (way or int(np.sign(value - far))), value
            elif way and abs(value - far) > width:
                turns, way, far = turns + 1, -way, value
        return turns

    @cached_property
    def runs_one_way(self) -> bool:
        """True if the temperature moves one way."""
        # A temperature that never turns back by three tenths of its range runs one way only.
        return self.swings(0.3 * float(np.ptp(self.temperature))) == 0

    @cached_property
    def spacing(self) -> float:
        """Usual time from one averaged row to the next [s]."""
        return float(np.median(self.data.steps)) if len(self.data.steps) else 1.0

    def lapse(self, rows: int) -> float:
        """Usual time between rows so far apart [s]."""
        same = self.data.segment[rows:] == self.data.segment[:-rows]
        return float(np.median((self.data.seconds[rows:] - self.data.seconds[:-rows])[same]))

    @cached_property
    def place(self) -> np.ndarray:
        """Place of each averaged row, in whole steps."""
        place = np.rint((self.data.seconds - self.data.seconds.min()) / self.spacing).astype(int)
        # Where pauses of months make eight steps of time for each averaged row, a search for waves counts rows instead.
        return place if place.max() < 8 * len(place) else np.arange(len(place))

    @cached_property
    def own(self) -> np.ndarray:
        """The model's columns without decays, (n, p)."""
        effects = [clone(e) for e in self.model.features_.effect_list() if not isinstance(e, InitialTransient)]
        for effect in effects:
            effect.learn(self.record)
        return np.column_stack([self.rows.constant, *self._columns(effects)])

    @cached_property
    def out_of_sample(self) -> OutOfSample:
        """Errors of the model on unseen data."""
        Q = orthonormal(self.own)
        left = self.reading - Q @ (Q.T @ self.reading)
        hidden = float(np.mean(left**2) - np.mean(self.coarse(left[:, None]) ** 2))
        # White noise, of which averages hide the rest; third differences leave out what bends slowly.
        white = float(np.mean(np.diff(left, n=3) ** 2)) / 20
        hidden += white * (float(np.median(self.data.counts)) - 1)
        return OutOfSample(self.coarse(self.reading[:, None])[:, 0], self.coarse(self.own), max(hidden, 0.0))

    def size(self, columns: np.ndarray, others: Sequence[np.ndarray]) -> float:
        """Rms that columns explain beyond model and others."""
        Q = orthonormal(np.column_stack((self.own, *others)))
        own = orthonormal(columns - Q @ (Q.T @ columns))
        left = self.reading - Q @ (Q.T @ self.reading)
        found = own.T @ left
        rest = left - own @ found
        by_chance = own.shape[1] * float(rest @ rest) / max(len(rest) - Q.shape[1] - own.shape[1], 1)
        return float(np.sqrt(max(float(found @ found) - by_chance, 0.0) / len(left)))

    def moment(self, effect: Effect) -> float | None:
        """Share of the rows before an effect's last moment."""
        if not isinstance(effect, Step | SeveralSteps | Disturbance):
            return None
        return float(np.mean(self.data.seconds < np.max(effect.seconds_)))

    @property
    def own_moment(self) -> float | None:
        """The last moment of the model's own effects."""
        moments = [self.moment(e) for e in self.model.features_.effect_list() if not is_level(self.model, e)]
        return max((moment for moment in moments if moment is not None), default=None)

    def coarse(self, columns: np.ndarray) -> np.ndarray:
        """Averages of columns for tests on unseen data."""
        size = max(1, len(columns) // COARSE)
        return sums_of(columns[: len(columns) // size * size], size) / size


def key_of(effect: Effect) -> Key:
    """Kind and column of an effect."""
    inputs = effect.inputs()
    return effect.kind, inputs[0] if inputs else None
