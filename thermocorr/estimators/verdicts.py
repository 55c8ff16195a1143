"""The verdicts of a diagnosis: when each is given, and what it means to whoever reads, signs or draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Grounds:
    """What a diagnosis found, as far as the verdict depends on it."""

    named: bool
    """Whether there is a cause."""
    ambiguous: bool
    """Whether the first cause has rivals that the record cannot tell it apart from."""
    structure: bool
    """Whether what is left is more than noise."""
    spoiled: bool
    """Whether invalid readings were used in the fit."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One verdict. A new one stands in this file alone."""

    word: str
    """As `Diagnosis.verdict` has it."""
    sentence: str
    given: Callable[[Grounds], bool]
    """Whether it is given, where none before it in `VERDICTS` is."""
    calm: bool = False
    """Whether nothing is advised, no place shown, and readings may be signed."""
    in_doubt: bool = False
    """Whether further quantities would help to tell the cause."""
    unknown: bool = False
    """Whether nobody is named although structure is left."""


AMBIGUOUS = Verdict(
    word="ambiguous",
    sentence="Something is missing, and this record cannot tell two explanations apart.",
    given=lambda grounds: grounds.named and grounds.ambiguous,
    in_doubt=True,
)
MISSING = Verdict(
    word="missing",
    sentence="Something is missing, and this record can tell what.",
    given=lambda grounds: grounds.named,
)
UNEXPLAINED = Verdict(
    word="unexplained",
    sentence="Structure is left in the residual that no known effect explains by itself.",
    given=lambda grounds: grounds.structure or grounds.spoiled,
    in_doubt=True,
    unknown=True,
)
NOTHING_MISSING = Verdict(
    word="nothing missing",
    sentence="Nothing is missing: what is left looks like noise.",
    given=lambda grounds: True,
    calm=True,
)
VERDICTS = {verdict.word: verdict for verdict in (AMBIGUOUS, MISSING, UNEXPLAINED, NOTHING_MISSING)}
"""Word -> verdict. The first that is given is the diagnosis's."""


def verdict_on(grounds: Grounds) -> Verdict:
    """The verdict on what was found."""
    return next(verdict for verdict in VERDICTS.values() if verdict.given(grounds))
