"""What stands in a cell, in whatever way of writing: a number, a date, nothing, a unit."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ..records.grammar import MINUS, is_missing, says_no_value
from ..records.units import unit_of_text

_POINT = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
GROUPED = {
    ",": re.compile(r"[+-]?\d{1,3}(?:\.\d{3})+,\d+"),
    ".": re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d+"),
}
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
    r"(?:\s*(?P<half>[AaPp]\.?[Mm]\.?))?"
)
"""A time of day: clock, fraction of a second, half of the day."""
_CLOCK = re.sub(r"\?P<\w+>", "?:", CLOCK) + r"(?: ?(?:Z|UTC|[+-]\d{2}:?\d{2}))?"
_DATE = r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}[-/ .]?[A-Za-z]{3}[a-z]*[-/ .,]+\d{2,4}|[A-Za-z]{3,9} \d{1,2},? \d{4}"
_ELAPSED = re.sub(r"\?P<\w+>", "?:", ELAPSED)
_MOMENT = re.compile(rf"(?:{_DATE})(?:[T ,]+{_CLOCK})?|{_CLOCK}|{_ELAPSED}|{DAYS}")
_SWITCHES = frozenset(("true", "false", "on", "off", "ok"))
_PATTERN_OF_DATES = re.compile(r"[dDmMyYhHsS]{1,4}(?:[-/.: T]+[dDmMyYhHsS]{1,4}){1,6}.*")


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a cell is a number with this decimal sign, or without any."""
    text = cell.strip().translate(MINUS)
    if _POINT.fullmatch(text):
        return decimal == "." or "." not in text
    return (decimal == "," and bool(_COMMA.fullmatch(text))) or bool(GROUPED[decimal].fullmatch(text))


def is_moment(cell: str) -> bool:
    """Whether a cell looks like a date, a time of day, or both."""
    return bool(_MOMENT.fullmatch(cell.strip()))


def first_cell(values: Iterable[object]) -> str:
    """The first cell of a column that holds something, without blanks around it."""
    return next((cell.strip() for cell in values if isinstance(cell, str) and cell.strip()), "")


def is_value(cell: str, decimal: str = ".") -> bool:
    """Whether a cell holds what a sample has: a number, a moment, a switch."""
    return is_number(cell, decimal) or is_moment(cell) or cell.strip().lower() in _SWITCHES or says_no_value(cell)


def is_unit(cell: str) -> bool:
    """Whether a cell, below the name of a column, is a unit, or says how dates are written."""
    text = cell.strip()
    bare = text[1:-1] if text[:1] + text[-1:] in ("[]", "()", "<>") else text
    return bare != text or unit_of_text(bare) != "" or bool(_PATTERN_OF_DATES.fullmatch(bare))


def plain_cell(cell: str, decimal: str) -> str:
    """A cell with a decimal point, and no sign between thousands; text as it stands.

    Raises ValueError for a number that may be a thousandfold of another one.
    """
    text = cell.strip().translate(MINUS)
    if decimal == "," and _COMMA.fullmatch(text):
        return text.replace(",", ".")
    if GROUPED[decimal].fullmatch(text):
        return text.replace("." if decimal == "," else ",", "").replace(",", ".")
    if IN_DOUBT[decimal].fullmatch(text):
        raise ValueError(text)
    if decimal == "," and _POINT.fullmatch(text) and "." in text:
        raise ValueError(text)
    return text if is_missing(text) else cell
