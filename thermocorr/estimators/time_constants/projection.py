"""Time constants between the grid's, by variable projection, and how well a record determines them.

The coefficients are linear and eliminated; the time constants are moved by Gauss-Newton steps on what is left (Golub &
Pereyra 1973, SIAM J. Numer. Anal. 10, 413, in the joint form: the sensitivities to ln tau stand beside the columns).
Each step is one pass over the record, and the same factors give the standard error of every time constant.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...equations import TriangularFactor, solve_ridge
from ..fitting import Swept, standard_errors
from .crossvalidation import no_worse
from .folds import LagColumns
from .search import Factored

DIFFERENCE = 1e-4
"""Step in ln tau of the numerical sensitivity."""
MAX_PASSES = 8
CONVERGED = 1e-3
"""A step in ln tau below which nothing is moved any more."""
SMALLEST_GAIN = 1e-6
"""Relative gain of the residual sum of squares below which nothing is moved any more."""
DAMPINGS = (0.003, 0.03, 0.3)
"""Dampings of a step, relative to the sensitivities; the next is tried where one makes the fit worse."""
LONGEST_STEP = 0.5
"""Longest step in ln tau."""


@dataclass(frozen=True)
class Extended:
    """Factors of ``[1 | Q | dU/dln tau | U]``, made when somebody asks for them."""

    chunks: Sequence[TriangularFactor]
    """Factors of ``[1 | Q | Q of moved time constants | U]``, stretch by stretch."""
    combination: np.ndarray
    """What makes the columns of these those of the others."""
    n_time_constants: int

    @cached_property
    def factors(self) -> list[TriangularFactor]:
        """Stretch by stretch."""
        return [chunk.combined(self.combination) for chunk in self.chunks]

    def log_errors(self) -> np.ndarray:
        """Standard error of each ln tau; true for residuals that forget within a stretch (see `standard_errors`).

        Infinite where the record says nothing about a time constant.
        """
        n = self.n_time_constants
        swept = Swept([factor for factor in self.factors if factor.n_rows], [], 0.0)
        solution = solve_ridge(swept.total())
        silent = np.linalg.norm(solution.inverse_triangle[-n:], axis=1) == 0
        return np.where(silent, np.inf, standard_errors(swept, solution, 0.0)[-n:])


@dataclass(frozen=True)
class Sensitivity:
    """A model and its sensitivity to each time constant."""

    base: Factored
    columns: LagColumns
    extended: Extended
    residual_sum_of_squares: float

    @property
    def time_constants(self) -> np.ndarray:
        """[s]."""
        return self.columns.layout.grid

    @cached_property
    def model(self) -> Factored:
        """Factors of ``[1 | Q | U]``, stretch by stretch, and what their columns are."""
        own = _own_columns(self.columns)
        return Factored(
            record=self.base.record, reading=self.base.reading, features=self.base.features, columns=self.columns,
            chunks=[chunk.select(own) for chunk in self.extended.chunks], folds=self.base.folds,
        )  # fmt: skip

    def step(self, alpha: float, damping: float) -> np.ndarray:
        """Gauss-Newton step in ln tau, damped as Levenberg and Marquardt do where directions are nearly alike."""
        factor, n = TriangularFactor.merged(self.extended.factors), len(self.time_constants)
        n_rows = factor.n_rows
        rows = np.zeros((n, factor.r.shape[1]), order="F")
        rows[:, -1 - n : -1] = np.diag(damping * np.linalg.norm(factor.r[1:, -1 - n : -1], axis=0))
        factor.update(rows)
        factor.n_rows = n_rows
        return np.clip(solve_ridge(factor, alpha).coef[-n:], -LONGEST_STEP, LONGEST_STEP)


def sensitivity(base: Factored, time_constants: np.ndarray, alpha: float) -> Sensitivity:
    """Factors of a model and of its sensitivities to its lags' time constants, in one pass.

    `base` (Factored): The record, its static part and its folds. `time_constants` (array of shape (J,)): [s]. `alpha`
    (float): Ridge penalty.
    """
    record, n_lags = base.record, len(time_constants)
    columns = LagColumns.of(base.features, record, time_constants)
    moved_lag, moved_transient = copy.copy(columns.lag), copy.copy(columns.transient)
    moved_lag.time_constants_ = time_constants * np.exp(DIFFERENCE)
    moved_transient.decays_ = {key: taus * np.exp(DIFFERENCE) for key, taus in columns.transient.decays_.items()}
    effects = [*base.features.effect_list(), columns.lag, columns.transient, moved_lag, moved_transient]
    swept = columns.swept(record, effects, base.folds.edges)
    *own, reading = _own_columns(columns)
    n_model, n_moved = len(own), reading - len(own)
    solution = solve_ridge(swept.total().select([*own, reading]), alpha)
    combination = np.zeros((reading + 1, n_model + n_lags + 1))
    combination[:n_model, :n_model] = np.eye(n_model)
    combination[-1, -1] = 1.0
    for j in range(n_lags):
        for column in columns.layout.columns([j]):  # dU/dln tau: coefficient times (moved column less column)
            share = solution.coef[column - 1] / DIFFERENCE
            combination[column, n_model + j] = -share
            combination[column + n_moved, n_model + j] = share
    extended = Extended(swept.chunks, combination, n_lags)
    return Sensitivity(base, columns, extended, solution.residual_sum_of_squares)


def _own_columns(columns: LagColumns) -> list[int]:
    """Those of ``[1 | Q | U]`` where the columns of moved time constants stand before the reading."""
    n_moved = len(columns.layout.grid) + len(columns.decays)
    n_model = columns.layout.n_free + n_moved
    return [*range(n_model), n_model + n_moved]


def moved_to_best(here: Sensitivity, alpha: float) -> Sensitivity:
    """Move the time constants to the least residual sum of squares, by steps that never increase it."""
    for _ in range(MAX_PASSES):
        there = None
        for damping in DAMPINGS:
            step = here.step(alpha, damping)
            if np.abs(step).max(initial=0.0) < CONVERGED:
                break
            taus = here.time_constants * np.exp(step)
            if (np.diff(np.log(taus)) > CONVERGED).all() and taus[0] > here.base.record.usual_step() / 2:
                trial = sensitivity(here.base, taus, alpha)
                if trial.residual_sum_of_squares < here.residual_sum_of_squares:
                    there = trial
                    break
        if there is None:
            break
        gain = 1 - there.residual_sum_of_squares / here.residual_sum_of_squares
        here = there
        if gain < SMALLEST_GAIN:
            break
    return here


def refined(base: Factored, time_constants: np.ndarray, alpha: float) -> tuple[Sensitivity, np.ndarray]:
    """Refine time constants, then leave out those that the folds do not miss.

    Time constants that were spread over two neighbours of the grid meet when they are free to move, and one of them
    becomes superfluous: it leaves, the others are moved again, as long as the loss on the tested stretches does not
    grow (see `no_worse`).

    Returns sensitivity (Sensitivity): of the refined model. Returns losses (array of shape (n_folds,)): its loss in
    each fold.
    """
    start = sensitivity(base, time_constants, alpha)
    moved = moved_to_best(start, alpha)
    before, after = _losses(start, alpha), _losses(moved, alpha)
    best, losses = (start, before) if before.mean() < after.mean() else (moved, after)
    while len(best.time_constants) > 1:
        cross = best.model.cross_validation()
        everything = range(len(best.time_constants))
        sets = [tuple(i for i in everything if i != left_out) for left_out in everything]
        kept = sets[int(cross.score_sets(sets, alpha).mean(axis=1).argmin())]
        fewer = moved_to_best(sensitivity(base, best.time_constants[list(kept)], alpha), alpha)
        fewer_losses = _losses(fewer, alpha)
        if not no_worse(fewer_losses, losses):
            break
        best, losses = fewer, fewer_losses
    return best, losses


def _losses(model: Sensitivity, alpha: float) -> np.ndarray:
    everything = tuple(range(len(model.time_constants)))
    losses: np.ndarray = model.model.cross_validation().score_sets([everything], alpha)[0]
    return losses
