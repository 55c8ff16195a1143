"""Labels of runs."""

from __future__ import annotations

from datetime import date, timedelta
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError, quoted
from .times import BEYOND, EARLIEST, LATEST, UNITS

LABELS = (str, bool, int, float, Decimal, np.number, np.bool_, date, timedelta, np.datetime64, np.timedelta64)
"""What may label a run: dates and spans of pandas are dates and spans of Python too."""


def factorized(labels: pd.Series[Any], what: str) -> tuple[NDArray[np.intp], pd.Index[Any]]:
    """Codes of the labels, and the labels that differ; `what` names the column in messages.

    Raises RecordError for labels that are missing, of other types than `LABELS`, or dates and spans out of reach.
    """
    missing = labels.isna().to_numpy()
    if missing.any():
        raise RecordError(f"{what} is empty in row {missing.argmax()}. Label every row.")
    alike = labels.dtype.kind in "biufmM" and not isinstance(labels.dtype, pd.ArrowDtype)
    try:
        for row, value in enumerate(() if alike or isinstance(labels.dtype, pd.StringDtype) else labels):
            if not isinstance(value, LABELS):
                raise RecordError(
                    f"{what} holds a {type(value).__name__} in row {row}. Label runs with text, numbers or dates."
                )
    except (ArithmeticError, pd.errors.OutOfBoundsDatetime):  # a date that pandas cannot hand over
        raise RecordError(f"{what} holds dates out of reach. {BEYOND}") from None
    codes, names = pd.factorize(labels)
    check_dates(codes, names, what)
    return codes, names


def refuse_labels_of_rows(labels: pd.Series[Any], column: object) -> None:
    """Refuse labels of which (nearly) every row has another: a column of times, say, of which a fit would take ages."""
    try:
        count = labels.nunique()
    except (TypeError, ArithmeticError, ValueError):  # what can be no label: the record says so
        return
    # Rows of a run, on average, below which labels are no labels of runs: something else is in their column
    # So many runs may be as short as they are
    if count > 20 and len(labels) < 8 * count:
        raise RecordError(
            f"{quoted(column)} has {count} different values in {len(labels)} rows: each run needs many rows. Is it the "
            "right column for the runs?"
        )


def check_dates(codes: NDArray[np.intp], names: pd.Index[Any], what: str) -> None:
    """Refuse labels that are dates and spans which no clock of nanoseconds reaches: no file could keep them."""
    if isinstance(names, pd.DatetimeIndex | pd.TimedeltaIndex):
        unit = 1_000_000_000 // UNITS[names.unit]
        far = np.flatnonzero((names.asi8 > LATEST // unit) | (names.asi8 < EARLIEST // unit))
        if len(far):
            seconds = int(names.asi8[far[0]]) // UNITS[names.unit]
            shown = np.datetime64(seconds, "s") if isinstance(names, pd.DatetimeIndex) else f"a span of {seconds} s"
            raise RecordError(f"{what} is {shown} in row {int((codes == far[0]).argmax())}. {BEYOND}")
        return
    for k, name in enumerate(names):
        if out_of_reach(name):
            raise RecordError(f"{what} is {name!s:.60} in row {int((codes == k).argmax())}. {BEYOND}")


def out_of_reach(label: Any) -> bool:
    """True if a label is a date or a span that no clock of nanoseconds reaches in every zone."""
    try:
        if isinstance(label, timedelta | np.timedelta64):
            value: int = pd.Timedelta(label).value
        elif isinstance(label, date | np.datetime64):
            value = pd.Timestamp(label).value
        else:
            return False
    except (ArithmeticError, ValueError):
        return True
    return not EARLIEST <= value <= LATEST
