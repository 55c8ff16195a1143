"""Columns to factors to coefficients: sweep, weights, ridge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, overload

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data

from ..effects import InitialTransient
from ..effects.protocol import Effect
from ..effects.stream import block_rows, own_starts, pieces, walk
from ..equations import RidgeSolution, TriangularFactor, solve_ridge
from ..equations.leastsquares import WIDE, BorderedFactor
from ..records import BLOCK_ROWS, Record, RecordError
from .averages import Binned, Binning
from .progress import one_blas_thread
from .reading import flat_effects


class MergedRidge(RegressorMixin, BaseEstimator):
    """Ridge least squares, eqs. (13) (32), for nearly equal columns.

    The last step of a `DynamicBiasRegressor`'s pipeline, usable behind any features. The penalty acts on coefficients
    times the standard deviation of their columns: the same as ``make_pipeline(StandardScaler(), Ridge(alpha))``, so
    `alpha` does not depend on units.

    Parameters
    ----------
    alpha : float, default 0.0
        Ridge penalty, eps of eq. (13).

    Attributes
    ----------
    coef_ : ndarray of shape (n_columns,)
    intercept_ : float
    rank_ : int
        Number of independent columns.
    residual_std_ : float
        Standard deviation of the residuals, in the unit of y.

    Examples
    --------
    >>> import numpy as np
    >>> from thermocorr.model import MergedRidge
    >>> Q = np.arange(10.0)[:, None]
    >>> ridge = MergedRidge().fit(Q, 3.0 + 2.0 * Q[:, 0])
    >>> float(round(ridge.intercept_, 6)), ridge.coef_.round(6)
    (3.0, array([2.]))
    """

    _parameter_constraints: dict[str, Any] = {"alpha": [Interval(Real, 0, None, closed="left")]}

    def __init__(self, alpha: float = 0.0):
        self.alpha = alpha

    def fit(self, X: Any, y: Any) -> MergedRidge:
        """Fit to a matrix (n_rows, n_columns) and readings (n_rows,)."""
        self._validate_params()
        X, y = validate_data(self, X, y, y_numeric=True, dtype=np.float64, ensure_min_samples=2)
        factor = TriangularFactor(X.shape[1] + 2)
        offset = float(y[0])
        with one_blas_thread():
            for start in range(0, len(X), BLOCK_ROWS):
                part = X[start : start + BLOCK_ROWS]
                rows = np.empty((len(part), X.shape[1] + 2), order="F")
                rows[:, 0], rows[:, 1:-1], rows[:, -1] = 1.0, part, y[start : start + BLOCK_ROWS] - offset
                factor.update(rows)
            return self.take(solve_ridge(factor, self.alpha), offset)

    def take(self, solution: RidgeSolution, offset: float) -> MergedRidge:
        """Become the estimator that a solution describes."""
        self.coef_ = solution.coef
        self.intercept_ = solution.intercept + offset
        self.rank_ = solution.rank
        self.n_features_in_ = len(solution.coef)
        freedom = max(solution.n_rows - solution.rank - 1, 1)
        self.residual_std_ = float(np.sqrt(solution.residual_sum_of_squares / freedom))
        return self

    def predict(self, X: Any) -> np.ndarray:
        """Modelled readings, shape (n_rows,)."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        return np.asarray(X @ self.coef_ + self.intercept_)


@dataclass
class Swept:
    """Triangular factors of a record, and final states."""

    chunks: Sequence[TriangularFactor]
    end_states: list[list[Any]]
    reading_offset: float
    """Subtracted from every reading before it was swept in, so that its digits are kept."""
    binned: Binned | None = None
    """The record, averaged over short stretches; None where nobody gathered it."""
    bordered: BorderedFactor | None = None
    """What the segments say of columns of their own and of those they share; None where nobody made it."""

    def without(self, columns: Sequence[int]) -> Swept:
        """Zero these columns, so that they get no coefficient."""
        for factor in self.chunks:
            factor.r[:, list(columns)] = 0.0
        self.bordered = None
        return self

    def total(self) -> TriangularFactor:
        """One factor of all rows."""
        return TriangularFactor.merged(self.chunks)

    def solution(self, alpha: float) -> RidgeSolution:
        """Ridge least squares of all rows."""
        found = None if self.bordered is None else self.bordered.solution(alpha)
        return solve_ridge(self.total(), alpha) if found is None else found


def reading_offset(record: Record) -> float:
    """A reading near all the others; 0 for none."""
    assert record.reading is not None
    for start in range(0, record.n_rows, BLOCK_ROWS):
        part = np.asarray(record.reading[start : start + BLOCK_ROWS], float)
        finite = part[np.isfinite(part)]
        if len(finite):
            return float(finite[len(finite) // 2])
    return 0.0


def sweep_effects(
    record: Record, effects: Sequence[Effect], edges: np.ndarray, starts: InitialTransient | None = None
) -> Swept:
    """Factors of ``[1 | Q | U]``, one per stretch between `edges`.

    What the decays of `starts` hold is taken out of all columns, segment by segment, and in each stretch apart.

    Columns made of a recorded one that never changes beyond its rounding are zero.
    """
    swept = _swept(record, effects, edges, starts)
    flat = {id(effect) for effect in flat_effects(record, effects)}
    if not flat:
        return swept
    silent = [id(effect) in flat for effect in effects for _ in effect.names()]
    return swept.without((1 + np.flatnonzero(silent)).tolist())


def _swept(
    record: Record, effects: Sequence[Effect], edges: np.ndarray, starts: InitialTransient | None = None
) -> Swept:
    """Sweep rows into a triangle per stretch and segment.

    `own` are the decays of the row's segment: those of `starts`, or else of the model's start-up decays. They stand
    first, the fastest before all others, since leading columns of zeros cost nothing. Rows without a reading are left
    out; others count by their weight, where they have one.
    """
    assert record.reading is not None
    own: Any = starts or next((effect for effect in effects if type(effect) is InitialTransient), None)
    shared = [i for i, effect in enumerate(effects) if effect is not own]
    first = np.cumsum([1, *(effect.n_columns() for effect in effects)]).tolist()
    places = [column for i in shared for column in range(first[i], first[i + 1])]
    decays = {} if own is None else own.decays_
    front = max(map(len, decays.values()), default=0)
    at = next((first[i] for i, effect in enumerate(effects) if effect is own), None)
    begins = {} if own is None else own.first_column_
    gathered = SegmentFactors(first[-1] + 1, len(edges) - 1, [0, *places, first[-1]], front, at is None and front > 0)
    binning, offset, ends = Binning(record, first[-1] - 1), reading_offset(record), list[list[Any]]()
    walked, size = [effects[i] for i in shared], block_rows(record.n_used)
    for block, rows, states in walk(walked, record, starts=own_starts(record), size=size, front=front + 1, extra=1):
        k = len(decays.get(block.segment, ()))
        rows[:, : front - k] = 0.0
        mine: Sequence[int] = ()
        if k:
            rows[:, front - k : front] = own.own(block)
        if k and at is not None:
            mine = range(at + begins[block.segment], at + begins[block.segment] + k)
        reading = np.asarray(record.reading[block.rows], float) - offset
        rows[:, front], rows[:, -1] = 1.0, reading
        binning.take(block, rows, [*mine, 0, *places], reading)
        if block.stop == record.segments[block.segment].stop:
            left = iter(states)
            ends.append([None if effect is own else next(left) for effect in effects])
        if record.weight is not None:
            rows *= np.sqrt(record.weight[block.rows])[:, None]
        known = np.isfinite(reading) if np.isnan(reading.sum()) else None
        for chunk, part in pieces(edges, block):
            piece = rows[part] if known is None else rows[part][known[part]]
            gathered.take(chunk, block.segment, mine, np.asfortranarray(piece))
    return Swept(gathered, ends, offset, binning.binned(), gathered.bordered())


class SegmentFactors(Sequence[TriangularFactor]):
    """Factors of ``[1 | Q | U]`` per stretch, made on demand.

    `width` (int): Columns of ``[1 | Q | U]``. `n_stretches` (int). `shared` (sequence of int): Numbers of the columns
    that all segments share: the 1 first, the reading last. `front` (int): Columns of a segment's own. `hidden` (bool):
    These have no number: what they hold is taken out of the others.
    """

    def __init__(self, width: int, n_stretches: int, shared: Sequence[int], front: int, hidden: bool):
        self.width, self._shared, self._front, self._hidden = width, list(shared), front, hidden
        self._parts: list[dict[int, TriangularFactor]] = [{} for _ in range(n_stretches)]
        self._own: dict[int, list[int]] = {}
        self._made: list[TriangularFactor] | None = None

    def take(self, stretch: int, segment: int, own: Sequence[int], rows: np.ndarray) -> None:
        """Sweep in a segment's rows ``[own | 1 | Q | U]``."""
        self._own[segment] = list(own)
        self._parts[stretch].setdefault(segment, TriangularFactor(rows.shape[1])).update(rows)

    def _triangle(self, factor: TriangularFactor, segment: int) -> np.ndarray:
        """R of a segment over its own columns and the shared."""
        first = self._front - len(self._own[segment])
        return factor.behind(first).r if self._hidden else factor.r[first:, first:]

    def __len__(self) -> int:
        return len(self._parts)

    @overload
    def __getitem__(self, which: int) -> TriangularFactor: ...
    @overload
    def __getitem__(self, which: slice) -> list[TriangularFactor]: ...
    def __getitem__(self, which: int | slice) -> TriangularFactor | list[TriangularFactor]:
        if self._made is None:
            self._made = [self._whole(parts) for parts in self._parts]
            self._parts = [{} for _ in self._made]
        return self._made[which]

    def _whole(self, parts: dict[int, TriangularFactor]) -> TriangularFactor:
        """The factor of a stretch."""
        made = [(self._own[segment], self._triangle(factor, segment)) for segment, factor in parts.items()]
        stacked, at = np.zeros((sum(len(r) for _, r in made), self.width), order="F"), 0
        for own, r in made:
            stacked[at : at + len(r), [*own, *self._shared]] = r
            at += len(r)
        return TriangularFactor.standing_for(stacked, sum(factor.n_rows for factor in parts.values()))

    def bordered(self) -> BorderedFactor | None:
        """Factor with own columns per segment; None for few."""
        if self.width <= WIDE or self._hidden or not self._front:
            return None
        of_segments: dict[int, list[TriangularFactor]] = {}
        for parts in self._parts:
            for segment, factor in parts.items():
                of_segments.setdefault(segment, []).append(factor)
        merged = {
            key: some[0] if len(some) == 1 else TriangularFactor.merged(some) for key, some in of_segments.items()
        }
        segments = [(self._own[key], self._triangle(factor, key)) for key, factor in merged.items()]
        return BorderedFactor.of(self._shared, segments, sum(factor.n_rows for factor in merged.values()))


def require_rows(n_readings: int, n_columns: int, what: str = "model") -> None:
    """Refuse a record that is too short for its model."""
    if n_readings <= n_columns + 1:
        plural = "1 sample" if n_readings == 1 else f"{n_readings} samples"
        raise RecordError(
            f"The record is too short: {plural} with a reading, and the {what} has {n_columns + 1} coefficients. "
            "Record longer, or choose fewer time_constants and a lower degree."
        )


def standard_errors(
    swept: Swept, solution: RidgeSolution, alpha: float, combinations: np.ndarray | None = None
) -> np.ndarray:
    """Standard errors of (U0, coefficients), for correlated residuals.

    Delete-a-block jackknife over the chunks of time (Kuensch 1989, Annals of Statistics 17, 1217), never below the
    white-noise formula. Shape (1 + p,).

    With `combinations`, shape (k, 1 + p), those of these linear combinations, shape (k,): coefficients of neighbouring
    lags have correlated errors, which do not simply add.
    """
    if combinations is None:
        combinations = np.eye(1 + len(solution.coef))
    white = white_errors(solution, combinations)
    chunks = [chunk for chunk in swept.chunks if chunk.n_rows]
    if len(chunks) < 4:
        return white
    norms = np.linalg.norm(swept.total().r[:, 1:-1], axis=0)
    last = len(norms) + 1
    estimates = np.tile(np.concatenate(([solution.intercept], solution.coef)), (len(chunks), 1))
    for rest, estimate in zip(_each_left_out(chunks, TriangularFactor(last + 1)), estimates, strict=True):
        # A start-up decay that only the chunk left out has seen keeps its estimate: the rest cannot say anything on it.
        seen = np.flatnonzero(np.linalg.norm(rest.r[:, 1:-1], axis=0) > 0.01 * norms) + 1
        part = solve_ridge(rest.select([0, *seen, last]), alpha)
        estimate[0], estimate[seen] = part.intercept, part.coef
    spread = np.var(estimates @ combinations.T, axis=0) * (len(chunks) - 1)
    return np.asarray(np.maximum(np.sqrt(spread), white))


def _each_left_out(chunks: Sequence[TriangularFactor], others: TriangularFactor) -> Iterator[TriangularFactor]:
    """Factors of all chunks but one, for each."""
    if len(chunks) == 1:
        yield others
        return
    first, second = chunks[: len(chunks) // 2], chunks[len(chunks) // 2 :]
    yield from _each_left_out(first, TriangularFactor.merged([others, *second]))
    yield from _each_left_out(second, TriangularFactor.merged([others, *first]))


def white_errors(solution: RidgeSolution, combinations: np.ndarray) -> np.ndarray:
    """Standard errors under white residuals, shape (k,)."""
    n = solution.n_rows
    variance = solution.residual_sum_of_squares / max(n - solution.rank - 1, 1)
    without_means = combinations[:, 1:] - combinations[:, :1] * solution.mean  # U0 = mean of U - means of Q @ coef
    through = without_means @ solution.inverse_triangle
    return np.asarray(np.sqrt(variance * (combinations[:, 0] ** 2 / n + np.einsum("ij,ij->i", through, through))))
