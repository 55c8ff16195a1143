"""Formulas and statements of a program, and what they cost.

Arithmetic makes them: ``share * (earlier - later)``. What is computed first although it binds less tightly comes into
brackets by itself, so that a printer only writes down what it is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Literal, NamedTuple


@dataclass(frozen=True)
class Operations:
    """Floating-point operations of some code."""

    multiply_adds: int = 0
    """Multiplications, each with the addition that takes its product, if there is one in its statement."""
    adds: int = 0
    """Further additions and subtractions."""
    divisions: int = 0
    calls: int = 0
    """Calls of libm: exp, sin, ..."""

    def __add__(self, other: Operations) -> Operations:
        return Operations(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __mul__(self, times: int) -> Operations:
        return Operations(*(times * getattr(self, f.name) for f in fields(self)))

    @classmethod
    def of(cls, products: int = 0, sums: int = 0, divisions: int = 0, calls: int = 0) -> Operations:
        """Operations of one statement: each product takes an addition with it, as long as there are any."""
        return cls(products, max(0, sums - products), divisions, calls)


NOTHING = Operations()


class Costed(NamedTuple):
    """A formula, and what it costs in one update."""

    value: Formula
    operations: Operations = NOTHING


Kind = Literal["number", "int32", "uint32", "int64", "uint64", "truth"]
"""Kinds of values: floating-point numbers of the target's precision, whole numbers by their bits, 0 or 1."""
_BINDING = {"or": 0, "<": 1, "<=": 1, ">": 1, ">=": 1, "==": 1, "!=": 1, ">>": 2, "+": 3, "-": 3, "*": 4, "/": 4}
_BINDING["%"] = _BINDING["*"]
"""How tightly operators bind, in every language of interest."""


def _operator(sign: str) -> Callable[[Formula, Formula], Binary]:
    """The method of a formula for an operator."""
    return lambda left, right: binary(left, sign, right)


class Formula:
    """A value that the code computes or is given; as text it is what comments call it."""

    __add__, __sub__, __mul__, __truediv__, __mod__ = map(_operator, ("+", "-", "*", "/", "%"))
    __lt__, __gt__ = map(_operator, ("<", ">"))

    def __str__(self) -> str:
        return "a value"

    def __neg__(self) -> Unary:
        return Unary("-", _inside(self, _BINDING["*"]))

    def __getitem__(self, index: Formula) -> Item:
        return Item(self, index)


@dataclass(frozen=True)
class Number(Formula):
    """A literal of the target's precision."""

    value: float


@dataclass(frozen=True)
class Whole(Formula):
    """A whole number as a literal; `kind` where its bits matter."""

    value: int
    kind: Kind | None = None

    def __str__(self) -> str:
        return str(self.value)


@dataclass(frozen=True)
class Largest(Formula):
    """The largest value of a kind."""

    kind: Kind


@dataclass(frozen=True)
class Variable(Formula):
    """A local variable, an argument, or a constant or table of the program."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Output(Formula):
    """The second result of a helper, inside it."""

    name: str


@dataclass(frozen=True)
class Kept(Formula):
    """A member of the state, kept from sample to sample."""

    name: str

    def __str__(self) -> str:
        return f"s.{self.name}"


@dataclass(frozen=True)
class Item(Formula):
    """An element of an array."""

    array: Formula
    index: Formula

    def __str__(self) -> str:
        return f"{self.array}[{self.index}]"


@dataclass(frozen=True)
class Bracketed(Formula):
    """A value in brackets."""

    value: Formula


@dataclass(frozen=True)
class Unary(Formula):
    """A value behind ``-`` or ``not``."""

    sign: Literal["-", "not"]
    value: Formula


@dataclass(frozen=True)
class Binary(Formula):
    """Two values with an operator between them: arithmetic, a comparison, ``or``, ``>>`` (of bits)."""

    left: Formula
    sign: str
    right: Formula


@dataclass(frozen=True)
class Choice(Formula):
    """One value where a condition holds, else another."""

    condition: Formula
    one: Formula
    other: Formula


@dataclass(frozen=True)
class Call(Formula):
    """An elementary function (exp, expm1, log1p, sin, cos), or ``is_within(value, limit)``, a condition."""

    function: str
    arguments: tuple[Formula, ...]


@dataclass(frozen=True)
class Converted(Formula):
    """A value as another kind; whole numbers without sign wrap at their bits."""

    kind: Kind
    value: Formula


@dataclass(frozen=True)
class Raised(Formula):
    """True if one of these flags of the result is raised, a condition."""

    flags: tuple[str, ...]


TURN = Variable("j")
"""Where a loop stands, from 0."""


@dataclass(frozen=True)
class Bias(Formula):
    """The bias of a named outcome."""

    outcome: str


def behind(index: Formula, places: int) -> Formula:
    """The index so many places behind another."""
    if isinstance(index, Whole):
        return Whole(index.value + places)
    return index + Whole(places) if places else index


def binary(left: Formula, sign: str, right: Formula) -> Binary:
    """Two values with an operator between them, in brackets where they need them."""
    return Binary(_inside(left, _BINDING[sign]), sign, _inside(right, _BINDING[sign] + 1))


def _inside(value: Formula, binding: int) -> Formula:
    loose = isinstance(value, Choice) or (isinstance(value, Binary) and _BINDING[value.sign] < binding)
    return Bracketed(value) if loose else value


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


@dataclass(frozen=True)
class Follow(Statement):
    """Go on by one sample with one of the two courses, `now` or `twin`; its outcome has a name."""

    outcome: str
    course: str
    inputs: str
    """Array of the temperature and the columns."""


@dataclass(frozen=True)
class Fork(Statement):
    """Let the twin be where the course is now."""


@dataclass(frozen=True)
class Finish(Statement):
    """Give the outcome called ``result`` back, with the flags that were raised."""


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
        """Add a loop of some turns, of which each costs so much; one turn stands alone."""
        body = turn(TURN if times > 1 else Whole(0))
        if times > 1:
            self.add(Loop(times, body), cost=cost * times)
        else:
            self.add(*(body if len(body) == 1 else [Scope(body)]), cost=cost)
