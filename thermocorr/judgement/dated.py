"""Explanations that begin at a row: a step, another law, a short disturbance. The best of all rows of each."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from ..effects import Disturbance, InitialTransient, SensitivityStep, Step
from ..effects.protocol import Effect
from .anywhere import step_gains
from .cuts import change_gains
from .levels import LEAST_RULE, SHORTEST_STRETCH, STRETCHES
from .likelihood import Comparison
from .pool import Explanation, Key, Pool, of_first_rows
from .stretches import best_stretch

DATED = (Step.kind, SensitivityStep.kind, Disturbance.kind)
"""Kinds that are looked for at every row, not on a grid of candidates."""
MANY: tuple[Key, ...] = ((Step.kind, None), (Disturbance.kind, None))
"""Kinds, and their columns, that may occur several times in a record."""


def tries(n: int) -> dict[Key, int]:
    """How many different moments or stretches each kind is tried at, on a record of n rows."""
    return {(Step.kind, None): n, (SensitivityStep.kind, None): n, (Disturbance.kind, None): STRETCHES * n}


def dated(
    pool: Pool, judged: Comparison, theta: np.ndarray, rows: np.ndarray, kinds: Collection[str] = DATED
) -> list[Explanation]:
    """The best of each kind under a given noise; none where none gains anything.

    `rows` is what `anywhere.filtered` says. Another law is left out where a step alone does as well.
    """
    found: list[Explanation] = []
    either = Step.kind in kinds or SensitivityStep.kind in kinds
    steps = step_gains(judged, theta, pool.rows.weight, rows) if either else np.zeros(1)
    steps[:SHORTEST_STRETCH] = steps[max(judged.n - SHORTEST_STRETCH, 0) :] = 0.0  # a few first or last large readings
    if Step.kind in kinds and steps.max() > 0:
        found.append(_from(pool, Step, int(steps.argmax())))
    if SensitivityStep.kind in kinds:
        changes = change_gains(judged, theta, pool.rows.weight, pool.temperature, rows)
        few = int(LEAST_RULE * judged.n)
        changes[:few] = changes[judged.n - few :] = 0.0
        if changes.max() > steps.max() + 0.5 * math.log(judged.n):
            found.append(_from(pool, SensitivityStep, int(changes.argmax())))
    if Disturbance.kind in kinds and (stretch := best_stretch(judged, theta, pool.rows.weight)) is not None:
        effect = Disturbance(moment(pool, stretch.start), moment(pool, stretch.stop, ends=True))
        effect.learn(pool.record)
        start, end = effect.seconds_
        inside = (pool.data.seconds >= start) & (pool.data.seconds < end)
        found.append(Explanation(effect, pool.rows.weighed(inside.astype(float)[:, None])))
    return found


def lasting(pool: Pool, effect: Effect) -> bool:
    """Whether an effect lasts for as many rows as the shortest that is looked for, however it was tuned.

    A few large readings of heavy tails that follow on one another are no disturbance, the first ones no start, and they
    or the last ones no step. True for other kinds.
    """
    if isinstance(effect, InitialTransient):
        return not of_first_rows(effect, pool.spacing)
    if isinstance(effect, Step):
        before = np.count_nonzero(pool.data.seconds < effect.seconds_)
        return bool(SHORTEST_STRETCH <= before <= len(pool.data.seconds) - SHORTEST_STRETCH)
    if not isinstance(effect, Disturbance):
        return True
    start, end = effect.seconds_
    rows = np.count_nonzero((pool.data.seconds >= start) & (pool.data.seconds < end))
    return bool(rows >= SHORTEST_STRETCH)


def moment(pool: Pool, row: int, ends: bool = False) -> float:
    """Time between an averaged row and the one before it, since the record began [s].

    Where a run begins that overlaps the one before it, half a step before its first row, or behind the other's last.
    """
    seconds = pool.data.seconds
    if seconds[row - 1] < seconds[row]:
        return float(np.mean(seconds[row - 1 : row + 1]))
    at, beside = (row - 1, row - 2) if ends else (row, min(row + 1, len(seconds) - 1))
    return float(seconds[at] + (seconds[at] - seconds[beside]) / 2)


def _from(pool: Pool, kind: type[Step], row: int) -> Explanation:
    """What begins between an averaged row and the one before it."""
    effect = kind(moment(pool, row))
    effect.learn(pool.record)
    later = (pool.data.seconds >= effect.seconds_).astype(float)
    columns = [later] if kind is Step else [later, later * pool.temperature]
    return Explanation(effect, pool.rows.weighed(np.column_stack(columns)))
