"""`TimeConstantSearch`: time constants by cross-validation in one pass."""

from __future__ import annotations

import time
from functools import cached_property
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin, clone
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.metaestimators import available_if
from sklearn.utils.validation import check_is_fitted

from .progress import one_blas_thread
from .reading import Reading
from .regressor import DynamicBiasRegressor
from .search import (
    METHODS,
    CandidateRow,
    SearchSettings,
    TimeConstantChoice,
    check_alphas,
    check_candidates,
    interval_table,
    refined,
    search,
    sensitivity,
    spectrum_table,
)
from .thermometers import Thermometers


class TimeConstantSearch(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Search over time constants and penalties, in one pass.

    The pass turns every stretch of time into a small triangular factor over all columns of a dense grid of time
    constants. All sets, folds and penalties are then solved from these factors, exactly: the errors are those of
    ``GridSearchCV`` over a ``Pipeline`` of `DiffusiveFeatures`, ``StandardScaler`` and ``Ridge``.

    Parameters
    ----------
    estimator : DynamicBiasRegressor, optional
        The model whose time constants (and alpha) are searched; everything else of it stays.
    candidates : "auto", sequence of times, or sequence of such sequences, default "auto"
        A pool to choose from, in seconds or spans such as "15 min"; or the very sets to compare. "auto" is a pool of 24
        from two sampling steps to the length of the record, evenly spread in the logarithm, and one of half a step.
    method : {"spectrum", "cross_validation"}, default "spectrum"
        "spectrum" fits the whole pool with a ridge penalty chosen by forecasting and takes the few time constants
        that span its modelled reading: the most reliable on measured records (`benchmarks/real_records.py`).
        "cross_validation" takes the fewest with no more than one standard error above the least error on held-out
        stretches: of all sets where there are at most 20 000, of forward steps with exchanges beyond. It moves them
        between the pool's by variable projection. Best where the device has a few distinct time constants and these
        are what you want to know. Where sets are given, it chooses among these.
    count : int, optional
        Number of time constants; None chooses it, up to 6 by cross-validation.
    alphas : "auto" or sequence of float, default "auto"
        Ridge penalties to choose from, in `DynamicBiasRegressor`'s sense; "auto" is 0, 1e-8, 1e-6 and 1e-4 per
        reading. "spectrum" chooses its own.
    cv : int, splitter or iterable, default 5
        An int is forward chaining as in ``TimeSeriesSplit``, with 1 % of the record left out before each test.
        Splitters get the runs as groups; their folds must be whole stretches of time. The lags run on through all rows.
    refit : bool, default True
        Fit `best_estimator_`.

    Attributes
    ----------
    cv_results_ : dict of arrays
        As in scikit-learn: params, param_time_constants, param_alpha, split0_test_score (negative root mean squared
        error), ..., mean_test_score, std_test_score, rank_test_score. Of all sets of a pool, the 200 best of each size.
    best_index_ : int
        Row of the choice in `cv_results_`, which is the fewest time constants that are no worse, not the best score.
    best_params_ : dict
        ``time_constants`` (tuple, [s]) and ``alpha``, ready for ``DynamicBiasRegressor(**best_params_)``.
    best_score_ : float
    best_estimator_ : DynamicBiasRegressor
        Fitted on the whole record.
    time_constants_ : DataFrame
        The choice with 95 % intervals [s]: columns time_constant, low, high, relative_error.
    spectrum_ : DataFrame
        Diffusive spectrum mu(tau) over the pool and what the record can see of it, see
        `thermocorr.model.search.spectrum_table`. None where sets were given.
    n_splits_ : int
    refit_time_, search_time_ : float
        [s].

    Examples
    --------
    >>> from thermocorr import TimeConstantSearch
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(4000, seed=1)
    >>> search = TimeConstantSearch(candidates=[["5 min"], ["1 h"], ["5 min", "1 h"]])
    >>> search.fit(record[["temperature"]], record["reading"]).best_params_["time_constants"]
    (300.0, 3600.0)
    """

    _parameter_constraints: dict[str, Any] = {
        "method": [StrOptions(set(METHODS))],
        "count": [Interval(Integral, 1, None, closed="left"), None],
        "refit": ["boolean"],
    }

    def __init__(
        self,
        estimator: DynamicBiasRegressor | None = None,
        candidates: Any = "auto",
        *,
        method: str = "spectrum",
        count: int | None = None,
        alphas: Any = "auto",
        cv: Any = 5,
        refit: bool = True,
    ):
        self.estimator = estimator
        self.candidates = candidates
        self.method = method
        self.count = count
        self.alphas = alphas
        self.cv = cv
        self.refit = refit

    def fit(self, X: Any, y: Any, sample_weight: Any = None, *, mask: Any = None) -> TimeConstantSearch:
        """Search, and fit the best model to the whole record.

        Parameters
        ----------
        X, y, mask, sample_weight : as for `DynamicBiasRegressor.fit`

        Raises
        ------
        RecordError
            For a record that cannot be used, or is too short for a search.
        """
        self._validate_params()
        if y is None:
            raise ValueError("This TimeConstantSearch requires y to be passed, but the target y is None.")
        check_candidates(self.candidates)
        check_alphas(self.alphas)
        model = DynamicBiasRegressor() if self.estimator is None else clone(self.estimator)
        if Thermometers.of(model.temperature).further:
            raise ValueError(
                f"TimeConstantSearch searches the time constants of one thermometer. Got {model.temperature!r}: fit "
                "DynamicBiasRegressor(temperature=[...], time_constants='auto'), which chooses those of several."
            )
        started = time.perf_counter()
        with one_blas_thread():
            record = model._unfitted_features(()).read(X, y, sample_weight, mask)
            model._learn_levels(record)
            settings = SearchSettings(self.candidates, self.method, self.count, self.alphas, self.cv)
            choice = search(model._unfitted_features(()), record, Reading.of(X, y, record), settings)
            self._conclude(choice)
        self.search_time_ = time.perf_counter() - started
        if self.refit:
            started = time.perf_counter()
            self.best_estimator_ = model.set_params(**self.best_params_).fit(X, y, sample_weight, mask=mask)
            self.refit_time_ = time.perf_counter() - started
            for name in ("n_features_in_", "feature_names_in_"):
                if hasattr(self.best_estimator_, name):
                    setattr(self, name, getattr(self.best_estimator_, name))
        return self

    @available_if(lambda self: self.refit)
    def predict(self, X: Any, return_std: bool = False) -> Any:
        """Modelled reading of the best model, and its uncertainty.

        With ``return_std=True`` a pair, else the reading alone; see `DynamicBiasRegressor.predict`.
        """
        return self._best().predict(X, return_std=return_std)

    @available_if(lambda self: self.refit)
    def correct(self, X: Any, y: Any, return_std: bool = False) -> Any:
        """Corrected reading of the best model, and its uncertainty.

        With ``return_std=True`` a pair, else the reading alone; see `DynamicBiasRegressor.correct`.
        """
        return self._best().correct(X, y, return_std=return_std)

    def _best(self) -> DynamicBiasRegressor:
        check_is_fitted(self, "best_estimator_")
        best: DynamicBiasRegressor = self.best_estimator_
        return best

    def _conclude(self, choice: TimeConstantChoice) -> None:
        """Refine, and set out the results."""
        factored, chosen = choice.factored, choice.chosen
        assert factored is not None and chosen is not None
        tried = list(choice.tried)
        grid = choice.grid.tolist()
        times = [tuple([grid[i] for i in line.members]) for line in tried]
        best = next(i for i, line in enumerate(tried) if line is chosen or _same(line, chosen))
        pooled = isinstance(self.candidates, str) or np.ndim(self.candidates[0]) == 0
        if len(choice.time_constants) == 0:
            final = None
        elif pooled and self.method == "cross_validation":
            final, losses = refined(factored, choice.time_constants, choice.alpha)
            tried.append(CandidateRow((), choice.alpha, losses))
            times.append(tuple(final.time_constants.tolist()))
            best = len(tried) - 1
        else:
            final = sensitivity(factored, choice.time_constants, choice.alpha)
        self.__dict__.pop("time_constants_", None)
        self._chosen = (np.zeros(0), None) if final is None else (final.time_constants, final.extended)
        self.spectrum_ = None if choice.reference is None else spectrum_table(factored, choice.reference)
        self.cv_results_ = _results(tried, times)
        self.best_index_ = best
        self.best_params_ = dict(self.cv_results_["params"][best])
        self.best_score_ = float(self.cv_results_["mean_test_score"][best])
        self.n_splits_ = len(chosen.losses)

    @cached_property
    def time_constants_(self) -> pd.DataFrame:
        """The choice with 95 % intervals [s]."""
        check_is_fitted(self, "cv_results_")
        time_constants, extended = self.__dict__.pop("_chosen")
        return interval_table(time_constants, np.zeros(0) if extended is None else extended.log_errors())

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.regressor_tags.poor_score = True  # of many columns it uses one, unless effects name others
        return tags


def _same(one: CandidateRow, other: CandidateRow) -> bool:
    return one.members == other.members and one.alpha == other.alpha


def _results(tried: list[CandidateRow], times: list[tuple[float, ...]]) -> dict[str, Any]:
    """The table in the form of scikit-learn's ``cv_results_``."""
    scores = -np.array([line.losses for line in tried])
    mean = scores.mean(axis=1)
    sets = np.empty(len(times), dtype=object)
    sets[:] = times
    alphas = np.array([line.alpha for line in tried])
    rank = pd.Series(-mean).rank(method="min").to_numpy(dtype=np.int32)
    return {
        "param_time_constants": np.ma.MaskedArray(sets, mask=False),
        "param_alpha": np.ma.MaskedArray(alphas, mask=False),
        "params": [{"time_constants": t, "alpha": float(a)} for t, a in zip(times, alphas, strict=True)],
        **{f"split{f}_test_score": scores[:, f] for f in range(scores.shape[1])},
        "mean_test_score": mean,
        "std_test_score": scores.std(axis=1),
        "rank_test_score": rank,
    }
