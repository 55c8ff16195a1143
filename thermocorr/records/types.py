"""What a column may be, by its type; limits of values."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from .errors import RecordError, option

ColumnKind = Literal["number", "switch", "date", "span", "text", "complex", "other"]
Role = Literal["temperature", "reading", "reference", "column", "time", "label"]

_VALUES = frozenset(("number", "text"))
ALLOWED: dict[str, frozenset[str]] = {
    "temperature": _VALUES,
    "reading": _VALUES,
    "reference": _VALUES,
    "column": _VALUES | {"switch"},
    "time": frozenset(("number", "date", "span", "text")),
    "label": frozenset(("number", "switch", "date", "span", "text")),
}
"""Role -> kinds of columns that can play it. Text is read: numbers as text, dates as text, labels as they are."""
_REMEDY = {
    "complex": "holds complex numbers. Complex data not supported: pass real numbers.",
    "date": "holds times ({type}) where numbers are needed. Is it the time column? Pass {time}",
    "span": "holds times ({type}) where numbers are needed. Is it the time column? Pass {time}",
    "switch": "holds true/false where {wanted} are needed. Is it the right column?",
    "other": "holds {type} where {wanted} are needed. Convert it before, or name another column.",
    "number": "holds numbers ({type}) where {wanted} are needed.",
    "text": "holds text ({type}) where {wanted} are needed.",
}
_WANTED = {"time": "dates, time spans or seconds", "label": "labels"}


def kind_of(values: Any) -> ColumnKind:
    """Kind of a Series or an array."""
    dtype = values.dtype
    if isinstance(dtype, np.dtype) and dtype.kind in "fiu":
        return "number"
    if pd.api.types.is_bool_dtype(dtype):
        return "switch"
    if pd.api.types.is_complex_dtype(dtype):
        return "complex"
    if pd.api.types.is_numeric_dtype(dtype):
        return "number"
    if pd.api.types.is_datetime64_any_dtype(dtype) or isinstance(dtype, pd.PeriodDtype):
        return "date"
    if pd.api.types.is_timedelta64_dtype(dtype):
        return "span"
    inner = pd.api.types.infer_dtype(values, skipna=True) if pd.api.types.is_object_dtype(dtype) else ""
    if inner == "mixed" and isinstance(values[pd.notna(values)].iloc[0], list | dict | np.ndarray):
        return "other"
    return {"boolean": "switch", "decimal": "number"}.get(inner, "text")  # type: ignore[return-value]


def require_role(kind: ColumnKind, role: Role, what: str, type_name: str) -> None:
    """Refuse a column that cannot play its role."""
    if kind not in ALLOWED[role]:
        remedy = _REMEDY[kind].format(type=type_name, wanted=_WANTED.get(role, "numbers"), time=option("time"))
        raise RecordError(f"{what} {remedy}")


LARGEST = 1e40
"""A number beyond this is no measurement. Squares and cubes of smaller ones stay within double precision."""


class Check(NamedTuple):
    """A condition on a value, and the words for it."""

    holds: Callable[[Any], bool]
    wanted: str


def within(low: float, high: float) -> Check:
    """Limits of a number or array; NaN fails."""

    def holds(value: Any) -> bool:
        return bool(np.all((np.asarray(value) >= low) & (np.asarray(value) <= high)))

    return Check(holds, f"a number from {low:g} to {high:g}")


def _is_label(value: Any) -> bool:
    if type(value) is tuple:
        return all(map(_is_label, value))
    return value is None or (isinstance(value, bool | int | float | str | date | pd.Timedelta) and bool(value == value))


LEAST = 5e-324
Number = Annotated[float, within(-LARGEST, LARGEST)]
Size = Annotated[float, within(0.0, LARGEST)]
Positive = Annotated[float, within(LEAST, LARGEST)]
Variance = Annotated[float, within(0.0, LARGEST**2)]
Large = Annotated[float, within(-1e300, 1e300)]
"""A sum or power of measurements."""
Loose = Annotated[float, Check(lambda value: True, "a number")]
"""Any number, infinities and NaN too."""
Counted = Annotated[int, within(0, 1 << 53)]
"""A number of rows: one that can go on counting."""
Vector = Annotated[np.ndarray, within(-(LARGEST**2), LARGEST**2)]
Sizes = Annotated[np.ndarray, within(0.0, LARGEST**2)]
Stamp = int | float
"""A time on the clock of a record, see `thermocorr.records.times.Times`."""
RunLabel = Annotated[Any, Check(_is_label, "a label (text, a number, a date)")]
Column = Annotated[
    Any, Check(lambda value: isinstance(value, str) or (type(value) is int and value >= 0), "the name of a column")
]
