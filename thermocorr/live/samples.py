"""Samples of a stream: what comes in, and what is answered."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import quoted
from ..records.hints import LARGEST
from ..records.labels import check_dates, out_of_reach
from ..records.numbers import as_numbers, as_pandas, is_frame, numeric_column, numeric_reading
from ..records.screen import Limits
from ..records.segments import Flags
from ..records.times import BEYOND

NO_TEMPERATURE = "no temperature"
"""Flag of a sample that lacks a temperature, or a column that the model needs."""


class Corrected(NamedTuple):
    """Result for one sample."""

    corrected: float
    """Reading less bias, eq. (24); NaN without a reading."""
    bias: float
    """What was taken away; NaN without a temperature."""
    flags: tuple[str, ...]
    """Every reason for distrust, the weightiest first; empty where there is none."""
    smoothed: float = math.nan
    """Moving average of the corrected reading, eq. (26); NaN unless asked for."""
    reference: float = math.nan
    """Tracked U0; NaN unless asked for."""
    u: float = math.nan
    """Standard uncertainty of the corrected reading; NaN unless asked for."""
    u_smoothed: float = math.nan
    """Standard uncertainty of the moving average; NaN unless both are asked for."""

    @property
    def flag(self) -> str:
        """The weightiest reason for distrust, as in `DynamicBiasRegressor.flags`; "" where there is none."""
        return self.flags[0] if self.flags else ""


COLUMNS = {"flag": "flags"}
"""Name of a result -> attribute of `Answers`, where they differ."""


class Answers:
    """Results for many samples, column by column."""

    def __init__(self, n: int):
        self.corrected, self.bias, self.smoothed, self.reference = (np.full(n, np.nan) for _ in range(4))
        self.u, self.u_smoothed = (np.full(n, np.nan) for _ in range(2))
        self.flags = Flags(n)

    def frame(self, X: Any, names: Sequence[str]) -> pd.DataFrame:
        """The columns of these names, with the index of X."""
        result = {name: getattr(self, COLUMNS.get(name, name)) for name in names}
        result["flag"] = self.flags.column()
        return pd.DataFrame(result, index=X.index if isinstance(X, pd.DataFrame) else None)

    def spread(self, why: np.ndarray, reference: float) -> Answers:
        """Columns with rows between that got nothing, for a reason; `reference` was tracked before them."""
        out, kept = Answers(len(why)), why == ""
        for name, column in vars(self).items():
            getattr(out, name)[kept] = column
        out.flags[~kept] = why[~kept]
        last = np.maximum.accumulate(np.where(kept, np.arange(len(kept)), -1))
        out.reference = np.where(last < 0, reference, out.reference[last])
        return out


def one_number(value: Any) -> float:
    """A float; NaN for None. RecordError for text, TypeError for what is of another type."""
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else RecordError
        raise kind(
            "A sample's temperature, reading and columns must be numbers, None or NaN where there is none. "
            f"Got {value!r:.60} instead."
        ) from None


def _through(values: Any, door: Callable[[Any], Any]) -> np.ndarray:
    """What `door` makes of values, as floats; infinite ones are missing, and absurd ones stay: a stream goes on."""
    values = as_pandas(values)
    if getattr(getattr(values, "dtype", None), "kind", "") != "f":
        return np.array(door(values), float)
    given = np.asarray(values, float)
    odd = np.abs(given) > LARGEST
    if not odd.any():
        return np.array(door(values), float)
    found = np.array(door(values.mask(odd) if isinstance(values, pd.Series) else np.where(odd, np.nan, given)), float)
    absurd = (odd & np.isfinite(given)).reshape(found.shape)
    found[absurd] = given.reshape(found.shape)[absurd]
    return found


def readings(y: Any, X: Any) -> np.ndarray:
    """Readings as floats, row by row as X, NaN where there is none; RecordError for what `evaluate` refuses."""
    return _through(y, lambda values: numeric_reading(values, X))


def column_of(X: Any, name: Any, role: Any) -> np.ndarray:
    """A column as floats, NaN for what is missing; RecordError for what `evaluate` refuses."""
    if is_frame(X) and (name not in X.columns or X[name].ndim != 1):
        return np.array(numeric_column(X, name, role), float)  # a sentence about what is wrong
    values = X[name][:] if is_frame(X) else X[:, name]
    return _through(values, lambda each: as_numbers(each, f"{role.capitalize()} {quoted(name)}", role))


def refused_rows(inputs: Mapping[Any, Limits], stamps: np.ndarray, values: Any) -> np.ndarray | None:
    """Why each row is passed over, "" where it is not; None where all are believed."""
    lacking = np.flatnonzero(~np.logical_and.reduce([np.isfinite(column) for column in values.values()]))
    found = [
        each for name, limits in inputs.items() for each in limits.reasons(values[name], lambda k: stamps[k].item())
    ]
    found.append((lacking, NO_TEMPERATURE))
    if not any(len(rows) for rows, _ in found):
        return None
    why = np.full(len(stamps), "", dtype=object)
    for rows, reason in found:
        why[rows] = reason
    return why


def checked_label(label: Any, column: Any) -> Any:
    """The label of a sample's run; RecordError for one that is missing, and for a date out of reach."""
    if type(label) is not str:
        if pd.isna(label):
            raise RecordError(f"The sample has no label of its run in {quoted(column)}. Label every sample.")
        if out_of_reach(label):
            raise RecordError(f"The label of the sample's run is {label!s:.60}. {BEYOND}")
    return label


def stretches(labels: pd.Series[Any] | None, n: int) -> list[tuple[int, int, Any]]:
    """Stretches of rows of the same run: first row, row after the last, label."""
    if labels is None:
        return [(0, n, None)]
    if labels.isna().any():
        raise RecordError(f"Row {int(labels.isna().argmax())} has no label of its run. Label every row.")
    codes, names = pd.factorize(labels)
    check_dates(codes, names, "The column of the run's label")
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), n]
    return [(low, high, labels.iloc[low]) for low, high in pairwise(edges)]
