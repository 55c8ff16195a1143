"""A diagnosis as sections of a page, in the order of the user's questions; sentences first, then figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup

from ..effects.protocol import SINCE_START, TEMPERATURE, TEMPERATURE_DIFFERENCE
from ..estimators.verdicts import VERDICTS
from ..pictures.protocols import DiagnosisLike, RefinementLike
from ..pictures.words import each_row, effect_text, further_text, left_sentences
from ..records.quantities import scale_of, span_text
from ..records.units import difference_unit
from .data import PageData
from .figures import placed
from .html import Section, plain, section, unit_text, with_signs

SHOWN_PLACES = 8
"""Places of failure in the first table; the rest is folded."""

HELPS = "One effect lowers the error on data that it was not learned from; that it is the cause is not proven."


def judged(
    found: DiagnosisLike, data: PageData, noise: Markup, time: Markup, refined: RefinementLike | None = None
) -> list[Section]:
    """The four questions; `noise` and `time` are figures for the first two, `refined` what was made of the answers."""
    since = Since.of(refined)
    return [anything(found, noise, since), places(found, data, time), suspects(found, data), cure(found, since)]


class Since(NamedTuple):
    """What became of the model that the four questions are asked of."""

    has: str = ""
    """Effects of the model to use from here; empty where it is still the same."""
    verdict: str = ""
    """What is said of that one."""
    calm: bool = True
    """Whether nothing is missing there."""

    @classmethod
    def of(cls, refined: RefinementLike | None) -> Since:
        """What a refinement did."""
        if refined is None:
            return cls()
        verdict = refined.diagnoses[-1].verdict
        return cls(further_text(refined), verdict, VERDICTS[verdict].calm)


def anything(found: DiagnosisLike, figures: Markup, since: Since) -> Section:
    """1: residual against noise floor."""
    named = "" if found.best is None else effect_text(found.best)
    helps = bool(named) and found.suspects[0].standing == "helps"
    return section(
        "anything",
        "1 Is anything missing?",
        found=found,
        since=since,
        named=named,
        calm=VERDICTS[found.verdict].calm,
        said=HELPS if helps else VERDICTS[found.verdict].sentence,
        left=with_signs(" ".join(left_sentences(found.left, found.unit, found.verdict))),
        scale=scale_of((found.residual_rms, found.noise_floor), found.unit),
        largest=max(found.residual_rms, found.noise_floor) or 1.0,
        figures=figures,
    )


class WherePlace(NamedTuple):
    """A row of `Diagnosis.where` with what its bar and its button need."""

    row: Any
    scale: float
    """Share of the error that fills the bar."""
    stretch: tuple[float, float] | None
    """Where it stands on the axis of time; None for what is no single stretch of it."""


def places(found: DiagnosisLike, data: PageData, figures: Markup) -> Section:
    """2: where the model fails; the worst place and the worst band of frequencies in words."""
    where, calm = found.where, VERDICTS[found.verdict].calm
    shown = 0 if calm else SHOWN_PLACES
    bands = where[where["aspect"] == "frequency"]
    longest = float(max(where["share"].drop(bands.index).max(), 1e-300)) if len(where) else 1.0
    rows = [
        WherePlace(
            row,
            1.0 if row.aspect == "frequency" else longest,
            placed(data, row.low, row.high) if row.aspect == "time" else None,
        )
        for row in each_row(where)
    ]
    return section(
        "where",
        "2 Where does it fail?",
        worst=rows[0].row if rows else None,
        band=bands.nlargest(1, "share").iloc[0] if len(bands) else None,
        calm=calm,
        shown=rows[:shown],
        folded=rows[shown:],
        scale=scale_of(where["rms"], found.unit),
        figures=figures,
    )


def suspects(found: DiagnosisLike, data: PageData) -> Section:
    """3: the causes, what lowers the error on later data most first, and the other suspects as they are ranked."""
    causes = [suspect for suspect in found.suspects if suspect.standing]
    causes.sort(key=lambda cause: -np.nan_to_num(cause.later_db, nan=-np.inf))
    ranked = [*causes, *(suspect for suspect in found.suspects if not suspect.standing)]
    return section(
        "what",
        "3 What is missing?",
        suspects=[(suspect, parameters_text(suspect.effect, data)) for suspect in ranked],
        physics=by_kind([suspect.effect for suspect in (causes or ranked)[:3]]),
        calm=VERDICTS[found.verdict].calm,
        unexplained=VERDICTS[found.verdict].unknown,
        level=f"{found.level:g}",
    )


def cure(found: DiagnosisLike, since: Since) -> Section:
    """4: the effect ready to be added, and the measurement that would confirm it or part rivals."""
    rivals = () if found.best is None else (found.best, *(found.suspects[0].confusable_with if found.suspects else ()))
    return section(
        "cure",
        "4 What to do?",
        since=since,
        code="" if found.best is None else repr(found.best),
        checks=by_kind(rivals),
        calm=VERDICTS[found.verdict].calm,
    )


class Scales(NamedTuple):
    """What parameters of effects are said on."""

    start: float | None
    """Seconds since 1970 of the first row; None for a record without dates."""
    temperature_unit: str


def parameters_text(effect: Any, data: PageData | Scales, said: Callable[[str], str] = unit_text) -> str:
    """Parameters that have a unit, in words; moments of a record with dates as dates. `said` writes a unit."""
    parts = []
    for name, unit in (effect.info.parameters if effect.info is not None else {}).items():
        value = getattr(effect, name)
        several = value if isinstance(value, list | tuple | np.ndarray) else [value]
        try:
            numbers = [float(item) for item in several]
        except (TypeError, ValueError):
            continue
        if not numbers:
            continue
        if unit == SINCE_START and data.start is not None:
            shown = [str(pd.Timestamp(data.start + number, unit="s").round("s")) for number in numbers]
        elif unit in ("s", SINCE_START):
            shown = [span_text(number) for number in numbers]
        else:
            degrees = {
                TEMPERATURE: data.temperature_unit,
                TEMPERATURE_DIFFERENCE: difference_unit(data.temperature_unit),
            }
            unit = said(degrees.get(unit, unit))
            shown = [f"{plain(v, 3)} {unit}" for v in numbers]
        parts.append(f"{name.replace('_', ' ').removesuffix('s' if len(several) == 1 else '')} {', '.join(shown)}")
    return "; ".join(parts)


def by_kind(effects: Sequence[Any]) -> list[Any]:
    """The first effect of each kind that says what it is."""
    said: dict[str, Any] = {}
    for effect in effects:
        if effect.info is not None:
            said.setdefault(effect.kind, effect)
    return list(said.values())
