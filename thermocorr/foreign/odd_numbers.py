"""Columns of numbers with cells that are none as they stand: words for no value, and other minus signs."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pandas as pd

from ..records.errors import quoted, times_word
from ..records.grammar import MINUS, says_no_value
from ..records.types import kind_of

NEARLY = 0.5
"""Share of the cells of a column that are numbers, from which the others are looked at."""
SOME = 10_000
"""Cells of a column, at random, that tell whether it is worth looking at all of them."""


def nearly_numbers(frame: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """The frame with numbers in columns of numbers, and what is said of their other cells.

    A word for no value becomes none. A column with any other word stays as it is: it is no column of numbers.
    """
    columns, said = {}, []
    for name in frame.columns:
        if kind_of(frame[name]) != "text":
            continue
        some = frame[name].dropna()
        some = some.sample(min(len(some), SOME), random_state=np.random.default_rng(0))
        if not len(some) or np.isfinite(_numbers(some)).mean() < NEARLY / 2:  # far from it: dates, words
            continue
        numbers = _numbers(frame[name])
        others: Any = frame[name][np.isnan(numbers) & frame[name].notna().to_numpy()]
        if len(others) > (1 - NEARLY) * frame[name].notna().sum() or np.isinf(numbers).any():
            continue
        words = Counter(others[[not says_no_value(str(cell)) for cell in others]])
        if words:
            cells = times_word(sum(words.values()), "cell")
            said.append(f"{quoted(name)} as text, for {cells} without a number, such as {next(iter(words))!r}")
            continue
        if pd.to_numeric(frame[name], errors="coerce").notna().equals(frame[name].notna()):
            continue  # numbers as text, which the reader had a reason for
        columns[name] = numbers
        if len(others):
            cells = times_word(len(others), "cell")
            said.append(f"{cells} of {quoted(name)} without a value, such as {others.iloc[0]!r}")
    return (frame.assign(**columns) if columns else frame), said


def _numbers(cells: pd.Series[Any]) -> np.ndarray:
    """Numbers of cells, NaN for what is none."""
    numbers: Any = pd.to_numeric(cells, errors="coerce")
    if numbers.isna().any():
        numbers = pd.to_numeric(cells.astype("string").str.translate(MINUS).astype(object), errors="coerce")
    return np.asarray(numbers, float)
