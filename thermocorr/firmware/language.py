"""What a language has to say for itself; all that stands beside it in this room is common to all languages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from .finished import Firmware
from .selftest import Trial


class Language(Protocol):
    """A language that a program can be printed in: one file, which `export` is given.

    It prints the statements and formulas of `statements` and `formulas`, each kind by a rule of its own, the two
    functions that `frame` has the statements of, and what stands around them.
    """

    title: str
    """Name, for messages."""
    suffixes: tuple[str, ...]
    """Endings of paths that name files; any other path is a folder."""
    keywords: frozenset[str]
    """Names that nothing in the code may have, in small letters."""
    unfit: frozenset[str]
    """Names that an export may not have, in small letters."""

    def files(self, firmware: Firmware, provenance: Sequence[str], trial: Trial) -> dict[str, str]:
        """ASCII texts of the files by their endings, one of which runs the self-test.

        `provenance` are lines for the comment that heads the first. ValueError for a number that has no place.
        """
        ...
