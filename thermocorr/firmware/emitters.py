"""Which effect is written by what: one small emitter for each class of effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..effects import CATALOGUE, Effect
from .counter import Clock
from .lagbank import LagBank
from .program import Numbers, Program

Finish = Callable[[], None]


@dataclass
class Part:
    """An effect of a model, as its emitter sees it."""

    effect: Any
    """Learned effect."""
    coefficients: Numbers
    """One for each of its columns."""
    state: Any
    """What it ended the fit with, for a program that continues it; else None."""
    program: Program
    lags: LagBank
    clock: Clock
    number: int
    """For names of its own."""
    unit: str
    """Unit of the reading."""

    @property
    def continues(self) -> bool:
        """Whether the program goes on where the fit ended."""
        return self.program.target.continues

    def name(self, text: str) -> str:
        """A name of this effect's own."""
        return f"{text}_{self.number}"

    def per(self, unit: str) -> str:
        """Unit of a coefficient."""
        return f"{self.unit or 'unit of the reading'}/{unit}" if unit else self.unit or "unit of the reading"


Emitter = Callable[[Part], Finish | None]
"""Asks for lags, inputs and time; what it returns runs once all lags have their places."""

EMITTERS: dict[type[Effect], Emitter] = {}


def emits(*classes: type[Effect]) -> Callable[[Emitter], Emitter]:
    """Register the emitter of some classes; a subclass may compute something else and is not among them."""

    def register(emitter: Emitter) -> Emitter:
        for one in classes:
            EMITTERS[one] = emitter
        return emitter

    return register


def refuse(effects: Sequence[Effect]) -> None:
    """Raise ValueError that names the first effect that cannot be written in C."""
    for effect in effects:
        if type(effect) not in EMITTERS:
            raise ValueError(
                f"The effect {effect.label()!r} ({type(effect).__name__}) cannot be exported to C: its columns are "
                f"Python code that the export does not know. It knows {', '.join(CATALOGUE)}. Leave the effect out "
                "and fit again, or correct with the model itself."
            )
