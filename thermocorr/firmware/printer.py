"""C from formulas; names and comments in C."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ..effects.expressions import Decays, Delayed, Lag, Node, Play, Previous, Trace, TraceError

DEFAULT = "thermal_bias"
_UNFIT = frozenset(
    """
    assert complex ctype errno features fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
    stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype
    atomic cnd mtx posix_spawn_file_actions posix_spawnattr pthread_attr pthread_barrier pthread_barrierattr
    pthread_cond pthread_condattr pthread_mutex pthread_mutexattr pthread_rwlock pthread_rwlockattr pthread_spin sem
    """.split()  # noqa: SIM905
)
"""Headers of C's library, which a file of that name would hide, and what has an ``..._init`` of its own there."""
_SIGNS = str.maketrans({"\u00b0": "deg", "\u03bc": "u", "\u03a9": "Ohm", "\u00df": "ss", "\u2206": "D", "\u0394": "D"})
"""Signs of units and names as ASCII has them, once others are taken apart: degree, micro, ohm, sharp s, delta."""


def comment(text: object) -> str:
    """Text for a comment, one safe line of ASCII.

    Examples
    --------
    >>> comment("Wägezelle */ [µV/°C]")
    'Wagezelle * / [uV/degC]'
    """
    parted = (c for c in unicodedata.normalize("NFKD", str(text)) if not unicodedata.combining(c))  # no accents
    plain = "".join(parted).translate(_SIGNS).encode("ascii", "replace").decode()
    plain = "".join(c if c.isprintable() else " " for c in plain).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", plain)  # ends, beginnings, trigraphs


def identifier(text: object, taken: set[str], fallback: str) -> str:
    """A new identifier close to a text."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "ignore").decode()
    name = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_") or fallback
    name = f"{fallback}_{name}" if name[0].isdigit() else name
    result, count = name, 1
    while result.lower() in taken:
        count += 1
        result = f"{name}_{count}"
    taken.add(result.lower())
    return result


def prefix(text: object) -> str:
    """The user's prefix of names and files."""
    name = identifier(text, set(), DEFAULT)
    return f"{DEFAULT}_{name}" if name.lower() in _UNFIT else name


_FUNCTIONS = {name: name for name in ("exp", "log", "log1p", "sqrt", "sin", "cos")} | {
    "maximum": "fmax",
    "minimum": "fmin",
}
MOST_KEPT = 4096
"""Samples of a delay's memory."""


def number(value: float) -> str:
    """A double in C with all digits, or ValueError.

    Examples
    --------
    >>> number(0.1), number(-3.0)
    ('0.1', '-3.0')
    """
    if not math.isfinite(value):
        raise ValueError(f"A constant of the model is {value}, which has no place in C.")
    return repr(float(value))


@dataclass
class Program:
    """The lines of one update, and what they remember."""

    columns: list[Any]
    """Recorded columns in the order in which they are given."""
    members: list[str] = field(default_factory=list)
    """Members of the struct of one course."""
    tables: list[str] = field(default_factory=list)
    """Constants outside of functions."""
    lines: list[str] = field(default_factory=list)
    shares: list[tuple[str, str]] = field(default_factory=list)
    """Name of each effect, and the expression of its share of the bias."""


def program_of(effects: Sequence[Any], weights: Sequence[Any], began: float, usual_step: float) -> Program:
    """Print the formulas of learned effects.

    `weights`: Coefficients of each one's columns. `began`: Absolute time at which the fitted record began, where
    phases of periods count [s]. `usual_step` [s]: Delays keep as many samples as twice the usual rate needs.

    Raises ValueError for an effect that has no formula, or needs later samples.
    """
    program = Program(list(dict.fromkeys(name for effect in effects for name in effect.inputs())))
    trace, columns = Trace(), []
    for effect in effects:
        columns.append(_columns(effect, trace))
    weighed = [(w, c) for own, each in zip(weights, columns, strict=True) for w, c in zip(own, each, strict=True) if w]
    used = {column.number for _, column in weighed if isinstance(column, Node)}
    for node in reversed(trace.nodes):  # operations stand behind those that they need
        if node.number in used:
            used |= {argument.number for argument in node.arguments if isinstance(argument, Node)}
    for node in trace.nodes:
        if node.number in used:
            _print(node, program, began, usual_step)
    for effect, own, coefficients in zip(effects, columns, weights, strict=True):
        terms = [f"{_value(float(w))} * {_value(c)}" for w, c in zip(coefficients, own, strict=True) if w]
        terms = [term for term in terms if not term.endswith(" * 0.0")]
        program.shares.append((comment(effect.label()), " + ".join(terms) or "0.0"))
    return program


def _columns(effect: Any, trace: Trace) -> list[Any]:
    """Columns of an effect as nodes and numbers."""
    refused = f"The effect {effect.label()!r} ({type(effect).__name__}) cannot be exported to C: "
    if not effect.says_signals():
        raise ValueError(
            f"{refused}its columns are Python code of its own. Say their formula in `signals`, or leave it out."
        )
    try:
        return [trace.checked(column) for column in effect.signals(trace)]
    except (TraceError, TypeError, AttributeError) as error:
        raise ValueError(f"{refused}{error}.") from None


def _value(argument: Any) -> str:
    """A node by its name, a number as itself."""
    if not isinstance(argument, Node):
        return number(argument) if argument >= 0 else f"({number(argument)})"
    if argument.operator == "T":
        return "in[0]"
    if argument.operator in ("seconds", "elapsed", "step"):
        return argument.operator
    if argument.operator == "item":
        word = argument.arguments[0]
        return "0.0" if isinstance(word.detail[1], Decays) else f"s->lag{word.number}[{argument.detail}]"
    return f"v{argument.number}"


def _print(node: Node, program: Program, began: float, usual_step: float) -> None:
    """Add the line of a node, and what it remembers."""
    a, me = [_value(argument) for argument in node.arguments], f"v{node.number}"
    match node.operator:
        case "T" | "seconds" | "elapsed" | "step" | "item":
            return
        case "word":
            said = _word(node, node.detail[1], a, program, usual_step)
            if not said:
                return
        case "column":
            said = f"in[{1 + program.columns.index(node.detail)}]"
        case "angle":
            turn = number(2.0 * math.pi / node.detail)
            said = f"{turn} * fmod({number(began % node.detail)} + seconds, {number(node.detail)})"
        case "neg":
            said = f"-{a[0]}"
        case "**":
            said = " * ".join([a[0]] * node.detail) or "1.0"
        case "where":
            said = f"{a[0]} != 0.0 ? {a[1]} : {a[2]}"
        case name if name in _FUNCTIONS:
            said = f"{_FUNCTIONS[name]}({', '.join(a)})"
        case operator:
            said = f"{a[0]} {operator} {a[1]}"
    program.lines.append(f"const double {me} = {said};")


def _word(node: Node, word: Any, a: list[str], program: Program, usual_step: float) -> str:
    """The call of a stateful word, or ""."""
    k = node.number
    match word:
        case Lag():
            if not word.time_constants:
                return ""
            n, taus = len(word.time_constants), ", ".join(map(number, word.time_constants))
            program.members += [f"double lag{k}[{n}];", f"double before{k};"]
            program.tables.append(f"static const double tau{k}[{n}] = {{ {taus} }}; /* s */")
            held = int(word.hold == "zero_order")
            program.lines.append(f"lag(s->lag{k}, &s->before{k}, tau{k}, {n}, {held}, {a[0]}, step, first);")
            return ""
        case Previous():
            program.members.append(f"double previous{k};")
            return f"previous(&s->previous{k}, {a[0]}, first)"
        case Play():
            program.members.append(f"double play{k};")
            return f"play(&s->play{k}, {number(word.width / 2)}, {a[0]}, first)"
        case Delayed():
            n = 2 * math.ceil(word.delay / usual_step) + 4
            if n > MOST_KEPT:
                raise ValueError(
                    f"A delay of {word.delay:.10g} s keeps {n} samples at steps of {usual_step:.10g} s, and no more "
                    f"than {MOST_KEPT} are exported to C. Fit on averages of the record."
                )
            program.members += [f"double late{k}[2][{n}];", f"int count{k};", f"int at{k};"]
            kept = f"s->late{k}[0], s->late{k}[1], &s->count{k}, &s->at{k}, {n}"
            return f"delayed({kept}, {number(word.delay)}, {a[0]}, elapsed, first, flags)"
    return ""
