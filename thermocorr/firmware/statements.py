"""Statements of C, each with what it costs; a loop is a function of its index."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from .language import Operations

NOTHING = Operations()


class CLine(NamedTuple):
    """A line of C (or an expression); `operations` is what it costs in one update."""

    text: str
    operations: Operations = NOTHING


class Index(NamedTuple):
    """Where a turn of a loop stands: a number, or that of a turn of ``j``."""

    number: int
    looped: bool = False

    def __add__(self, other: object) -> Index:
        return Index(self.number + other, self.looped) if isinstance(other, int) else NotImplemented

    def __str__(self) -> str:
        if not self.looped:
            return str(self.number)
        return f"j + {self.number}" if self.number else "j"


class Statements:
    """Statements that are run one after the other."""

    def __init__(self) -> None:
        self.lines: list[CLine] = []

    def __iter__(self) -> Iterator[CLine]:
        return iter(self.lines)

    def __bool__(self) -> bool:
        return bool(self.lines)

    @property
    def texts(self) -> list[str]:
        """The lines without their costs."""
        return [line.text for line in self.lines]

    def add(self, *statements: str, cost: Operations = NOTHING) -> None:
        """Add lines that cost so much together."""
        self.lines += [CLine(text, NOTHING if k else cost) for k, text in enumerate(statements)]

    def loop(self, times: int, turn: Callable[[Index], str | Sequence[str]], cost: Operations = NOTHING) -> None:
        """Add a loop of so many turns, of which each costs so much; one turn stands alone."""
        said = turn(Index(0, looped=times > 1))
        statements = [said] if isinstance(said, str) else said
        if times == 1:
            self.add(*statements, cost=cost)
        else:
            inside = [f"    {text}" for text in statements]
            self.add(f"for (int j = 0; j < {times}; ++j) {{", *inside, "}", cost=cost * times)
