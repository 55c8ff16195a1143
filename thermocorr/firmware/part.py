"""Effects as parts of a program: polynomials of its inputs.

`x.T` is ``deviation + near_t0`` to the code, a column its own deviation and a usual value, the play its lead over what
it follows and that. So T - T0, squares of a pressure, or the paper's form of a lag lose no digit in single precision,
and what several effects say of one thing becomes one coefficient.

A sum or product of values is a polynomial, and costs nothing until it is needed. Two things are not multiplied out. A
difference of two values stays a difference, whose digits single precision would lose otherwise. A product with a factor
of several values takes that factor as one value.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..effects import Effect
from ..effects.expressions import Decays, Node, Previous, Traced, traced
from .statements import Bracketed, Choice, Converted, Costed, Formula, Kind, Number, Operations, Unary, Whole, binary
from .target import MICROSECONDS


@dataclass(frozen=True)
class Atom:
    """A value that the code computes or is given, as polynomials see it."""

    read: Callable[[], Formula]
    """Reads it: declares what the code lacks for it, and returns where it stands."""
    said: str
    """For comments."""
    unit: str
    degree: int = 1
    """Highest power of an input in it."""
    condition: Callable[[], Formula] | None = None
    """Reads a condition, for an atom that is 1 where it holds and else 0."""


Monomial = tuple[int, ...]
"""Numbers of atoms, in order, each as often as its power says; () for the constant."""


class Polynomial:
    """Sum of ``coefficient * product of atoms``.

    >>> x, y = Polynomial.of(0), Polynomial.of(1)
    >>> ((x + 3.0) * (x - 3.0) + y).terms
    {(0, 0): 1.0, (): -9.0, (1,): 1.0}
    """

    def __init__(self, terms: Mapping[Monomial, float]):
        self.terms = {monomial: c for monomial, c in terms.items() if c != 0.0}

    @classmethod
    def of(cls, atom: int, coefficient: float = 1.0) -> Polynomial:
        """An atom times a number."""
        return cls({(atom,): coefficient})

    @property
    def constant(self) -> float:
        """The constant term."""
        return self.terms.get((), 0.0)

    @property
    def moving(self) -> Polynomial:
        """All but the constant term."""
        return Polynomial({monomial: c for monomial, c in self.terms.items() if monomial})

    @property
    def atoms(self) -> set[int]:
        """Atoms in it."""
        return {atom for monomial in self.terms for atom in monomial}

    def key(self) -> tuple[Any, ...]:
        """Key that is equal for equal polynomials."""
        return tuple(sorted(self.terms.items()))

    def alone(self) -> int | None:
        """The atom that the polynomial is, apart from its constant; None where it is anything else."""
        (monomial, c), *more = self.moving.terms.items() or [((), 0.0)]
        return monomial[0] if not more and c == 1.0 and len(monomial) == 1 else None

    def __add__(self, other: Polynomial | float) -> Polynomial:
        terms = dict(self.terms)
        for monomial, c in (other.terms if isinstance(other, Polynomial) else {(): other}).items():
            terms[monomial] = terms.get(monomial, 0.0) + c
        return Polynomial(terms)

    def __sub__(self, other: Polynomial | float) -> Polynomial:
        return self + other * -1.0

    def __mul__(self, other: Polynomial | float) -> Polynomial:
        if not isinstance(other, Polynomial):
            return Polynomial({monomial: c * other for monomial, c in self.terms.items()})
        terms: dict[Monomial, float] = {}
        for one, c in self.terms.items():
            for two, d in other.terms.items():
                monomial = tuple(sorted(one + two))
                terms[monomial] = terms.get(monomial, 0.0) + c * d
        return Polynomial(terms)


class Said(NamedTuple):
    """A formula and what it costs, statement aside."""

    value: Formula
    products: int = 0
    sums: int = 0

    def cost(self, products: int = 0, sums: int = 0) -> Operations:
        """Operations of a statement that has this, and more products and sums."""
        return Operations.of(self.products + products, self.sums + sums)


def most_common(monomials: Mapping[Monomial, float]) -> int:
    """The atom that stands in most of the monomials; the first of several."""
    counts = Counter(atom for monomial in monomials for atom in set(monomial))
    return min(counts, key=lambda atom: (-counts[atom], atom))


def without(monomial: Monomial, atom: int) -> Monomial:
    """A monomial divided by one of its atoms."""
    at = monomial.index(atom)
    return monomial[:at] + monomial[at + 1 :]


_TURN = 2**64


class Part:
    """One effect of a program: its expression, node by node."""

    def __init__(self, composer: Any, effect: Effect):
        self.composer, self.program, self.target = composer, composer.program, composer.target
        self.expression: Traced = traced(effect)
        self.name = effect.kind
        needed = {node.number for column in self.expression.columns for node in self.expression.below(column)}
        self.nodes = [node for node in self.expression.nodes if node.number in needed]
        self.uses = self._uses()
        self.stages: dict[int, int] = {}
        for node in self.nodes:
            before = [self.stages[arg.number] for arg in node.arguments if isinstance(arg, Node)]
            remembers = node.operator == "word" and not isinstance(node.detail[1], Previous)
            self.stages[node.number] = max(before, default=0) + remembers
        self.last_stage = max(self.stages.values(), default=0)
        self.values: dict[int, Any] = {}

    def _uses(self) -> Counter[int]:
        """Number of uses of each node."""
        asked = [arg for node in self.nodes for arg in node.arguments] + self.expression.columns
        return Counter(value.number for value in asked if isinstance(value, Node))

    def columns(self) -> list[Polynomial]:
        """Polynomials of the effect's columns, once all its stages are written."""
        return [self.value(column) for column in self.expression.columns]

    def value(self, argument: Any) -> Any:
        """Polynomial of an argument: a condition is 1 where it holds, else 0."""
        return self.values[argument.number] if isinstance(argument, Node) else Polynomial({(): argument})

    def write(self, stage: int) -> None:
        """Write what belongs to a stage; the words that follow it last."""
        for node in self.nodes:
            if self.stages[node.number] == stage:
                value = self._value(node, stage)
                if isinstance(value, Polynomial) and self.uses[node.number] > 1 and len(value.atoms) > 1:
                    value = self._as_one(value, stage)
                self.values[node.number] = value
        for node in self.nodes:
            if node.operator == "word" and self.stages[node.number] == stage + 1:
                self._follow(node, stage)

    def _follow(self, node: Node, stage: int) -> None:
        """Let a word follow a value of this stage; what it then says belongs to the next."""
        _, word = node.detail
        p = None if isinstance(word, Decays) else self.value(node.arguments[0] if node.arguments else word.value)
        self.values[-1 - node.number] = self.composer.words.follow(word, p, self.name, stage)

    def _value(self, node: Node, stage: int) -> Any:
        op, composer = node.operator, self.composer
        if op in ("T", "column", "seconds", "elapsed", "step", "angle"):
            return self._input(node)
        if op == "word":
            if isinstance(node.detail[1], Previous):
                return composer.words.previous(self.value(node.arguments[0]), self.name, stage)
            said = self.values[-1 - node.number]
            return said(stage)
        if op == "item":
            return self.value(node.arguments[0])[node.detail]
        args = [self.value(argument) for argument in node.arguments]
        if op == "where":
            return self._choice(args[0], args[1], args[2], stage)
        if op == "neg":
            return args[0] * -1.0
        if op in ("+", "-"):
            return self._sum(args[0], args[1] if op == "+" else args[1] * -1.0, stage)
        if op == "*":
            return self._product(args, stage)
        if op == "**":
            base = args[0] if len(args[0].atoms) < 2 else self._as_one(args[0], stage)
            power = Polynomial({(): 1.0})
            for _ in range(node.detail):
                power = power * base
            return power
        if op == "/":
            return self._quotient(args[0], args[1], stage)
        if op in ("exp", "log1p", "sin", "cos"):
            return self._call(op, args[0], stage)
        if op in ("maximum", "minimum"):
            return self._extreme(args[0], args[1], ">" if op == "maximum" else "<", stage)
        return self._condition(op, args[0], args[1])

    def _input(self, node: Node) -> Polynomial:
        composer, program = self.composer, self.program
        if node.operator in ("T", "column"):
            given = program.temperature() if node.operator == "T" else program.column(node.detail, self._near(node))
            p = composer.atom(given.centred, lambda: program.centred(given), given.said, given.unit)
            composer.inputs[p.alone()] = given
            return p + given.reference
        if node.operator == "seconds":
            return self._seconds()
        if node.operator == "angle":
            return self._angle(node.detail)
        if self.target.period is not None:
            return Polynomial({(): self.target.period})
        return self._step()

    def _seconds(self) -> Polynomial:
        return self.composer.atom("seconds", self.composer.clock.seconds, "time", "s")

    def _step(self) -> Polynomial:
        return self.composer.atom("step", self.program.step, "step", "s")

    def _near(self, node: Node) -> float:
        """A usual value of a column: what the formula subtracts from it, or else its mean over the fitted rows."""
        for other in self.nodes:
            if other.operator == "-" and other.arguments[0] is node and not isinstance(other.arguments[1], Node):
                return float(other.arguments[1])
        return self.target.history.record.moments(node.detail).mean

    def _angle(self, period: float) -> Polynomial:
        """In single precision the phase is a whole number, computed from the counter anew at every sample.

        It is a share of a turn in 64 bits where the sampling period is fixed (the product wraps at a turn by itself),
        the remainder of the time in microseconds where it is not: neither runs away. In double precision the angle is
        computed as in Python, whose own rounding grows with the time.
        """
        program, target = self.program, self.target
        began = target.absolute_zero() % period

        def angle() -> Costed:
            turn = program.shared("omega", 2.0 * math.pi / period, "rad/s")
            zero = program.shared("began", began, "s, phase of the first fitted row")
            return Costed(turn * (zero + self.composer.clock.seconds()), Operations(1))

        def exact_angle() -> Costed:
            phase, unit = self._phase(period, began)
            kind: Kind = "uint32" if target.fixed else "int64"
            counted = program.local(program.name("phase"), lambda: Costed(phase), kind=kind)
            return Costed(Converted("number", counted) * unit, Operations(1))

        return self.composer.local(("angle", period), "angle", 0, exact_angle if target.single else angle)

    def _phase(self, period: float, began: float) -> tuple[Formula, Formula]:
        """A whole number, and the constant of the angle that is one of it."""
        program, target, clock = self.program, self.target, self.composer.clock
        if target.period is not None:
            stride = round(target.period / period * _TURN) % _TURN
            start = round(began / period * _TURN) % _TURN
            count = Converted("uint64", Converted("int64", clock.count()))
            share = Bracketed(count * Whole(stride, "uint64") + Whole(start, "uint64"))
            phase = Converted("uint32", Bracketed(binary(share, ">>", Whole(32))))
            return phase, program.shared("turn", 2.0 * math.pi / 2**32, "rad, turn/2^32")
        whole = round(period * MICROSECONDS)
        start = round(began * MICROSECONDS) % whole
        length, ahead = Whole(whole, "int64"), Whole(whole + start, "int64")  # never negative, before the fit too
        phase = (clock.count() % length + ahead) % length
        return phase, program.shared("radians", 2.0 * math.pi / whole, "rad/us")

    # ------------------------------------------------------------------------------------------------------ operations

    def _sum(self, a: Polynomial, b: Polynomial, stage: int) -> Polynomial:
        total = a + b
        signs = {c > 0 for c in total.moving.terms.values()}
        if len(total.atoms) > 1 and len(signs) > 1 and a.atoms and b.atoms:
            return self._as_one(total, stage)  # a difference keeps its digits
        return total

    def _product(self, factors: list[Polynomial], stage: int) -> Polynomial:
        if all(factor.atoms for factor in factors):
            factors = [p if len(p.atoms) < 2 else self._as_one(p, stage) for p in factors]
        return factors[0] * factors[1]

    def _call(self, function: str, p: Polynomial, stage: int) -> Polynomial:
        def write() -> Costed:
            said = self.composer.formula(p)
            return Costed(self.program.call(function, said.value), said.cost() + Operations(calls=1))

        return self.composer.local((function, p.key()), self.name, stage, write)

    def _quotient(self, a: Polynomial, b: Polynomial, stage: int) -> Polynomial:
        if not b.atoms:
            return a * (1.0 / b.constant)

        def write() -> Costed:
            above, below = self.composer.formula(a), self.composer.formula(b)
            value: Formula = Bracketed(above.value) / Bracketed(below.value)
            if b.key() == self._step().key():
                zero = Number(0.0)
                value = Choice(below.value > zero, value, zero)
            cost = Operations.of(above.products + below.products, above.sums + below.sums, divisions=1)
            return Costed(value, cost)

        return self.composer.local(("/", a.key(), b.key()), self.name, stage, write)

    def _extreme(self, a: Polynomial, b: Polynomial, sign: str, stage: int) -> Polynomial:
        """``max(a, b) = a0 + max(a - a0, b - a0)``, the constants apart."""
        if not a.atoms:
            a, b = b, a
        one, composer = self._as_one(a, stage), self.composer
        constant, other = one.constant, b - one.constant
        if other.atoms:
            other = self._as_one(other, stage)

        def larger() -> Costed:
            left, right = composer.formula(one.moving), composer.formula(other)
            larger = binary(left.value, sign, right.value)
            return Costed(Choice(larger, left.value, right.value), right.cost())

        def beyond_edge() -> Costed:
            value, zero, apart = composer.formula(one.moving).value, Number(0.0), other.constant
            if not apart:
                return Costed(Choice(binary(value, sign, zero), value, zero))
            edge = self.program.shared(f"{self.name}_edge", apart, "less what is usual")
            return Costed(Choice(binary(value, sign, edge), value - edge, zero), Operations(adds=1))

        key = (sign, one.key(), other.key())
        if other.atoms:
            return composer.local(key, self.name, stage, larger) + constant
        return composer.local(key, self.name, stage, beyond_edge, self._unit(one)) + b.constant

    def _as_one(self, p: Polynomial, stage: int) -> Polynomial:
        """A polynomial as one value and a constant."""
        return self.composer.as_one(p, self.name, stage)

    def _unit(self, p: Polynomial) -> str:
        alone = p.alone()
        return "" if alone is None else self.composer.atoms[alone].unit

    def _condition(self, op: str, a: Polynomial, b: Polynomial) -> Polynomial:
        """A comparison; one of the time with a number counts whole samples or microseconds."""
        clock, of_time = self.composer.clock, a.moving.key() == self._seconds().key()
        if of_time and not b.atoms and op in (">=", "<"):
            moment = b.constant - a.constant

            def reached() -> Formula:
                later = clock.reached(moment)
                return later if op == ">=" else Unary("not", Bracketed(later))

            return self.composer.condition((op, "time", moment), reached)

        def compared() -> Formula:
            return binary(self.composer.formula((a - b).moving).value, op, Number((b - a).constant))

        return self.composer.condition((op, (a - b).key()), compared)

    def _choice(self, truth: Polynomial, a: Polynomial, b: Polynomial, stage: int) -> Polynomial:
        """``condition ? a : b``; of two numbers it is ``b + (a - b) [condition]``."""
        if not truth.atoms:
            return a if truth.constant else b
        if self.composer.condition_of(truth) is None:
            truth = self._condition("!=", truth, Polynomial({}))
        if not a.atoms and not b.atoms:
            return truth * (a.constant - b.constant) + b.constant

        def write() -> Costed:
            one, other = self.composer.formula(a), self.composer.formula(b)
            cost = Operations.of(one.products + other.products, one.sums + other.sums)
            return Costed(Choice(self.composer.condition_of(truth)(), one.value, other.value), cost)

        return self.composer.local(("?", truth.key(), a.key(), b.key()), self.name, stage, write)
