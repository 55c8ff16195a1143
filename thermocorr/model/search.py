"""Search of time constants: methods, and the pass that serves all."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects.stream import equal_edges
from ..effects.thermal import PLAIN, seconds_array
from ..equations import RidgeSolution, TriangularFactor, solve_ridge
from ..records import Record, RecordError
from ..records.history import rows_apart
from ..records.numbers import span_texts
from .features import DiffusiveFeatures
from .fitting import Swept, require_rows, standard_errors
from .folds import NEGLIGIBLE, CrossValidation, LagColumns, Set, TimeFolds, count_sets, fewest, folds_in_time, no_worse
from .reading import Reading, check_plausible
from .spectrum import (
    LARGEST_ALPHA,
    MIN_ROWS,
    N_BLOCKS,
    PENALTIES,
    POOL_SIZE,
    GridLayout,
    GridRidge,
    log_grid,
    project,
    reference_of,
    spread,
)


def check_candidates(candidates: Any) -> None:
    """Raise ValueError unless candidates are "auto", times, or lists of times."""
    if isinstance(candidates, str) and candidates == "auto":
        return
    listed = not isinstance(candidates, str) and hasattr(candidates, "__len__")
    if listed and len(candidates) == 0:
        raise ValueError("The 'candidates' parameter is empty: name time constants to choose from, or 'auto'.")
    if not listed or len({isinstance(item, str) or not hasattr(item, "__len__") for item in candidates}) > 1:
        raise ValueError(
            "The 'candidates' parameter must be 'auto', a list of times, or a list of lists of times. "
            f"Got {candidates!r} instead."
        )


def check_alphas(alphas: Any) -> None:
    """Raise ValueError for penalties that are no numbers >= 0."""
    if isinstance(alphas, str) and alphas == "auto":
        return
    try:
        values = np.atleast_1d(np.asarray(alphas, float))
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.ndim != 1 or not len(values) or not (np.isfinite(values) & (values >= 0)).all():
        raise ValueError(
            "The 'alphas' parameter must be 'auto' or ridge penalties that are finite and not negative. "
            f"Got {alphas!r} instead."
        )


METHODS = ("spectrum", "cross_validation")
WORTH = 0.01
"""Share of what is left that a slow one must explain. Those that a thermometer's noise (0.1 K) brings in explain up to
1.1 %. The gain of 36 devices is wrong by 0.18 % on the average with this, by 0.43 % without, by 0.7 and 2.2 % at most
(`benchmarks/thermometer_noise.py`; chosen on seeds 0 to 11, these are 12 to 47). The least of the slow lags in each of
eight measured records explains 0.1 %, 1.2 %, 3 %, and 5 to 50 %: only the first leaves, and the errors on later data
change by less than 0.3 % (`benchmarks/real_records.py`)."""
EXHAUSTIVE_LIMIT = 20_000
"""Up to this many sets, cross-validation tries them all; beyond, forward steps with exchanges."""


@dataclass(frozen=True)
class SearchSettings:
    """Settings of a search; see `TimeConstantSearch`."""

    candidates: Any = "auto"
    method: str = "spectrum"
    count: int | None = None
    alphas: Any = "auto"
    cv: Any = 5


class CandidateRow(NamedTuple):
    """One line of the table of candidates."""

    members: Set
    alpha: float
    losses: np.ndarray
    """Shape (n_folds,)."""


@dataclass(frozen=True, kw_only=True)
class Factored:
    """A record as the search needs it, read once."""

    record: Record
    reading: Reading
    features: DiffusiveFeatures
    """Static law and further effects, learned."""
    columns: LagColumns
    chunks: list[TriangularFactor]
    """One for each stretch of `folds`."""
    folds: TimeFolds

    @cached_property
    def whole(self) -> TriangularFactor:
        """One factor of all stretches."""
        return TriangularFactor.merged(self.chunks)

    @property
    def layout(self) -> GridLayout:
        """Layout of the columns."""
        return self.columns.layout

    def cross_validation(self) -> CrossValidation:
        """Errors of sets in the folds."""
        dead = self.columns.dead(self.record, self.folds)
        return CrossValidation(self.chunks, self.folds, self.layout, dead)


@dataclass(frozen=True, kw_only=True)
class TimeConstantChoice:
    """Result of a search."""

    time_constants: np.ndarray
    """Those of the first thermometer [s]."""
    further: dict[object, np.ndarray] = field(default_factory=dict)
    """Those of the thermometers beyond it [s]."""
    ambient: object = None
    """Name of the first thermometer."""
    alpha: float
    """Ridge penalty for the final fit."""
    grid: np.ndarray
    """The time constants that were searched [s]."""
    tried: tuple[CandidateRow, ...] = ()
    """The candidates, best first."""
    chosen: CandidateRow | None = None
    reference: GridRidge | None = None
    factored: Factored | None = None
    spectrum: dict[str, np.ndarray] | None = None
    """Columns of `resolution.spectrum_table`, in the choice that a fitted `DynamicBiasRegressor` keeps."""

    @property
    def parameter(self) -> Any:
        """The time constants as the parameter of this name takes them."""
        return {self.ambient: self.time_constants, **self.further} if self.further else self.time_constants


def search(
    features: DiffusiveFeatures, record: Record, reading: Reading, settings: SearchSettings
) -> TimeConstantChoice:
    """Search time constants for a record.

    `features` (DiffusiveFeatures): The model without lags: static law and further effects, which stand in every set.
    `record` (Record): With readings. `reading` (Reading): Of the record. `settings` (SearchSettings).
    """
    grid_given = not isinstance(settings.candidates, str)
    learn_checked(features, record, reading)
    span = record.longest_read()
    if reading.n_readings < MIN_ROWS:
        if settings.method == "spectrum" and not grid_given:
            return _evenly_spread(features, record, reading, span, settings)
        raise RecordError(
            f"The record is too short for a search: {reading.n_readings} readings, and {MIN_ROWS} are needed. Record "
            "longer, or give time_constants."
        )
    explicit = _explicit_sets(settings.candidates)
    if explicit is not None:
        grid = np.unique(np.concatenate(explicit))
    elif grid_given:
        grid = seconds_array(settings.candidates)
    else:
        grid = log_grid(record.usual_step(), span, POOL_SIZE)
    factored = factors_of(features, record, reading, grid, settings)
    cross = factored.cross_validation()
    if not cross.sides:
        raise RecordError(
            rows_apart(record)
            or "No fold has readings both to learn from and to test. Record longer, or give time_constants; in "
            "TimeConstantSearch, choose other folds with cv=..."
        )
    if settings.method == "spectrum" and explicit is None:
        return _by_spectrum(factored, cross, settings)
    return _by_cross_validation(factored, cross, settings, explicit)


def learn_checked(features: DiffusiveFeatures, record: Record, reading: Reading) -> None:
    """Let features learn; refuse a record that teaches nothing."""
    features.learn_from(record)
    require_rows(reading.n_readings, sum(effect.n_columns() for effect in features.effect_list()))
    check_plausible(record, reading)


def _by_spectrum(factored: Factored, cross: CrossValidation, settings: SearchSettings) -> TimeConstantChoice:
    """A spectrum chosen by forecasting, then projected on few."""
    reference = reference_spectrum(factored)
    path = project(factored.whole, factored.layout, reference, settings.count)
    alpha = final_alpha(factored, reference)
    if path and settings.count is None:
        path.append(_without_idle_ones(_with_fast_ones(path[-1], factored, cross, alpha), factored, alpha))
    tried = [CandidateRow(members, alpha, cross.score_sets([members], alpha)[0]) for members in path]
    chosen = tried[-1] if tried else CandidateRow((), alpha, cross.score_sets([()], alpha)[0])
    return _choice(factored, tried or [chosen], chosen, reference)


def _with_fast_ones(members: Set, factored: Factored, cross: CrossValidation, alpha: float) -> Set:
    """Add fast time constants that the penalty suppressed.

    The mean over the folds has to be better with them, and so have all folds but one: a missing effect may upset one.
    Only fast ones: any stretch of a record has seen many of their lives, and forecasts are safe.
    """
    grid = factored.layout.grid
    # Any stretch has seen many lives of time constants up to a 200th of the record.
    fast = [i for i in range(len(grid)) if grid[i] <= (1 / 200) * factored.layout.span]
    # Up to three fast time constants may join the projected ones.
    for _ in range(3):
        now = cross.score_sets([members], alpha)[0]
        more = [tuple(sorted((*members, i))) for i in fast if i not in members]
        if not more:
            break
        losses = cross.score_sets(more, alpha)
        best = int(np.argmin([each.mean() for each in losses]))
        if not (np.sum(losses[best] >= now) <= 1 and losses[best].mean() < now.mean() * (1 - NEGLIGIBLE)):
            break
        members = more[best]
    return members


def _without_idle_ones(members: Set, factored: Factored, alpha: float) -> Set:
    """Drop slow time constants that explain nothing more.

    A slow lag is nearly a straight line, and shares the static law with it: one that is there for nothing costs the
    gain some digits. A thermometer with noise brings such lags in. Where starts of many segments were taken out, no lag
    is idle: the fit has the decays of no others, and a slow body may show in these alone.
    """
    layout = factored.layout
    if factored.columns.starts.decays_:
        return members
    # Time constants above a fiftieth of the record are slow.
    slow = [i for i in members if layout.grid[i] > (1 / 50) * layout.span]

    def left(some: Set) -> float:
        columns = [*range(layout.n_free), *layout.columns(some), factored.whole.r.shape[1] - 1]
        return solve_ridge(factored.whole.select(columns), alpha).residual_sum_of_squares

    now = left(members)
    while slow and len(members) > 1:
        without = {i: left(tuple(j for j in members if j != i)) for i in slow}
        idle = min(slow, key=without.__getitem__)
        if without[idle] > now * (1 + WORTH):
            break
        members, now = tuple(j for j in members if j != idle), without[idle]
        slow.remove(idle)
    return members


def _by_cross_validation(
    factored: Factored, cross: CrossValidation, settings: SearchSettings, explicit: list[np.ndarray] | None
) -> TimeConstantChoice:
    """Set and penalty with the least error on unseen stretches."""
    n = factored.reading.n_readings
    # Ridge penalties per reading, where none are given:
    alphas = sorted(
        [alpha * n for alpha in (0.0, 1e-8, 1e-6, 1e-4)]
        if isinstance(settings.alphas, str)
        else np.atleast_1d(np.asarray(settings.alphas, float)).tolist()
    )
    grid = factored.layout.grid
    if explicit is not None:
        members = iter(np.searchsorted(grid, np.concatenate(explicit)).tolist())
        sets = [tuple(islice(members, len(times))) for times in explicit]
        for alpha in alphas:
            cross.try_sets(sets, alpha)
        best = _best_of_each_size(cross, sets, alphas)
    else:
        candidates = list(range(len(grid)))
        # Cross-validation tries up to six time constants.
        most = settings.count or 6
        exhaustive = count_sets(len(grid), most) <= EXHAUSTIVE_LIMIT
        path = (cross.exhaustive if exhaustive else cross.greedy)(candidates, most, alphas[0])
        if settings.count is not None:
            path = path[-1:]
        for alpha in alphas[1:]:
            cross.score_sets(path, alpha)
        best = _best_of_each_size(cross, path, alphas)
    chosen = best[fewest([line.losses for line in best])]
    tried = [CandidateRow(members, alpha, losses) for (alpha, members), losses in cross.losses.items()]
    reference = None
    if explicit is None:
        reference = reference_spectrum(factored)
    return _choice(factored, tried, chosen, reference)


def _best_of_each_size(cross: CrossValidation, sets: Sequence[Set], alphas: Sequence[float]) -> list[CandidateRow]:
    lines = [(members, alpha) for members in sets for alpha in alphas]
    losses = np.array([cross.losses[alpha, members] for members, alpha in lines])
    sizes, mean = np.array([len(members) for members, _ in lines]), losses.mean(axis=1)
    best = []
    for size in np.unique(sizes):
        alike = np.flatnonzero(sizes == size)
        i = int(alike[mean[alike].argmin()])
        best.append(CandidateRow(*lines[i], losses[i]))
    return best


def _choice(
    factored: Factored, tried: Sequence[CandidateRow], chosen: CandidateRow, reference: GridRidge | None
) -> TimeConstantChoice:
    grid = factored.layout.grid
    order = np.argsort(np.array([line.losses for line in tried]).mean(axis=1), kind="stable")
    ordered = [tried[i] for i in order.tolist()]
    members = np.array(chosen.members, np.intp)
    own = [grid[members[factored.layout.owner[members] == i]] for i in range(len(factored.layout.deviations))]
    return TimeConstantChoice(
        time_constants=own[0],
        ambient=factored.record.temperature_name,
        further=dict(zip(factored.features.thermometers().further, own[1:], strict=True)),
        alpha=chosen.alpha,
        grid=grid,
        tried=tuple(ordered),
        chosen=chosen,
        reference=reference,
        factored=factored,
    )


def _explicit_sets(candidates: Any) -> list[np.ndarray] | None:
    """Sets of time constants that the user lists [s], or None."""
    if isinstance(candidates, str) or not len(candidates) or np.ndim(candidates[0]) == 0:
        return None
    if all(PLAIN.issuperset(map(type, times)) for times in candidates):
        known = {}
        for n in {len(times) for times in candidates}:
            known[n] = np.sort(np.array([times for times in candidates if len(times) == n], float), axis=1)
        if all((np.isfinite(k) & (k > 0)).all() and (np.diff(k, axis=1) > 0).all() for k in known.values()):
            rows = {n: iter(k) for n, k in known.items()}
            return [next(rows[len(times)]) for times in candidates]
    return [seconds_array(times) for times in candidates]


def _evenly_spread(
    features: DiffusiveFeatures, record: Record, reading: Reading, span: float, settings: SearchSettings
) -> TimeConstantChoice:
    """A few evenly spread time constants, for too few readings."""
    n_static = sum(effect.n_columns() for effect in features.effect_list())
    count = 3 if settings.count is None else settings.count
    count = max(1, min(count, (reading.n_readings - n_static - 2) // 4))
    grid = spread(log_grid(record.usual_step(), span), span, count)
    if isinstance(settings.cv, Integral):
        settings = replace(settings, cv=max(2, min(int(settings.cv), record.n_rows // 4)))
    factored = factors_of(features, record, reading, grid, settings)
    cross = factored.cross_validation()
    members, alpha = tuple(range(len(factored.layout.grid))), PENALTIES[2] * reading.n_readings
    losses = cross.score_sets([members], alpha)[0] if cross.sides else np.full(1, np.nan)
    chosen = CandidateRow(members, alpha, losses)
    return _choice(factored, [chosen], chosen, None)


def factors_of(
    features: DiffusiveFeatures, record: Record, reading: Reading, grid: np.ndarray, settings: SearchSettings
) -> Factored:
    """A factor per stretch of ``[1 | static | lags | decays | U]``."""
    columns = LagColumns.of(features, record, grid)
    folds = folds_in_time(record, settings.cv)
    effects = [*features.effect_list(), columns.lag, *columns.further, columns.transient]
    chunks = list(columns.swept(record, effects, folds.edges).chunks)
    return Factored(record=record, reading=reading, features=features, columns=columns, chunks=chunks, folds=folds)


def reference_spectrum(factored: Factored) -> GridRidge:
    """The whole spectrum, from `N_BLOCKS` stretches of equal length."""
    ends = equal_edges(factored.record, N_BLOCKS)
    block = np.searchsorted(ends, factored.folds.edges[:-1], side="right") - 1
    blocks = [
        TriangularFactor.merged([chunk for chunk, b in zip(factored.chunks, block, strict=True) if b == number])
        for number in range(len(ends) - 1)
    ]
    return reference_of(blocks, factored.layout)


def final_alpha(factored: Factored, reference: GridRidge) -> float:
    """Ridge penalty of the final fit: the reference's, within limits."""
    return min(LARGEST_ALPHA, reference.penalty) * factored.reading.n_readings


UNDETERMINED = 10.0
"""Upper over lower end of an interval, above which the record does not determine the time constant."""
CONFIDENCE_95 = 1.96


def spectrum_table(factored: Factored, reference: GridRidge) -> pd.DataFrame:
    """Diffusive spectrum mu(tau), and what the record resolves.

    Returns DataFrame with columns: time_constant [s], of the lags of the (first) thermometer; coefficient: mu(tau) of
    the reference model (ridge over the whole grid), reading per K; excitation [K]: rms of the lag difference, the
    static law and further effects taken out; smallest_coefficient: coefficient of twice its standard error, were this
    the only lag and the residuals white; alike_next: correlation with the next longer time constant, after the same
    projection: near 1 where the record cannot tell the two apart.
    """
    layout, whole = factored.layout, factored.whole
    grid = layout.grid[layout.owner == 0]
    lags = whole.r[layout.n_free :, layout.n_free : layout.n_free + len(grid)]
    norms = np.linalg.norm(lags, axis=0)
    noise = np.sqrt(reference.residual_sum_of_squares / whole.n_rows)
    unit = lags / np.where(norms > 0, norms, 1.0)
    with np.errstate(divide="ignore"):
        smallest = 2 * noise / norms
    return pd.DataFrame(
        {
            "time_constant": grid,
            "coefficient": reference.coefficients[layout.n_free : layout.n_free + len(grid)],
            "excitation": norms / np.sqrt(whole.n_rows),
            "smallest_coefficient": smallest,
            "alike_next": np.append(np.einsum("ij,ij->j", unit[:, :-1], unit[:, 1:]), np.nan),
        }
    )


def interval_table(time_constants: np.ndarray, log_errors: np.ndarray) -> pd.DataFrame:
    """Time constants with 95 % intervals [s]."""
    with np.errstate(over="ignore"):
        factor = np.exp(CONFIDENCE_95 * log_errors)
    return pd.DataFrame(
        {
            "time_constant": time_constants,
            "low": time_constants / factor,
            "high": time_constants * factor,
            "relative_error": log_errors,
        }
    )


def unresolved(
    time_constants: np.ndarray, record: Record, solution: RidgeSolution, n_static: int, noise: float
) -> list[str]:
    """Sentences on time constants that the record leaves open.

    `time_constants` (array of shape (J,)): Of a fitted model [s], increasing. `record` (Record). `solution`
    (RidgeSolution): Columns are `n_static` static ones, then the lags. `noise` (float): Standard deviation of the
    residuals.
    """
    step, span = record.usual_step(), record.longest_read()
    said = []
    for tau in time_constants[time_constants > span]:
        late, whole, needed = span_texts((tau, span, 3 * tau))
        said.append(
            f"A time constant of {late} is longer than the record ({whole}): over the record its lag looks like a "
            f"drift, and its coefficient is a guess. Record for at least {needed}, or leave it out."
        )
    for tau in time_constants[time_constants < step / 2]:
        late, sampled = span_texts((tau, step))
        said.append(
            f"A time constant of {late} is shorter than half the sampling step ({sampled}): the record cannot tell it "
            "from no lag. Sample faster, or leave it out."
        )
    mu = solution.coef[n_static : n_static + len(time_constants)]
    triangle = solution.inverse_triangle[n_static : n_static + len(time_constants)]
    for j in range(len(time_constants) - 1):
        both = float(np.abs(mu[j]) + np.abs(mu[j + 1]))
        error, error_of_sum = (
            CONFIDENCE_95 * noise * float(np.linalg.norm(triangle[j] + sign * triangle[j + 1])) for sign in (-1, 1)
        )
        if abs(mu[j] + mu[j + 1]) < error_of_sum:
            continue  # nothing here that could be parted
        pair = f"Time constants of {' and '.join(span_texts(time_constants[j : j + 2]))}"
        if error > both or not (triangle[j].any() and triangle[j + 1].any()):
            said.append(
                f"{pair} cannot be distinguished in this record: the difference of their coefficients is known to "
                f"+-{error:.3g} only, more than both together. What both say together is known, the two coefficients "
                "are not: leave one out, or record faster temperature changes."
            )
        elif abs(mu[j] + mu[j + 1]) < 0.1 * both:  # they cancel
            said.append(
                f"{pair} work against each other: their coefficients, {mu[j]:.4g} and {mu[j + 1]:.4g}, nearly cancel. "
                "What both say together is known, but these are no bodies of the device: leave one out."
            )
    return said


DIFFERENCE = 1e-4
"""Step in ln tau of the numerical sensitivity."""
CONVERGED = 1e-3
"""A step in ln tau below which nothing is moved any more."""
LONGEST_STEP = 0.5
"""Longest step in ln tau."""


@dataclass(frozen=True)
class Extended:
    """Factors of ``[1 | Q | dU/dln tau | U]``, made on demand."""

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
        """Standard error of each ln tau.

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
        """Factors of ``[1 | Q | U]`` per stretch, and their columns."""
        own = _own_columns(self.columns)
        return Factored(
            record=self.base.record, reading=self.base.reading, features=self.base.features, columns=self.columns,
            chunks=[chunk.select(own) for chunk in self.extended.chunks], folds=self.base.folds,
        )  # fmt: skip

    def step(self, alpha: float, damping: float) -> np.ndarray:
        """Damped Gauss-Newton step in ln tau (Levenberg, Marquardt)."""
        factor, n = TriangularFactor.merged(self.extended.factors), len(self.time_constants)
        n_rows = factor.n_rows
        rows = np.zeros((n, factor.r.shape[1]), order="F")
        rows[:, -1 - n : -1] = np.diag(damping * np.linalg.norm(factor.r[1:, -1 - n : -1], axis=0))
        factor.update(rows)
        factor.n_rows = n_rows
        return np.clip(solve_ridge(factor, alpha).coef[-n:], -LONGEST_STEP, LONGEST_STEP)


def sensitivity(base: Factored, time_constants: np.ndarray, alpha: float) -> Sensitivity:
    """Factors of a model and its sensitivities, in one pass.

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
    """Numbers of the columns of ``[1 | Q | U]``."""
    n_moved = len(columns.layout.grid) + len(columns.decays)
    n_model = columns.layout.n_free + n_moved
    return [*range(n_model), n_model + n_moved]


def moved_to_best(here: Sensitivity, alpha: float) -> Sensitivity:
    """Move the time constants to the least residual."""
    for _ in range(8):
        there = None
        # Where one damping, relative to the sensitivities, makes the fit worse, the next is tried.
        for damping in (0.003, 0.03, 0.3):
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
        # Nothing is moved for a relative gain below 1e-6 of the residual sum of squares.
        if gain < 1e-6:
            break
    return here


def refined(base: Factored, time_constants: np.ndarray, alpha: float) -> tuple[Sensitivity, np.ndarray]:
    """Refine time constants, then drop unneeded ones.

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
