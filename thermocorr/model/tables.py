"""Tables of a fitted model, and the four verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..effects.protocol import Effect
from ..records.errors import printable
from ..records.numbers import unit_text
from ..records.units import difference_unit
from .reading import Reading


def coefficient_table(
    effects: Sequence[Effect], coefficients: np.ndarray, errors: np.ndarray, reading: Reading
) -> pd.DataFrame:
    """One row per column of the model, U0 first.

    Characters that steer a terminal are shown as escapes, except line ends and tabs in names, which pandas itself
    escapes in what it prints.
    """
    names, kinds, units = ["U0"], ["reference reading"], [reading.unit]
    for effect in effects:
        names += effect.names()
        kinds += [effect.label()] * effect.n_columns()
        units += [_per(reading, unit) for unit in effect.units()]
    return pd.DataFrame(
        {
            "effect": [printable(kind) for kind in kinds],
            "coefficient": coefficients,
            "unit": [printable(unit) for unit in units],
            "standard_error": errors,
        },
        index=pd.Index([printable(name, kept="\t\n\r") for name in names], name="column"),
    )


def _per(reading: Reading, unit: str) -> str:
    unit = unit.replace("K", difference_unit(reading.temperature_unit))
    top = reading.unit or "1"
    if not unit or (unit.startswith("unit") and not reading.unit):
        return reading.unit
    return f"{top}/({unit})" if set(unit) & {" ", "/"} else f"{top}/{unit}"


def equation_text(effects: Sequence[Effect], coefficients: np.ndarray, reading: Reading, temperature: str) -> str:
    """The fitted formula as text, with its symbols."""
    unit = f" {printable(unit_text(reading.unit))}" if reading.unit else ""
    lines = [f"{printable(reading.name)} = {coefficients[0]:.10g}{unit}"]
    terms = [printable(term) for effect in effects for term in effect.terms()]
    for value, term in zip(coefficients[1:], terms, strict=True):
        lines.append(f"    {'-' if value < 0 else '+'} {abs(value):.6g} * {term}")
    explained: dict[str, dict[str, float]] = {}
    for effect in effects:
        if effect.names():
            explained.setdefault(effect.explained(printable(temperature)), {}).update(effect.means())
    for said, means in explained.items():
        numbers = ", ".join(f"{printable(name)} {mean:.10g}" for name, mean in means.items())
        of_which = f" (mean{'s' * (len(means) > 1)}: {numbers})" if means else ""
        lines += [f"{said}{of_which}"] if said else []
    return "\n".join(lines)


def distinct(labels: Sequence[str]) -> list[str]:
    """Labels, repeated ones numbered: "thermal lag (2)"."""
    counts = [labels[: i + 1].count(label) for i, label in enumerate(labels)]
    return [label if count == 1 else f"{label} ({count})" for label, count in zip(labels, counts, strict=True)]


@dataclass(frozen=True, kw_only=True)
class Grounds:
    """Findings of a diagnosis on which its verdict depends."""

    named: bool
    """True if there is a cause."""
    ambiguous: bool
    """True if the first cause has rivals that the record cannot tell it apart from."""
    structure: bool
    """True if what is left is more than noise: it wanders, or an effect is proven and not confirmed."""
    spoiled: bool
    """True if invalid readings were used in the fit."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One verdict. A new one stands in this file alone."""

    word: str
    """As `Diagnosis.verdict` has it."""
    sentence: str
    given: Callable[[Grounds], bool]
    """True if it is given, where none before it in `VERDICTS` is."""
    calm: bool = False
    """True if nothing is advised, no place shown, and readings may be signed."""
    in_doubt: bool = False
    """True if further quantities would help to tell the cause."""
    unknown: bool = False
    """True if nobody is named although structure is left."""


AMBIGUOUS = Verdict(
    word="ambiguous",
    sentence="Something is missing, and this record cannot tell two explanations apart.",
    given=lambda grounds: grounds.named and grounds.ambiguous,
    in_doubt=True,
)
MISSING = Verdict(
    word="missing", sentence="Something is missing, and this record can tell what.", given=lambda grounds: grounds.named
)
UNEXPLAINED = Verdict(
    word="unexplained",
    sentence="Structure is left in the residual that no confirmed effect explains.",
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
