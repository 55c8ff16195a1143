"""Traces of the thermometers' errors, and of a log with too few rows: what looks like another cause."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ..effects import Covariate, Hysteresis
from .choice import Cause, Tried
from .levels import BETWEEN_ROWS, CHANGES, FOLLOWS, GAIN, LITTLE, NEAR_ROWS, OF_THERMOMETER, PLAY, SHARP, TINY
from .pool import Pool


def together(thermometers: pd.DataFrame) -> float:
    """Standard deviation of what the errors of all thermometers make wander in the reading, in its unit."""
    return float(np.sqrt((thermometers["wandering"] ** 2).sum())) if len(thermometers) else 0.0


def is_between_rows(cause: Cause, pool: Pool) -> bool:
    """Whether a cause is a trace of what the temperature did between its rows.

    It needs nothing but the temperature, as does all that it cannot be told from, and is no lead or delay of many rows;
    it explains no more than that may make, and helps little. Where the temperature turns as sharply as it moves, it may
    help more; and what helps nowhere at all, and does not look ahead, may be what a jump makes.
    """
    effects = [t.explanation.effect for t in (cause.tried, *cause.alike)]
    near = NEAR_ROWS * pool.record.usual_step()
    if not all(effect.of_temperature_alone and effect.moves_by() <= near for effect in effects):
        return False
    helped, between, (curve, jump) = cause.tried.worth.both, pool.between_rows, BETWEEN_ROWS
    sharp = between.turning > SHARP
    most = jump if helped < TINY and sharp and not effects[0].foresees else curve
    return helped < (GAIN if sharp else LITTLE) and cause.size <= most * between.curve


class Imitations:
    """What of a pool's explanations may be traces of the thermometers' errors."""

    def __init__(self, pool: Pool):
        self.pool = pool

    def taken_out(self, tried: Sequence[Tried], found: Sequence[Cause], left: float) -> Sequence[Tried]:
        """What was tried, less what may be a trace and does not help.

        That is so where a thermometer's noise is a cause already, or an effect of the model; or where it has evidence
        and the errors make as much as is `left`: the standard deviation of what wanders, in the unit of the reading.
        Where they cannot make that, the noise is no cause, and taken out itself.
        """
        known = self._known(found)
        if not known and not any(_noisy(t) and (t.score > 0 or t.worth.both >= GAIN) for t in tried):
            return tried
        if not self._suffice(found, left):
            return [t for t in tried if not _noisy(t)]
        least = [self._least(t) for t in tried]
        return [
            t for t, needed in zip(tried, least, strict=True) if t.worth.both >= needed or (_noisy(t) and not known)
        ]

    def behind(self, best: Tried, rivals: Sequence[Tried], found: Sequence[Cause], left: float) -> Tried:
        """The noise of the thermometer, where it is as good a cause as what may be a trace of it; else the cause."""
        if not best.explanation.effect.thermal_rank or not self._suffice(found, left):
            return best
        return next((t for t in rivals if _noisy(t)), best)

    def _known(self, found: Sequence[Cause]) -> bool:
        own = (effect for _, effect in self.pool.model.features_.further_effects())
        return any(effect.of_thermometer for effect in own) or any(_noisy(cause.tried) for cause in found)

    def _suffice(self, found: Sequence[Cause], left: float) -> bool:
        """Whether the thermometers' errors are known to act, or make as much as is left."""
        made = together(self.pool.thermometers)
        return self._known(found) or (made > 0 and left <= OF_THERMOMETER * made)

    def _least(self, t: Tried) -> float:
        """Help [dB] above which it is no artefact of the thermometer: any for a recorded column, else much."""
        effect, column = t.explanation.effect, t.key[1]
        if isinstance(effect, Hysteresis) and len(self.pool.thermometers):
            first = self.pool.thermometers.iloc[0]
            own = effect.width <= max(PLAY[0] * first["noise"], PLAY[1] * first["resolution"])
            return np.inf if own else -np.inf
        if effect.thermal_rank or column in self._followers:
            return GAIN
        return -np.inf if column is None else 0.0

    @cached_property
    def _followers(self) -> set[Any]:
        """Recorded columns that change as the temperature does: they may know it better."""
        last = {e.key[1]: e for e in self.pool.explanations if e.key[0] == Covariate.kind}
        plain = {e.key[1]: e.columns for e in self.pool.with_columns(list(last.values()))}
        T = self.pool.rows.weighed(self.pool.temperature)
        return {name for name, columns in plain.items() if _follows(columns[:, 0], T)}


def _noisy(t: Tried) -> bool:
    return t.explanation.effect.of_thermometer


def _follows(values: np.ndarray, temperature: np.ndarray) -> bool:
    """Whether two series change together, over a few rows or over many."""
    for rows in CHANGES:
        one, other = values[rows:] - values[:-rows], temperature[rows:] - temperature[:-rows]
        size = float(np.sqrt((one @ one) * (other @ other)))
        if abs(float(one @ other)) > FOLLOWS * size:
            return True
    return False
