"""Labels of runs, and text columns as states.

A state is named ``column=word``, such as ``operator=Kim``: 1 in the rows where the column says so, 0 elsewhere. Effects
use it as any recorded column; it need not stand in the data, where the column does.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import date, timedelta
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError, quoted
from .grammar import is_missing
from .times import BEYOND, EARLIEST, LATEST, UNITS
from .types import kind_of

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


FEWEST_ROWS = 20
"""Rows in a state, and out of it, below which nothing can be learned of it."""


def states_of(X: Any) -> list[str]:
    """States that columns of text or categories can be in; of two, the one that is met later stands for both."""
    found: list[str] = []
    for column in X.columns if isinstance(X, pd.DataFrame) else ():
        if kind_of(X[column]) == "text":
            words = _words(X[column])
            counted = words.value_counts(sort=False)  # in the order of the rows
            # Words of a column from which it is no state but a text: a comment, a serial number
            if 2 <= len(counted) <= 8:
                names = [
                    f"{column}={word}"
                    for word, rows in counted.items()
                    if FEWEST_ROWS <= rows <= counted.sum() - FEWEST_ROWS
                ]
                found += names[1:] if len(names) == len(counted) == 2 else names
    return [name for name in found if name not in X.columns and is_state(X, name)]


def is_state(X: Any, name: object) -> bool:
    """True if a name is a state of a column in the data, which it is not itself."""
    if not (isinstance(name, str) and isinstance(X, pd.DataFrame)) or name in X.columns:
        return False
    parted = parted_state(name, X.columns)
    return parted is not None and kind_of(X[parted[0]]) == "text"


def state(X: pd.DataFrame, name: str) -> NDArray[np.float64]:
    """1 in the rows that are in a state, 0 in others, NaN where the column says nothing; shape (n_rows,)."""
    parted = parted_state(name, X.columns)
    if parted is None:
        raise RecordError(f"There is no column of the state {quoted(name)} in the data.")
    words, word = _words(X[parted[0]]), parted[1]
    values = (words == word).astype(float).where(words.notna())
    return np.asarray(values.to_numpy(dtype=float, na_value=np.nan))


def parted_state(name: str, columns: Iterable[Any]) -> tuple[Any, str] | None:
    """The column and the word of a state's name; None where no column is called so.

    Examples
    --------
    >>> parted_state("operator=Kim", ["temperature", "operator"])
    ('operator', 'Kim')
    """
    known = {str(column): column for column in columns}
    at = name.find("=")
    while at >= 0:
        if name[:at] in known:
            return known[name[:at]], name[at + 1 :]
        at = name.find("=", at + 1)
    return None


def _words(values: pd.Series[Any]) -> pd.Series[Any]:
    """Words of a column, without blanks around them; missing where it says nothing."""
    text: Any = values.astype("object").where(values.notna(), None)
    words = text.map(lambda value: None if value is None or is_missing(str(value)) else str(value).strip())
    result: pd.Series[Any] = words
    return result
