"""Polynomials of what the code knows at a sample: constants are folded in double precision, before they are written.

`x.T` is ``deviation + near_t0`` to the code, a column its own deviation and a usual value, the play its lead over what
it follows and that. So T - T0, squares of a pressure, or the paper's form of a lag lose no digit in single precision,
and what several effects say of one thing becomes one coefficient.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from .formulas import Formula
from .operations import Operations


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
        """What is equal for equal polynomials."""
        return tuple(sorted(self.terms.items()))

    def alone(self) -> int | None:
        """The atom that the polynomial is, beside its constant; None where it is anything else."""
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
        """Operations of a statement that has this, and so many more products and sums."""
        return Operations.of(self.products + products, self.sums + sums)


def most_common(monomials: Mapping[Monomial, float]) -> int:
    """The atom that stands in most of the monomials; the first of several."""
    counts = Counter(atom for monomial in monomials for atom in set(monomial))
    return min(counts, key=lambda atom: (-counts[atom], atom))


def without(monomial: Monomial, atom: int) -> Monomial:
    """A monomial divided by one of its atoms."""
    at = monomial.index(atom)
    return monomial[:at] + monomial[at + 1 :]
