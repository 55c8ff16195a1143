"""The columns that a search works on: lags of a grid of time constants, and start-up decays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...effects import InitialTransient, ThermalLag
from ...effects.covariates import ColumnLags
from ...effects.protocol import Effect
from ...records import Record
from ..features import DiffusiveFeatures
from ..fitting import Swept, sweep_effects
from .folds import TimeFolds
from .spectrum import DECAY_SHARE, GridLayout

MOST_SEGMENTS = 8
"""With more segments, each has a few decays of its own that are taken out, not one for each time constant tried."""
N_STARTS = 4
"""How many: decays of neighbouring time constants are much alike."""
FASTEST_START = 2.0
"""The fastest of them, in sampling steps."""


@dataclass(frozen=True)
class LagColumns:
    """Learned lags and decays for a list of time constants, and where their columns stand."""

    lag: ThermalLag
    further: list[ColumnLags]
    """Lags of the thermometers beyond the first."""
    transient: InitialTransient
    starts: InitialTransient
    """Decays that are fitted and taken out of everything: where there are many segments, or several thermometers that
    share them, in place of `transient`."""
    layout: GridLayout
    decays: list[tuple[int, int, float]]
    """Column, segment and time constant of each decay."""

    @classmethod
    def of(cls, features: DiffusiveFeatures, record: Record, time_constants: np.ndarray) -> LagColumns:
        """Lags, and decays up to `DECAY_SHARE` of the record, behind the columns of the learned `features`.

        Each thermometer has lags of all the time constants.
        """
        taus = time_constants.tolist()
        lag = ThermalLag(taus, features.hold)
        columns = features.thermometers().further
        further = [ColumnLags(column, taus, features.hold) for column in columns]
        fitted, many = features.initial_state == "fit", bool(further) or len(record.segments) > MOST_SEGMENTS
        transient = InitialTransient(taus, DECAY_SHARE if fitted and not many else 0.0)
        span = record.longest_read()
        few = np.geomspace(FASTEST_START * record.usual_step(), max(span, record.usual_step()), N_STARTS)
        starts = InitialTransient(few.tolist(), DECAY_SHARE if fitted and many else 0.0)
        for effect in (lag, *further, transient, starts):
            effect.learn(record)
        n_free = 1 + sum(effect.n_columns() for effect in features.effect_list())
        grid = np.tile(time_constants, 1 + len(further))
        owned: list[list[int]] = [[] for _ in grid]
        decays = []
        for key, taus in transient.decays_.items():
            for offset, tau in enumerate(taus):
                column = n_free + len(time_constants) + transient.first_column_[key] + offset
                owned[int(np.searchsorted(time_constants, tau))].append(column)
                decays.append((column, key, float(tau)))
        deviations = [record.moments(name).std or 1.0 for name in (record.temperature_name, *columns)]
        layout = GridLayout(grid, span, n_free, owned, deviations)
        return cls(lag=lag, further=further, transient=transient, starts=starts, layout=layout, decays=decays)

    def dead(self, record: Record, folds: TimeFolds) -> list[list[int]]:
        """Decays too slow for what each fold learns from: columns that it must not use."""
        if not self.decays:
            return [[] for _ in range(len(folds))]
        result = []
        for f in range(len(folds)):
            limits = self.transient.longest([folds.learned_duration(f, record, segment) for segment in record.segments])
            result.append([column for column, key, tau in self.decays if tau > limits[key]])
        return result

    @property
    def taken_out(self) -> InitialTransient | None:
        """`starts`, where they are used."""
        return self.starts if self.starts.decays_ else None

    def swept(self, record: Record, effects: Sequence[Effect], edges: np.ndarray) -> Swept:
        """Factors of ``[1 | Q | U]`` for the stretches between `edges`, less what starts of many segments hold."""
        return sweep_effects(record, effects, edges, self.taken_out)
