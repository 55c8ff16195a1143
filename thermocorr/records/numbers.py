"""Numbers, quantities and units as people write them.

For sentences, tables on a terminal, pages and pictures. Names of columns, frames, files and code keep their numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.utils import column_or_1d

from .errors import RecordError, listing, option, quoted, times_word, way
from .types import LARGEST, Role, kind_of, require_role

MISSING = frozenset(("", "NA", "N/A", "n/a", "#N/A", "<NA>", "NaN", "nan", "-nan", "NULL", "null", "None"))
"""What stands in a cell of text where there is no value; blanks around it do not count."""
_CHUNK = 1 << 16  # rows looked at together, so that checks need no memory of the record's size


def as_pandas(X: Any) -> Any:
    """A foreign table as a pandas one; anything else unchanged.

    A masked array is filled with NaN.

    polars, lazy frames too; with narwhals (which scikit-learn brings, or the extra "frames") pyarrow, DuckDB, modin and
    whatever else it knows. A lazy table is computed.
    """
    if isinstance(X, np.ma.MaskedArray):
        return np.ma.filled(X.astype(float), np.nan) if X.dtype.kind in "biuf" else np.asarray(X)
    package = type(X).__module__.partition(".")[0]
    if package == "polars":
        X = X.collect() if type(X).__name__ == "LazyFrame" else X
        return _from_polars(X) if type(X).__name__ == "DataFrame" else X
    # narwhals reads the tables of these packages.
    if package not in ("pyarrow", "duckdb", "modin", "ibis", "cudf", "pyspark", "sqlframe"):
        return X
    try:
        import narwhals
    except ImportError:
        raise RecordError(
            f"The data are a table of {package}, for which the package narwhals is needed: pip install "
            "narwhals, or pass a pandas DataFrame."
        ) from None
    table: Any = narwhals.from_native(X, pass_through=True, allow_series=True)
    if isinstance(table, narwhals.LazyFrame):
        table = table.collect("pandas")
    return table.to_pandas() if isinstance(table, narwhals.DataFrame | narwhals.Series) else X


def _from_polars(X: Any) -> pd.DataFrame:
    """A polars frame as a pandas one, without pyarrow."""
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
    """Raise RecordError for a dict or a file's name."""
    if not isinstance(X, Mapping | str | PathLike) or hasattr(X, "shape"):  # a sparse array may be a mapping
        return
    made = "for example pandas.DataFrame(X)"
    if not isinstance(X, Mapping):
        made = "which thermocorr.read_log makes of a file"
    raise RecordError(
        f"X is a {type(X).__name__}. Pass a DataFrame, {made}: its columns are the temperature and whatever else was "
        "recorded."
    )


def as_data(X: Any) -> Any:
    """Data as the package needs them: tables in pandas.

    Raises RecordError for a dict, and for the name of a file.
    """
    refuse_no_table(X)
    return as_pandas(X)


def is_frame(X: Any) -> bool:
    """True if the data have named columns."""
    return isinstance(X, pd.DataFrame)


def numeric_column(X: Any, column: object, role: Role = "column") -> NDArray[Any]:
    """A column as floats, NaN for missing values."""
    if is_frame(X):
        if column not in X.columns:
            raise RecordError(
                f"There is no {role} {quoted(column)} in the data. Its columns are {listing(X.columns)}. "
                f"Name one of them{' with ' + option(role) if role in ('temperature', 'reference') else ''}."
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
    """Readings as numbers, row by row as X."""
    refuse_no_table(X)
    y = as_pandas(y)
    if isinstance(y, pd.DataFrame):
        if y.shape[1] != 1:
            raise RecordError(
                f"y has {y.shape[1]} columns ({listing(y.columns)}). Pass one, such as y[{y.columns[0]!r}], or fit a "
                "model for each."
            )
        y = y.iloc[:, 0]
    check_same_rows(y, X, "y")
    values = as_numbers(y if isinstance(y, pd.Series) else np.asarray(y), "The reading y", "reading")
    if values.ndim == 2 and values.shape[1] == 1:
        values = column_or_1d(values, warn=True)
    if values.ndim != 1:
        raise RecordError(f"y must be one column of readings. Got an array of shape {values.shape} instead.")
    if len(values) != len(X):
        raise RecordError(f"X has {len(X)} rows and y has {len(values)}. Each row needs one reading (NaN where none).")
    return values


def check_same_rows(given: Any, X: Any, name: str) -> None:
    """Refuse y with another index than that of X."""
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
    if isinstance(own, pd.RangeIndex) and isinstance(others, pd.RangeIndex):
        raise RecordError(
            f"The rows of X are numbered from {others.start} to {others.stop - 1}, those of {name} from {own.start} to "
            f"{own.stop - 1}. Take the same rows of both, as {name}.loc[X.index] does; if they belong together as they "
            f"stand, pass {name}.to_numpy()."
        )


def as_numbers(values: Any, what: str, role: Role = "column") -> NDArray[Any]:
    """Numbers, NaN where missing; RecordError for anything else."""
    kind = kind_of(values)
    require_role(kind, role, what, str(values.dtype))
    if kind == "text" or values.dtype == object:
        values = _parse_numbers(values, what)
    if isinstance(values, pd.Series):
        values = (
            values.to_numpy() if isinstance(values.dtype, np.dtype) else values.to_numpy(dtype=float, na_value=np.nan)
        )
    for start in range(0, len(values), _CHUNK):
        _refuse_absurd(what, values[start : start + _CHUNK], start)
    checked: np.ndarray = values
    return checked


def _refuse_absurd(what: str, chunk: Any, first_row: int) -> None:
    """Refuse infinities and absurdly large numbers."""
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
    series = series.where(~series.map(lambda value: isinstance(value, str) and value.strip() in MISSING), None)
    try:
        numbers = pd.to_numeric(series, errors="coerce")
    except OverflowError:  # a whole number of more than 300 digits
        numbers = series.map(_float_or_infinity)
    bad = (numbers.isna() & series.notna()).to_numpy()
    if bad.any():
        row = int(bad.argmax())
        coerced = "; pandas.to_numeric(..., errors='coerce') does so"
        raise RecordError(
            f"{what} is not a number in row {row}: {series.iloc[row]!r} ({times_word(int(bad.sum()), 'such row')} in "
            "all). Remove units and text from the file, or leave the cell empty where there is no value"
            f"{way(': ' + option('na', str(series.iloc[row])), coerced)}."
        )
    return numbers.to_numpy(dtype=float, na_value=np.nan)


def _float_or_infinity(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        return np.inf
    except (TypeError, ValueError):
        return np.nan


SPANS = {
    "y": 365.25 * 86_400.0, "d": 86_400.0, "h": 3600.0, "min": 60.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
}  # fmt: skip
"""Units of time spans, the longest first [s]."""
_AXES = {"ms": 1.0, "s": 150.0, "min": 9000.0, "h": 4 * SPANS["d"], "d": 3 * SPANS["y"], "y": math.inf}
"""Longest axis of time in each unit [s]."""
_POWERS = {
    "f": -15, "p": -12, "n": -9, "u": -6, "\u00b5": -6, "\u03bc": -6, "m": -3, "c": -2, "": 0, "h": 2, "k": 3, "M": 6,
    "G": 9,
}  # fmt: skip
"""Prefixes that are understood, and their powers of ten."""
_WRITTEN = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
"""Prefixes that are written."""
_LARGEST = {
    "V": 6, "A": 6, "ohm": 9, "Ohm": 9, "\u03a9": 9, "S": 3, "F": 0, "H": 0, "Hz": 9, "W": 9, "J": 9, "Pa": 9, "bar": 3,
    "N": 6, "T": 0, "m": 3, "g": 3, "s": 0, "rad": 0, "strain": 0, "Gal": 0,
}  # fmt: skip
"""Units that take prefixes, with the largest power of ten that people write with them."""
_LEAST, _MOST = 0.1, 1e4
"""A number between these reads well in the unit that it came in; smaller ones are written from `_LEAST` on as well."""
UNKNOWN = "-"
"""What stands for NaN."""


_UNITS = {"degC": "°C", "degF": "°F", "ohm": "Ω", "u": "µ"}
"""Units and prefixes that print has signs for."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Scale(NamedTuple):
    """One unit for numbers that are compared."""

    factor: float
    """A number in the unit that it came in, times this, is a number in `unit`."""
    unit: str

    def number(self, value: float, digits: int = 3) -> str:
        """The number in this unit, without it: ``0.97``."""
        return number_text(value * self.factor, digits)

    def text(self, value: float, digits: int = 3) -> str:
        """A number with its unit in print: ``0.97 mΩ``."""
        number = self.number(value, digits)
        return number if number == UNKNOWN else f"{number} {unit_text(self.unit)}".rstrip()


class Prefixed(NamedTuple):
    """A unit with one of the prefixes that it takes."""

    power: int
    """Power of ten that it is of the unit that numbers came in."""
    unit: str
    least: float
    """Numbers in the unit that they came in are written in this one from here on."""


def number_text(value: float, digits: int = 3) -> str:
    """A number of some significant digits: 0.0651, 15.5, 84012."""
    value = float(value) + 0.0  # no -0
    if math.isnan(value):
        return UNKNOWN
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e" in text and 1 <= abs(value) < 1e6 else text


def quantity_text(value: float, unit: str = "", digits: int = 3) -> str:
    """A quantity with the prefix that suits its size.

    Examples
    --------
    >>> quantity_text(0.00097, "ohm"), quantity_text(3.1e-05, "V"), quantity_text(0.00097, "mV")
    ('0.97 mΩ', '31 µV', '0.97 µV')
    >>> quantity_text(0.00097, "ppm"), quantity_text(1013.25, "hPa"), quantity_text(4.2e-6, "mV/K")
    ('0.00097 ppm', '1013 hPa', '4.2 nV/K')
    """
    return scale_of([value], unit).text(value, digits)


def quantity_texts(values: Iterable[float], unit: str = "", digits: int = 3) -> list[str]:
    """Quantities to compare: one prefix, digits that tell them apart.

    Examples
    --------
    >>> quantity_texts([0.0014, 0.00013], "mV"), quantity_texts([5.0001, 5.0002], "ppm")
    (['1.4 µV', '0.13 µV'], ['5.0001 ppm', '5.0002 ppm'])
    """
    given = [float(value) for value in values]
    return _told_apart(given, scale_of(given, unit), digits)


def scale_of(values: Any, unit: str) -> Scale:
    """The unit for a table, by the median of its sizes.

    Examples
    --------
    >>> scale_of([1.4e-3, 1.3e-4, 1.2e-4], "mV").unit, scale_of([1.4e-3, 1.3e-4], "K").unit
    ('uV', 'K')
    """
    sizes = np.abs(np.asarray(values, float))
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    steps = prefixed(unit)
    if not steps or not len(sizes):
        return Scale(1.0, unit)
    size = float(np.median(sizes))
    if _LEAST <= size < _MOST:
        return Scale(1.0, unit)
    chosen = [step for step in steps if size >= step.least][-1:] or steps[:1]
    return Scale(float(f"1e{-chosen[0].power}"), chosen[0].unit)


@cache
def prefixed(unit: str) -> tuple[Prefixed, ...]:
    """A unit with each of its prefixes, the smallest first."""
    head, rest = _head(unit)
    prefix, bare = prefix_and_unit(head)
    # A unit with a prefix may be followed by m/s and the like, but not by m3 nor V^2.
    if bare not in _LARGEST or rest[:1] not in ("", " ", "/", "*", "\u00b7"):
        return ()
    own = _POWERS[prefix]
    powers = [power for power in _WRITTEN if power <= _LARGEST[bare]]
    return tuple(
        Prefixed(power - own, f"{_WRITTEN[power]}{bare}{rest}", float(f"1e{power - own - (power <= 0)}"))
        for power in powers
    )


def prefix_and_unit(unit: str) -> tuple[str, str]:
    """Prefix of a unit, and its rest: ``("m", "V")``."""
    # Some units only look as if they had a prefix.
    if unit not in _LARGEST and unit != "pH" and unit[:1] in _POWERS and unit[1:] in _LARGEST:
        return unit[:1], unit[1:]
    return "", unit


def unit_text(unit: str) -> str:
    """A unit in print: °C, Ω, µV, K²."""
    words = [prefix_and_unit(word) for word in re.split(r"([ /()*]|\^-?\d+)", unit)]
    return "".join(_UNITS.get(prefix, prefix) + _UNITS.get(bare, _raised(bare)) for prefix, bare in words)


def _raised(word: str) -> str:
    return re.sub(r"\^(-?\d+)", lambda power: power[1].translate(SUPERSCRIPTS), word)


def span_text(seconds: float, digits: int = 3) -> str:
    """A time span [s] in its longest unit: 2.5 min, 3.2 d.

    Examples
    --------
    >>> span_text(900), span_text(55_800), span_text(0.0002), span_text(0)
    ('15 min', '15.5 h', '200 µs', '0 s')
    """
    scale = _span_scale(seconds, digits)
    rounded_up = 0.99 < abs(seconds) * scale.factor < 1  # 59.97 s are 60.0 s, a minute
    return scale.text(math.copysign(1 / scale.factor, seconds) if rounded_up else seconds, digits)


def span_texts(seconds: Iterable[float], digits: int = 3) -> list[str]:
    """Time spans [s] to compare, in the unit of the shortest.

    Each has its own unit where they are too far apart for one.

    Examples
    --------
    >>> span_texts([900, 55_800]), span_texts([3600, 3605]), span_texts([15, 1e6])
    (['15 min', '930 min'], ['1 h', '1.001 h'], ['15 s', '11.6 d'])
    """
    given = [float(value) for value in seconds]
    sizes = [abs(value) for value in given if math.isfinite(value) and value]
    scale = _span_scale(min(sizes, default=0.0), digits)
    # Above a thousand of the unit of the shortest time span, longer units are used.
    if scale.factor * max(sizes, default=0.0) > 1000.0:
        return [span_text(value, digits) for value in given]
    return _told_apart(given, scale, digits)


def span_unit(longest: float) -> str:
    """The unit for a time axis of this length [s]."""
    return next((unit for unit, limit in _AXES.items() if longest <= limit), "s")


def _span_scale(seconds: float, digits: int) -> Scale:
    rounded = abs(float(f"{seconds:.{digits}g}"))
    unit = next((unit for unit, size in SPANS.items() if rounded >= size), "ns" if rounded else "s")
    unit = unit if math.isfinite(rounded) else "s"
    return Scale(1 / SPANS[unit], unit)


def _told_apart(values: list[float], scale: Scale, digits: int) -> list[str]:
    """Numbers with digits that tell different ones apart."""
    different = {value for value in values if math.isfinite(value)}
    # Up to four digits are added to distinguish numbers.
    enough = (n for n in range(digits, digits + 4) if len({scale.text(v, n) for v in different}) == len(different))
    digits = next(enough, digits)
    return [scale.text(value, digits) for value in values]


def _head(unit: str) -> tuple[str, str]:
    """The prefixed part of a unit, and the rest: ``("mV", "/K")``."""
    end = next((i for i, sign in enumerate(unit) if not (sign.isalpha() or sign == "%")), len(unit))
    return unit[:end], unit[end:]
