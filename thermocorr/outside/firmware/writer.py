"""Header and source from a finished program."""

from __future__ import annotations

import re

from .clock import Clock
from .language import Operations, comment, count_operations
from .program import BYTES, Constant, Line, Member, Program

FLAGS = (
    ("NO_TEMPERATURE", "temperature missing or not finite: the last good one was taken"),
    ("NO_COLUMN", "a recorded column missing or not finite: its last good value was taken"),
    ("NO_READING", "reading missing or not finite: no corrected reading"),
    ("WASHOUT", "the lags have not yet forgotten an unknown start"),
    ("OUTSIDE_RANGE", "temperature outside the fitted range: the bias is extrapolated"),
    ("NOT_STARTED", "no sample with all inputs yet: nothing is corrected"),
    ("BAD_STEP", "step of zero or longer than 31 years: the sample was left out"),
)
LONGEST_STEP_US = 10**15
_LARGEST_INPUT = 1e12


class Source:
    """Texts of `<name>.h` and `<name>.c`, and what an update costs."""

    def __init__(self, program: Program, clock: Clock, provenance: list[str], limits: tuple[float, float]):
        self.program, self.clock, self.provenance = program, clock, provenance
        self.target = program.target
        self.limits = limits
        self._frame: list[Line] = []
        self.bias_constant = program.constant("bias_at_reference", program.bias_constant, "sum of all constant terms")
        self.source = self._source()

    # ------------------------------------------------------------------------------------------------ the state

    def members(self) -> list[Member]:
        """Members of the state, those of eight bytes first, so that nothing is lost between them."""
        program, T = self.program, self.target.dtype
        members = [Member(T, "temperature", None, "at the last sample"), *program.members]
        if program.columns:
            members.insert(1, Member(T, "column", len(program.columns), "recorded columns at the last sample"))
        members.append(Member("uint32_t", "started", None, "0 until the first usable sample"))
        return sorted(members, key=lambda member: -BYTES[member.ctype])

    @property
    def state_bytes(self) -> int:
        """Size of the state, padded at its end."""
        members = self.members()
        widest = max(BYTES[member.ctype] for member in members)
        return -(-sum(member.size for member in members) // widest) * widest

    @property
    def constant_bytes(self) -> int:
        """Constants and tables; small helpers and code come on top."""
        return BYTES[self.target.dtype] * sum(len(constant.values) for constant in self.program.constants)

    @property
    def operations(self) -> Operations:
        """Of one update, counted in its statements; the larger number of each kind where there are two branches."""
        lines = [*self._frame, *self.program.locals]
        for section in ("advance", "output"):
            lines += self.program.lines.get(section, [])  # type: ignore[call-overload]
        return sum((line.operations for line in lines), Operations())

    # ------------------------------------------------------------------------------------------------ the header

    def flags(self) -> list[tuple[str, int, str]]:
        """Flags that this program can raise: name, bit, meaning."""
        absent = set() if self.program.columns else {"NO_COLUMN"}
        if self.target.fixed:
            absent.add("BAD_STEP")
        return [(name, 1 << i, text) for i, (name, text) in enumerate(FLAGS) if name not in absent]

    def header(self) -> str:
        """Text of the header."""
        t, T = self.target, self.target.dtype
        flags = [f"#define {t.macro(name)} {bit}u /* {text} */" for name, bit, text in self.flags()]
        columns = [
            f"    {t.macro('COLUMN_' + name)} = {i}, /* {comment(column)} */"
            for i, (column, name) in enumerate(self.program.columns.items())
        ]
        if columns:
            columns = ["enum {", *columns, f"    {t.macro('COLUMNS')} = {len(columns)}", "};", ""]
        members = [
            f"    {m.ctype} {m.name}{'' if m.length is None else f'[{m.length}]'}; /* {comment(m.comment)} */"
            for m in self.members()
        ]
        guard = t.macro("H")
        return "\n".join(
            [
                "/*",
                *(f" * {comment(line)}".rstrip() for line in self.provenance),
                " */",
                f"#ifndef {guard}",
                f"#define {guard}",
                "",
                "#include <stdint.h>",
                "",
                "#ifdef __cplusplus",
                'extern "C" {',
                "#endif",
                "",
                *flags,
                "",
                *columns,
                "typedef struct {",
                *members,
                f"}} {t.name}_state;",
                "",
                f"#define {t.macro('STATE_BYTES')} {self.state_bytes}u",
                "",
                "typedef struct {",
                f"    {T} bias;      /* what temperature and the other causes add to the reading, its unit */",
                f"    {T} corrected; /* reading - bias, eq. (24) */",
                "    uint32_t flags; /* why the result deserves no trust; 0: it does */",
                f"}} {t.name}_result;",
                "",
                *self._documentation(),
                f"{self._init_signature()};",
                "",
                f"{self._update_signature()};",
                "",
                "#ifdef __cplusplus",
                "}",
                "#endif",
                "",
                "#endif",
                "",
            ]
        )

    def _documentation(self) -> list[str]:
        t = self.target
        said = ["/* Call init once, then update for every sample, also where an input is missing (NaN)."]
        if self.clock.used and not t.continues:
            unit = f"samples of {t.period:.10g} s" if t.fixed else "microseconds"
            first = "first sample" if t.fixed else "call of init, from which the first step counts"
            said.append(f" * start: {unit} from the first fitted row to the {first}.")
        if not t.fixed:
            said.append(" * step_us: microseconds since the update before.")
        if self.program.columns:
            said.append(" * columns: recorded columns in the order of the enum above, in their fitted units.")
        said[-1] += " */"
        return said

    def _init_signature(self) -> str:
        start = f", {self.clock.counter_type} start" if self.clock.used and not self.target.continues else ""
        return f"void {self.target.name}_init({self.target.name}_state *s{start})"

    def _update_signature(self) -> str:
        name, T = self.target.name, self.target.dtype
        step = "" if self.target.fixed else "uint64_t step_us, "
        columns = f", const {T} *columns" if self.program.columns else ""
        return f"{name}_result {name}_update({name}_state *s, {step}{T} temperature, {T} reading{columns})"

    # ------------------------------------------------------------------------------------------------ the source

    def _source(self) -> str:
        body = [*self._init(), "", *self._update()]
        text = "\n".join(body)
        helpers = [helper for helper, _ in self.program.helpers.values()]
        math = bool(re.search(r"\b(?:sin|cos|exp|expm1|log1p)f?\(", text + "".join(helpers)))
        largest = "FLT_MAX" if self.target.single else "DBL_MAX"
        return "\n".join(
            [
                f"/* Made by thermocorr; see {self.target.name}.h. */",
                f'#include "{self.target.name}.h"',
                "",
                "#include <float.h>",
                *(["#include <math.h>"] if math else []),
                "",
                "#ifdef __FAST_MATH__",
                "#error Rounding is carried on purpose and missing inputs are told by comparisons: no -ffast-math",
                "#endif",
                "",
                *(self._declare(constant) for constant in self.program.constants),
                "",
                f"static int is_within({self.target.dtype} value, {self.target.dtype} limit)",
                "{",
                "    return value >= -limit && value <= limit; /* false for NaN */",
                "}",
                "",
                *helpers,
                text.replace("LARGEST", largest),
                "",
            ]
        )

    def _declare(self, constant: Constant) -> str:
        numbers = [self.target.number(value) for value in constant.values]
        T, said = self.target.dtype, comment(constant.comment)
        if not constant.table:
            return f"static const {T} {constant.name} = {numbers[0]}; /* {said} */"
        rows = [", ".join(numbers[i : i + 4]) for i in range(0, len(numbers), 4)]
        inside = ",\n    ".join(rows)
        return f"static const {T} {constant.name}[{len(numbers)}] = {{ /* {said} */\n    {inside}\n}};"

    def _init(self) -> list[str]:
        t, zero = self.target, self.target.number(0.0)
        lines = []
        for m in self.members():
            value = zero if m.ctype == t.dtype else "0"
            if m.length is None:
                lines.append(f"    s->{m.name} = {value};")
            else:
                lines += [f"    for (int j = 0; j < {m.length}; ++j) {{", f"        s->{m.name}[j] = {value};", "    }"]
        if self.clock.used and not t.continues:
            lines.append(f"    {self.clock.counter} = start;")
        lines += [f"    {text}" for text in self.program.texts("init")]
        if t.continues:
            lines.append("    s->started = 1;")
        return [self._init_signature(), "{", *lines, "}"]

    def _update(self) -> list[str]:
        t, p = self.target, self.program
        body = [f"{t.name}_result result;", f"{t.dtype} bias = {self.bias_constant};"]
        sections = {name: p.texts(name) for name in ("begin", "advance", "output", "store")}  # type: ignore[arg-type]
        everything = "\n".join([*(line.text for line in p.locals), *(x for s in sections.values() for x in s)])
        both = bool(sections["begin"] or sections["advance"])
        if both:
            body.append("const int first = s->started == 0;")
        body += ["", *self._inputs(), "", *self._first(), ""]
        if re.search(r"\bstep\b", everything):
            self._say(body, f"const {t.dtype} step = ({t.dtype})step_us / {t.number(1e6)};")
        body += [line.text for line in p.locals]
        if sections["begin"]:
            body += ["if (first) {", *(f"    {x}" for x in sections["begin"])]
            body += ["} else {", *(f"    {x}" for x in sections["advance"]), "}"] if sections["advance"] else ["}"]
        elif sections["advance"]:
            body += ["if (!first) {", *(f"    {x}" for x in sections["advance"]), "}"]
        low, high = (t.number(value) for value in self.limits)
        body += ["", *sections["output"], ""]
        body += [f"if (temperature < {low} || temperature > {high}) {{"]
        body += [f"    result.flags |= {t.macro('OUTSIDE_RANGE')};", "}"]
        body += [*sections["store"], "s->temperature = temperature;"]
        if p.columns:
            body += [f"for (int j = 0; j < {len(p.columns)}; ++j) {{", "    s->column[j] = column[j];", "}"]
        body += [*self._tick(), "result.bias = bias;"]
        self._say(body, "result.corrected = reading - bias;")
        body.append("return result;")
        return [self._update_signature(), "{", *(f"    {line}" if line else "" for line in body), "}"]

    def _say(self, body: list[str], text: str) -> None:
        body.append(text)
        self._frame.append(Line(text, count_operations(text)))

    def _tick(self) -> list[str]:
        if not (self.clock.used and self.target.fixed):
            return []
        largest = self.clock.counter_type.replace("_t", "_max").upper()
        return [f"if ({self.clock.counter} < {largest}) {{", f"    ++{self.clock.counter};", "}"]

    def _limit(self, power: int) -> str:
        largest = 1e37 if self.target.single else 1e300
        return self.target.number(float(f"{min(_LARGEST_INPUT, largest ** (1 / power)):.3g}"))

    def _inputs(self) -> list[str]:
        t, p = self.target, self.program
        lines = ["result.flags = 0;"]
        if not t.fixed:
            lines += [f"if (step_us == 0 || step_us > UINT64_C({LONGEST_STEP_US})) {{", "    step_us = 0;"]
            lines += ["    if (s->started) {", f"        result.flags |= {t.macro('BAD_STEP')};"]
            lines += ["        temperature = s->temperature;", "    }", "}"]
            if self.clock.used:
                lines.append(f"{self.clock.counter} += (int64_t)step_us;")
        lines += [f"if (!is_within(temperature, {self._limit(p.temperature_power)})) {{"]
        lines += [f"    result.flags |= {t.macro('NO_TEMPERATURE')};", "    temperature = s->temperature;", "}"]
        if p.columns:
            n = len(p.columns)
            lines += [f"{t.dtype} column[{n}];", f"for (int j = 0; j < {n}; ++j) {{", "    column[j] = columns[j];"]
            bad_step = "" if t.fixed else f" || (result.flags & {t.macro('BAD_STEP')}) != 0"
            lines += [f"    if (!is_within(column[j], {self._limit(p.column_power)}){bad_step}) {{"]
            if t.fixed:
                lines += [f"        result.flags |= {t.macro('NO_COLUMN')};"]
            else:
                lines += [f"        result.flags |= (result.flags & {t.macro('BAD_STEP')}) != 0 ? 0 : {t.macro('NO_COLUMN')};"]
            lines += ["        column[j] = s->column[j];", "    }", "}"]
        lines += ["if (!is_within(reading, LARGEST)) {", f"    result.flags |= {t.macro('NO_READING')};", "}"]
        return lines

    def _first(self) -> list[str]:
        t, p = self.target, self.program
        missing = t.macro("NO_TEMPERATURE") + (f" | {t.macro('NO_COLUMN')}" if p.columns else "")
        missing = f"({missing})" if p.columns else missing
        lines = ["if (s->started == 0) {", f"    if ((result.flags & {missing}) != 0) {{"]
        lines += [f"        result.flags |= {t.macro('NOT_STARTED')};"]
        lines += [f"        {line}" for line in self._tick()]
        lines += [f"        result.bias = {t.number(0.0)};", "        result.corrected = reading;"]
        lines += ["        return result;", "    }", "    s->started = 1;", "    s->temperature = temperature;"]
        if p.columns:
            lines += [f"    for (int j = 0; j < {len(p.columns)}; ++j) {{", "        s->column[j] = column[j];", "    }"]
        return [*lines, "}"]
