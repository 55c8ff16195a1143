"""What formulas cost: floating-point operations, counted while a program is written."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

from .formulas import Formula


@dataclass(frozen=True)
class Operations:
    """Floating-point operations of some code."""

    multiply_adds: int = 0
    """Multiplications, each with the addition that takes its product, if there is one in its statement."""
    adds: int = 0
    """Additions and subtractions beside those."""
    divisions: int = 0
    calls: int = 0
    """Calls of libm: exp, sin, ..."""

    def __add__(self, other: Operations) -> Operations:
        return Operations(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __mul__(self, times: int) -> Operations:
        return Operations(*(times * getattr(self, f.name) for f in fields(self)))

    @property
    def total(self) -> int:
        """Operations of every kind together."""
        return self.multiply_adds + self.adds + self.divisions + self.calls

    @classmethod
    def of(cls, products: int = 0, sums: int = 0, divisions: int = 0, calls: int = 0) -> Operations:
        """Operations of one statement: each product takes an addition with it, as long as there are any."""
        return cls(products, max(0, sums - products), divisions, calls)


NOTHING = Operations()


class Costed(NamedTuple):
    """A formula, and what it costs in one update."""

    value: Formula
    operations: Operations = NOTHING
