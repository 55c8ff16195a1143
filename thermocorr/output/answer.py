"""The answer to a record: correction, worth, what is missing."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..model.advice import REFINED, SIMPLER, Advice, advise_refined
from ..model.tables import VERDICTS
from ..model.variants import VariantComparison
from ..records.errors import printable
from ..records.numbers import Scale, scale_of, unit_text
from .words import (
    better_text,
    decide_sentence,
    effect_text,
    further_text,
    left_sentences,
    page_width,
    probability_text,
    small_sentence,
    wrapped,
)

LINES = 16
"""Lines of a printed answer, at most."""
GAP = "   "
"""Between columns of a table."""
CAUSES = 5
"""Causes that are printed at most."""


class Missing(NamedTuple):
    """An effect that is, or was, missing in a model."""

    suspect: Any
    """As `Diagnosis.causes` has it."""
    state: str
    """ "missing"; "added", or "not confirmed", by a refinement."""

    @property
    def title(self) -> str:
        """The effect in words."""
        return str(printable(self.suspect.title or self.suspect.effect.title()))

    def to_dict(self) -> dict[str, Any]:
        """It as JSON has it."""
        effect, each = self.suspect.effect, self.suspect.each
        return {
            "effect": self.title,
            "kind": effect.kind,
            "column": next(iter(effect.inputs()), None),
            "before": _or_null(self.suspect.before),
            "after": _or_null(self.suspect.after),
            "better_stretches": sum(fall > 0 for fall in each),
            "stretches": len(each),
            "p_value": self.suspect.p_value,
            "confusable_with": [str(printable(other.title())) for other in self.suspect.confusable_with],
            "to_confirm": "" if effect.info is None else effect.info.bench_check,
            "state": self.state,
        }


def _or_null(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Answer on a record, in at most 16 lines."""

    diagnosis: Any = None
    """Diagnosis of the model; a refinement has its own."""
    refinement: Any = None
    comparison: VariantComparison | None = None
    advice: Advice | None = None
    """Which correction to use; by default that of the comparison."""
    asked: str = ""
    """Variant that the user asked for, whatever is advised."""
    begun: str = ""
    """Variant that a refinement began with; by default that of the comparison."""
    steps: Any = None
    """Errors of the steps of a user, as `Story.errors` has them."""
    unjudged: str = ""
    """Why there is no diagnosis."""
    source: str = ""
    """File that the data came from."""
    command: str = ""
    """The command that asked."""
    notes: tuple[str, ...] = ()
    """How the data were understood, and what is odd about them."""
    files: tuple[str, ...] = ()
    """Files that were written."""

    @classmethod
    def of(cls, X: Any, y: Any, **known: Any) -> Answer:
        """The answer, the refined model among the corrections."""
        answer = cls(**known)
        comparison, refined, advice = answer.comparison, answer.refinement, answer.advised
        if comparison is None or advice is None:
            return answer
        if answer.asked:
            advice = advice.using(answer.asked, comparison.models)
        if refined is not None and further_text(refined):
            advice = advise_refined(advice, comparison.models, refined.model_, refined.moment, X, y)
        notes = (*answer.notes, *filter(None, [advice.unproven]))
        return replace(answer, advice=advice, notes=notes)

    @property
    def advised(self) -> Advice | None:
        """Advised correction."""
        return self.advice if self.advice is not None or self.comparison is None else self.comparison.advice

    @property
    def last(self) -> Any:
        """Diagnosis of the model that is kept."""
        if self.refinement is None:
            return self.diagnosis
        return self.refinement.diagnoses[-1 if self.refined else 0]

    @property
    def refined(self) -> bool:
        """True if the refined model is the one to use."""
        if self.refinement is None or not further_text(self.refinement):
            return False
        return self.advised is None or self.advised.choice == REFINED

    @property
    def choice(self) -> str:
        """none, static, dynamic or refined; "" for unknown."""
        if self.advised is None:
            return REFINED if self.refined else ""
        return self.advised.choice

    @property
    def model(self) -> str:
        """The correction to use, in words; "" for none."""
        if not self.refined or self.refinement is None:
            return "" if self.advised is None else self.advised.variant
        begun = self.asked or self.begun or ("" if self.comparison is None else self.comparison.begun)
        if any(suspect.effect.memory() > 0 for some in self.refinement.added for suspect in some):
            begun = begun.removeprefix("static ")  # with a lag it is static no more
        return f"{begun} with {further_text(self.refinement)}".strip()

    @property
    def causes(self) -> tuple[Missing, ...]:
        """Missing effects, added ones first."""
        if self.refinement is None:
            return () if self.diagnosis is None else tuple(Missing(s, "missing") for s in self.diagnosis.causes)
        later = self.refinement.steps["later_rms"]
        tried = [
            replace(suspect, before=float(later.iloc[k]), after=float(later.iloc[k + 1]))
            for k, some in enumerate(self.refinement.added)
            for suspect in some
        ]
        if not self.refined:
            return tuple(Missing(s, "not confirmed") for s in tried or self.refinement.diagnoses[0].causes)
        state = "missing" if self.refinement.untried else "not confirmed"
        rest = (Missing(suspect, state) for suspect in self.refinement.diagnoses[-1].causes)
        return (*(Missing(suspect, "added") for suspect in tried), *rest)

    @property
    def left(self) -> list[str]:
        """Sentences on the residual and the detection limits."""
        found = self.last
        return [self.unjudged] if found is None else left_sentences(found.left, self.scale(), found.verdict)

    def scale(self) -> Scale:
        """The unit of every error in the answer."""
        sizes = [size for cause in self.causes for size in (cause.suspect.before, cause.suspect.after)]
        unit = "" if self.last is None else self.last.unit
        if self.advised is not None:
            unit = self.advised.unit
            sizes += [] if self.advised.table.empty else self.advised.table["all"].tolist()
        elif self.last is not None:
            sizes += [self.last.residual_rms, self.last.noise_floor]
        return scale_of(sizes, str(printable(unit)))

    def to_dict(self) -> dict[str, Any]:
        """Answer as JSON, errors in the reading's unit."""
        advice, found = self.advised, self.last
        error: dict[str, Any] = {"before": None, "after": None, "longest": None, "after_range": None}
        errors: dict[Any, float] = {}
        if advice is not None and not advice.table.empty:
            error = {"before": advice.before, "after": advice.after, "longest": _or_null(advice.longest)}
            error["after_range"] = list(advice.range) if np.isfinite(advice.range[0]) else None
            errors = advice.table["all"].to_dict()
        return {
            "choice": self.choice or None,
            "model": self.model,
            "error": {**error, "unit": "" if advice is None else advice.unit},
            "errors": errors,
            "verdict": None if found is None else found.verdict,
            "causes": [cause.to_dict() for cause in self.causes],
            "proposal": None if found is None or found.proposal is None else found.proposal.to_dict(),
            "small": 0 if found is None else len(found.small),
            "left": self.left,
            "notes": list(self.notes),
            "files": list(self.files),
        }

    def sentence(self) -> str:
        """Sentence on which correction to use, and its error."""
        advice, scale = self.advised, self.scale()
        if advice is None:
            return f"The refined model has {self.model.removeprefix('with ')}." if self.refined else ""
        if not advice.variant or advice.table.empty:
            return advice.sentence(scale)
        said = "You asked for the" if self.asked and not self.refined else "Use the"
        said += f" refined correction, {self.model}" if self.refined else f" {self.model} correction"
        return f"{said}: it leaves {advice.promise(scale)}; no correction leaves {scale.text(advice.before, 2)}."

    def __str__(self) -> str:
        return "\n".join(str(printable(line)) for line in self.lines())

    def lines(self) -> list[str]:
        """The printed answer, shortened to its room."""
        parts = [
            (0, _wrapped(self.sentence())),
            (0, self._bars()),
            (0, self._causes()),
            (3, _wrapped("" if self.last is None else small_sentence(self.last))),
            (1, _wrapped(self._verdict(), 3)),
            (2, _wrapped(self._after(), 3)),
        ]
        end = _wrapped(self._written(), 3)
        room = LINES - len(end) - 2 * bool(self.notes)
        for least in (3, 2, 1):
            if sum(len(lines) for _, lines in parts) > room:
                parts = [(rank, lines) for rank, lines in parts if rank != least]
        found = [line for _, lines in parts for line in lines]
        return [*found, *self._noted(LINES - len(found) - len(end)), *end]

    def _written(self) -> str:
        """The files, each folder once."""
        names: dict[str, list[str]] = {}
        for path in map(Path, self.files):
            names.setdefault(str(path.parent), []).append(path.name)
        said = [", ".join(some) + ("" if folder == "." else f" in {folder}") for folder, some in names.items()]
        return f"Written: {'; '.join(said)}" if said else ""

    def _noted(self, room: int) -> list[str]:
        """As many of the notes as there is room for."""
        lines: list[str] = []
        for number, note in enumerate(self.notes):
            more = _wrapped(note if note.startswith("Read as: ") else f"Data: {note}", 3)
            if len(lines) + len(more) + (number < len(self.notes) - 1) > room:
                return [*lines, f"{len(self.notes) - number} more on the data: --json"]
            lines += more
        return lines

    def errors(self) -> dict[str, float]:
        """Error on later data of each kind of correction."""
        advice = self.advised
        if advice is None or advice.table.empty:
            return {}
        known = advice.table["all"]
        compared = self.comparison is not None and self.comparison.models[self.comparison.begun].reference is not None
        none = "offset alone" if compared else "no correction"
        shown = {none: advice.before}
        for kind in ("static", "dynamic"):
            of_kind = known[[str(name).startswith(kind) for name in known.index]]
            if len(of_kind):
                best = advice.variant if advice.variant in of_kind.index else str(of_kind.idxmin())
                shown[best] = float(of_kind[best])
        if REFINED in known.index:
            shown[REFINED] = float(known[REFINED])
        return shown

    def _bars(self) -> list[str]:
        """The errors as a table."""
        advice, scale, shown = self.advised, self.scale(), self.errors()
        if advice is None or not shown:
            return []
        head = f"rms on later data{f' [{unit_text(scale.unit)}]' if scale.unit else ''}"
        chosen = advice.variant or next(iter(shown))
        names = [f"{name} *" if name == chosen else name for name in shown]
        mark = "* is advised"
        if self.asked and not self.refined:
            mark = "* is asked for"
        elif advice.variant and shown[chosen] > min(shown.values()):
            mark = f"* is the simplest within {SIMPLER:g} dB"
        return _columns([[head, *names], [mark, *(scale.number(v) for v in shown.values())]])

    def _causes(self) -> list[str]:
        causes, scale = self.causes, self.scale()
        if not causes:
            return []
        rows = [["Effect", "before", "after", "better in", "p-value", ""]]
        for cause in causes[:CAUSES]:
            suspect = cause.suspect
            rows.append(
                [
                    cause.title,
                    *(scale.number(size) for size in (suspect.before, suspect.after)),
                    better_text(suspect),
                    probability_text(suspect.p_value),
                    f"{cause.state}, not proven" if suspect.standing == "helps" else cause.state,
                ]
            )
        more = len(causes) - CAUSES
        return [*_columns(rows), *([f"and {more} more: --json"] if more > 0 else [])]

    def _verdict(self) -> str:
        """The verdict on the kept model, and the rest."""
        found = self.last
        if found is None:
            return self.unjudged
        of = "Verdict on the refined model" if self.refined else "Verdict"
        likely = [effect for cause in found.causes[:1] for effect in (cause.effect, *cause.confusable_with)]
        rivals = list(dict.fromkeys(map(effect_text, likely)))
        tied = f" ({' or '.join(rivals[:3])})" if len(rivals) > 1 else ""
        return f"{of}: {found.verdict}{tied}. {self.left[0]}"

    def _after(self) -> str:
        """Advice on the next step."""
        found = self.last
        if found is None:
            return ""
        if said := decide_sentence(found):
            return said
        begin = next((cause for cause in self.causes if cause.state == "missing"), None)
        if begin is not None:
            add = "--refine adds what is missing to the model, and measures whether the error falls."
            return f"Next: {add}{self._check(begin.suspect)}"
        if self.causes:
            return self._check(self.causes[0].suspect).strip()
        if VERDICTS[found.verdict].unknown:
            more = self.left[1] if len(self.left) > 1 else ""
            return more or "Next: record longer, or more of what may act on the instrument."
        return ""

    @staticmethod
    def _check(suspect: Any) -> str:
        info = suspect.effect.info
        return "" if info is None else f" To confirm {effect_text(suspect.effect)}: {info.bench_check}"


def _wrapped(text: str, most: int = 4) -> list[str]:
    """Lines of a text, a few of them."""
    text = str(printable(text))
    return textwrap.wrap(text, page_width(), max_lines=most, placeholder=" ...", subsequent_indent="  ") if text else []


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """A table: names left, the rest right."""
    widths = [max(len(row[k]) for row in rows) for k in range(1, len(rows[0]))]
    room = page_width() - sum(widths) - len(GAP) * len(widths)
    names = [wrapped(row[0], max(room, 20)).split("\n") for row in rows]
    longest = max(len(line) for name in names for line in name)
    cells = [[cell.rjust(width) for cell, width in zip(row[1:], widths, strict=True)] for row in rows]
    lines = []
    for name, row in zip(names, cells, strict=True):
        lines += [GAP.join([name[0].ljust(longest), *row]).rstrip(), *(f"  {more}" for more in name[1:])]
    return lines
