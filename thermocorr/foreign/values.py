"""Cells that are no plain numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import quoted, times_word
from ..records.grammar import MINUS, is_missing, says_no_value
from ..records.types import kind_of
from ..records.units import unit_of_text

NEARLY = 0.5
"""Share of the cells of a column that are numbers, from which the others are looked at."""
SOME = 10_000
"""Cells of a column, at random, that tell whether it is worth looking at all of them."""


def without(frame: pd.DataFrame, missing: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """The frame without the words and numbers that say that there is no value, and how many these were.

    Raises RecordError for one that stands nowhere.
    """
    columns: dict[str, Any] = {}
    counts = dict.fromkeys(missing, 0)
    for name in frame.columns:
        kind = kind_of(frame[name])
        if kind not in ("text", "number"):
            continue
        gone = np.zeros(len(frame), bool)
        for word in missing:
            same = frame[name].astype("string").str.strip() == word.strip() if kind == "text" else None
            if kind == "number" and is_number(word):
                same = frame[name] == float(word.translate(MINUS))
            if same is not None:
                gone |= same.fillna(False).to_numpy(bool)
                counts[word] += int(same.sum())
        if gone.any():
            kept = frame[name].where(~gone)
            numbers = pd.to_numeric(kept, errors="coerce")
            columns[str(name)] = numbers if numbers.notna().equals(kept.notna()) else kept
    nowhere = next((word for word, count in counts.items() if not count), None)
    if nowhere is not None:
        raise RecordError(f"--na {nowhere!r} stands in no cell of the log.")
    said = [f"{times_word(count, 'cell')} {word!r} without a value" for word, count in counts.items()]
    return (frame.assign(**columns) if columns else frame), said


def nearly_numbers(frame: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """The frame with numbers in columns of numbers, and what is said of their other cells.

    A word for no value becomes none. A column with any other word stays as it is, and ``attrs["words"]`` has one of its
    words: it is no column of numbers until somebody says that these are no values.
    """
    columns, said = {}, []
    odd: dict[str, str] = {}
    for name in frame.columns:
        if kind_of(frame[name]) != "text":
            continue
        some = frame[name].dropna()
        some = some.sample(min(len(some), SOME), random_state=np.random.default_rng(0))
        if not len(some) or np.isfinite(_numbers(some)).mean() < NEARLY / 2:  # far from it: dates, words
            continue
        numbers = _numbers(frame[name]).copy()
        infinite = np.flatnonzero(np.isinf(numbers))
        numbers[[row for row in infinite if says_no_value(str(frame[name].iloc[row]))]] = np.nan
        others: Any = frame[name][np.isnan(numbers) & frame[name].notna().to_numpy()]
        if len(others) > (1 - NEARLY) * frame[name].notna().sum() or np.isinf(numbers).any():
            continue
        none = [says_no_value(str(cell)) for cell in others]
        words = Counter(others[[not is_one for is_one in none]])
        if words:
            cells = times_word(sum(words.values()), "cell")
            odd[str(name)] = str(next(iter(words)))
            said.append(f"{quoted(name)} as text, for {cells} without a number, such as {next(iter(words))!r}")
            continue
        if not len(infinite) and pd.to_numeric(frame[name], errors="coerce").notna().equals(frame[name].notna()):
            continue  # numbers as text, which the reader had a reason for
        columns[name] = numbers
        if len(others):
            cells = times_word(len(others), "cell")
            said.append(f"{cells} of {quoted(name)} without a value, such as {others.iloc[0]!r}")
    frame = frame.assign(**columns) if columns else frame
    if odd:
        frame.attrs["words"] = odd
    return frame, said


def _numbers(cells: pd.Series[Any]) -> np.ndarray:
    """Numbers of cells, NaN for anything else."""
    numbers: Any = pd.to_numeric(cells, errors="coerce")
    if numbers.isna().any():
        numbers = pd.to_numeric(cells.astype("string").map(_bare, na_action="ignore").astype(object), errors="coerce")
    return np.asarray(numbers, float)


_POINT = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
GROUPED = {",": re.compile(r"[+-]?\d{1,3}(?:\.\d{3})+,\d+"), ".": re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d+")}
"""By decimal sign: a number with a sign between its thousands, and a decimal sign behind."""
IN_DOUBT = {",": re.compile(r"[+-]?\d{1,3}(?:\.\d{3})+"), ".": re.compile(r"[+-]?\d{1,3}(?:,\d{3})+")}
"""By decimal sign: whole thousands, or a number with the other decimal sign."""
ELAPSED = r"(?P<hours>\d+):(?P<minutes>[0-5]\d):(?P<seconds>[0-5]\d)(?:[.,](?P<fraction>\d+))?"
"""Time since a start: hours may be more than 24."""
DAYS = r"-?\d+ days?(?: [+-]?\d{2}:\d{2}:\d{2}(?:\.\d{1,9})?)?"
"""Time since a start as pandas writes it."""
CLOCK = (
    r"(?P<clock>\d{1,2}:\d{2}(?::\d{1,2}(?=\D|$))?)"
    r"(?:(?<=:\d\d:\d\d)[.,](?P<fraction>\d+)|(?<=:\d\d:\d\d):(?P<third>\d{3}))?"
    r"(?:\s*(?P<half>[AaPp]\.?\s?[Mm]\.?))?"
)
"""A time of day: clock, fraction of a second, half of the day."""
_CLOCK = re.sub(r"\?P<\w+>", "?:", CLOCK) + r"(?: ?(?:Z|UTC|[+-]\d{2}:?\d{2}))?"
_DATE = r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}[-/ .]?[A-Za-z]{3}[a-z]*[-/ .,]+\d{2,4}|[A-Za-z]{3,9} \d{1,2},? \d{4}"
_ELAPSED = re.sub(r"\?P<\w+>", "?:", ELAPSED)
_MOMENT = re.compile(rf"(?:{_DATE})(?:[T ,]+{_CLOCK})?|{_CLOCK}|{_ELAPSED}|{DAYS}")
_SWITCHES = frozenset(("true", "false", "on", "off", "ok"))
_PATTERN_OF_DATES = re.compile(r"[dDmMyYhHsS]{1,4}(?:[-/.: T]+[dDmMyYhHsS]{1,4}){1,6}.*")


_APART = re.compile(r"(?<=\d)['\u2019\u00a0\u202f](?=\d{3})")
"""Signs between thousands that stand for nothing else: the Swiss apostrophe, blanks that do not break."""


def _bare(cell: str) -> str:
    """A cell with ASCII's minus sign, and none of the signs between thousands that are no decimal signs."""
    text = cell.translate(MINUS)
    return text if text.isascii() and "'" not in text else _APART.sub("", text)


def is_number(cell: str, decimal: str = ".") -> bool:
    """True if a cell is a number with this decimal sign, or without any."""
    text = _bare(cell.strip())
    if _POINT.fullmatch(text):
        return decimal == "." or "." not in text
    return (decimal == "," and bool(_COMMA.fullmatch(text))) or bool(GROUPED[decimal].fullmatch(text))


def is_moment(cell: str) -> bool:
    """True if a cell looks like a date, a time of day, or both."""
    return bool(_MOMENT.fullmatch(cell.strip()))


def first_cell(values: Iterable[object]) -> str:
    """The first cell of a column that holds something, without blanks around it."""
    return next((cell.strip() for cell in values if isinstance(cell, str) and cell.strip()), "")


def is_value(cell: str, decimal: str = ".") -> bool:
    """True if a cell holds what a sample has: a number, a moment, a switch."""
    return is_number(cell, decimal) or is_moment(cell) or cell.strip().lower() in _SWITCHES or says_no_value(cell)


def is_unit(cell: str) -> bool:
    """True if a cell, below the name of a column, is a unit, or says how dates are written."""
    text = cell.strip()
    bare = text[1:-1] if text[:1] + text[-1:] in ("[]", "()", "<>") else text
    return bare != text or unit_of_text(bare) != "" or bool(_PATTERN_OF_DATES.fullmatch(bare))


def plain_cell(cell: str, decimal: str) -> str:
    """A cell with a decimal point, and no sign between thousands; text as it stands.

    Raises ValueError for a number that may be a thousandfold of another one.
    """
    text = _bare(cell.strip())
    if decimal == "," and _COMMA.fullmatch(text):
        return text.replace(",", ".")
    if GROUPED[decimal].fullmatch(text):
        return text.replace("." if decimal == "," else ",", "").replace(",", ".")
    if IN_DOUBT[decimal].fullmatch(text):
        raise ValueError(text)
    if decimal == "," and _POINT.fullmatch(text) and "." in text:
        raise ValueError(text)
    return text if is_missing(text) else cell
