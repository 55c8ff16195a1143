"""The parts of a C program while effects write them: constants, state, and lines of the two functions."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..effects.thermal import column_text
from .language import Operations, identifier
from .target import Target

Numbers = Sequence[float] | NDArray[np.float64]
Section = Literal["init", "output", "store", "close"]
StageSection = Literal["locals", "begin", "advance"]
NOTHING = Operations()
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


class CLine(NamedTuple):
    """A line of C; `operations` is what it costs in one update."""

    text: str
    operations: Operations


@dataclass(frozen=True)
class Input:
    """An input as the code sees it: C expressions, and the value from which `centred` counts."""

    value: str
    centred: str
    """Local variable: the input less its reference."""
    change: str
    """C expression: change since the sample before."""
    reference: float
    said: str
    """Name, for comments."""
    unit: str


@dataclass
class Program:
    """Collects what the effects of a model need: `update` runs the stages, then the sections in the order of `Section`.

    In a stage ``locals`` are computed, then ``begin`` runs for the first usable sample, ``advance`` for every other.
    ``output`` adds to `bias`.
    """

    target: Target
    constants: list[Constant] = field(default_factory=list)
    members: list[Member] = field(default_factory=list)
    lines: dict[Section, list[CLine]] = field(default_factory=dict)
    stages: list[dict[StageSection, list[CLine]]] = field(default_factory=list)
    """What is computed one after the other: words that follow other words come in a later stage than these."""
    helpers: dict[str, tuple[str, Operations]] = field(default_factory=dict)
    """Static functions: name -> (text, operations of its dearest way)."""
    bias_constant: float = 0.0
    flags_washout: bool = False
    columns: dict[Any, str] = field(default_factory=dict)
    """Recorded columns in the order of their C array -> identifier."""
    highest_power: int = 2
    """Highest power of inputs, which bounds the inputs that cannot overflow."""
    references: dict[Any, float] = field(default_factory=dict)
    """Usual values of the columns."""
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

    def name(self, text: str) -> str:
        """A name of the code's own that nothing else has."""
        return identifier(text, self._taken)

    def local(self, name: str, expression: str, cost: Operations = NOTHING, stage: int = 0, ctype: str = "") -> str:
        """A value that several lines use: computed once, whoever asks first."""
        text = f"const {ctype or self.target.dtype} {name} = {expression};"
        lines = self._stage(stage, "locals")
        if not any(line.text == text for line in lines):
            lines.append(CLine(text, cost))
        return name

    def _stage(self, stage: int, section: StageSection) -> list[CLine]:
        while len(self.stages) <= stage:
            self.stages.append({})
        return self.stages[stage].setdefault(section, [])

    def add(self, section: Section, *statements: str, times: int = 1, cost: Operations = NOTHING) -> None:
        """Add lines, as a loop over j where `times` says so; `cost` is that of one turn."""
        self.lines.setdefault(section, []).extend(_lines(statements, times, cost))

    def add_to_stage(
        self, stage: int, section: StageSection, *statements: str, times: int = 1, cost: Operations = NOTHING
    ) -> None:
        """Lines of a section of a stage."""
        self._stage(stage, section).extend(_lines(statements, times, cost))

    def texts(self, section: Section) -> list[str]:
        """Lines of a section."""
        return [line.text for line in self.lines.get(section, [])]

    def all_lines(self) -> list[CLine]:
        """Every line of `update`."""
        staged = (lines for stage in self.stages for lines in stage.values())
        return [line for lines in (*staged, *self.lines.values()) for line in lines]

    def prune(self) -> None:
        """Leave out local variables and constants that no line reads."""
        while True:
            lines = self.all_lines()
            words = Counter(word for line in lines for word in set(re.findall(r"\w+", line.text)))
            local = [line for stage in self.stages for line in stage.get("locals", [])]
            unused = [line for line in local if words[line.text.split(" = ")[0].split()[-1]] < 2]
            if not unused:
                break
            for stage in self.stages:
                stage["locals"] = [line for line in stage.get("locals", []) if line not in unused]
        self.constants = [constant for constant in self.constants if words[constant.name]]

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
                self.add("output", f"bias += {table}[j] * {array}[{where}];", times=run, cost=Operations(1))
            else:
                constant = self.constant(name, float(weights[at]), unit)
                self.add("output", f"bias += {constant} * {columns[at]};", cost=Operations(1))
            at += run

    # What effects read: the temperature and recorded columns, counted from a value nearby so that no digit is lost.

    def temperature(self) -> Input:
        """The temperature less `Target.reference_temperature` [K]."""
        return Input(
            value="temperature",
            centred="deviation",
            change="change",
            reference=self.target.reference_temperature,
            said="T",
            unit="K",
        )

    def column(self, name: Any, near: float) -> Input:
        """A recorded column; `near` is a usual value of it, taken from whoever asks first."""
        if name == self.target.temperature_name:
            return self.temperature()
        if name not in self.columns:
            self.columns[name] = identifier(name, self._columns_taken, "column")
            self.references[name] = self.target.held(near)
        k, said = list(self.columns).index(name), column_text(name)
        return Input(
            value=f"column[{k}]",
            centred=f"centred_{k}",
            change=f"change_{k}",
            reference=self.references[name],
            said=said,
            unit=f"({said})",
        )

    def centred(self, given: Input) -> str:
        """Local variable: an input less its reference."""
        name = given.centred.replace("deviation", "t0").replace("centred_", "")
        near = self.shared(f"near_{name}", given.reference, f"a usual value of {given.said}")
        return self.local(given.centred, f"{given.value} - {near}", Operations.of(sums=1))

    def change(self, given: Input) -> str:
        """Local variable: change of an input since the sample before."""
        return self.local(given.change, f"{given.value} - s->{given.value}", Operations.of(sums=1))


def _lines(statements: Sequence[str], times: int, cost: Operations) -> list[CLine]:
    indent = "" if times == 1 else "    "
    if times == 1:
        statements = [re.sub(r"\[j(?: \+ )?(\d*)\]", _place, statement) for statement in statements]
    lines = [CLine(indent + statement, NOTHING) for statement in statements]
    lines[0] = CLine(lines[0].text, cost * times)
    return (
        lines if times == 1 else [CLine(f"for (int j = 0; j < {times}; ++j) {{", NOTHING), *lines, CLine("}", NOTHING)]
    )


def _place(index: re.Match[str]) -> str:
    return f"[{index[1] or 0}]"


def _element(expression: str) -> tuple[str | None, int | None]:
    """Array and index of ``s->lag[3]``; None for anything else."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", expression)
    return (match[1], int(match[2])) if match else (None, None)
