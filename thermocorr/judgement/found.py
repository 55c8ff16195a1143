"""What a diagnosis found, as objects and numbers; sentences are made where they are shown."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from ..effects.protocol import Effect
from ..estimators.tables import VERDICTS
from ..pages import DiagnosisPage, PageData
from ..pictures.words import each_row, effect_text, left_sentences, suspect_sentence, worst_sentence
from ..records.errors import printable
from ..records.numbers import quantity_texts
from .left import Left
from .levels import LEVEL

WIDTH = 110
"""Characters in a line of a printed diagnosis."""
RANKING = ["label", "kind", "column", "parameters", "standing", "gain_db", "later_db", "p_value", "share",
           "confusable_with", "sentence"]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FoundSuspect:
    """An effect under suspicion, and what is held against it."""

    effect: Effect
    """The effect, ready for ``model.with_effect``."""
    standing: str
    """ "proven": the likelihood of the record leaves no doubt; "helps": it lowers the error on data that it was not
    learned from, and its cause is not proven; "": tried, and not named."""
    share: float
    """Share of the structured variance that it explains."""
    gain_db: float
    """Fall of the squared error on blocks of time that it was not learned from [dB]."""
    later_db: float
    """Fall of the squared error on later stretches, learned from earlier ones [dB]."""
    p_value: float
    """Error probability, corrected for the number of candidates tried."""
    confusable_with: tuple[Effect, ...] = ()
    """Effects that this record cannot tell it apart from."""
    in_model: bool = False
    """Whether this record cannot tell it apart from slow lags that the model has: a slow body."""
    when: tuple[tuple[Any, Any], ...] = ()
    """Interval (95 %) of each moment at which a step, another law or a disturbance begins or ends, in order of time:
    dates where the record has dates, else seconds since it began. Empty for other kinds."""
    title: str = ""
    """Name in sentences, where it is more than `Effect.title` can know: dates, units of temperatures."""

    @property
    def label(self) -> str:
        """Kind and column."""
        return effect_text(self.effect)


@dataclass(frozen=True, repr=False, kw_only=True)
class Diagnosis(DiagnosisPage):
    """What `diagnose` found. Prints as a page."""

    verdict: str
    """ "nothing missing", "missing", "ambiguous" or "unexplained"."""
    noise_floor: float
    """Standard deviation of one sample that no effect can explain, in the unit of y."""
    explainable: float
    """Share of the residual variance that something could still explain."""
    where: pd.DataFrame
    """Conditions under which the model fails, worst first, see `thermocorr.judgement.where`."""
    allan: pd.DataFrame
    """Allan deviation of the residual against white noise, see `thermocorr.judgement.where`."""
    suspects: tuple[FoundSuspect, ...]
    """The causes, by what they are worth on later data and by how sure they are; then other suspects, best first."""
    n_causes: int
    left: Left
    """What no cause explains: whether it wanders, for how long it remembers, spikes, and what could have been seen."""
    residual_rms: float
    """Rms residual of the model on these data, in the unit of y."""
    unit: str
    level: float = LEVEL
    """Error probability of the whole family of suspects, below which one is named."""
    gather: Callable[[], PageData] | None = field(default=None, compare=False)
    """Gathers series, formula and coefficients of the model on the record; None in a pickled copy."""

    @property
    def causes(self) -> tuple[FoundSuspect, ...]:
        """What is missing: each proven, or helpful on data that it was not learned from."""
        return self.suspects[: self.n_causes]

    @property
    def best(self) -> Effect | None:
        """The first cause, ready for ``model.with_effect``; None where the verdict names nobody."""
        return self.suspects[0].effect if self.n_causes else None

    @property
    def ranking(self) -> pd.DataFrame:
        """`suspects` as a table: label, kind, column, parameters, standing, gain_db (blocks held out), later_db,
        p_value (of the whole family), share (of the structured variance), confusable_with (labels), sentence.
        """
        rows = [
            {
                "label": effect_text(suspect.effect),
                "kind": suspect.effect.kind,
                "column": next(iter(suspect.effect.inputs()), None),
                "parameters": suspect.effect.get_params(deep=False),
                "standing": suspect.standing,
                "gain_db": suspect.gain_db,
                "later_db": suspect.later_db,
                "p_value": suspect.p_value,
                "share": suspect.share,
                "confusable_with": tuple(effect_text(effect) for effect in suspect.confusable_with),
                "sentence": suspect_sentence(suspect),
            }
            for suspect in self.suspects
        ]
        return pd.DataFrame(rows, columns=RANKING).astype({"column": object})

    @property
    def data(self) -> PageData | None:
        """What a page shows of the model on the record, gathered when it is first asked for; None in a pickled copy."""
        if "_data" not in self.__dict__:
            self.__dict__["_data"] = None if self.gather is None else self.gather()
        data: PageData | None = self.__dict__["_data"]
        return data

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_data"} | {"gather": None}

    def __str__(self) -> str:
        residual, floor = quantity_texts((self.residual_rms, self.noise_floor), self.unit, 4)
        lines = [
            f"Verdict: {self.verdict}",
            f"Residual {residual}, noise floor {floor}: "
            f"{self.explainable:.0%} of the residual variance could still be explained.",
        ]
        if len(self.where) and not VERDICTS[self.verdict].calm:
            lines.append(worst_sentence(next(each_row(self.where))))
        if VERDICTS[self.verdict].unknown:
            lines.append(VERDICTS[self.verdict].sentence)
        said = self.causes or self.suspects[:3]
        word = "Cause" if self.causes else "Suspect"
        lines += [f"{word} {k}, {suspect_sentence(suspect)}" for k, suspect in enumerate(said, 1)]
        lines += left_sentences(self.left, self.unit, self.verdict)
        if self.best is not None and self.best.info is not None:
            lines.append(f"To confirm the first on the bench: {self.best.info.bench_check}")
            lines.append("To add it: better = model.with_effect(diagnosis.best).fit(X, y), or refine(model, X, y).")
        return "\n".join(textwrap.fill(printable(line), WIDTH, subsequent_indent="    ") for line in lines)

    __repr__ = __str__

    def plot(self, X: Any = None) -> Any:
        """Draw the suspects, and where the model fails; returns the figure (extra "plot").

        `X`, the record, tells the units of its columns.
        """
        from ..pictures import plot_diagnosis

        return plot_diagnosis(self, X)
