"""An effect's formula as symbols, to write other code from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from .signals import Numbers, Signals


class TraceError(TypeError):
    """A formula that no symbols can express."""


@dataclass(frozen=True)
class Word:
    """A word with a memory, as an effect asked for it."""

    value: Any
    """What it follows: a `Node` or a number."""

    @property
    def memory(self) -> float:
        """Time for which an unknown start matters [s]."""
        return 0.0


@dataclass(frozen=True)
class Lag(Word):
    """Lags of a value, as `Signals.lag` has them."""

    time_constants: tuple[float, ...]
    hold: str

    @property
    def memory(self) -> float:
        """The longest time constant [s]."""
        return max(self.time_constants, default=0.0)


@dataclass(frozen=True)
class Previous(Word):
    """The value before, as `Signals.previous` has it."""


@dataclass(frozen=True)
class Play(Word):
    """Play, as `Signals.play` has it."""

    width: float


@dataclass(frozen=True)
class Delayed(Word):
    """A delayed value, as `Signals.delayed` has it."""

    delay: float

    @property
    def memory(self) -> float:
        """The delay [s]."""
        return self.delay


@dataclass(frozen=True)
class Decays(Word):
    """Start-up decays; they have no state but the clock."""

    of_segments: tuple[tuple[int, tuple[float, ...]], ...]


OF_TIME = ("seconds", "elapsed", "step", "angle")
"""Operators of inputs that only a clock tells."""


def _both(name: str) -> tuple[Any, Any]:
    """Both operand orders of a `Node` operator."""
    return lambda one, other: one.trace.node(name, one, other), lambda one, other: one.trace.node(name, other, one)


class Node:
    """One operation: an `operator` and its arguments.

    Operators: ``T seconds elapsed step`` (inputs), ``column`` (its name is `detail`), ``angle`` (`detail`: the period),
    ``+ - * / ** neg``, comparisons, ``exp log log1p sqrt sin cos maximum minimum where``, ``word`` (`detail`: a
    `Word`), and ``item`` (`detail`: which of a word's columns).
    """

    __slots__ = ("arguments", "detail", "number", "operator", "trace")
    __array_ufunc__ = None
    """NumPy's numbers leave the arithmetic to this class."""

    def __init__(self, trace: Trace, number: int, operator: str, arguments: tuple[Any, ...], detail: Any):
        self.trace, self.number = trace, number
        self.operator, self.arguments, self.detail = operator, arguments, detail

    __add__, __radd__ = _both("+")
    __sub__, __rsub__ = _both("-")
    __mul__, __rmul__ = _both("*")
    __truediv__, __rtruediv__ = _both("/")
    __lt__, __gt__ = _both("<")[0], _both(">")[0]
    __le__, __ge__ = _both("<=")[0], _both(">=")[0]
    __eq__, __ne__ = _both("==")[0], _both("!=")[0]
    __hash__ = object.__hash__

    def __pow__(self, power: int) -> Any:
        if not float(power).is_integer() or not 0 <= power <= 99:
            raise TraceError(
                f"powers of signals are whole numbers from 0 to 99, got {power!r}: use x.sqrt, x.exp, x.log"
            )
        return self.trace.node("**", self, detail=int(power))

    def __neg__(self) -> Any:
        return self.trace.node("neg", self)

    def __abs__(self) -> Any:
        return self.trace.node("maximum", self, -self)

    def __bool__(self) -> bool:
        raise TraceError("signals cannot decide by `if`, `and`, `max` or `min`: use x.where, x.maximum, x.minimum")


def _function(name: str) -> Any:
    """The method of a `Trace` for an elementary function."""
    return lambda trace, *arguments: trace.node(name, *arguments)


class Trace(Signals):
    """Symbols for values; equal operations share a node."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.words: list[Word] = []
        """In the order in which the effect asks for them, which is that of its states."""
        self._known: dict[Any, Node] = {}
        self.T, self.seconds, self.elapsed, self.step = map(self.node, ("T", "seconds", "elapsed", "step"))

    def node(self, operator: str, *arguments: Any, detail: Any = None) -> Node:
        """The node of an operation."""
        taken = tuple(self.checked(argument) for argument in arguments)
        key = (operator, *(arg.number if isinstance(arg, Node) else ("number", arg) for arg in taken), detail)
        if key not in self._known:
            self._known[key] = Node(self, len(self.nodes), operator, taken, detail)
            self.nodes.append(self._known[key])
        return self._known[key]

    def checked(self, argument: Any) -> Any:
        if isinstance(argument, Node):
            return argument
        try:
            return float(argument)
        except (TypeError, ValueError):
            raise TraceError(f"signals are made of numbers and other signals, got {argument!r:.60}") from None

    def __getitem__(self, column: object) -> Any:
        return self.node("column", detail=column)

    exp, log, log1p, sqrt, sin, cos = map(_function, ("exp", "log", "log1p", "sqrt", "sin", "cos"))
    maximum, minimum, where = map(_function, ("maximum", "minimum", "where"))

    def angle(self, period: float) -> Any:
        return self.node("angle", detail=float(period))

    def _word(self, word: Word) -> Node:
        if not isinstance(word, Decays):
            self.words.append(word)
        return self.node("word", *(() if word.value is None else (word.value,)), detail=(len(self.words), word))

    def _items(self, word: Node, count: int) -> list[Any]:
        return [self.node("item", word, detail=i) for i in range(count)]

    def lag(self, value: Any, time_constants: Numbers, hold: str = "first_order") -> list[Any]:
        taus = tuple(map(float, time_constants))
        return self._items(self._word(Lag(self.checked(value), taus, hold)), len(taus))

    def previous(self, value: Any) -> Any:
        return self._word(Previous(self.checked(value)))

    def play(self, value: Any, width: float) -> Any:
        return self._word(Play(self.checked(value), float(width)))

    def delayed(self, value: Any, delay: float) -> Any:
        return self._word(Delayed(self.checked(value), float(delay)))

    def decays(self, of_segments: Mapping[int, Numbers]) -> list[Any]:
        taken = tuple((key, tuple(map(float, taus))) for key, taus in of_segments.items())
        return self._items(self._word(Decays(None, taken)), sum(len(taus) for _, taus in taken))


@dataclass(frozen=True)
class Traced:
    """The expression of a learned effect."""

    columns: list[Any]
    """A `Node` or a number for each."""
    nodes: list[Node]
    words: list[Word]

    def below(self, node: Any) -> Iterator[Node]:
        """A node and all that it needs, in order."""
        needed = {node.number} if isinstance(node, Node) else set()
        for number in range(max(needed, default=-1), -1, -1):
            if number in needed:
                needed |= {arg.number for arg in self.nodes[number].arguments if isinstance(arg, Node)}
        return (self.nodes[number] for number in sorted(needed))


def traced(effect: Any) -> Traced:
    """The expression that a learned effect's `signals` says.

    Raises TraceError for an effect that computes its `columns` by Python of its own.
    """
    if not effect.says_signals():
        raise TraceError("its columns are Python code of its own")
    trace = Trace()
    try:
        columns = [trace.checked(column) for column in effect.signals(trace)]
    except (TypeError, AttributeError) as error:
        hint = "; numpy's functions are x.exp, x.sqrt, ... here" if "ufunc" in str(error) else ""
        raise TraceError(f"{error}{hint}") from None
    return Traced(columns, trace.nodes, trace.words)


def follows_temperature(effect: Any) -> bool:
    """True if an effect responds to temperature and comes to rest.

    It does for lags, hysteresis or a hinge; not for other columns, for time, or for the change since the sample before.
    """
    try:
        expression = traced(effect)
    except TraceError:
        return False
    read = {node.operator for column in expression.columns for node in expression.below(column)}
    changes = any(isinstance(word, Previous) for word in expression.words)
    return "T" in read and not changes and not read & {"column", *OF_TIME}


def words_of(effect: Any) -> list[Word] | None:
    """Stateful words of an effect; None for Python code."""
    try:
        return traced(effect).words
    except TraceError:
        return None
