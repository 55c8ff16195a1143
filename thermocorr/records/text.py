"""Names and units of the user's where people read them: on a terminal, in a page, in a message."""

from __future__ import annotations

import unicodedata

_LINE_ENDS = ("Zl", "Zp")
"""Categories of the separators of lines and paragraphs: they end a line as a newline does."""


def printable(text: object, kept: str = "") -> str:
    r"""Text in which nothing steers a terminal or reorders what is read.

    Control and format characters, lone surrogates and characters that Unicode has not assigned (all of its category C)
    and separators of lines and paragraphs become the escapes that Python writes for them. All else stays: blanks of
    any width, accents, every script.

    Parameters
    ----------
    text : object
        Whatever names a column, a unit or a run; ``str`` of it is taken.
    kept : str
        Characters of those kinds that stay as they are.

    Examples
    --------
    >>> print(printable("\x1b[31mΔT \u202egnorw [°C]\n"))
    \x1b[31mΔT \u202egnorw [°C]\n
    """
    plain = str(text)
    if plain.isascii() and plain.isprintable():
        return plain
    return "".join(c if c in kept or not _steers(c) else c.encode("unicode_escape").decode("ascii") for c in plain)


def _steers(character: str) -> bool:
    category = unicodedata.category(character)
    return category.startswith("C") or category in _LINE_ENDS
