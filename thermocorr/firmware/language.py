"""Interface of an export language; all else in this room, but `c99`, is common to all languages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from .finished import Firmware
from .selftest import Trial


class Language(Protocol):
    """A language that `export_to` can write: one file, with a rule for each kind of `formulas` and of `statements`.

    It writes the flags, constants, helpers and members of the program, the functions ``init`` and ``update`` around the
    statements that `frame` has for them, and the self-test.
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
        """Texts of the files, in ASCII, by their endings; ValueError for a number that has no place in the language.

        `provenance` are the lines of the comment that heads the first.
        """
        ...
