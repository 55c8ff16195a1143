"""What may label a run."""

from __future__ import annotations

from datetime import date, timedelta
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd

from .errors import RecordError
from .times import BEYOND, UNITS, within_range

LABELS = (str, bool, int, float, Decimal, np.number, np.bool_, date, timedelta, np.datetime64, np.timedelta64)
"""What may label a run: dates and spans of pandas are dates and spans of Python too."""
_DAY = 86_400
_FARTHEST = (1 << 63) - 1 - _DAY * 1_000_000_000
"""Nanoseconds from 1970: a day before the last date, so that it is one in any zone."""


def check_labels(labels: pd.Series[Any], what: str) -> None:
    """Refuse labels that are missing, of other types than `LABELS`, or dates and spans out of reach."""
    missing = labels.isna().to_numpy()
    if missing.any():
        raise RecordError(f"{what} is empty in row {missing.argmax()}. Label every row.")
    check_dates(labels, what)
    if labels.dtype.kind in "mM":
        return
    for row, value in enumerate(labels):
        if not isinstance(value, LABELS):
            raise RecordError(
                f"{what} holds a {type(value).__name__} in row {row}. Label runs with text, numbers or dates."
            )


def check_dates(labels: pd.Series[Any], what: str) -> None:
    """Refuse dates and spans that no clock of nanoseconds reaches: neither files nor other zones can have them."""
    dtype: Any = labels.dtype
    if dtype.kind in "mM" and not isinstance(dtype, pd.ArrowDtype):
        ticks: Any = labels.array
        within_range(ticks.asi8, UNITS[ticks.unit], what, margin=_DAY)
    elif dtype.kind in "OmM":
        try:
            for row, value in enumerate(labels):
                check_date(value, f"{what}, row {row},")
        except (ArithmeticError, pd.errors.OutOfBoundsDatetime):  # a value that pandas cannot hand over
            raise RecordError(f"{what} holds dates out of reach. {BEYOND}") from None


def check_date(label: Any, what: str) -> None:
    """Refuse one label that is a date or a span out of reach."""
    try:
        if isinstance(label, timedelta | np.timedelta64):
            value: int = pd.Timedelta(label).value
        elif isinstance(label, date | np.datetime64):
            value = pd.Timestamp(label).value
        else:
            return
    except (ArithmeticError, ValueError):
        value = _FARTHEST + 1
    if abs(value) > _FARTHEST:
        raise RecordError(f"{what} is {label!s:.60}. {BEYOND}")
