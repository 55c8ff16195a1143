"""Levels of the runs of a log, a U0 each.

A log may hold runs of different measurands: 3 V on Monday, 7 V on Tuesday. One U0 for both makes the temperature's
columns explain the difference, and the correction is nonsense. So a step at the start of each run stands in the model,
which `correct` keeps. Runs at one level are no runs: a gap alone starts a segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects import SeveralSteps
from ..effects.protocol import Effect
from ..records import BLOCK_ROWS, Record, RecordError
from ..records.errors import option
from ..records.numbers import is_frame

MOST = 50
"""Runs above which all have one level: a fit takes time with the cube of their number."""
NAME = "run_levels"
"""Name of the steps among the effects of a model."""


class RunLevels(NamedTuple):
    """Moments at which the level changes [s since the start]."""

    times: tuple[float, ...] = ()
    note: str = ""

    def added_to(self, effects: list[tuple[str, Effect]]) -> list[tuple[str, Effect]]:
        """Effects of a model, then the steps between runs."""
        if not self.times:
            return effects
        taken = {name for name, _ in effects}
        name = NAME if NAME not in taken else f"{NAME}_of_runs"
        return [*effects, (name, SeveralSteps(list(self.times)))]

    @classmethod
    def among(cls, learned: Sequence[tuple[str, Effect]], given: Sequence[tuple[str, Effect]]) -> RunLevels:
        """Levels of a fitted model, from its effects."""
        own = {name for name, _ in given}
        steps = [e for name, e in learned if name.startswith(NAME) and name not in own and isinstance(e, SeveralSteps)]
        return cls(tuple(float(time) for step in steps for time in step.times))


def run_levels(record: Record) -> RunLevels:
    """Levels of a record's runs, and a note on doubts.

    Raises RecordError where runs overlap in time at levels that are far apart: a model holds one level at a time.
    """
    runs = [run for run in _runs(record) if run.has_readings]
    if len(runs) < 2:
        return RunLevels()
    if len(runs) > MOST:
        return RunLevels(note=f"There are {len(runs)} runs: with more than {MOST}, all have one level (U0).")
    ordered = sorted(runs, key=lambda run: run.begins)
    for before, after in pairwise(ordered):
        if after.begins <= before.ends:
            if _far_apart(record, runs):
                raise RecordError(
                    f"Runs {before.label!r} and {after.label!r} overlap in time and have readings at different levels: "
                    "one model holds one level at a time. Fit a model for each run."
                )
            overlap = f"Runs {before.label!r} and {after.label!r} overlap in time"
            return RunLevels(note=f"{overlap}: all have one level (U0).")
    zero = record.first_stamp()
    between = [(before.ends + after.begins) / 2 for before, after in pairwise(ordered)]
    return RunLevels(tuple(record.times.between(moment, zero) for moment in between), _at_set_points(record, runs))


def _far_apart(record: Record, runs: Sequence[_Run]) -> bool:
    """True if runs differ ten times as much as their readings."""
    reading: Any = record.reading
    values = [np.asarray(reading[record.kept(run.first, run.stop)], float) for run in runs]
    return bool(np.var([np.nanmean(own) for own in values]) > 10.0**2 * np.mean([np.nanvar(own) for own in values]))


def _at_set_points(record: Record, runs: Sequence[_Run]) -> str:
    """Note on runs at one temperature each."""
    temperature, squares = record.columns[record.temperature_name], 0.0
    for run in runs:
        own = np.asarray(temperature[record.kept(run.first, run.stop)], float)
        squares += len(own) * float(np.var(own)) if len(own) else 0.0
    known = record.moments(record.temperature_name)
    # Runs within which the temperature moves by less than three tenths of its spread hardly show the static law.
    if squares > 0.3**2 * known.n * known.std**2:
        return ""
    return (
        "The temperature differs between the runs and hardly within them, and each run has a level of its own: the "
        f"static law is not learned. If the runs measure the same quantity, leave out {option('run')}."
    )


class _Run(NamedTuple):
    """Consecutive segments with one label."""

    label: object
    first: int
    stop: int
    """Rows in time order at which it begins, and behind its end."""
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
        start, stop = segments[0].start, segments[-1].stop
        known = any(_known(record, segment.start, segment.stop) for segment in segments)
        found.append(_Run(segments[0].run, start, stop, record.stamp(start), record.stamp(stop - 1), known))
    return found


def _known(record: Record, start: int, stop: int) -> bool:
    """True if there are readings between two rows in time order."""
    reading: Any = record.reading
    blocks = (record.rows(low, min(low + BLOCK_ROWS, stop)) for low in range(start, stop, BLOCK_ROWS))
    return any(np.isfinite(np.asarray(reading[rows], float)).any() for rows in blocks)


def unlearned(model: Any, X: Any, known: np.ndarray) -> np.ndarray:
    """True for rows of runs without a known level, (n_rows,).

    `model` (DynamicBiasRegressor): Fitted; where its runs have one level, there are no such rows. `X` (as for its
    `fit`). `known` (array of shape (n_rows,)): Readings that are learned from, NaN elsewhere.
    """
    if not model._run_levels.times:
        return np.zeros(len(known), bool)
    labels = pd.Series(X[model.run][:] if is_frame(X) else X[:, model.run]).reset_index(drop=True)
    return np.asarray(~labels.isin(labels[np.isfinite(known)].unique()))


def is_level(model: Any, effect: Effect) -> bool:
    """True if an effect is the level of each run."""
    times = model._run_levels.times
    return bool(times) and isinstance(effect, SeveralSteps) and tuple(effect.times) == times


def level_variance(model: Any) -> float:
    """Variance of the runs' levels about the last.

    What the level of a run that was never seen may be off by, as far as the fitted runs tell.
    """
    times = model._run_levels.times
    if not times:
        return 0.0
    effects = model.features_.effect_list()
    ends = np.cumsum([effect.n_columns() for effect in effects]).tolist()
    last = max(k for k, effect in enumerate(effects) if is_level(model, effect))
    levels = np.concatenate(([0.0], np.cumsum(model.coef_[ends[last] - len(times) : ends[last]])))
    return float(np.sum((levels - levels[-1]) ** 2) / len(times))
