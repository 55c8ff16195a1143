"""Time spans, from numbers, texts and objects to seconds; and dates that are told from them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd

_LETTERS = {"d": "D", "w": "W", "H": "h", "S": "s"}
"""Units of spans, of one letter, as they may be written and as every version of pandas has them."""
_BARE = re.compile(r"[+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?")
"""A number without a unit, which pandas would count in nanoseconds."""
_COMMA = re.compile(r"[0-9],[0-9]")
"""A decimal comma or one between thousands, which pandas would pass over: 1,5 h as 15 h."""
_UNIT_LETTER = re.compile(r"(?<![^\W\d_])[dwHSTLUN](?![^\W\d_])")
"""A unit of one letter that some version of pandas has warned of."""


_DAY = re.compile(r"(?<![0-9.,:])[0-9]{4}(?:[0-9]{4})?(?![0-9])|[0-9][./-][0-9]")
"""What tells a date from a time of day: a year, or numbers with what parts days from months."""


def date_of(value: Any) -> Any:
    """A date as pandas reads it; NaT for none, and for text without a day, which pandas takes for a time of today."""
    if isinstance(value, str) and not _DAY.search(value):
        return pd.NaT
    try:
        date = pd.Timestamp(value)
        date.as_unit("ns")  # or it is out of reach
        return date
    except (ValueError, TypeError):
        return pd.NaT


def span_of(value: Any) -> Any:
    """A time span as pandas reads it, in text ("1 d 2 h") or as an object; NaT for what says that there is none.

    Text without a unit ("60") is a number of seconds, as a number is. A comma inside a number is refused, for it may
    stand before decimals or between thousands. Units are days and weeks, hours and seconds in small letters and in
    capitals: which of them are out of use differs between versions of pandas.

    Raises ValueError or TypeError for what is no span.

    Examples
    --------
    >>> span_of("1 d 2 H").total_seconds()
    93600.0
    >>> span_of("60").total_seconds()
    60.0
    """
    if isinstance(value, str):
        if _COMMA.search(value):
            raise ValueError("a comma inside a number")
        if _BARE.fullmatch(value.strip()):
            return pd.Timedelta(float(value), unit="s")
    if isinstance(value, str) and not value.strip().lstrip("+-").startswith("P"):  # ISO 8601 has capitals of its own
        value = _UNIT_LETTER.sub(_known_unit, value)
    return pd.Timedelta(value)


def _known_unit(found: re.Match[str]) -> str:
    """A unit of one letter as every version of pandas knows it."""
    if found[0] not in _LETTERS:
        raise ValueError(f"invalid unit abbreviation: {found[0]}")
    return _LETTERS[found[0]]


def seconds_of(value: Any, name: str) -> float:
    """A time span in seconds: a number, or anything that pandas reads as a span ('15 min', Timedelta).

    Raises ValueError in the words of scikit-learn's parameter checks.

    Examples
    --------
    >>> seconds_of("15 min", "time_constant")
    900.0
    """
    if isinstance(value, int | float | np.number) and not isinstance(value, bool | np.timedelta64):
        seconds = float(value)
    else:
        try:
            seconds = span_of(value).total_seconds()
        except (ValueError, TypeError):
            seconds = float("nan")
    if not (np.isfinite(seconds) and seconds > 0):
        raise ValueError(
            f"The {name!r} parameter must be a positive time: seconds, or a span such as '15 min'. "
            f"Got {value!r} instead."
        )
    return seconds
