"""Runs at different levels, each with a U0 of its own.

A log may hold runs of different measurands: 3 V on Monday, 7 V on Tuesday. One U0 for both makes the temperature's
columns explain the difference, and the correction is nonsense. So a step at the start of each run stands in the model,
which `correct` keeps, where the record says so.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..effects import ThermalLag
from ..equations import TriangularFactor
from ..records import Record, RecordError
from .features import DiffusiveFeatures
from .fitting import sweep_effects

DISTINCT = 100.0
"""Levels of their own must make the residual variance of a model with few lags smaller by this factor: measurands are
more than ten times as far apart as what is left within a run. What moves the reading by less from run to run is an
effect, to be found by a diagnosis: a drift, a step, another column. Half and twice of it is 7 and 14 times as far."""
WITHIN = 0.3
"""Share of the temperature's standard deviation that lies within the runs, from which on they tell the static law by
themselves. Runs at set points, one temperature each, do not: their levels are the static law."""
LAGS = 5
"""Lags of the model that decides, from two steps to a tenth of the longest run."""


class RunLevels(NamedTuple):
    """Moments at which the level of the reading changes, in seconds since the record began; none for one level."""

    times: tuple[float, ...] = ()
    note: str = ""


def run_levels(features: DiffusiveFeatures, record: Record, always: bool) -> RunLevels:
    """Whether runs have levels of their own, and where these begin.

    Parameters
    ----------
    features : DiffusiveFeatures
        Learned on the record: static law and further effects, without lags.
    record : Record
        With readings.
    always : bool
        Do not ask the record.

    Raises
    ------
    RecordError
        Where runs overlap in time and are to have levels of their own: a model holds one at a time.
    """
    firsts = [k for k, segment in enumerate(record.segments) if k == 0 or segment.run != record.segments[k - 1].run]
    if len(firsts) < 2:
        return RunLevels()
    better = np.inf if always else _gain(features, record, firsts)
    if better < DISTINCT:
        return RunLevels()
    spans = []
    for first, behind in pairwise([*firsts, len(record.segments)]):
        start, end = record.segments[first].start, record.segments[behind - 1].stop - 1
        spans.append((record.stamp(start), record.stamp(end), record.segments[first].run))
    spans.sort(key=lambda span: span[0])
    for before, after in pairwise(spans):
        if after[0] <= before[1]:
            raise RecordError(
                f"Runs {before[2]!r} and {after[2]!r} overlap in time and have readings at different levels: one model "
                "holds one level at a time. Fit a model for each of them, or pass run_offset='same' if they are one "
                "measurand."
            )
    zero = record.first_stamp()
    gaps = [(before[1], after[0]) for before, after in pairwise(spans)]
    times = tuple(record.times.between((end + start) / 2, zero) for end, start in gaps)
    if always:
        return RunLevels(times)
    return RunLevels(
        times,
        f"The {len(firsts)} runs are at different levels: each has a U0 of its own, which correct keeps "
        f"(run_offset='each'); one for all would leave {np.sqrt(better):.3g} times the residual. Pass "
        "run_offset='same' if they are one measurand.",
    )


def _gain(features: DiffusiveFeatures, record: Record, firsts: list[int]) -> float:
    """Residual variance with one level over that with a level for each run; 1 where the runs cannot tell."""
    longest = max(record.duration(segment) for segment in record.segments)
    step = record.usual_step()
    lag = ThermalLag(np.geomspace(2 * step, max(longest / 10, 4 * step), LAGS).tolist(), features.hold)
    lag.learn(record)
    edges = np.array([*(record.segments[k].start for k in firsts), record.n_rows])
    edges[0] = 0
    chunks = [
        chunk for chunk in sweep_effects(record, [*features.effect_list(), lag], edges).chunks if chunk.n_rows > 1
    ]
    if len(chunks) < 2:
        return 1.0
    one, each = TriangularFactor.merged(chunks).behind(1), TriangularFactor.merged(c.behind(1) for c in chunks)
    free = one.n_rows - len(one.r) - len(chunks)
    if features.degree and np.linalg.norm(each.r[:, 0]) < WITHIN * np.linalg.norm(one.r[:, 0]):
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
