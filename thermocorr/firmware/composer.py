"""The program of any effects: the bias is one polynomial of what is known at a sample, by Horner's rule."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

from ..effects import CATALOGUE, Effect
from ..effects.expressions import TraceError, traced
from ..effects.protocol import refuse_foresight
from .lagbank import LagBank
from .part import Atom, Part, Polynomial, Said, most_common, without
from .program import Input, Numbers, Program, TimeCounter
from .recursions import Words
from .statements import Bracketed, Choice, Costed, Formula, Item, Number, Operations, Whole


def refuse(effects: Sequence[Effect], language: str) -> None:
    """Raise ValueError that names the first effect that cannot be written in a language."""
    refuse_foresight(effects, "a device")
    for effect in effects:
        reason = ""
        try:
            expression = traced(effect)
            needed = {node.operator for column in expression.columns for node in expression.below(column)}
            reason = "it reads the time since its segment began, which the code does not keep" * ("elapsed" in needed)
        except TraceError as error:
            reason = str(error)
        if reason:
            known = [kind for kind, effect in CATALOGUE.items() if not effect.foresees]
            raise ValueError(
                f"The effect {effect.label()!r} ({type(effect).__name__}) cannot be exported to {language}: {reason}. "
                f"It knows {', '.join(known)}, and effects of your own that say their formula in `signals`. Leave the "
                "effect out and fit again, or correct with the model itself."
            )


class Composer:
    """Writes effects into a program, those that follow others later.

    Parameters
    ----------
    program : Program
    unit : str
        Of the reading.
    """

    def __init__(self, program: Program, unit: str):
        self.program, self.target, self.clock, self.unit = program, program.target, TimeCounter(program), unit
        self.lags = LagBank(program)
        self.atoms: list[Atom] = []
        self.bias = Polynomial({})
        self._known: dict[Hashable, int] = {}
        self.inputs: dict[int, Input] = {}
        self.words = Words(self)

    def write(self, effects: Sequence[Effect], weights: Sequence[Numbers], states: Sequence[Any]) -> None:
        """Write effects, the coefficients of their columns, and the states that they go on from (None: from rest)."""
        parts = [Part(self, effect, state) for effect, state in zip(effects, states, strict=True)]
        for stage in range(1 + max((part.last_stage for part in parts), default=0)):
            for part in parts:
                part.write(stage)
            self.lags.emit(stage)
        for part, coefficients in zip(parts, weights, strict=True):
            for column, coefficient in zip(part.columns(), coefficients, strict=True):
                self.bias = self.bias + column * float(coefficient)
        self._write_bias()

    # ------------------------------------------------------------------------------------------------------- the bias

    def _write_bias(self) -> None:
        """Add each monomial to the bias once: products by Horner's rule, single values in loops."""
        program, left = self.program, self.bias.moving.terms
        program.bias_constant += self.bias.constant
        program.highest_power = max([program.highest_power, *(self.degree(m) for m in left)])
        while products := {monomial: c for monomial, c in left.items() if len(monomial) > 1}:
            atom = most_common(products)
            inside = {without(m, atom): c for m, c in left.items() if atom in m}
            said = self.said(Polynomial(inside), of_bias=[atom])
            program.add_to_bias(self.read(atom) * Bracketed(said.value), said.cost(1, 1))
            left = {monomial: c for monomial, c in left.items() if atom not in monomial}
        alone = [monomial[0] for monomial in left]
        places = {atom: self.read(atom) for atom in alone if self.atoms[atom].condition is None}
        by_array: dict[tuple[str, str], list[int]] = {}
        for atom in sorted(places, key=lambda atom: _located(places[atom])):
            by_array.setdefault((_located(places[atom])[0], self.atoms[atom].unit), []).append(atom)
        for (_, unit), atoms in by_array.items():
            comment = f"{self.per(unit)}, of {self.atoms[atoms[0]].said}"
            program.weigh("weight", [left[atom,] for atom in atoms], [places[atom] for atom in atoms], comment)
        for atom in alone:
            if (condition := self.atoms[atom].condition) is not None:
                weight = self._number(left[atom,], [atom])
                program.add_to_bias(Choice(condition(), weight, Number(0.0)), Operations(adds=1))

    def per(self, unit: str) -> str:
        """Unit of a coefficient."""
        return f"{self.unit or 'unit of the reading'}/{unit}" if unit else self.unit or "unit of the reading"

    def degree(self, monomial: Sequence[int]) -> int:
        """Highest power of an input in a monomial."""
        return sum(self.atoms[atom].degree for atom in monomial)

    def said(self, p: Polynomial, of_bias: Sequence[int] | None = None) -> Said:
        """A polynomial as a formula, by Horner's rule; `of_bias`: it stands in the bias, times these atoms."""
        terms, parts = dict(p.terms), []
        while moving := {monomial: c for monomial, c in terms.items() if monomial}:
            atom = most_common(moving)
            terms = {m: c for m, c in terms.items() if atom not in m}
            parts.append(self._factored(atom, {without(m, atom): c for m, c in moving.items() if atom in m}, of_bias))
        if terms or not parts:
            parts.append(("+", Said(self._number(p.constant, of_bias))))
        (sign, first), *more = parts
        value = -first.value if sign == "-" else first.value
        for sign, part in more:
            value = value - part.value if sign == "-" else value + part.value
        return Said(value, sum(s.products for _, s in parts), sum(s.sums for _, s in parts) + len(parts) - 1)

    def _factored(self, atom: int, inside: dict[Any, float], of_bias: Sequence[int] | None) -> tuple[str, Said]:
        """Sign and value of ``atom * (inside)``."""
        value, within = self.read(atom), None if of_bias is None else (*of_bias, atom)
        if len(inside) == 1 and within is None and abs(next(iter(inside.values()))) == 1.0:
            ((monomial, c),) = inside.items()
            for atom in monomial:
                value = value * self.read(atom)
            return "+" if c > 0 else "-", Said(value, len(monomial))
        if set(inside) == {()}:
            return "+", Said(self._number(inside[()], within) * value, 1)
        inner = self.said(Polynomial(inside), within)
        return "+", Said(value * Bracketed(inner.value), inner.products + 1, inner.sums)

    def _number(self, value: float, of_bias: Sequence[int] | None) -> Formula:
        """A constant: of a formula, or a coefficient of these atoms in the bias."""
        if of_bias is None:
            return self.program.shared("number", value, "of a formula")
        unit = " ".join(filter(None, (self.atoms[atom].unit for atom in of_bias)))
        unit = f"({unit})" if " " in unit else unit
        said = " * ".join(self.atoms[atom].said for atom in of_bias)
        return self.program.constant("weight", value, f"{self.per(unit)}, of {said}")

    # ----------------------------------------------------------------------------------------------- atoms and locals

    def read(self, atom: int) -> Formula:
        """An atom, once what it needs is declared."""
        return self.atoms[atom].read()

    def atom(self, key: Hashable, read: Callable[[], Formula], said: str, unit: str = "") -> Polynomial:
        """The polynomial of a value; one for each key, which says what it is."""
        return self._one(key, lambda: Atom(read, said, unit))

    def condition(self, key: Hashable, read: Callable[[], Formula]) -> Polynomial:
        """The polynomial of a condition: 1 where it holds, else 0."""

        def value() -> Formula:
            return Bracketed(Choice(read(), Number(1.0), Number(0.0)))

        return self._one(key, lambda: Atom(value, "a condition", "", 1, read))

    def condition_of(self, p: Polynomial) -> Callable[[], Formula] | None:
        """Reads the condition that a polynomial is; None where it is none."""
        alone = p.alone()
        return None if alone is None or p.constant else self.atoms[alone].condition

    def local(
        self, key: Hashable, name: str, stage: int, write: Callable[[], Costed], unit: str = "", degree: int = 1
    ) -> Polynomial:
        """A local variable, which `write` gives its formula where something reads it; one for each key."""

        def atom() -> Atom:
            variable = self.program.name(name)
            return Atom(lambda: self.program.local(variable, write, stage), variable, unit, degree)

        return self._one(key, atom)

    def _one(self, key: Hashable, make: Callable[[], Atom]) -> Polynomial:
        if key not in self._known:
            self._known[key] = len(self.atoms)
            self.atoms.append(make())
        return Polynomial.of(self._known[key])

    def as_one(self, p: Polynomial, name: str, stage: int) -> Polynomial:
        """A polynomial as one value and a constant."""
        moving = p.moving
        if moving.alone() is not None or not moving.terms:
            return p
        degree = max(map(self.degree, moving.terms))
        units = {self.atoms[m[0]].unit if len(m) == 1 else "" for m in moving.terms}
        unit = units.pop() if len(units) == 1 else ""

        def write() -> Costed:
            said = self.said(moving)
            return Costed(said.value, said.cost())

        return self.local(("sum", moving.key()), name, stage, write, unit, degree) + p.constant

    def input_of(self, p: Polynomial) -> Input | None:
        """The input that a polynomial is, beside a constant; None where it is none."""
        alone = p.alone()
        return None if alone is None else self.inputs.get(alone)


def _located(place: Formula) -> tuple[str, int]:
    """Array (or variable) and index of a value, by which values are sorted."""
    if isinstance(place, Item) and isinstance(place.index, Whole):
        return str(place.array), place.index.value
    return str(place), 0
