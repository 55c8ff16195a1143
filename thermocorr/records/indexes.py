"""The index of a frame: times where it holds some, else in words what it holds."""

from __future__ import annotations

from datetime import date

import numpy as np
import pandas as pd

from .errors import quoted
from .times import Times, date_of_text, times_from
from .types import kind_of


def index_times(index: pd.Index) -> Times | None:
    """Times of an index of dates, spans, periods (when they begin) or text in the forms of ISO 8601; None for others.

    Raises RecordError for an index of times of which some are missing or unreadable, naming the first.
    """
    if isinstance(index, pd.PeriodIndex):
        index = index.to_timestamp(how="start")
    kind = "text" if isinstance(index, pd.MultiIndex) else kind_of(index)
    if kind not in ("date", "span") and not (kind == "text" and len(index) and _is_date(index[0])):
        return None
    return times_from(index, "The index")


def _is_date(label: object) -> bool:
    """Whether a label of an index is a date, as such or in text; text of digits alone is none."""
    if not isinstance(label, str | date):
        return False
    text = str(label).strip()
    return not text.isdigit() and not pd.isna(date_of_text(text))


def no_times_text(index: pd.Index | None) -> str:
    """What an index without times holds, and what to make of it; "" for numbers of rows, and where there is none."""
    if index is None or not len(index):
        return ""
    if isinstance(index, pd.MultiIndex):
        return f"The index has {index.nlevels} levels: make columns of them with X.reset_index(). "
    if kind_of(index) != "number":
        return (
            f"The index holds {quoted(index[0])} and so on, no dates in a form of ISO 8601: make dates of it with "
            "pandas.to_datetime, if they are some. "
        )
    numbers = index.to_numpy(dtype=float, na_value=np.nan)
    if (np.diff(numbers) == 1).all() and not numbers[0] % 1:
        return ""
    return (
        f"The index holds numbers, {numbers[0]:.10g} to {numbers[-1]:.10g}, which are not taken as times: if they are "
        "seconds, make a column of them, as with X.assign(seconds=X.index) and time='seconds'. "
    )
