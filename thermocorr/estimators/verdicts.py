"""The verdicts of a diagnosis: what each means to whoever reads, signs or draws it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One verdict. A new one stands here, and in `judgement.diagnosis`, which says when it is given."""

    word: str
    """As `Diagnosis.verdict` has it."""
    sentence: str
    calm: bool = False
    """Whether nothing is advised, no place shown, and readings may be signed."""
    in_doubt: bool = False
    """Whether further quantities would help to tell the cause."""
    unknown: bool = False
    """Whether nobody is named although structure is left."""


NOTHING_MISSING = Verdict(
    word="nothing missing", sentence="Nothing is missing: what is left looks like noise.", calm=True
)
MISSING = Verdict(word="missing", sentence="Something is missing, and this record can tell what.")
AMBIGUOUS = Verdict(
    word="ambiguous",
    sentence="Something is missing, and this record cannot tell two explanations apart.",
    in_doubt=True,
)
UNEXPLAINED = Verdict(
    word="unexplained",
    sentence="Structure is left in the residual that no known effect explains by itself.",
    in_doubt=True,
    unknown=True,
)
VERDICTS = {verdict.word: verdict for verdict in (NOTHING_MISSING, MISSING, AMBIGUOUS, UNEXPLAINED)}
