"""How rows are counted, beside messages that name one: other messages of the commands speak of lines of a file."""

from __future__ import annotations

import re

_ROW = re.compile(r"\brows? \d")
COUNTED = "Row 0 is the first row of data."


def with_first_row(text: str) -> str:
    """A message, and where its rows are counted from if it names one.

    Examples
    --------
    >>> with_first_row("'temperature' is not a number in row 7: 'abc'.")
    "'temperature' is not a number in row 7: 'abc'. Row 0 is the first row of data."
    >>> with_first_row("Line 9 has a field too many.")
    'Line 9 has a field too many.'
    """
    return f"{text} {COUNTED}" if _ROW.search(text) else text
