"""Expressions of effects as statements of a program, with their recursions.

What a word says is what it follows and a difference: T(t - d) is T and ``late``, the play is T and its ``lead``. So the
columns T(t - d) - T and p - T are one small number each, and no digit is lost on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ..effects import CATALOGUE, Effect
from ..effects.expressions import Decays, Delayed, Lag, Play, TraceError, Word, traced
from ..effects.protocol import refuse_foresight
from .lagbank import LagBank, LagInput
from .part import Atom, Part, Polynomial, Said, most_common, without
from .program import Input, Numbers, Program, TimeCounter
from .statements import Assign, Bracketed, Choice, Costed, Formula, If, Item, Number, Operations, Whole

LONGEST_DELAY = 4096
"""Samples that a delay may reach back to: 16 kB in single precision."""

Later = Callable[[int], Any]
"""What a word says in the next stage: a polynomial, or a list of them."""


@dataclass(frozen=True)
class Followed:
    """Value that a word follows, as the code holds it."""

    value: Formula
    change: Callable[[], Formula]
    """Reads the local variable: change since the sample before, 0 where a segment begins."""
    said: str
    unit: str


class Words:
    """Writes words into a program; `composer` knows its values."""

    def __init__(self, composer: Any):
        self.composer, self.program, self.target = composer, composer.program, composer.program.target
        self._followed: dict[Hashable, Followed] = {}

    def follow(self, word: Word, p: Polynomial, name: str, stage: int) -> Later:
        """Let a word follow a value."""
        if isinstance(word, Lag):
            return self._lag(word, p, name, stage)
        if isinstance(word, Play):
            return self._play(word, p, stage)
        if isinstance(word, Delayed):
            return self._delayed(word, p, name, stage)
        assert isinstance(word, Decays)  # eq. (18): they belong to fitted segments, of which the device is none
        return lambda _: [Polynomial({}) for _, taus in word.of_segments for _ in taus]

    def previous(self, p: Polynomial, name: str, stage: int) -> Polynomial:
        """The value less its change."""
        given = self._following(p, name, stage)
        said = f"change of {given.said}"
        return p - self.composer.atom(("change", p.moving.key()), given.change, said, given.unit)

    def _following(self, p: Polynomial, name: str, stage: int) -> Followed:
        """Follow a value: an input is remembered already, for any other the code keeps the one before."""
        program, composer = self.program, self.composer
        if (given := composer.input_of(p)) is not None:
            return Followed(given.value, lambda: program.change(given), given.said, given.unit)
        p = composer.as_one(p, name, stage)
        if (key := p.moving.key()) not in self._followed:
            value, alone = composer.formula(p.moving).value, p.alone()
            unit = "" if alone is None else composer.atoms[alone].unit
            before = program.member(f"{name}_before", f"{value} at the sample before")
            program.store.add(Assign(before, value))
            moved = program.name(f"{name}_moved")

            def change() -> Costed:
                return Costed(Choice(program.first(), Number(0.0), value - before), Operations(adds=1))

            said = f"{name} ({value})"
            reads = partial(program.local, moved, change, stage)
            self._followed[key] = Followed(value, reads, said, unit)
        return self._followed[key]

    def _lag(self, word: Lag, p: Polynomial, name: str, stage: int) -> Later:
        """Eqs. (19) (25)."""
        given = self._following(p, name, stage)
        source, taus = LagInput(given.value, given.said, given.change, given.unit or "1"), word.time_constants
        group = self.composer.lags.request(source, taus, word.hold, stage)

        def later(_: int) -> list[Polynomial]:
            return [self._lagged(place, tau, given) for place, tau in zip(group.columns(taus), taus, strict=True)]

        return later

    def _lagged(self, place: Formula, tau: float, given: Followed) -> Polynomial:
        return self.composer.atom(place, lambda: place, f"lag of {given.said}, {tau:.6g} s", given.unit)

    def _play(self, word: Play, p: Polynomial, stage: int) -> Later:
        """The play operator; its position is counted as the value is."""
        program, composer = self.program, self.composer
        value = composer.formula(composer.as_one(p, "play", stage).moving).value
        play = program.member("play", f"position of the play of width {word.width:.6g}, as {value}")
        half = program.shared("half_width", word.width / 2, "of the play")
        program.stage(stage).begin.add(Assign(play, value))
        upper = If(play > value + half, [Assign(play, value + half)])
        moved = If(play < value - half, [Assign(play, value - half)], otherwise=upper)
        program.stage(stage).advance.add(moved, cost=Operations(adds=4))

        def lead() -> Costed:
            return Costed(play - value, Operations(adds=1))

        return lambda after: p + composer.local(play, "lead", after, lead, self.target.degree)

    def _delayed(self, word: Delayed, p: Polynomial, name: str, stage: int) -> Later:
        """A ring of the last values; a straight line between two of them."""
        program, target, composer = self.program, self.target, self.composer
        if target.period is None:
            raise ValueError(
                f"A delay of {word.delay:.6g} s ({name}) cannot be exported for steps that are known only at run time: "
                "how many samples it must remember has no bound. Give a sampling_period, or leave the effect out and "
                "fit again."
            )
        whole = math.floor(word.delay / target.period + 1e-9)
        between = max(word.delay / target.period - whole, 0.0)
        between = between if between > 1e-9 else 0.0
        length = whole + (between > 0)
        if length > LONGEST_DELAY:
            raise ValueError(
                f"A delay of {word.delay:.6g} s ({name}) would need {length} values at a sampling period of "
                f"{target.period:.6g} s; {LONGEST_DELAY} is the limit of an export. Export for a longer sampling "
                "period, or leave the effect out and fit again."
            )
        given = composer.input_of(p)
        value = given.value if given else composer.formula(composer.as_one(p, name, stage).moving).value
        ring = program.member("ring", f"{value}, the last {length} samples", length)
        oldest = program.member("oldest", f"where in {ring.name} the oldest stands", kind="uint32")
        program.stage(stage).begin.loop(length, lambda j: [Assign(ring[j], value)])
        earlier, next_one = ring[oldest], oldest + Whole(1)
        step_on = Choice(next_one < Whole(length), next_one, Whole(0))
        program.store.add(Assign(earlier, value), *([Assign(oldest, step_on)] if length > 1 else []))

        def late(after: int) -> Costed:
            if not between:
                return Costed(earlier - value, Operations(adds=1))
            share = program.constant("share", between, "of a sample that the delay is longer")
            later = Costed(value if whole == 0 else ring[step_on])
            following = program.local(program.name("following"), lambda: later, after)
            lag = Bracketed(following - value) + share * (earlier - following)
            return Costed(lag, Operations.of(products=1, sums=3))

        unit = given.unit if given else ""
        return lambda after: p + composer.local(ring, "late", after, partial(late, after), unit)


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

    `program` (Program). `unit` (str): Of the reading.
    """

    def __init__(self, program: Program, unit: str):
        self.program, self.target, self.clock, self.unit = program, program.target, TimeCounter(program), unit
        self.lags = LagBank(program)
        self.atoms: list[Atom] = []
        self.bias = Polynomial({})
        self._known: dict[Hashable, int] = {}
        self.inputs: dict[int, Input] = {}
        self.words = Words(self)

    def write(self, effects: Sequence[Effect], weights: Sequence[Numbers]) -> None:
        """Write effects, and the coefficients of their columns."""
        parts = [Part(self, effect) for effect in effects]
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
            said = self.formula(Polynomial(inside), of_bias=[atom])
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

    def formula(self, p: Polynomial, of_bias: Sequence[int] | None = None) -> Said:
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
        inner = self.formula(Polynomial(inside), within)
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
            said = self.formula(moving)
            return Costed(said.value, said.cost())

        return self.local(("sum", moving.key()), name, stage, write, unit, degree) + p.constant

    def input_of(self, p: Polynomial) -> Input | None:
        """Input that a polynomial equals, apart from a constant; None where there is none."""
        alone = p.alone()
        return None if alone is None else self.inputs.get(alone)


def _located(place: Formula) -> tuple[str, int]:
    """Array (or variable) and index of a value, by which values are sorted."""
    if isinstance(place, Item) and isinstance(place.index, Whole):
        return str(place.array), place.index.value
    return str(place), 0
