"""Columns and readings as numbers, from frames and arrays of any kind."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from os import PathLike
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.utils import column_or_1d

from .errors import RecordError, listing, quoted, times_word
from .grammar import LARGEST, has_other_blanks, is_missing
from .log import Log
from .states import is_state, state
from .types import Role, kind_of, require_role

_CHUNK = 1 << 16  # rows looked at together, so that checks need no memory of the record's size

TABLES = ("pyarrow", "duckdb", "modin", "ibis", "cudf", "pyspark", "sqlframe")
"""Packages whose tables narwhals reads."""


def as_pandas(X: Any) -> Any:
    """A table of another package as a pandas one (times as in pandas, missing values as NaN); anything else as it is.

    polars, lazy frames too; with narwhals (which scikit-learn brings, or the extra "frames") pyarrow, DuckDB, modin and
    whatever else it knows. A lazy table is computed.
    """
    package = type(X).__module__.partition(".")[0]
    if package == "polars":
        X = X.collect() if type(X).__name__ == "LazyFrame" else X
        return _from_polars(X) if type(X).__name__ == "DataFrame" else X
    if package not in TABLES:
        return X
    try:
        import narwhals
    except ImportError:
        raise RecordError(
            f"The data are a table of {package}, for which the package narwhals is needed: pip install "
            "'thermocorr[frames]', or pass a pandas DataFrame."
        ) from None
    table: Any = narwhals.from_native(X, pass_through=True, allow_series=True)
    if isinstance(table, narwhals.LazyFrame):
        table = table.collect("pandas")
    return table.to_pandas() if isinstance(table, narwhals.DataFrame | narwhals.Series) else X


def _from_polars(X: Any) -> pd.DataFrame:
    """A polars frame without a detour: what narwhals makes of it needs pyarrow."""
    columns: dict[str, Any] = {}
    for name in X.columns:
        series = X[name]
        if str(series.dtype).startswith(("String", "Utf8", "Categorical", "Enum")):
            columns[name] = pd.Series(series.to_list(), dtype=object)
            continue
        columns[name] = pd.Series(series.to_numpy())
        zone = getattr(series.dtype, "time_zone", None)
        if zone is not None:  # to_numpy gives the time in UTC, without saying so
            columns[name] = columns[name].dt.tz_localize("UTC").dt.tz_convert(zone)
    return pd.DataFrame(columns)


def refuse_no_table(X: Any) -> None:
    """Raise RecordError for a dict, or the name of a file, where a table is needed."""
    if not isinstance(X, Mapping | str | PathLike) or hasattr(X, "shape"):  # a sparse array may be a mapping
        return
    made = "for example pandas.DataFrame(X)"
    if not isinstance(X, Mapping):
        made = "which pandas.read_csv makes of a file, or ParquetLog(path)"
    raise RecordError(
        f"X is a {type(X).__name__}. Pass a DataFrame, {made}: its columns are the temperature and whatever else was "
        "recorded."
    )


def is_frame(X: Any) -> bool:
    """Whether the data have named columns."""
    return isinstance(X, pd.DataFrame | Log)


def numeric_column(X: Any, column: object, role: Role = "column") -> NDArray[Any]:
    """A column as numbers: a view where the data allow it. NaN marks missing values; infinities are refused."""
    if is_frame(X):
        if is_state(X, column):
            return state(X, str(column))
        if column not in X.columns:
            raise RecordError(
                f"There is no {role} {quoted(column)} in the data. Its columns are {listing(X.columns)}. "
                f"Name one of them{' with temperature=...' if role == 'temperature' else ''}."
            )
        values: Any = X[column]
        if values.ndim != 1:
            raise RecordError(
                f"The name {quoted(column)} stands over {values.shape[1]} columns. Give columns unique names."
            )
    else:
        values = X[:, column]
    return as_numbers(values, f"{role.capitalize()} {quoted(column)}", role)


def numeric_reading(y: Any, X: Any) -> NDArray[Any]:
    """Readings as numbers, row by row beside X."""
    refuse_no_table(X)
    y = as_pandas(y)
    if isinstance(y, pd.DataFrame):
        if y.shape[1] != 1:
            raise RecordError(
                f"y has {y.shape[1]} columns ({listing(y.columns)}). Pass one, such as y[{y.columns[0]!r}], or fit a "
                "model for each with thermocorr.cluster.channels.fit_channels(X, y)."
            )
        y = y.iloc[:, 0]
    check_same_rows(y, X, "y")
    values = as_numbers(
        y if isinstance(y, pd.Series) or isinstance(X, Log) else np.asarray(y), "The reading y", "reading"
    )
    if values.ndim == 2 and values.shape[1] == 1:
        values = column_or_1d(values, warn=True)
    if values.ndim != 1:
        raise RecordError(f"y must be one column of readings. Got an array of shape {values.shape} instead.")
    if len(values) != len(X):
        raise RecordError(f"X has {len(X)} rows and y has {len(values)}. Each row needs one reading (NaN where none).")
    return values


def check_same_rows(given: Any, X: Any, name: str) -> None:
    """Refuse a Series beside X whose index says that its rows stand in another order, or have other times."""
    if not (isinstance(given, pd.Series) and isinstance(X, pd.DataFrame)) or len(given) != len(X):
        return
    own, others = given.index, X.index
    if type(own) is not type(others) or own.equals(others):
        return
    zoned = isinstance(own, pd.DatetimeIndex) and isinstance(others, pd.DatetimeIndex) and own.tz and others.tz
    if zoned and pd.DatetimeIndex(own).tz_convert(zoned).equals(others):  # the same moments, by clocks of two zones
        return
    if isinstance(others, pd.DatetimeIndex | pd.TimedeltaIndex | pd.PeriodIndex):
        row = int(np.argmax(np.asarray(own != others)))
        raise RecordError(
            f"X and {name} have different times: in row {row}, X has {others[row]} and {name} has {own[row]}. "
            f"Align them first, for example with {name}.reindex(X.index)."
        )
    if own.sort_values().equals(others.sort_values()):
        row = int(np.argmax(np.asarray(own != others)))
        raise RecordError(
            f"X and {name} have the same rows in another order: row {row} is {others[row]!r} in X and {own[row]!r} in "
            f"{name}. Align them first, for example with {name}.reindex(X.index)."
        )


def as_numbers(values: Any, what: str, role: Role = "column") -> NDArray[Any]:
    """Numbers with NaN for missing ones; text, complex numbers, dates and infinities are refused by row."""
    kind = kind_of(values)
    require_role(kind, role, what, str(getattr(values, "type_name", values.dtype)))
    if kind == "text" or values.dtype == object:
        if isinstance(getattr(values, "log", None), Log):
            raise RecordError(
                f"{what} holds {values.type_name}, not numbers. Convert it when the file is written, or read the file "
                "with pandas to see which rows are no numbers."
            )
        values = _parse_numbers(values, what)
    if isinstance(values, pd.Series):
        values = (
            values.to_numpy() if isinstance(values.dtype, np.dtype) else values.to_numpy(dtype=float, na_value=np.nan)
        )
    if hasattr(values, "looked_at_by"):  # a column of a log stays what it is, and is read when it is sliced
        later: np.ndarray = values.looked_at_by(partial(_refuse_absurd, what))
        return later
    for start in range(0, len(values), _CHUNK):
        _refuse_absurd(what, values[start : start + _CHUNK], start)
    checked: np.ndarray = values
    return checked


def _refuse_absurd(what: str, chunk: Any, first_row: int) -> None:
    """Refuse infinities, and numbers that no instrument shows: their squares would not be numbers."""
    if chunk.dtype.kind != "f" or not len(chunk):
        return
    if chunk.dtype == np.float64 and chunk.ndim == 1:
        with np.errstate(over="ignore", invalid="ignore"):
            if chunk.dot(chunk) <= LARGEST**2:  # one look, where none is NaN
                return
    high, low = float(np.fmax.reduce(chunk, axis=None)), float(np.fmin.reduce(chunk, axis=None))
    if not max(high, -low) > LARGEST:
        return
    absurd = (chunk > LARGEST) | (chunk < -LARGEST) if chunk.dtype.itemsize > 4 else np.isinf(chunk)
    place = int(np.flatnonzero(absurd.reshape(len(chunk), -1).any(axis=1))[0])
    row, value = first_row + place, chunk[absurd][0]
    if np.isinf(value):
        raise RecordError(
            f"{what} contains infinity in row {row}. Replace it by NaN if there is no value, or by the right one."
        )
    raise RecordError(
        f"{what} is {value:.6g} in row {row}: no measurement is that large. Replace it by NaN if there is no value, "
        "or by the right one."
    )


def _parse_numbers(values: Any, what: str) -> NDArray[Any]:
    series = pd.Series(values)
    for row, value in enumerate(series):  # pandas would coerce dicts, lists and bytes without a word
        if isinstance(value, dict | list | tuple | set | bytes | bytearray | np.ndarray):
            raise TypeError(f"{what}: argument must be a string or a number, row {row} holds {value!r:.60}.")
    series = series.where(~series.map(lambda value: isinstance(value, str) and is_missing(value)), None)
    try:
        numbers = pd.to_numeric(series, errors="coerce")
    except OverflowError:  # a whole number of more than 300 digits
        numbers = series.map(_float_or_infinity)
    odd = series.map(lambda value: isinstance(value, str) and has_other_blanks(value)).to_numpy(dtype=bool)
    bad = (numbers.isna() & series.notna()).to_numpy() | odd
    if bad.any():
        row = int(bad.argmax())
        raise RecordError(
            f"{what} is not a number in row {row}: {series.iloc[row]!r} ({times_word(int(bad.sum()), 'such row')} in "
            "all). Remove units and text from the file, or leave the cell empty where there is no value; in Python "
            "pandas.to_numeric(..., errors='coerce') does so."
        )
    return numbers.to_numpy(dtype=float, na_value=np.nan)


def _float_or_infinity(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        return np.inf
    except (TypeError, ValueError):
        return np.nan
