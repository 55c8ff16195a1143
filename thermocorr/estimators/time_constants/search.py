"""Search of time constants: what is asked for, the methods, and the one pass that serves all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np

from ...effects.thermal import PLAIN, seconds_array
from ...equations import TriangularFactor, solve_ridge
from ...records import Record, RecordError
from ...records.gaps import rows_apart
from ..cutting import equal_edges
from ..features import DiffusiveFeatures
from ..fitting import require_rows
from ..reading import Reading, check_plausible
from .crossvalidation import NEGLIGIBLE, CrossValidation, Set, count_sets, fewest
from .folds import LagColumns, TimeFolds, folds_in_time
from .spectrum import (
    LARGEST_ALPHA,
    MIN_ROWS,
    N_BLOCKS,
    PENALTIES,
    POOL_SIZE,
    GridLayout,
    GridRidge,
    Projected,
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
    """Raise ValueError unless alphas are "auto", or ridge penalties that are finite and not negative."""
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
MOST_TRIED = 6
"""Most time constants that cross-validation tries."""
FAST_SHARE = 1 / 200
"""Time constants up to this share of the record are fast: any stretch has seen many of their lives."""
MOST_FAST = 3
"""Fast time constants that may join the projected ones."""
SLOW_SHARE = 1 / 50
"""Time constants above this share of the record are slow."""
WORTH = 0.01
"""Share of what is left that a slow one must explain. Those that a thermometer's noise (0.1 K) brings in explain up to
1.1 %. The gain of 36 devices is wrong by 0.18 % on the average with this, by 0.43 % without, by 0.7 and 2.2 % at most
(`benchmarks/thermometer_noise.py`; chosen on seeds 0 to 11, these are 12 to 47). The least of the slow lags in each of
eight measured records explains 0.1 %, 1.2 %, 3 %, and 5 to 50 %: only the first leaves, and the errors on later data
change by less than 0.3 % (`benchmarks/real_records.py`)."""
EXHAUSTIVE_LIMIT = 20_000
"""Up to this many sets, cross-validation tries them all; beyond, forward steps with exchanges."""
ALPHAS_PER_ROW = (0.0, 1e-8, 1e-6, 1e-4)
"""Ridge penalties that are tried when none are given, per reading."""


@dataclass(frozen=True)
class SearchSettings:
    """What to search and how; see `TimeConstantSearch`."""

    candidates: Any = "auto"
    method: str = "spectrum"
    count: int | None = None
    alphas: Any = "auto"
    cv: Any = 5
    say: Callable[[str], None] = lambda text: None


class CandidateRow(NamedTuple):
    """One line of the table of candidates."""

    members: Set
    alpha: float
    losses: np.ndarray
    """Shape (n_folds,)."""


@dataclass(frozen=True, kw_only=True)
class Factored:
    """A record, turned into what the search works on: the only pass over the data."""

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
        """Which column is what."""
        return self.columns.layout

    def projected(self, reference: GridRidge) -> Projected:
        """What `project` needs."""
        return Projected(self.whole, self.layout, reference)

    def cross_validation(self) -> CrossValidation:
        """Errors of sets in the folds."""
        dead = self.columns.dead(self.record, self.folds)
        return CrossValidation(self.chunks, self.folds, self.layout, dead)


@dataclass(frozen=True, kw_only=True)
class TimeConstantChoice:
    """What the search found and how."""

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
    products: bool | int = False
    """Products of lags that the model has beside them, as the parameter of this name takes them."""
    spectrum: dict[str, np.ndarray] | None = None
    """Columns of `resolution.spectrum_table`, in the choice that a fitted `DynamicBiasRegressor` keeps."""

    @property
    def parameter(self) -> Any:
        """The time constants as the parameter of this name takes them."""
        return {self.ambient: self.time_constants, **self.further} if self.further else self.time_constants


def search(features: DiffusiveFeatures, X: Any, y: Any, settings: SearchSettings) -> TimeConstantChoice:
    """Search time constants for a record.

    `features` (DiffusiveFeatures): The model without lags: static law and further effects, which stand in every set.
    `X`, `y` (as for `DynamicBiasRegressor.fit`). `settings` (SearchSettings).
    """
    grid_given = not isinstance(settings.candidates, str)
    record, reading = learned(features, X, y)
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


def learned(features: DiffusiveFeatures, X: Any, y: Any) -> tuple[Record, Reading]:
    """Let the features learn a record; refuse one that nothing can be learned from."""
    record = features.learn(X, y)
    reading = Reading.of(X, y, record)
    require_rows(reading.n_readings, sum(effect.n_columns() for effect in features.effect_list()))
    check_plausible(record, reading)
    return record, reading


def _by_spectrum(factored: Factored, cross: CrossValidation, settings: SearchSettings) -> TimeConstantChoice:
    """A whole spectrum chosen by forecasting, projected on few time constants: see `spectrum`."""
    reference = reference_spectrum(factored)
    path = project([factored.projected(reference)], settings.count)
    alpha = final_alpha(factored, reference)
    if path and settings.count is None:
        path.append(_without_idle_ones(_with_fast_ones(path[-1], factored, cross, alpha), factored, alpha))
    tried = [CandidateRow(members, alpha, cross.score_sets([members], alpha)[0]) for members in path]
    chosen = tried[-1] if tried else CandidateRow((), alpha, cross.score_sets([()], alpha)[0])
    return _choice(factored, tried or [chosen], chosen, reference)


def _with_fast_ones(members: Set, factored: Factored, cross: CrossValidation, alpha: float) -> Set:
    """Add fast time constants that the penalty of the reference has held down.

    The mean over the folds has to be better with them, and so have all folds but one: a missing effect may upset one.
    Only fast ones: any stretch of a record has seen many of their lives, and forecasts are safe.
    """
    grid = factored.layout.grid
    fast = [i for i in range(len(grid)) if grid[i] <= FAST_SHARE * factored.layout.span]
    for _ in range(MOST_FAST):
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
    """Leave out slow time constants that explain next to nothing beside the others.

    A slow lag is nearly a straight line, and shares the static law with it: one that is there for nothing costs the
    gain some digits. A thermometer with noise brings such lags in. Where starts of many segments were taken out, no lag
    is idle: the fit has the decays of no others, and a slow body may show in these alone.
    """
    layout = factored.layout
    if factored.columns.starts.decays_:
        return members
    slow = [i for i in members if layout.grid[i] > SLOW_SHARE * layout.span]

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
    """The set and the ridge penalty with the least error on stretches of time that they did not see."""
    n = factored.reading.n_readings
    alphas = sorted(
        [alpha * n for alpha in ALPHAS_PER_ROW]
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
        most = settings.count or MOST_TRIED
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
    """Sets of time constants [s], where the user lists them; None where one pool is given."""
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
    """Too few readings to choose from: a few time constants, evenly spread in the logarithm."""
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
    """The one pass: a factor for each stretch over ``[1 | static | lags | decays | U]``."""
    columns = LagColumns.of(features, record, grid)
    folds = folds_in_time(record, settings.cv)
    effects = [*features.effect_list(), columns.lag, *columns.further, columns.transient]
    chunks = list(columns.swept(record, effects, folds.edges).chunks)
    return Factored(record=record, reading=reading, features=features, columns=columns, chunks=chunks, folds=folds)


def reference_spectrum(factored: Factored) -> GridRidge:
    """The whole spectrum, from the factors of consecutive stretches merged to `N_BLOCKS` of equal length."""
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
