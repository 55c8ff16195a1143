"""Which readings a fit learns from, and how much each counts: masks and weights."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from ..effects.moments import since_start
from ..records import Layout, Log, RecordError, read_record
from ..records.errors import times_word, warn
from ..records.labels import refuse_labels_of_rows
from ..records.numbers import as_pandas, check_same_rows, is_frame, numeric_reading
from ..records.record_log import as_data
from ..records.weighted import WeightedReading

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")
"""A date as the end of a stretch is its whole day, as in slices of pandas."""
_DAY = 86400.0


def learned_readings(X: Any, y: Any, layout: Layout, mask: Any, weights: Mapping[str, Any]) -> Any:
    """The readings to learn from: NaN where they are masked, with weights where some are given.

    Parameters
    ----------
    X, y, mask : see `DynamicBiasRegressor.fit`
    layout : Layout
        Where things stand in X.
    weights : mapping
        Further arguments of `fit`: ``sample_weight``, or none.

    Raises
    ------
    TypeError
        For any other argument.
    RecordError
        For masks and weights that do not fit the record.
    """
    unknown = set(weights) - {"sample_weight"}
    if unknown:
        raise TypeError(f"fit() got an unexpected keyword argument {sorted(unknown)[0]!r}")
    _refuse_short_runs(X, layout)
    if mask is not None:
        y = masked_readings(X, y, layout, mask)
    weight = weights.get("sample_weight")
    if weight is None:
        return y
    check_same_rows(as_pandas(weight), as_data(X), "sample_weight")
    return WeightedReading(y, _checked(weight, len(X)))


def _refuse_short_runs(X: Any, layout: Layout) -> None:
    """Refuse a column of runs that has other things than labels of runs, before it costs minutes."""
    X = X if isinstance(X, Log) else as_data(X)
    if layout.run is None or not is_frame(X) or layout.run not in X.columns:
        return  # the record says what is wrong with it
    labels = X[str(layout.run)][:] if isinstance(X, Log) else X[layout.run]
    if np.ndim(labels) == 1:
        refuse_labels_of_rows(pd.Series(labels), layout.run)


def masked_readings(X: Any, y: Any, layout: Layout, mask: Any) -> Any:
    """The readings with NaN where they are masked."""
    if isinstance(X, Log):
        raise RecordError("A mask is for a record in memory. Write NaN for these readings when the file is written.")
    X, y = as_data(X), as_pandas(y)
    check_same_rows(as_pandas(mask), X, "mask")
    values = np.array(numeric_reading(y, X), float)
    known = np.isfinite(values).any()
    values[_rows(X, layout, mask, len(values))] = np.nan
    if known and not np.isfinite(values).any():
        raise RecordError(
            f"The mask leaves out all readings of the {len(values)} rows: nothing is left to learn from. Mask less."
        )
    if isinstance(y, pd.DataFrame):
        y = y.iloc[:, 0]
    if not isinstance(y, pd.Series):
        return values
    masked = pd.Series(values, index=y.index, name=y.name)
    masked.attrs = dict(y.attrs)
    return masked


def _rows(X: Any, layout: Layout, mask: Any, n: int) -> np.ndarray:
    """Rows that are masked, shape (n,), booleans."""
    marks = isinstance(mask, list) and all(isinstance(mark, bool | np.bool_) for mark in mask)
    given = mask if isinstance(mask, list) and not marks else np.asarray(mask)
    if isinstance(given, np.ndarray) and given.dtype == object:
        given = given.astype(float)
    if isinstance(given, np.ndarray) and given.dtype.kind in "bif" and given.ndim == 1:
        if len(given) != n or not np.isin(given, (0, 1)).all():
            raise RecordError(
                f"The mask must say of each of the {n} rows whether it is left out, True or False. Got an array of "
                f"{len(given)}, with values such as {given[:1].tolist()}."
            )
        return np.asarray(given.astype(bool))
    record = read_record(X, layout, quiet=True)
    found = np.zeros(n, bool)
    seconds = record.times.seconds(slice(0, n), record.first_stamp())
    for stretch in mask:
        if isinstance(stretch, str) or np.ndim(stretch) != 1 or len(stretch) != 2:
            raise RecordError(
                "The mask must be an array of True and False, one for each row, or a list of (start, end). Got "
                f"{stretch!r} in a list."
            )
        start, end = (since_start(moment, record, "mask", "fit") for moment in stretch)
        if not start <= end:
            raise RecordError(f"The mask has a stretch that ends before it starts: {stretch!r}.")
        whole_day = isinstance(stretch[1], str) and _DATE.fullmatch(stretch[1].strip())
        inside = (seconds >= start) & (seconds < end + _DAY if whole_day else seconds <= end)
        if not inside.any():
            warn(f"The mask has a stretch in which there are no rows: {stretch!r}.")
        found |= inside
    return found


def _checked(weight: Any, n: int) -> np.ndarray:
    """Weights as numbers of mean 1 where they count, shape (n,)."""
    values = np.asarray(weight, float)
    if values.ndim == 0:
        values = np.full(n, float(values))
    if values.shape != (n,):
        raise ValueError(f"sample_weight.shape == {values.shape}, expected {(n,)}: one weight for each row.")
    wrong = ~(np.isfinite(values) & (values >= 0))
    if wrong.any():
        raise RecordError(
            f"sample_weight must be finite and not negative. Row {int(wrong.argmax())} has {values[wrong][0]} "
            f"({times_word(int(wrong.sum()), 'such row')} of {n})."
        )
    if not values.any():
        raise RecordError("All weights of the readings are zero: there is nothing to learn from.")
    values = values / values.max()
    return np.asarray(values / values[values > 0].mean())
