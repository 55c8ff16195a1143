"""C of any effects: the bias is one polynomial of what the code knows at a sample, written by Horner's rule."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..effects import CATALOGUE, Effect
from ..effects.expressions import TraceError, traced
from ..effects.protocol import refuse_foresight
from .counter import TimeCounter
from .lagbank import LagBank
from .language import Operations
from .part import Part
from .polynomial import Atom, Polynomial, Said, most_common, without
from .program import NOTHING, Input, Numbers, Program
from .recursions import Words


def refuse(effects: Sequence[Effect]) -> None:
    """Raise ValueError that names the first effect that cannot be written in C."""
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
                f"The effect {effect.label()!r} ({type(effect).__name__}) cannot be exported to C: {reason}. It "
                f"knows {', '.join(known)}, and effects of your own that say their formula in `signals`. Leave the "
                "effect out and fit again, or correct with the model itself."
            )


class Printer:
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
        self._known: dict[str, int] = {}
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
        self.program.prune()

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
            program.add("output", f"bias += {self._text(atom)} * ({said.text});", cost=said.cost(1, 1))
            left = {monomial: c for monomial, c in left.items() if atom not in monomial}
        places = sorted(left, key=lambda monomial: self.atoms[monomial[0]].text)
        plain = [m[0] for m in places if not self.atoms[m[0]].condition]
        by_array: dict[tuple[str, str], list[int]] = {}
        for atom in sorted(plain, key=lambda atom: _place(self.atoms[atom].text)):
            by_array.setdefault((_place(self.atoms[atom].text)[0], self.atoms[atom].unit), []).append(atom)
        for (_, unit), atoms in by_array.items():
            names = [self.atoms[atom].text for atom in atoms]
            comment = f"{self.per(unit)}, of {self.atoms[atoms[0]].said}"
            program.weigh("weight", [left[atom,] for atom in atoms], names, comment)
        for monomial in places:
            if condition := self.atoms[monomial[0]].condition:
                name, zero = self._number(left[monomial], monomial), self.target.number(0.0)
                program.add("output", f"bias += {condition} ? {name} : {zero};", cost=Operations(adds=1))

    def per(self, unit: str) -> str:
        """Unit of a coefficient."""
        return f"{self.unit or 'unit of the reading'}/{unit}" if unit else self.unit or "unit of the reading"

    def degree(self, monomial: Sequence[int]) -> int:
        """Highest power of an input in a monomial."""
        return sum(self.atoms[atom].degree for atom in monomial)

    def said(self, p: Polynomial, of_bias: Sequence[int] | None = None) -> Said:
        """A polynomial in C, by Horner's rule; `of_bias`: it stands in the bias, times these atoms."""
        terms, parts = dict(p.terms), []
        while moving := {monomial: c for monomial, c in terms.items() if monomial}:
            atom = most_common(moving)
            terms = {m: c for m, c in terms.items() if atom not in m}
            parts.append(self._factored(atom, {without(m, atom): c for m, c in moving.items() if atom in m}, of_bias))
        if terms or not parts:
            parts.append(("+", Said(self._number(p.constant, of_bias))))
        text = " ".join(f"{sign} {part.text}" for sign, part in parts)
        text = text.removeprefix("+ ") if text.startswith("+") else f"-{text[2:]}"
        return Said(text, sum(s.products for _, s in parts), sum(s.sums for _, s in parts) + len(parts) - 1)

    def _factored(self, atom: int, inside: dict[Any, float], of_bias: Sequence[int] | None) -> tuple[str, Said]:
        """Sign and text of ``atom * (inside)``."""
        text, within = self._text(atom), None if of_bias is None else (*of_bias, atom)
        if len(inside) == 1 and within is None and abs(next(iter(inside.values()))) == 1.0:
            ((monomial, c),) = inside.items()
            return "+" if c > 0 else "-", Said(" * ".join([text, *map(self._text, monomial)]), len(monomial))
        if set(inside) == {()}:
            return "+", Said(f"{self._number(inside[()], within)} * {text}", 1)
        inner = self.said(Polynomial(inside), within)
        return "+", Said(f"{text} * ({inner.text})", inner.products + 1, inner.sums)

    def _text(self, atom: int) -> str:
        one = self.atoms[atom]
        return one.text or f"({one.condition} ? {self.target.number(1.0)} : {self.target.number(0.0)})"

    def _number(self, value: float, of_bias: Sequence[int] | None) -> str:
        """The name of a constant: of a formula, or a coefficient of these atoms in the bias."""
        if of_bias is None:
            return self.program.shared("number", value, "of a formula")
        unit = " ".join(filter(None, (self.atoms[atom].unit for atom in of_bias)))
        unit = f"({unit})" if " " in unit else unit
        said = " * ".join(self.atoms[atom].said for atom in of_bias)
        return self.program.constant("weight", value, f"{self.per(unit)}, of {said}")

    # ----------------------------------------------------------------------------------------------- atoms and locals

    def atom(self, text: str, said: str, unit: str = "", degree: int = 1, condition: str = "") -> Polynomial:
        """The polynomial of a value, whoever asks for it first."""
        key = text or condition
        if key not in self._known:
            self._known[key] = len(self.atoms)
            self.atoms.append(Atom(text, said, unit, degree, condition))
        return Polynomial.of(self._known[key])

    def local(
        self, name: str, expression: str, stage: int, cost: Operations = NOTHING, unit: str = "", degree: int = 1
    ) -> Polynomial:
        """A local variable; one for each expression."""
        key = f"{expression} = "
        if key not in self._known:
            variable = self.program.local(self.program.name(name), expression, cost, stage)
            self._known[key] = self.atom(variable, variable, unit, degree).alone()  # type: ignore[assignment]
        return Polynomial.of(self._known[key])

    def as_one(self, p: Polynomial, name: str, stage: int) -> Polynomial:
        """A polynomial as one value and a constant."""
        moving = p.moving
        if moving.alone() is not None or not moving.terms:
            return p
        said, degree = self.said(moving), max(map(self.degree, moving.terms))
        units = {self.atoms[m[0]].unit if len(m) == 1 else "" for m in moving.terms}
        unit = units.pop() if len(units) == 1 else ""
        return self.local(name, said.text, stage, said.cost(), unit, degree) + p.constant

    def input_of(self, p: Polynomial) -> Input | None:
        """The input that a polynomial is, beside a constant; None where it is none."""
        alone = p.alone()
        return None if alone is None else self.inputs.get(alone)


def _place(text: str) -> tuple[str, int]:
    """Array and index of ``s->lag[3]``, to sort by."""
    array, _, index = text.partition("[")
    return array, int(index.rstrip("]")) if index.rstrip("]").isdigit() else 0
