"""C99: how statements, formulas and names are written in it, and the texts of its three files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from . import statements as formulas
from . import statements as statements
from .finished import Firmware
from .frame import starting, updating
from .program import Constant
from .selftest import SAMPLES, Trial
from .statements import Formula, Helper, Kind, Statement
from .target import Dtype, one_line

_SIGNS = {"or": "||", "not": "!"}
"""Operators that C calls otherwise."""
_FAST = (
    "#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)",
    "#error Roundings are carried on and missing inputs told by comparisons: build without fast mathematics",
    "#endif",
)


def number(value: float, dtype: Dtype) -> str:
    """A constant in C that reads back as the same float (9 digits) or double (17 digits).

    Raises ValueError for a number that the type cannot hold.
    """
    value = float(value)
    if dtype == "double":
        text = f"{value:.17g}"
        held = np.isfinite(value)
    else:
        with np.errstate(over="ignore", under="ignore"):
            single = np.float32(value)
        text = f"{single:.9g}"
        smallest = float(np.finfo(np.float32).tiny)
        held = bool(np.isfinite(single)) and (value == 0.0 or abs(value) >= smallest)
    if not held:
        raise ValueError(f"The constant {value!r} has no place in a C {dtype}. Export with dtype='double'.")
    if not any(mark in text for mark in ".e"):
        text += ".0"
    return text + ("f" if dtype == "float" else "")


def comment(text: object) -> str:
    """Text of the user that may stand in a C comment: no comment begins or ends in it, and there is no trigraph."""
    return one_line(text, apart=[("*", "/"), ("/", "*"), ("?", "?")])


class C99:
    """The language C99: header, source and self-test.

    An export's name stands before ``_state``, ``_init`` or a flag's name, as a column's name stands behind
    ``..._COLUMN_``. So it can hit no keyword, macro or function of a library, but for those in `unfit`: a header would
    be found in the place of the library's where the include path holds its folder, and C11 and POSIX have an
    ``..._init`` of their own for the others.
    """

    title = "C"
    suffixes: tuple[str, ...] = (".c", ".h")
    keywords = frozenset(
        """
        auto break case char const continue default do double else enum extern float for goto if inline int long
        register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
        main
        """.split()  # noqa: SIM905
    )
    unfit = frozenset(
        """
        assert complex ctype errno features fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
        stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype
        atomic cnd mtx posix_spawn_file_actions posix_spawnattr pthread_attr pthread_barrier pthread_barrierattr
        pthread_cond pthread_condattr pthread_mutex pthread_mutexattr pthread_rwlock pthread_rwlockattr pthread_spin sem
        """.split()  # noqa: SIM905
    )

    def files(self, firmware: Firmware, provenance: Sequence[str], trial: Trial) -> dict[str, str]:
        """Texts of header, source and self-test by their endings."""
        text = CText(firmware)
        return {".h": text.header(provenance), ".c": text.source(), "_test.c": text.test(trial)}


class CText:
    """C of one program."""

    def __init__(self, firmware: Firmware):
        self.firmware, self.program, self.target = firmware, firmware.program, firmware.target
        self.name, self.T = self.target.name, self.target.dtype

    # -------------------------------------------------------------------------------------- formulas and statements

    def number(self, value: float) -> str:
        """A literal."""
        return number(value, self.target.dtype)

    def macro(self, name: str) -> str:
        """A name in capitals, with the export's before it."""
        return f"{self.name}_{name}".upper()

    def kind(self, kind: Kind) -> str:
        """C type of a kind of values."""
        return self.T if kind == "number" else "int" if kind == "truth" else f"{kind}_t"

    def function(self, name: str) -> str:
        """Name of a function of libm for the type of the numbers."""
        return f"{name}f" if self.target.single and name != "is_within" else name

    def formula(self, f: Formula) -> str:
        """A formula as a C expression."""
        match f:
            case formulas.Number(value):
                return self.number(value)
            case formulas.Whole(value, kind):
                return f"{kind.upper()}_C({value})" if kind else str(value)
            case formulas.Largest("number"):
                return "FLT_MAX" if self.target.single else "DBL_MAX"
            case formulas.Largest(kind):
                return f"{kind.upper()}_MAX"
            case formulas.Kept(name):
                return f"s->{name}"
            case formulas.Output(name):
                return f"*{name}"
            case formulas.Variable(name):
                return name
            case formulas.Item(array, index):
                return f"{self.formula(array)}[{self.formula(index)}]"
            case formulas.Bracketed(value):
                return f"({self.formula(value)})"
            case formulas.Unary(sign, value):
                return _SIGNS.get(sign, sign) + self.formula(value)
            case formulas.Binary(left, sign, right):
                return f"{self.formula(left)} {_SIGNS.get(sign, sign)} {self.formula(right)}"
            case formulas.Choice(condition, one, other):
                return f"{self.formula(condition)} ? {self.formula(one)} : {self.formula(other)}"
            case formulas.Call(function, arguments):
                return f"{self.function(function)}({', '.join(map(self.formula, arguments))})"
            case formulas.Converted(kind, value):
                return f"({self.kind(kind)}){self.formula(value)}"
            case formulas.Bias(outcome):
                return f"{outcome}.bias"
            case formulas.Raised(flags):
                asked = " | ".join(map(self.macro, flags))
                return f"(result.flags & {f'({asked})' if len(flags) > 1 else asked}) != 0"
        raise TypeError(f"{f!r} has no place in C")

    def statement(self, s: Statement) -> list[str]:
        """A statement as lines of C."""
        match s:
            case statements.Local(name, value, kind, note):
                return [f"const {self.kind(kind)} {name} = {self.formula(value)};{_noted(note)}"]
            case statements.Declare(name, length):
                return [f"{self.T} {name}{_length(length)};"]
            case statements.Assign(place, formulas.Whole(1), "+" | "-" as sign):
                return [f"{2 * sign}{self.formula(place)};"]
            case statements.Assign(place, value, sign, note):
                return [f"{self.formula(place)} {sign}= {self.formula(value)};{_noted(note)}"]
            case statements.If():
                return self.branch(s)
            case statements.Loop(times, body):
                return [f"for (int j = 0; j < {times}; ++j) {{", *self.inside(body), "}"]
            case statements.Scope(body):
                return ["{", *self.inside(body), "}"]
            case statements.Raise(flag, unless):
                other = f"{self.formula(formulas.Raised((unless,)))} ? 0u : " if unless else ""
                return [f"result.flags |= {other}{self.macro(flag)};"]
            case statements.Answer(bias, corrected):
                given = [f"result.bias = {self.formula(bias)};", f"result.corrected = {self.formula(corrected)};"]
                return [*given, "return result;"]
            case statements.Follow(outcome, course, inputs):
                step = "" if self.target.fixed else "step_us, "
                columns = f", {inputs} + 1" if self.program.columns else ""
                kept = "" if outcome == "result" else "const "
                call = (
                    f"{kept}{self.name}_result {outcome} = advance(&s->{course}, {step}{inputs}[0], reading{columns});"
                )
                return [call]
            case statements.Fork():
                return ["s->twin = s->now;"]
            case statements.Finish():
                return ["return result;"]
            case statements.CallHelper(helper, arguments, used):
                call = f"{helper.name}({', '.join(map(self.formula, arguments))}, &{helper.second});"
                result = f"const {self.T} {helper.gives} = " if used else "(void)"
                return [f"{self.T} {helper.second};", result + call]
        raise TypeError(f"{s!r} has no place in C")

    def branch(self, s: statements.If) -> list[str]:
        """An if statement."""
        head = [f"if ({self.formula(s.condition)}) {{{_noted(s.note)}", *self.inside(s.then)]
        if isinstance(s.otherwise, statements.If):
            first, *rest = self.branch(s.otherwise)
            return [*head, f"}} else {first}", *rest]
        return [*head, *(["} else {", *self.inside(s.otherwise)] if s.otherwise else []), "}"]

    def inside(self, body: Iterable[Statement]) -> list[str]:
        """Statements within brackets."""
        return [f"    {line}" for statement in body for line in self.statement(statement)]

    # ----------------------------------------------------------------------------------------------------- the source

    def source(self) -> str:
        """Text of `<name>.c`."""
        T, name = self.T, self.name
        within = f"static int is_within({T} value, {T} limit)"
        result = [f"    {name}_result result;", f"    {T} bias = {self.formula(self.firmware.bias_constant)};"]
        checks, *sections = updating(self.firmware)
        first, *gates = self.firmware.guard.updating()
        start = f", {self.kind(self.firmware.clock.kind)} start" if self.firmware.asks_start else ""
        return _text(
            [f"/* Made by thermocorr; see {name}.h. */", f'#include "{name}.h"'],
            ["#include <float.h>", *(["#include <math.h>"] if self.program.calls_functions else [])],
            _FAST,
            map(self.constant, self.program.constants),
            [within, "{", "    return value >= -limit && value <= limit; /* false for NaN */", "}"],
            *map(self.helper, self.program.helpers.values()),
            [f"static void begin({self.name}_course *s{start})", "{", *self.inside(starting(self.firmware)), "}"],
            ["/* One course of the inputs goes on by a sample. */", self.advance_signature(), "{", *result],
            ["    result.flags = 0;", *self.inside(checks)],
            *map(self.inside, sections[:-1]),
            [*self.inside(sections[-1]), "}"],
            [
                self.init_signature(), "{",
                f"    begin(&s->now{', start' if self.firmware.asks_start else ''});", "    s->twin = s->now;",
                *self.inside(self.firmware.guard.starting()), "}",
            ],
            [self.update_signature(), "{", *self.inside(first)],
            *map(self.inside, gates[:-1]),
            [*self.inside(gates[-1]), "}"],
        )  # fmt: skip

    def constant(self, constant: Constant) -> str:
        """Definition of a constant or table."""
        numbers, said = list(map(self.number, constant.values)), comment(constant.comment)
        if not constant.table:
            return f"static const {self.T} {constant.name} = {numbers[0]}; /* {said} */"
        head = f"static const {self.T} {constant.name}[{len(numbers)}] = {{ /* {said} */\n    "
        return f"{head}{_rows(numbers, 4)}\n}};"

    def helper(self, helper: Helper) -> list[str]:
        """Definition of a static function, which writes its second result to where a pointer shows."""
        arguments = [f"{self.T} {name}" for name in (*helper.arguments, f"*{helper.second}")]
        head = f"static {self.T} {helper.name}({', '.join(arguments)})"
        first, then = map(self.inside, helper.body)
        return [head, "{", *first, "", *then, f"    return {helper.gives};", "}"]

    def init_signature(self) -> str:
        """Signature of the function that starts a device."""
        start = f", {self.kind(self.firmware.clock.kind)} start" if self.firmware.asks_start else ""
        return f"void {self.name}_init({self.name}_state *s{start})"

    def advance_signature(self) -> str:
        """Signature of the function that goes on with one course of the inputs."""
        public = self.update_signature()
        return "static " + public.replace(f"{self.name}_update({self.name}_state ", f"advance({self.name}_course ")

    def update_signature(self) -> str:
        """Signature of the function that takes a sample."""
        step = "" if self.target.fixed else "uint64_t step_us, "
        columns = f", const {self.T} *columns" if self.program.columns else ""
        inputs = f"{self.name}_state *s, {step}{self.T} temperature, {self.T} reading{columns}"
        return f"{self.name}_result {self.name}_update({inputs})"

    # ----------------------------------------------------------------------------------------------------- the header

    def header(self, provenance: Sequence[str]) -> str:
        """Text of `<name>.h`."""
        T, period, guard, columns = self.T, self.target.period, self.macro("H"), self.program.columns
        named = [
            f"    {self.macro('COLUMN_' + name)} = {i}, /* {comment(column)} */"
            for i, (column, name) in enumerate(columns.items())
        ]
        enum = ["enum {", *named, f"    {self.macro('COLUMNS')} = {len(columns)}", "};"]
        members, gates = (
            [f"    {self.kind(m.kind)} {m.name}{_length(m.length)}; /* {comment(m.comment)} */" for m in some]
            for some in (self.firmware.members(), self.firmware.guard.members())
        )
        said = [f" * {comment(line)}".rstrip() for line in provenance]
        return _text(
            ["/*", *said, " */", f"#ifndef {guard}", f"#define {guard}"],
            ["#include <stdint.h>"],
            ["#ifdef __cplusplus", 'extern "C" {', "#endif"],
            [f"#define {self.macro(name)} {bit}u /* {text} */" for name, bit, text in self.firmware.flags()],
            *([enum] if columns else []),
            ["typedef struct {", *members, f"}} {self.name}_course;"],
            [
                "typedef struct {",
                f"    {self.name}_course now;",
                f"    {self.name}_course twin; /* with other values in the place of doubtful ones */",
                *gates,
                f"}} {self.name}_state;",
            ],
            [
                f"#define {self.macro('STATE_BYTES')} {self.firmware.state_bytes}u",
                *([f"#define {self.macro('PERIOD_S')} {self.number(period)} /* between samples */"] if period else []),
            ],
            [
                "typedef struct {",
                f"    {T} bias;      /* what temperature and the other causes add to the reading, its unit */",
                f"    {T} corrected; /* reading - bias, eq. (24) */",
                "    uint32_t flags; /* why the result deserves no trust; 0: it does */",
                f"}} {self.name}_result;",
            ],
            [self.documentation(), f"{self.init_signature()};"],
            [f"{self.update_signature()};"],
            ["#ifdef __cplusplus", "}", "#endif"],
            ["#endif"],
        )

    def documentation(self) -> str:
        """Comment on how to call the two functions."""
        t = self.target
        said = [
            "Call init once, then update for every sample, also where an input is missing (NaN): its last good value",
            "stands in. After a long outage, or when the device was moved, call init again.",
        ]
        if self.firmware.asks_start:
            unit = f"samples of {t.period:.10g} s" if t.fixed else "microseconds"
            first = "first sample" if t.fixed else "call of init, from which the first step counts"
            said.append(f"start: {unit} from the first fitted row to the {first}.")
            if t.history.kind.startswith("datetime"):
                said.append(f"First fitted row: {t.absolute_zero():.6f} s since 1970 (UTC, or local without a zone).")
        if not t.fixed:
            said.append("step_us: microseconds since the update before.")
            if t.longest_step is not None:
                gap = f"{t.longest_step:.10g} s"
                said.append(f"A step longer than {gap} starts a new segment, as max_gap did in the fit.")
        if self.program.columns:
            said.append("columns: recorded columns in the order of the enum above, in their fitted units.")
        return "/* " + "\n * ".join(said) + " */"

    # -------------------------------------------------------------------------------------------------- the self-test

    def test(self, trial: Trial) -> str:
        """Text of `<name>_test.c`; its exit status is 0 where bias, correction, flags and the state's size agree."""
        T, given, columns = self.T, trial.given, self.program.columns
        temperatures = [f"({T})NAN" if v is None else self.number(v) for v in given.measured()]
        recorded = [self.number(given.columns[name][k]) for k in range(SAMPLES) for name in columns]
        update = ["&state", *([] if self.target.fixed else ["steps[k]"]), "temperatures[k]", "reading"]
        update += [f"columns + k * {self.macro('COLUMNS')}"] if columns else []
        steps = [f"UINT64_C({us})" for us in given.microseconds]
        tables = [
            _table(T, "temperatures", temperatures),
            *([_table(T, "columns", recorded)] if columns else []),
            *([] if self.target.fixed else [_table("uint64_t", "steps", steps)]),
            _table(T, "biases", list(map(self.number, trial.bias))),
            _table("uint32_t", "flags", [f"{flag}u" for flag in trial.flags]),
        ]
        return _text(
            [
                f"/* Self-test: build with {self.name}.c and run; status 0 is a pass. The bias was computed in Python.",
                " * Made by thermocorr. */",
                f'#include "{self.name}.h"',
            ],
            ["#include <math.h>", "#include <stdio.h>"],
            [f"#define SAMPLES {SAMPLES}"],
            tables,
            [
                "int main(void)",
                "{",
                f"    const {T} reading = {self.number(1.0)};",
                f"    const {T} tolerance = {self.number(trial.tolerance)};",
                f"    {T} largest = {self.number(0.0)};",
                "    int wrong = 0;",
                f"    {self.name}_state state;",
            ],
            [
                f"    {self.name}_init(&state{', 0' if self.firmware.asks_start else ''});",
                "    for (int k = 0; k < SAMPLES; ++k) {",
                f"        const {self.name}_result result = {self.name}_update({', '.join(update)});",
                f"        const {T} error = {self.function('fabs')}(result.bias - biases[k]);",
                "        largest = error > largest ? error : largest;",
                "        if (!(error <= tolerance) || result.flags != flags[k] ||",
                "            result.corrected < reading - result.bias || result.corrected > reading - result.bias) {",
                "            ++wrong;",
                "        }",
                "    }",
                f"    if (sizeof(state) > {self.macro('STATE_BYTES')}) {{",
                "        ++wrong;",
                "    }",
                f'    printf("{self.name}: %s, %d of %d samples wrong, largest error %.3g, allowed %.3g\\n",',
                '           wrong ? "FAILED" : "passed", wrong, SAMPLES, (double)largest, (double)tolerance);',
                "    return wrong ? 1 : 0;",
                "}",
            ],
        )


def _text(*paragraphs: Iterable[str]) -> str:
    """Lines in paragraphs, as the text of a file."""
    return "\n\n".join(map("\n".join, paragraphs)) + "\n"


def _noted(note: str) -> str:
    return f" /* {note} */" if note else ""


def _length(length: int | None) -> str:
    return "" if length is None else f"[{length}]"


def _rows(numbers: list[str], width: int) -> str:
    return ",\n    ".join(", ".join(numbers[i : i + width]) for i in range(0, len(numbers), width))


def _table(ctype: str, name: str, numbers: list[str]) -> str:
    return f"static const {ctype} {name}[{len(numbers)}] = {{\n    {_rows(numbers, 6)}\n}};"
