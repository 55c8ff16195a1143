"""`MergedRidge`: ridge least squares by triangular factors as a scikit-learn regressor of its own."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data

from ..equations import RidgeSolution, TriangularFactor, solve_ridge
from ..records import BLOCK_ROWS
from .threads import one_blas_thread


class MergedRidge(RegressorMixin, BaseEstimator):
    """Ridge least squares, eqs. (13) (32), that keeps its digits when columns are nearly alike.

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
    >>> from thermocorr import MergedRidge
    >>> Q = np.arange(10.0)[:, None]
    >>> ridge = MergedRidge().fit(Q, 3.0 + 2.0 * Q[:, 0])
    >>> float(round(ridge.intercept_, 6)), ridge.coef_.round(6)
    (3.0, array([2.]))
    """

    _parameter_constraints: dict[str, Any] = {"alpha": [Interval(Real, 0, None, closed="left")]}

    def __init__(self, alpha: float = 0.0):
        self.alpha = alpha

    def fit(self, X: Any, y: Any) -> MergedRidge:
        """Fit to a matrix of shape (n_rows, n_columns) and readings of shape (n_rows,)."""
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
