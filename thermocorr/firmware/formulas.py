"""Formulas of a program as data, in no language: each language prints the kinds that stand here in its own way.

Arithmetic makes them: ``share * (earlier - later)``. What is computed first although it binds less tightly comes into
brackets by itself, so that a printer only writes down what it is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

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
    """Whether one of these flags of the result is raised, a condition."""

    flags: tuple[str, ...]


TURN = Variable("j")
"""Where a loop stands, from 0."""


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
