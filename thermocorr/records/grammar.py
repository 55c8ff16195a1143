"""Grammar of the cells of a text table: a number, nothing, true or false, the label of a run."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from typing import Any

from .errors import RecordError

MISSING = frozenset((
    "", "NA", "N/A", "n/a", "#N/A", "#N/A N/A", "#NA", "<NA>", "NaN", "nan", "-NaN", "-nan", "NULL", "null", "None",
    "1.#IND", "-1.#IND", "1.#QNAN", "-1.#QNAN",
))  # fmt: skip
"""What stands in a cell where there is no value; blanks around it do not count. The list that pandas has."""
NO_VALUE = frozenset((
    "ovld", "ovld.", "ovl", "o.l", "o.l.", "ol", "0l", "0.l", "overload", "overflow", "ovrflw", "overrange",
    "over range", "out of range", "over", "under", "underflow", "underrange", "unavailable", "unknown", "no data",
    "nodata", "open", "burnout", "burn out", "fault", "error", "err", "bad", "invalid", "stale", "timeout",
    "not connected", "offline", "#value!", "#div/0!", "#ref!", "#num!", "#name?", "nan",
    "inf", "infinity",
    "undefined", "#nv", "#wert!", "?", "-", "--", "---", "----", "-----", "*", "***", "****", "*****", "#####",
))  # fmt: skip
"""What instruments and loggers write in place of a number that they do not have: in small letters, without a sign."""
MINUS = str.maketrans({"\u2212": "-", "\u2013": "-", "\ufe63": "-", "\uff0d": "-"})
"""Characters that stand for a minus sign."""
LARGEST = 1e40
"""A number beyond this is no measurement. Squares and cubes of smaller ones stay within double precision."""
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SWITCH = {"True": 1.0, "TRUE": 1.0, "true": 1.0, "False": 0.0, "FALSE": 0.0, "false": 0.0}
_BLANKS = " \t"


def is_missing(text: str) -> bool:
    """True if a cell is empty, or says so."""
    return text.strip(_BLANKS) in MISSING


def says_no_value(text: str) -> bool:
    """True if a cell among numbers says in words that there is no value."""
    bare = text.translate(MINUS).strip(_BLANKS).lower()
    return bare in NO_VALUE or bare.lstrip("+-") in NO_VALUE


def has_other_blanks(text: str) -> bool:
    """True if a cell begins or ends with a line feed, a vertical tab or the like: no number does."""
    return text.strip() != text.strip(_BLANKS)


def number(text: str, what: str, switch: bool = False) -> float:
    """The number in a cell; NaN where there is none.

    `text` (str): Digits of ASCII with a decimal point, an exponent after e or E, blanks around them: ``-1.5e-3``; or
    a word for no value, one of `NO_VALUE`. `what` (str): What the cell holds, for the message. `switch` (bool,
    default False): Read true and false as 1 and 0: recorded columns may be switches, temperatures and readings may
    not. Raises RecordError for anything else, and numbers beyond `LARGEST`.
    """
    cell = text.strip(_BLANKS)
    if _NUMBER.fullmatch(cell):
        value = float(cell)
        if abs(value) <= LARGEST:
            return value
        raise RecordError(f"{what} is {cell[:60]}, beyond {LARGEST:g}: no measurement is that large")
    if cell in MISSING or says_no_value(cell):
        return math.nan
    if switch and cell in _SWITCH:
        return _SWITCH[cell]
    plain = cell.translate(MINUS)
    if plain != cell:
        return number(plain, what, switch)
    raise RecordError(f"{what} is {text[:60]!r}, no number")


def label(text: str, known: Collection[Any]) -> Any:
    """The label of a run as the fitted record had it: a column of numbers alone had been read as numbers.

    Raises RecordError for a cell without a label.
    """
    cell = text.strip(_BLANKS)
    if cell in MISSING:
        raise RecordError("the row has no label of its run")
    if known and all(isinstance(run, bool) for run in known):
        return bool(_SWITCH[cell]) if cell in _SWITCH else text
    if known and all(isinstance(run, int | float) for run in known) and _NUMBER.fullmatch(cell):
        return float(cell)
    return text
