"""The parts of a C program while effects write them: constants, state, and lines of the two functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..effects.thermal import column_text
from .language import Operations, identifier
from .statements import NOTHING, CLine, Statements
from .target import MICROSECONDS, Target

Numbers = Sequence[float] | NDArray[np.float64]
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

    def __str__(self) -> str:
        return f"s->{self.name}"

    @property
    def size(self) -> int:
        """Bytes."""
        return BYTES[self.ctype] * (self.length or 1)


@dataclass(frozen=True)
class Place:
    """Where a value stands: a variable (no index) or an element of an array."""

    array: str
    index: int | None = None

    def __str__(self) -> str:
        return self.array if self.index is None else f"{self.array}[{self.index}]"


@dataclass(frozen=True)
class Input:
    """An input as the code sees it: C expressions, and the value from which `centred` counts."""

    value: str
    before: str
    """C expression: the value at the sample before."""
    centred: str
    """Local variable: the input less its reference."""
    near: str
    """Constant: the reference."""
    change: str
    """Local variable: change since the sample before."""
    reference: float
    said: str
    """Name, for comments."""
    unit: str


@dataclass
class Stage:
    """What is computed together: ``locals``, then ``begin`` for the first usable sample, ``advance`` for every other.

    Words that follow other words come in a later stage than these.
    """

    locals: Statements = field(default_factory=Statements)
    begin: Statements = field(default_factory=Statements)
    advance: Statements = field(default_factory=Statements)


@dataclass
class Program:
    """Collects what the effects of a model need: `update` runs the stages, then `output`, `store` and `close`.

    A local variable is declared by whoever reads it first, so that the code holds none that nothing reads.
    """

    target: Target
    constants: list[Constant] = field(default_factory=list)
    members: list[Member] = field(default_factory=list)
    init: Statements = field(default_factory=Statements)
    """Statements of the function that starts a device."""
    stages: list[Stage] = field(default_factory=list)
    output: Statements = field(default_factory=Statements)
    """What adds to `bias`."""
    store: Statements = field(default_factory=Statements)
    """What is kept for the next sample."""
    close: Statements = field(default_factory=Statements)
    helpers: dict[str, CLine] = field(default_factory=dict)
    """Static functions: name -> text, and operations of its dearest way."""
    bias_constant: float = 0.0
    flags_washout: bool = False
    asks_first: bool = False
    """Whether an expression reads ``first``."""
    calls_libm: bool = False
    columns: dict[Any, str] = field(default_factory=dict)
    """Recorded columns in the order of their C array -> identifier."""
    highest_power: int = 2
    """Highest power of inputs, which bounds the inputs that cannot overflow."""
    references: dict[Any, float] = field(default_factory=dict)
    """Usual values of the columns."""
    _taken: set[str] = field(default_factory=lambda: set(RESERVED))
    _columns_taken: set[str] = field(default_factory=lambda: {"s"})
    _declared: set[str] = field(default_factory=set)

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

    def member(self, name: str, comment: str, length: int | None = None, ctype: str | None = None) -> Member:
        """Declare a member of the state, which as text is the expression for it."""
        self.members.append(Member(ctype or self.target.dtype, identifier(name, self._taken), length, comment))
        return self.members[-1]

    def name(self, text: str) -> str:
        """A name of the code's own that nothing else has."""
        return identifier(text, self._taken)

    def stage(self, number: int) -> Stage:
        """A stage, and those before it."""
        while len(self.stages) <= number:
            self.stages.append(Stage())
        return self.stages[number]

    def local(self, name: str, write: Callable[[], CLine], stage: int = 0, ctype: str = "") -> Place:
        """Read a local variable: whoever reads it first declares it, behind all that its expression reads."""
        if name not in self._declared:
            self._declared.add(name)
            expression, cost = write()
            text = f"const {ctype or self.target.dtype} {name} = {expression};"
            self.stage(stage).locals.add(text, cost=cost)
        return Place(name)

    def step(self) -> Place:
        """Read the time since the sample before [s], where it is known only at run time."""
        if "step" not in self._declared:
            self._declared.add("step")
            T = self.target.dtype
            text = f"const {T} step = ({T})step_us / {self.target.number(MICROSECONDS)};"
            self.stage(0).locals.lines.insert(0, CLine(text, Operations(divisions=1)))
        return Place("step")

    def first(self) -> str:
        """Read whether the sample is the first of a segment."""
        self.asks_first = True
        return "first"

    def call(self, function: str) -> str:
        """Name of a libm function that the code calls."""
        self.calls_libm = True
        return self.target.call(function)

    @property
    def operations(self) -> Operations:
        """Operations of one update, the larger number of each kind where there are two branches."""
        staged = [line for stage in self.stages for block in (stage.locals, stage.advance) for line in block]
        lines = [*staged, *self.output, *self.store, *self.close]
        return sum((line.operations for line in lines), NOTHING)

    def weigh(self, name: str, weights: Numbers, values: Sequence[Place], comment: str) -> None:
        """Add ``weight * value`` to the bias for each; values that follow one another in an array share a loop."""
        at = 0
        while at < len(values):
            array, index, run = values[at].array, values[at].index, 1
            while index is not None and at + run < len(values) and values[at + run] == Place(array, index + run):
                run += 1
            if index is not None and run > 1:
                table = self.constant(name, list(weights[at : at + run]), comment)
                self._add_products(table, array, index, run)
            else:
                constant = self.constant(name, float(weights[at]), comment)
                self.output.add(f"bias += {constant} * {values[at]};", cost=Operations(1))
            at += run

    def _add_products(self, table: str, array: str, begin: int, length: int) -> None:
        self.output.loop(length, lambda j: f"bias += {table}[{j}] * {array}[{j + begin}];", Operations(1))

    # What effects read: the temperature and recorded columns, counted from a value nearby so that no digit is lost.

    def temperature(self) -> Input:
        """The temperature less `Target.reference_temperature` [K]."""
        return Input(
            value="temperature",
            before="s->temperature",
            centred="deviation",
            near="near_t0",
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
            before=f"s->column[{k}]",
            centred=f"centred_{k}",
            near=f"near_{k}",
            change=f"change_{k}",
            reference=self.references[name],
            said=said,
            unit=f"({said})",
        )

    def centred(self, given: Input) -> Place:
        """Read an input less its reference, a local variable."""

        def write() -> CLine:
            near = self.shared(given.near, given.reference, f"a usual value of {given.said}")
            return CLine(f"{given.value} - {near}", Operations.of(sums=1))

        return self.local(given.centred, write)

    def change(self, given: Input) -> Place:
        """Read the change of an input since the sample before, a local variable."""
        return self.local(given.change, lambda: CLine(f"{given.value} - {given.before}", Operations.of(sums=1)))
