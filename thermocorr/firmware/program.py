"""The parts of a C program while effects write them: constants, state, and lines of the two functions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..effects.thermal import column_text
from .language import Operations, count_operations, identifier
from .target import Target

Numbers = Sequence[float] | NDArray[np.float64]
Section = Literal["init", "begin", "advance", "output", "store", "close"]
RESERVED = frozenset(
    """
    s temperature reading columns column bias corrected change deviation result flags first step step_us started seconds
    j increment next gain loss decay
    """.split()  # noqa: SIM905
)
"""Names that the frame of `update` uses itself."""
BYTES = {"float": 4, "double": 8, "uint32_t": 4, "int32_t": 4, "uint64_t": 8, "int64_t": 8}


class Constant(NamedTuple):
    """A named constant or table of the type of the target."""

    name: str
    values: tuple[float, ...]
    comment: str
    table: bool


class Member(NamedTuple):
    """A member of the state."""

    ctype: str
    name: str
    length: int | None
    comment: str

    @property
    def size(self) -> int:
        """Bytes."""
        return BYTES[self.ctype] * (self.length or 1)


class Line(NamedTuple):
    """A line of C; `operations` is what it costs in one update."""

    text: str
    operations: Operations


@dataclass(frozen=True)
class Input:
    """A recorded column as the code sees it: C expressions, and the value from which `centred` counts."""

    value: str
    centred: str
    previous: str
    reference: float
    said: str
    """Name, for comments."""


@dataclass
class Program:
    """Collects what the effects of a model need. Sections of `update` run in the order of `Section`.

    ``begin`` runs for the first usable sample, ``advance`` for every other; ``output`` adds to `bias`.
    """

    target: Target
    constants: list[Constant] = field(default_factory=list)
    members: list[Member] = field(default_factory=list)
    lines: dict[Section, list[Line]] = field(default_factory=dict)
    locals: list[Line] = field(default_factory=list)
    helpers: dict[str, tuple[str, Operations]] = field(default_factory=dict)
    """Static functions: name -> (text, operations of its dearest way)."""
    bias_constant: float = 0.0
    flags_washout: bool = False
    columns: dict[Any, str] = field(default_factory=dict)
    """Recorded columns in the order of their C array -> identifier."""
    temperature_power: int = 2
    column_power: int = 2
    """Highest powers of inputs, which bound the inputs that cannot overflow."""
    _references: dict[Any, float] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=lambda: set(RESERVED))
    _columns_taken: set[str] = field(default_factory=lambda: {"s"})

    def constant(self, name: str, values: float | Numbers, comment: str) -> str:
        """Declare a constant (a number) or a table (a sequence); returns its name."""
        table = not isinstance(values, float | int)
        taken = (float(values),) if isinstance(values, float | int) else tuple(float(v) for v in values)
        name = identifier(name, self._taken)
        self.constants.append(Constant(name, taken, comment, table))
        return name

    def shared(self, name: str, value: float, comment: str) -> str:
        """A constant that several effects need: declared by whoever asks first."""
        for constant in self.constants:
            if constant.values == (float(value),) and constant.comment == comment and not constant.table:
                return constant.name
        return self.constant(name, value, comment)

    def member(self, name: str, comment: str, length: int | None = None, ctype: str | None = None) -> str:
        """Declare a member of the state; returns the expression for it."""
        name = identifier(name, self._taken)
        self.members.append(Member(ctype or self.target.dtype, name, length, comment))
        return f"s->{name}"

    def local(self, name: str, expression: str) -> str:
        """A value that several lines use: computed once, whoever asks first."""
        text = f"const {self.target.dtype} {name} = {expression};"
        if not any(line.text == text for line in self.locals):
            self.locals.append(Line(text, count_operations(text)))
        return name

    def add(self, section: Section, *statements: str, times: int = 1, counted: bool = True) -> None:
        """Add lines, as a loop over j where `times` says so. Integer lines pass ``counted=False``."""
        lines = self.lines.setdefault(section, [])
        if times == 1:
            statements = tuple(re.sub(r"\[j(?: \+ )?(\d*)\]", _place, statement) for statement in statements)
        else:
            lines.append(Line(f"for (int j = 0; j < {times}; ++j) {{", Operations()))
        indent = "" if times == 1 else "    "
        for statement in statements:
            cost = count_operations(statement) if counted else Operations()
            for name, (_, inside) in self.helpers.items():
                cost = cost + inside if f"{name}(" in statement else cost
            lines.append(Line(indent + statement, cost * times))
        if times != 1:
            lines.append(Line("}", Operations()))

    def texts(self, section: Section) -> list[str]:
        """Lines of a section."""
        return [line.text for line in self.lines.get(section, [])]

    def all_texts(self) -> list[str]:
        """Every line of `update`."""
        return [line.text for lines in (self.locals, *self.lines.values()) for line in lines]

    def weigh(self, name: str, weights: Numbers, columns: Sequence[str], unit: str) -> None:
        """Add ``weight * column`` to the bias for each; columns that follow one another in an array share a loop."""
        at = 0
        while at < len(columns):
            array, index = _element(columns[at])
            run = 1
            while array and at + run < len(columns) and _element(columns[at + run]) == (array, (index or 0) + run):
                run += 1
            if array and run > 1:
                table = self.constant(name, list(weights[at : at + run]), unit)
                where = "j" if not index else f"j + {index}"
                self.add("output", f"bias += {table}[j] * {array}[{where}];", times=run)
            else:
                constant = self.constant(name, float(weights[at]), unit)
                self.add("output", f"bias += {constant} * {columns[at]};")
            at += run

    # What effects read: the temperature and recorded columns, counted from a value nearby so that no digit is lost.

    def temperature(self) -> Input:
        """The temperature."""
        return Input("temperature", "deviation", "s->temperature", self.target.reference_temperature, "temperature")

    def deviation(self) -> str:
        """Temperature less `Target.reference_temperature` [K]."""
        near = self.shared("near_t0", self.target.reference_temperature, "unit of the temperature, near T0")
        return self.local("deviation", f"temperature - {near}")

    def column(self, name: Any, near: float = 0.0) -> Input:
        """A recorded column; `near` is a usual value of it."""
        if name == self.target.temperature_name:
            return self.temperature()
        if name not in self.columns:
            self.columns[name] = identifier(name, self._columns_taken, "column")
            self._references[name] = self.target.held(near)
        number = list(self.columns).index(name)
        index, said = f"[{number}]", column_text(name)
        return Input(f"column{index}", f"centred_{number}", f"s->column{index}", self._references[name], said)

    def centred(self, given: Input) -> str:
        """The local variable that holds an input less its reference."""
        if given.value == "temperature":
            return self.deviation()
        near = self.shared(f"near_{given.centred}", given.reference, f"a usual value of {given.said}")
        return self.local(given.centred, f"{given.value} - {near}")


def _place(index: re.Match[str]) -> str:
    return f"[{index[1] or 0}]"


def _element(expression: str) -> tuple[str | None, int | None]:
    """Array and index of ``s->lag[3]``; None for anything else."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", expression)
    return (match[1], int(match[2])) if match else (None, None)
