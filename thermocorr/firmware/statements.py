"""Statements of a program as data, in no language, and sequences of them with what they cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from .formulas import TURN, Formula, Kind, Whole
from .operations import NOTHING, Operations


class Statement:
    """One thing that a program does."""


@dataclass(frozen=True)
class Local(Statement):
    """A local variable that keeps its value."""

    name: str
    value: Formula
    kind: Kind = "number"
    note: str = ""
    """Comment on the line."""


@dataclass(frozen=True)
class Declare(Statement):
    """A number or an array of numbers without a value as yet."""

    name: str
    length: int | None = None


@dataclass(frozen=True)
class Assign(Statement):
    """``place = value``; with a sign, what is added to or taken from it."""

    place: Formula
    value: Formula
    sign: str = ""
    note: str = ""


@dataclass(frozen=True)
class If(Statement):
    """Statements for a condition, and others (or another condition) for the rest."""

    condition: Formula
    then: Sequence[Statement]
    otherwise: If | Sequence[Statement] = ()
    note: str = ""


@dataclass(frozen=True)
class Loop(Statement):
    """Statements for each turn ``j`` from 0."""

    times: int
    body: Sequence[Statement]


@dataclass(frozen=True)
class Scope(Statement):
    """Statements with local variables of their own."""

    body: Sequence[Statement]


@dataclass(frozen=True)
class Raise(Statement):
    """Raise a flag of the result, unless another one is raised."""

    flag: str
    unless: str = ""


@dataclass(frozen=True)
class Answer(Statement):
    """Give the result back."""

    bias: Formula
    corrected: Formula


@dataclass(frozen=True)
class Helper:
    """A function of numbers with two results: the variable `gives`, and the output `second`."""

    name: str
    arguments: tuple[str, ...]
    gives: str
    second: str
    body: Sequence[Sequence[Statement]]
    """In sections."""


@dataclass(frozen=True)
class CallHelper(Statement):
    """Declare the results of a helper as local variables; the first only where it is `used`."""

    helper: Helper
    arguments: tuple[Formula, ...]
    used: bool


class Statements:
    """Statements that are run one after the other, and what they cost."""

    def __init__(self) -> None:
        self.steps: list[Statement] = []
        self.cost = NOTHING

    def __iter__(self) -> Iterator[Statement]:
        return iter(self.steps)

    def __bool__(self) -> bool:
        return bool(self.steps)

    def add(self, *statements: Statement, cost: Operations = NOTHING) -> None:
        """Add statements that cost so much together."""
        self.steps += statements
        self.cost += cost

    def add_first(self, statement: Statement, cost: Operations) -> None:
        """Add a statement before all others."""
        self.steps.insert(0, statement)
        self.cost += cost

    def loop(self, times: int, turn: Callable[[Formula], Sequence[Statement]], cost: Operations = NOTHING) -> None:
        """Add a loop of so many turns, of which each costs so much; one turn stands alone."""
        body = turn(TURN if times > 1 else Whole(0))
        if times > 1:
            self.add(Loop(times, body), cost=cost * times)
        else:
            self.add(*(body if len(body) == 1 else [Scope(body)]), cost=cost)
