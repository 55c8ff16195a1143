"""The program of a model as data: members, constants, stages, counters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..effects.thermal import column_text
from .statements import (
    Assign,
    Call,
    Choice,
    Converted,
    Costed,
    Formula,
    Helper,
    If,
    Item,
    Kept,
    Kind,
    Local,
    Number,
    Operations,
    Raise,
    Statement,
    Statements,
    Variable,
    Whole,
    behind,
    binary,
)
from .target import MICROSECONDS, Target, identifier

Numbers = Sequence[float] | NDArray[np.float64]
RESERVED = frozenset(
    """
    s temperature reading columns column bias corrected change deviation result flags first step step_us started seconds
    j increment next gain loss decay
    """.split()  # noqa: SIM905
)
"""Names that the frame of `update` uses itself."""


class Constant(NamedTuple):
    """A named constant or table of numbers."""

    name: str
    values: tuple[float, ...]
    comment: str
    table: bool


class Member(NamedTuple):
    """A member of the state."""

    kind: Kind
    name: str
    length: int | None
    comment: str


@dataclass(frozen=True)
class Input:
    """An input as the code sees it, and the value from which `centred` counts."""

    value: Formula
    before: Formula
    """The value at the sample before."""
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
    """A stage: ``locals``, then ``begin`` for the first usable sample, ``advance`` for every other.

    Words that follow other words come in a later stage than these.
    """

    locals: Statements = field(default_factory=Statements)
    begin: Statements = field(default_factory=Statements)
    advance: Statements = field(default_factory=Statements)


@dataclass
class Program:
    """Collects what the effects of a model need: `update` runs the stages, then `output` and `store`.

    A local variable is declared by whoever reads it first, so that the code holds none that nothing reads.
    """

    target: Target
    keywords: frozenset[str] = frozenset()
    """Names that the language has taken."""
    constants: list[Constant] = field(default_factory=list)
    members: list[Member] = field(default_factory=list)
    stages: list[Stage] = field(default_factory=list)
    output: Statements = field(default_factory=Statements)
    """What adds to `bias`."""
    store: Statements = field(default_factory=Statements)
    """What is kept for the next sample."""
    helpers: dict[str, Helper] = field(default_factory=dict)
    bias_constant: float = 0.0
    flags_washout: bool = False
    asks_first: bool = False
    """True if a formula reads ``first``."""
    calls_functions: bool = False
    """True if it calls an elementary function."""
    columns: dict[Any, str] = field(default_factory=dict)
    """Recorded columns in the order in which `update` takes them -> identifier."""
    highest_power: int = 2
    """Highest power of inputs, which bounds the inputs that cannot overflow."""
    references: dict[Any, float] = field(default_factory=dict)
    """Usual values of the columns."""
    _taken: set[str] = field(default_factory=lambda: set(RESERVED))
    _columns_taken: set[str] = field(default_factory=lambda: {"s"})
    _declared: set[str] = field(default_factory=set)

    def constant(self, name: str, values: float | Numbers, comment: str) -> Variable:
        """Declare a constant (a number) or a table (a sequence)."""
        table = not isinstance(values, float | int)
        taken = (float(values),) if isinstance(values, float | int) else tuple(float(v) for v in values)
        self.constants.append(Constant(self.name(name), taken, comment, table))
        return Variable(self.constants[-1].name)

    def shared(self, name: str, value: float, comment: str) -> Variable:
        """A constant that several effects need: declared by whoever asks first."""
        for constant in self.constants:
            if constant.values == (float(value),) and constant.comment == comment and not constant.table:
                return Variable(constant.name)
        return self.constant(name, value, comment)

    def member(self, name: str, comment: str, length: int | None = None, kind: Kind = "number") -> Kept:
        """Declare a member of the state."""
        self.members.append(Member(kind, self.name(name), length, comment))
        return Kept(self.members[-1].name)

    def name(self, text: str) -> str:
        """A name of the code's own that nothing else has."""
        return identifier(text, self.keywords, self._taken)

    def stage(self, number: int) -> Stage:
        """A stage, and those before it."""
        while len(self.stages) <= number:
            self.stages.append(Stage())
        return self.stages[number]

    def local(self, name: str, write: Callable[[], Costed], stage: int = 0, kind: Kind = "number") -> Variable:
        """Read a local variable: whoever reads it first declares it, behind all that its formula reads."""
        if name not in self._declared:
            self._declared.add(name)
            value, cost = write()
            self.stage(stage).locals.add(Local(name, value, kind), cost=cost)
        return Variable(name)

    def step(self) -> Variable:
        """Read the time since the sample before [s], where it is known only at run time."""
        if "step" not in self._declared:
            self._declared.add("step")
            seconds = Converted("number", Variable("step_us")) / Number(MICROSECONDS)
            self.stage(0).locals.add_first(Local("step", seconds), Operations(divisions=1))
        return Variable("step")

    def first(self) -> Variable:
        """Read whether the sample is the first of a segment."""
        self.asks_first = True
        return Variable("first")

    def call(self, function: str, value: Formula) -> Call:
        """The call of an elementary function."""
        self.calls_functions = True
        return Call(function, (value,))

    def weigh(self, name: str, weights: Numbers, values: Sequence[Formula], comment: str) -> None:
        """Add ``weight * value`` to the bias for each; values that follow one another in an array share a loop."""
        at = 0
        while at < len(values):
            value, run = values[at], 1
            if isinstance(value, Item) and isinstance(value.index, Whole):
                while values[at + run : at + run + 1] == [value.array[behind(value.index, run)]]:
                    run += 1
                if run > 1:
                    table = self.constant(name, list(weights[at : at + run]), comment)
                    self._add_products(table, value.array, value.index.value, run)
            if run == 1:
                self.add_to_bias(self.constant(name, float(weights[at]), comment) * value, Operations(1))
            at += run

    def _add_products(self, table: Formula, array: Formula, begin: int, length: int) -> None:
        def turn(j: Formula) -> list[Statement]:
            return [Assign(Variable("bias"), table[j] * array[behind(j, begin)], "+")]

        self.output.loop(length, turn, Operations(1))

    def add_to_bias(self, value: Formula, cost: Operations) -> None:
        """Add a value to the bias."""
        self.output.add(Assign(Variable("bias"), value, "+"), cost=cost)

    # What effects read: the temperature and recorded columns, counted from a value nearby so that no digit is lost.

    def temperature(self) -> Input:
        """The temperature less `Target.reference_temperature` [K, or degF]."""
        return Input(
            value=Variable("temperature"),
            before=Kept("temperature"),
            centred="deviation",
            near="near_t0",
            change="change",
            reference=self.target.reference_temperature,
            said="T",
            unit=self.target.degree,
        )

    def column(self, name: Any, near: float) -> Input:
        """A recorded column; `near` is a usual value of it, taken from whoever asks first."""
        if name == self.target.temperature_name:
            return self.temperature()
        if name not in self.columns:
            self.columns[name] = identifier(name, self.keywords, self._columns_taken, "column")
            self.references[name] = self.target.held(near)
        k, said = list(self.columns).index(name), column_text(name)
        return Input(
            value=Variable("column")[Whole(k)],
            before=Kept("column")[Whole(k)],
            centred=f"centred_{k}",
            near=f"near_{k}",
            change=f"change_{k}",
            reference=self.references[name],
            said=said,
            unit=f"({said})",
        )

    def centred(self, given: Input) -> Variable:
        """Read an input less its reference, a local variable."""

        def write() -> Costed:
            near = self.shared(given.near, given.reference, f"a usual value of {given.said}")
            return Costed(given.value - near, Operations.of(sums=1))

        return self.local(given.centred, write)

    def change(self, given: Input) -> Variable:
        """Read the change of an input since the sample before, a local variable."""
        return self.local(given.change, lambda: Costed(given.value - given.before, Operations.of(sums=1)))


YEARS_OF_A_COUNTER = 100
_YEAR = 365.25 * 86_400.0
_ALMOST = {True: 1e-9, False: 1e-3}
"""Share of a sample (of a microsecond) by which a moment may miss it through rounding, for a fixed period or not."""


class TimeCounter:
    """Declares the counter that effects of time need, once, and gives them the time in the form they ask for."""

    def __init__(self, program: Program):
        self.program = program
        self.target = program.target
        self.counter: Kept | None = None

    @property
    def used(self) -> bool:
        """True if an effect of time has asked."""
        return self.counter is not None

    @property
    def bits(self) -> int:
        """Width of the counter."""
        fits = self.target.period is not None and 2**31 * self.target.period > YEARS_OF_A_COUNTER * _YEAR
        return 32 if fits else 64

    @property
    def kind(self) -> Kind:
        """Kind of the counter."""
        return "int32" if self.bits == 32 else "int64"

    def count(self) -> Kept:
        """Read the counter: samples, or microseconds, since the origin."""
        if self.counter is None:
            what = "number of the next sample" if self.target.fixed else "microseconds"
            name = "sample" if self.target.fixed else "microseconds"
            self.counter = self.program.member(name, f"{what} since the first fitted row", kind=self.kind)
        return self.counter

    def seconds(self) -> Variable:
        """Read the local variable: time since the first fitted row [s]."""
        return self.program.local("seconds", self._seconds)

    def _seconds(self) -> Costed:
        target, now = self.target, Converted("number", self.count())
        if target.period is not None:
            cost = Operations(1)
            seconds = now * self.program.shared("period", target.period, "s, sampling period")
        else:
            cost = Operations(divisions=1)
            seconds = now / Number(MICROSECONDS)
        return Costed(seconds, cost)

    def reached(self, moment: float) -> Formula:
        """Condition: the time since the first fitted row is at least `moment` [s]."""
        tick = self.target.period or 1 / MICROSECONDS
        count = math.ceil(moment / tick - _ALMOST[self.target.fixed])
        limit = 2**31 - 1 if self.bits == 32 else 2**62
        return binary(self.count(), ">=", Whole(min(max(count, -limit), limit), self.kind))


def settling(program: Program, washout: float) -> None:
    """Count down the stretch after a start that is flagged [s]."""
    target = program.target
    if washout <= 0:
        return
    program.flags_washout = True
    stage = program.stage(0)
    if target.period is None:
        count = math.ceil(washout * MICROSECONDS - _ALMOST[False])
        left = program.member("settling", "microseconds until the start is forgotten", kind="uint64")
        stage.begin.add(Assign(left, Whole(count, "uint64")))
        step = Variable("step_us")
        stage.advance.add(Assign(left, Choice(step < left, step, left), "-"))
        then: list[Statement] = []
    else:
        count = min(math.ceil(washout / target.period - _ALMOST[True]), 2**32 - 1)
        left = program.member("settling", "samples until the start is forgotten", kind="uint32")
        stage.begin.add(Assign(left, Whole(count, "uint32")))
        then = [Assign(left, Whole(1), "-")]
    program.store.add(If(left > Whole(0), [*then, Raise("WASHOUT")]))
