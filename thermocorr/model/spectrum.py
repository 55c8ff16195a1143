"""A whole spectrum chosen by forecasting, then projected.

1. One pass gives a triangular factor per block of time over ``[1 | static | lags of a log grid | fast decays | U]``.
2. Reference model: ridge on the whole grid. Its two knobs, penalty and longest time constant, are chosen by forward
   chaining inside the record: learn the past, forecast what follows, offset included.
3. The smallest set of time constants whose span reproduces the reference's modelled reading within `TOLERANCE` of its
   residual variance, by forward greedy steps with exchanges. The target carries no noise: nothing to overfit.
4. Fast time constants that the penalty has held down join where nearly every fold is better with them (in `search`).

Choosing sets by cross-validation on the readings themselves was tried first; on real records of one temperature sweep
it picks too many time constants and forecasts badly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..equations import TriangularFactor
from ..records import RecordError

POOL_SIZE = 25
N_BLOCKS = 20
DECAY_SHARE = 1 / 25
"""Decay columns only for time constants up to this share of the record: slower ones look like drift or ageing."""
CEILINGS = (1 / 3, 1.0)
"""Longest time constant, as a share of the record."""
PENALTIES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
"""Ridge penalties per row on sd(T) mu, for a grid of `GRID_STEP` in ln(time constant)."""
GRID_STEP = 0.33
TOLERANCE = 0.003
"""Misfit of the chosen set to the reference, as a share of the reference's residual variance."""
LARGEST_ALPHA = 1e-4
"""Largest ridge penalty per row of the final fit; a record that forecasts better with less keeps its own."""
MIN_ROWS = 120
"""With fewer readings nothing is searched: time constants are spread evenly in the logarithm."""


@dataclass(frozen=True)
class GridLayout:
    """Layout of the columns of a factor."""

    grid: np.ndarray
    """Time constants of the log grid [s], increasing; with several thermometers those of each, one behind the other."""
    span: float
    """Length of the longest segment [s]."""
    n_free: int
    """Columns that stand first and are never penalised: 1, the static law, further effects."""
    decays: Sequence[Sequence[int]]
    """``decays[i]``: columns of grid member i's decays, one for each segment that has it."""
    deviations: Sequence[float]
    """Standard deviation of each thermometer [K], the scale of the penalty on its lags."""

    @cached_property
    def owner(self) -> np.ndarray:
        """The number of the thermometer that each grid member follows."""
        return np.repeat(np.arange(len(self.deviations)), len(self.grid) // len(self.deviations))

    @cached_property
    def prior(self) -> np.ndarray:
        """Prior standard deviation of each grid coefficient.

        A denser grid means the same prior, and so does a thermometer that swings less.
        """
        size = len(self.grid) // len(self.deviations)
        step = np.gradient(np.log(self.grid[:size])) if size > 1 else np.full(1, GRID_STEP)
        scale = np.tile(np.sqrt(step / GRID_STEP), len(self.deviations))
        return np.asarray(scale / np.asarray(self.deviations)[self.owner])

    def columns(self, chosen: Sequence[int]) -> list[int]:
        """Columns with the grid members `chosen`."""
        lags = [self.n_free + i for i in chosen]
        return lags + [column for i in chosen for column in self.decays[i]]

    def members(self, ceiling: float) -> np.ndarray:
        """Grid members up to a share of the span."""
        return np.flatnonzero(self.grid <= ceiling * self.span * (1 + 1e-9))


@dataclass(frozen=True)
class GridRidge:
    """Ridge on the whole grid, its two knobs chosen by forecasting."""

    coefficients: np.ndarray
    ceiling: float
    """Longest time constant allowed, as a share of the record."""
    penalty: float
    """Ridge penalty per row."""
    forecast_errors: np.ndarray
    """``forecast_errors[f, c, a]``: mean squared error of forecast f, ceiling c, penalty a, in y's unit squared."""
    residual_sum_of_squares: float


def log_grid(usual_step: float, span: float, size: int = POOL_SIZE) -> np.ndarray:
    """Time constants from below one step to the record's length [s]."""
    low = 2 * usual_step
    # The fastest time constant is half a step: a body that follows within a step still shows as a lag.
    return np.append(0.5 * usual_step, np.geomspace(low, max(span, 2 * low), size - 1))


def spread(grid: np.ndarray, span: float, count: int) -> np.ndarray:
    """`count` time constants up to a third of the record [s]."""
    return np.geomspace(grid[1], max(span / 3, 1.5 * grid[1]), count)


def reference_of(blocks: Sequence[TriangularFactor], layout: GridLayout) -> GridRidge:
    """Choose penalty and ceiling by forecasting; fit the grid.

    `blocks` (sequence of TriangularFactor): Blocks of about equal length in time order. `layout` (GridLayout): Which
    column is what.
    """
    errors = forecast_errors(blocks, layout)
    if not len(errors):  # readings in few places: forecast from one to the next
        errors = forecast_errors([block for block in blocks if block.n_rows], layout)
    if not len(errors):
        raise RecordError(
            "The readings stand too close together to choose time constants by forecasts. Record readings for longer, "
            "or give time_constants."
        )
    c, a = np.unravel_index(int(np.argmin(errors.mean(axis=0))), errors.shape[1:])
    whole = TriangularFactor.merged(blocks)
    model = reference_models(whole, layout, CEILINGS[c], [PENALTIES[a]])[0]
    return GridRidge(model, CEILINGS[c], PENALTIES[a], errors, squared_error(whole, model))


def reference_models(
    factor: TriangularFactor, layout: GridLayout, ceiling: float, penalties: Sequence[float]
) -> np.ndarray:
    """Coefficients of the grid for each penalty.

    Minimises ``|U - A b|^2 + n penalty (sd_T^2 |mu|^2 + |nu|^2)``; the free columns are not penalised, so they drop
    out with the first rows of R, and one singular value decomposition serves every penalty.
    """
    r, free = factor.r, layout.n_free
    members = layout.members(ceiling)
    columns = np.array(layout.columns(members.tolist()))
    of_decays = [i for i in members for _ in layout.decays[i]]
    deviation = np.asarray(layout.deviations)[layout.owner[of_decays]]
    scale = np.concatenate((layout.prior[members], layout.prior[of_decays] * deviation))
    left, singular, right = np.linalg.svd(r[free:, columns] * scale, full_matrices=False)
    target = left.T @ r[free:, -1]
    result = np.zeros((len(penalties), r.shape[1] - 1))
    shrunk = singular / (singular**2 + factor.n_rows * np.array(penalties)[:, None])
    result[:, columns] = scale * ((shrunk * target) @ right)  # eq. (13)
    rest = r[:free, -1:] - r[:free, columns] @ result[:, columns].T
    result[:, :free] = np.linalg.lstsq(r[:free, :free], rest, rcond=1e-13)[0].T
    return result


def squared_error(factor: TriangularFactor, coefficients: np.ndarray) -> float:
    """Sum of squares of U - A b, from the triangle."""
    rest = factor.r[:, -1] - factor.r[:, :-1] @ coefficients
    return float(rest @ rest)


def forecast_errors(blocks: Sequence[TriangularFactor], layout: GridLayout) -> np.ndarray:
    """Mean squared forecast errors, shape (forecasts, ceilings, penalties), by forward chaining."""
    n_blocks = len(blocks)
    errors = []
    learned, done = TriangularFactor(blocks[0].r.shape[1]), 0
    for cut in sorted({max(1, round(cut / N_BLOCKS * n_blocks)) for cut in range(8, 17)}):
        learned.merge(*blocks[done:cut])
        done = cut
        # A forecast is to its past as 30 % to 70 %.
        future = [block for block in blocks[cut : cut + max(2, round((3 / 7) * cut))] if block.n_rows]
        if not future or learned.n_rows <= 2 * layout.n_free:
            continue
        test = TriangularFactor.merged(future)
        errors.append(
            [
                [
                    squared_error(test, model) / test.n_rows
                    for model in reference_models(learned, layout, ceiling, PENALTIES)
                ]
                for ceiling in CEILINGS
            ]
        )
    return np.array(errors)


def project(
    factor: TriangularFactor, layout: GridLayout, reference: GridRidge, count: int | None = None
) -> list[tuple[int, ...]]:
    """Grid members that span the reference's reading.

    Misfits are relative to the residual sum of squares, screened by cross products and confirmed by QR. Returns the set
    after each step; the last one is the choice, with `count` members or the first whose misfit falls below `TOLERANCE`.
    An empty list says that no lag is needed.
    """
    triangle = factor.r[layout.n_free :, :-1]  # below the rows of the free columns, which are in every set
    target = triangle @ reference.coefficients
    if reference.residual_sum_of_squares > 0:  # a reading that never changes leaves nothing
        target = target / np.sqrt(reference.residual_sum_of_squares)
    norms = np.linalg.norm(triangle, axis=0)
    unit = triangle / np.where(norms > 0, norms, 1.0)
    gram, moments, total = unit.T @ unit, unit.T @ target, float(target @ target)
    path: list[tuple[int, ...]] = []
    if count is None and total <= TOLERANCE:
        return path

    def best(sets: set[tuple[int, ...]]) -> tuple[tuple[int, ...], float]:
        ordered = sorted(sets, key=lambda members: (len(members), members))
        columns_of = [layout.columns(members) for members in ordered]
        widths, errors = np.array([len(columns) for columns in columns_of]), np.empty(len(ordered))
        for width in np.unique(widths):  # sets of equal width are solved together
            which = np.flatnonzero(widths == width)
            columns = np.array([columns_of[i] for i in which.tolist()])
            matrix = gram[columns[:, :, None], columns[:, None, :]] + 1e-11 * np.eye(width)
            solved = np.linalg.solve(matrix, moments[columns][:, :, None])[:, :, 0]
            errors[which] = total - np.einsum("bi,bi->b", moments[columns], solved)
        return ordered[int(np.argmin(errors))], float(np.min(errors))

    candidates, chosen = layout.members(reference.ceiling).tolist(), tuple[int, ...]()
    # A thermometer has eight time constants at most.
    most = 8 * len(layout.deviations)
    for _ in range(min(count or most, len(candidates))):
        chosen = grown(chosen, candidates, best, -1e-12 * total)
        path.append(chosen)
        matrix = unit[:, layout.columns(chosen)]
        rest = target - matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0]
        if count is None and float(rest @ rest) <= TOLERANCE:
            break
    return path


Best = Callable[[set[tuple[int, ...]]], tuple[tuple[int, ...], float]]


def grown(chosen: tuple[int, ...], candidates: Sequence[int], best: Best, slack: float = 0.0) -> tuple[int, ...]:
    """The best set with one member more, then exchanges.

    `best` takes sets and returns the one with the least error, and that error.
    """
    chosen, error = best({tuple(sorted((*chosen, new))) for new in candidates if new not in chosen})
    for _ in range(8):
        swapped = {
            tuple(sorted({*chosen} - {old} | {new})) for old in chosen for new in candidates if new not in chosen
        }
        if not swapped:
            break
        other, lower = best(swapped)
        if lower >= error * (1 - 1e-9) + slack:
            break
        chosen, error = other, lower
    return chosen
