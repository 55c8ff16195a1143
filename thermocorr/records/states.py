"""Columns of words as columns of 0 and 1: who operated, which fixture, which mode.

A state is named ``column=word``, such as ``operator=Kim``: 1 in the rows where the column says so, 0 elsewhere. Effects
use it as any recorded column; it need not stand in the data, where the column does.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .errors import RecordError, quoted
from .grammar import is_missing
from .types import kind_of

MOST_WORDS = 8
"""Words of a column from which it is no state but a text: a comment, a serial number."""
FEWEST_ROWS = 20
"""Rows in a state, and out of it, below which nothing can be learned of it."""


def states_of(X: Any) -> list[str]:
    """States that columns of text or categories can be in; of two, the one that is met later stands for both."""
    found: list[str] = []
    for column in X.columns if isinstance(X, pd.DataFrame) else ():
        if kind_of(X[column]) == "text":
            words = _words(X[column])
            counted = words.value_counts(sort=False)  # in the order of the rows
            if 2 <= len(counted) <= MOST_WORDS:
                names = [
                    f"{column}={word}"
                    for word, rows in counted.items()
                    if FEWEST_ROWS <= rows <= counted.sum() - FEWEST_ROWS
                ]
                found += names[1:] if len(names) == len(counted) == 2 else names
    return [name for name in found if name not in X.columns and is_state(X, name)]


def is_state(X: Any, name: object) -> bool:
    """Whether a name is a state of a column in the data, which it is not itself."""
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
