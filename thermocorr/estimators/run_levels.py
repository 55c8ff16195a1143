"""Runs at different levels, each with a U0 of its own.

A log may hold runs of different measurands: 3 V on Monday, 7 V on Tuesday. One U0 for both makes the temperature's
columns explain the difference, and the correction is nonsense. So a step at the start of each run stands in the model,
which `correct` keeps, where the record says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects import SeveralSteps, ThermalLag
from ..effects.protocol import Effect
from ..equations import TriangularFactor
from ..records import BLOCK_ROWS, Record, RecordError
from ..records.errors import option
from ..records.numbers import is_frame
from .features import DiffusiveFeatures
from .fitting import sweep_effects

NAME = "run_levels"
"""Name of the steps among the effects of a model."""


class RunLevels(NamedTuple):
    """Moments at which the level of the reading changes, in seconds since the record began; none for one level."""

    times: tuple[float, ...] = ()
    note: str = ""

    def beside(self, effects: list[tuple[str, Effect]]) -> list[tuple[str, Effect]]:
        """Effects of a model, and the steps between its runs after them, where there are any."""
        if not self.times:
            return effects
        taken = {name for name, _ in effects}
        name = NAME if NAME not in taken else f"{NAME}_of_runs"
        return [*effects, (name, SeveralSteps(list(self.times)))]

    @classmethod
    def among(cls, learned: Sequence[tuple[str, Effect]], given: Sequence[tuple[str, Effect]]) -> RunLevels:
        """Levels that a fitted model has, from its learned effects and those that its user gave."""
        own = {name for name, _ in given}
        steps = [e for name, e in learned if name.startswith(NAME) and name not in own and isinstance(e, SeveralSteps)]
        return cls(tuple(float(time) for step in steps for time in step.times))


def run_levels(features: DiffusiveFeatures, record: Record, always: bool) -> RunLevels:
    """True if runs have levels of their own, and where these begin.

    `features` (DiffusiveFeatures): Learned on the record: static law and further effects, without lags. `record`
    (Record): With readings. `always` (bool): Do not ask the record. Raises RecordError where runs overlap in time and
    are to have levels of their own: a model holds one at a time.
    """
    runs = [run for run in _runs(record) if run.has_readings]
    if len(runs) < 2:
        return RunLevels()
    better = np.inf if always else _gain(features, record)
    # Levels of their own must make the residual variance of a model with few lags smaller by this factor: measurands
    # are more than ten times as far apart as what is left within a run. What moves the reading by less from run to run
    # is an effect, to be found by a diagnosis: a drift, a step, another column. Half and twice of it is 7 and 14 times
    # as far.
    if better < 100.0:
        return RunLevels()
    runs.sort(key=lambda run: run.begins)
    for before, after in pairwise(runs):
        if after.begins <= before.ends:
            differ = "are to have" if always else "have readings at"
            raise RecordError(
                f"Runs {before.label!r} and {after.label!r} overlap in time and {differ} different levels: one model "
                "holds one level at a time. Fit a model for each of them, or pass "
                f"{option('run_offset', repr('same'))} if they are one measurand."
            )
    times = _between(runs, record)
    if always:
        return RunLevels(times)
    kept = "which correct keeps" if features.reference is None else "which is part of the error"
    return RunLevels(
        times,
        f"The {len(runs)} runs are at different levels: each has a U0 of its own, {kept} "
        f"({option('run_offset', repr('each'))}); one for all would leave {np.sqrt(better):.3g} times the residual. "
        f"Pass {option('run_offset', repr('same'))} if they are one measurand.",
    )


def moments_between_runs(record: Record) -> tuple[float, ...]:
    """Middle of the pause between each two runs that have readings [s since the record began]; none if some overlap."""
    runs = sorted((run for run in _runs(record) if run.has_readings), key=lambda run: run.begins)
    return _between(runs, record) if all(a.ends < b.begins for a, b in pairwise(runs)) else ()


def _between(runs: Sequence[_Run], record: Record) -> tuple[float, ...]:
    """Middle of the pauses between runs that do not overlap, in order [s since the record began]."""
    zero = record.first_stamp()
    return tuple(record.times.between((before.ends + after.begins) / 2, zero) for before, after in pairwise(runs))


class _Run(NamedTuple):
    """Consecutive segments with one label."""

    label: object
    first: int
    """Row in time order at which it begins."""
    begins: float
    ends: float
    """Stamps of its first and last row."""
    has_readings: bool


def _runs(record: Record) -> list[_Run]:
    numbers = range(len(record.segments))
    firsts = [k for k in numbers if k == 0 or record.segments[k].run != record.segments[k - 1].run]
    found = []
    for first, behind in pairwise([*firsts, len(record.segments)]):
        segments = record.segments[first:behind]
        start, end = segments[0].start, segments[-1].stop - 1
        known = any(_known(record, segment.start, segment.stop) for segment in segments)
        found.append(_Run(segments[0].run, start, record.stamp(start), record.stamp(end), known))
    return found


def _known(record: Record, start: int, stop: int) -> bool:
    """True if there are readings between two rows in time order."""
    reading: Any = record.reading
    blocks = (record.rows(low, min(low + BLOCK_ROWS, stop)) for low in range(start, stop, BLOCK_ROWS))
    return any(np.isfinite(np.asarray(reading[rows], float)).any() for rows in blocks)


def unlearned(model: Any, X: Any, known: np.ndarray) -> np.ndarray:
    """Rows of runs whose level a model cannot know, as it has no reading of them; shape (n_rows,), booleans.

    `model` (DynamicBiasRegressor): Fitted; where its runs have one level, there are no such rows. `X` (as for its
    `fit`). `known` (array of shape (n_rows,)): Readings that are learned from, NaN elsewhere.
    """
    if not model._run_levels.times:
        return np.zeros(len(known), bool)
    labels = pd.Series(X[model.run][:] if is_frame(X) else X[:, model.run]).reset_index(drop=True)
    return np.asarray(~labels.isin(labels[np.isfinite(known)].unique()))


def level_variance(model: Any) -> float:
    """Variance of the levels of a fitted model's runs about the last one, which later rows get; 0 for one level.

    What the level of a run that was never seen may be off by, as far as the fitted runs tell.
    """
    times = model._run_levels.times
    if not times:
        return 0.0
    effects = model.features_.effect_list()
    ends = np.cumsum([effect.n_columns() for effect in effects]).tolist()
    last = max(
        k for k, effect in enumerate(effects) if isinstance(effect, SeveralSteps) and tuple(effect.times) == times
    )
    levels = np.concatenate(([0.0], np.cumsum(model.coef_[ends[last] - len(times) : ends[last]])))
    return float(np.sum((levels - levels[-1]) ** 2) / len(times))


def _gain(features: DiffusiveFeatures, record: Record) -> float:
    """Residual variance with one level over that with a level for each run; 1 where the runs cannot tell."""
    longest = max(record.duration(segment) for segment in record.segments)
    step = record.usual_step()
    # Lags of the model that decides, from two steps to a tenth of the longest run
    lag = ThermalLag(np.geomspace(2 * step, max(longest / 10, 4 * step), 5).tolist(), features.hold)
    lag.learn(record)
    edges = np.array([*(run.first for run in _runs(record)), record.n_rows])
    edges[0] = 0
    chunks = [
        chunk for chunk in sweep_effects(record, [*features.effect_list(), lag], edges).chunks if chunk.n_rows > 1
    ]
    if len(chunks) < 2:
        return 1.0
    one, each = TriangularFactor.merged(chunks).behind(1), TriangularFactor.merged(c.behind(1) for c in chunks)
    free = one.n_rows - len(one.r) - len(chunks)
    # Share of the temperature's standard deviation that lies within the runs, from which they tell the static law by
    # themselves. Runs at set points, one temperature each, do not: their levels are the static law.
    if features.degree and np.linalg.norm(each.r[:, 0]) < 0.3 * np.linalg.norm(one.r[:, 0]):
        return 1.0
    left = _left(each)
    return _left(one) / left if free > 0 and left > 0 else 1.0


def _left(factor: TriangularFactor) -> float:
    """Sum of squares of the readings, the last column, that the others leave."""
    columns, reading = factor.r[:, :-1], factor.r[:, -1]
    norms = np.linalg.norm(columns, axis=0)
    fit = np.linalg.lstsq(columns / np.where(norms > 0, norms, 1.0), reading, rcond=1e-11)[0]
    rest = reading - columns / np.where(norms > 0, norms, 1.0) @ fit
    return float(rest @ rest)
