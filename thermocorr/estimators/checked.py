"""scikit-learn's checks of X, for frames, arrays and logs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import validate_data

from ..records import Log, RecordError
from ..records.record_log import RecordLog, as_data


def check_columns(estimator: Any, X: Any, reset: bool) -> Any:
    """scikit-learn's checks of X for frames (names and number) and arrays (shape, dtype, infinities)."""
    X = as_data(X)
    if isinstance(X, pd.Series):
        raise RecordError(
            "X is a Series. Reshape your data: pass a DataFrame, for example with X.to_frame(), whose columns are the "
            "temperature and whatever else was recorded."
        )
    if isinstance(X, Log):
        return _check_log_columns(estimator, X, reset)
    if isinstance(X, pd.DataFrame):
        if X.shape[1] == 0:
            raise RecordError(
                f"Found array with 0 feature(s) (shape={X.shape}) while a minimum of 1 is required: the data have no "
                "columns. The temperature is needed."
            )
        if len(X) == 0:
            raise RecordError("The data have 0 rows. Check the file, or the selection that made them.")
        if not X.columns.is_unique:
            twice = X.columns[X.columns.duplicated()][0]
            raise RecordError(f"Several columns are called {twice!r}. Give columns unique names.")
        _check_names(estimator, X, reset)
        return X
    return validate_data(
        estimator, X, reset=reset, dtype=np.float64, ensure_all_finite="allow-nan", accept_sparse=False
    )


def _check_names(estimator: Any, X: pd.DataFrame, reset: bool) -> None:
    """Set or compare names and number of a frame's columns, as `validate_data` does.

    Names that are text are set here, and are found to be the fitted ones: scikit-learn's way to them, which has any
    library's frames in mind, takes a twentieth of a fit. It is asked, and raises, wherever there is more to say.
    """
    names = np.array(X.columns.tolist(), dtype=object)
    plain = all(type(name) is str for name in names)
    if plain and reset:
        estimator.feature_names_in_, estimator.n_features_in_ = names, len(names)
    elif not (plain and np.array_equal(getattr(estimator, "feature_names_in_", ()), names)):
        validate_data(estimator, X, skip_check_array=True, reset=reset)


def _check_log_columns(estimator: Any, X: Log, reset: bool) -> Log:
    """scikit-learn's checks of a log: `validate_data` on an empty frame with the columns of the log."""
    if len(X) == 0:
        raise RecordError("The log has 0 rows. Check its files.")
    columns, names = X.columns, getattr(estimator, "feature_names_in_", ())
    if isinstance(X, RecordLog) and not reset:  # its times and runs are no columns any more
        columns = [name for name in names if name in columns or name in (estimator.time, estimator.run)]
        columns += [name for name in X.columns if name not in columns]
    validate_data(estimator, pd.DataFrame(columns=columns), skip_check_array=True, reset=reset)
    return X
