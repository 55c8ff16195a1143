"""A second language for exports, as an example: plain Python. All that is particular to it stands in this file."""

import keyword

from thermocorr.firmware import statements as f
from thermocorr.firmware import statements as s
from thermocorr.firmware.frame import starting, updating
from thermocorr.firmware.target import one_line

RAISED = "flags & ({}) != 0"
WITHIN = """\
def is_within(value, limit):
    return -limit <= value <= limit
"""
SELF_TEST = """\
def self_test():
    \"\"\"Largest error of the bias, and the number of samples that are wrong.\"\"\"
    device, largest, wrong = Device({start}), 0.0, 0
    for given, bias, flags in SAMPLES:
        found, corrected, raised = device.update(*given)
        error = abs(found - bias)
        largest = max(largest, error)
        wrong += not error <= TOLERANCE or raised != flags or corrected != given[{reading}] - found
    return largest, wrong
"""


class Python:
    """Numbers are of double precision; whole numbers have no end, and wrap nowhere."""

    title = "Python"
    suffixes = (".py",)
    keywords = frozenset(word.lower() for word in (*keyword.kwlist, "self", "math", "int", "float", "range"))
    unfit = frozenset({"math"})

    def files(self, firmware, provenance, trial):
        if firmware.target.single:
            raise ValueError("Python has no single precision. Export with dtype='double'.")
        p, start = firmware.program, ["start"] if firmware.asks_start else []
        arguments = [] if firmware.target.fixed else ["step_us"]
        arguments += ["temperature", "reading", *(["columns"] if p.columns else [])]
        self.step, self.columns = "" if firmware.target.fixed else "step_us, ", bool(p.columns)
        lines = [f"# {one_line(line)}" for line in provenance]
        lines += ["import copy", "import math", ""]
        lines += [f"{name} = {bit}  # {text}" for name, bit, text in firmware.flags()]
        lines += [f"{c.name} = {self.constant(c)}  # {one_line(c.comment)}" for c in p.constants]
        lines += ["", WITHIN]
        for helper in p.helpers.values():
            lines += [f"def {helper.name}({', '.join(helper.arguments)}):"]
            lines += [line for section in helper.body for line in self.inside(section)]
            lines += [f"    return {helper.gives}, {helper.second}", ""]
        for name, members, begin, sections, first in (
            (
                "Course",
                firmware.members(),
                starting(firmware),
                updating(firmware),
                f"bias, flags = {firmware.bias_constant}, 0",
            ),
            ("Device", firmware.guard.members(), firmware.guard.starting(), firmware.guard.updating(), "flags = 0"),
        ):
            lines += [f"class {name}:", f"    def __init__({', '.join(['self', *start])}):"]
            lines += [f"        self.now = Course({', '.join(start)})"] if name == "Device" else []
            lines += [f"        self.{m.name} = [0] * {m.length}" for m in members if m.length]
            lines += [f"    {line}" for line in self.inside(begin)]
            lines += ["", f"    def update({', '.join(['self', *arguments])}):", f"        {first}"]
            lines += [f"    {line}" for section in sections for line in self.inside(section)]
        return {".py": "\n".join([*lines, "", *self.self_test(firmware, trial), ""])}

    def self_test(self, firmware, trial):
        given, fixed = trial.given, firmware.target.fixed
        columns = list(zip(*given.columns.values(), strict=True)) or [()] * len(trial.bias)
        rows = zip(given.microseconds, given.measured(), columns, trial.bias, trial.flags, strict=True)
        lines = [f"TOLERANCE = {trial.tolerance!r}", "SAMPLES = ["]
        for step, temperature, recorded, bias, flags in rows:
            inputs = [*([] if fixed else [str(step)]), "math.nan" if temperature is None else repr(temperature), "1.0"]
            inputs += [f"{list(map(float, recorded))}"] if recorded else []
            lines.append(f"    (({', '.join(inputs)}), {float(bias)!r}, {flags}),")
        start = "0" if firmware.asks_start else ""
        return [*lines, "]", "", SELF_TEST.format(start=start, reading=1 if fixed else 2)]

    def constant(self, constant):
        return repr(list(constant.values) if constant.table else constant.values[0])

    def formula(self, formula):
        text = self.formula
        match formula:
            case f.Number(value) | f.Whole(value):
                return repr(value)
            case f.Largest("number"):
                return repr(1.7976931348623157e308)
            case f.Largest(kind):
                return repr(2 ** (int(kind.lstrip("uint")) - 1) - 1)
            case f.Kept(name):
                return f"self.{name}"
            case f.Variable(name) | f.Output(name):
                return name
            case f.Item(array, index):
                return f"{text(array)}[{text(index)}]"
            case f.Bracketed(value):
                return f"({text(value)})"
            case f.Unary(sign, value):
                return f"{sign} {text(value)}"
            case f.Binary(left, sign, right):
                return f"{text(left)} {sign} {text(right)}"
            case f.Choice(condition, one, other):
                return f"{text(one)} if {text(condition)} else {text(other)}"
            case f.Call(function, arguments):
                name = function if function == "is_within" else f"math.{function}"
                return f"{name}({', '.join(map(text, arguments))})"
            case f.Converted(kind, value):
                return f"{'float' if kind == 'number' else 'int'}({text(value)})"
            case f.Bias(outcome):
                return f"{outcome}[0]"
            case f.Raised(flags):
                return f"flags & ({' | '.join(flags)}) != 0"

    def statement(self, statement):
        text = self.formula
        match statement:
            case s.Local(name, value):
                return [f"{name} = {text(value)}"]
            case s.Declare(name, length):
                return [f"{name} = [0.0] * {length}"] if length else []
            case s.Assign(place, value, sign):
                return [f"{text(place)} {sign}= {text(value)}"]
            case s.If(condition, then, otherwise):
                rest = [otherwise] if isinstance(otherwise, s.If) else otherwise
                branch = ["else:", *self.inside(rest)] if rest else []
                return [f"if {text(condition)}:", *self.inside(then), *branch]
            case s.Loop(times, body):
                return [f"for j in range({times}):", *self.inside(body)]
            case s.Scope(body):
                return [line for inner in body for line in self.statement(inner)]
            case s.Raise(flag, unless):
                return [f"flags |= 0 if flags & {unless} else {flag}" if unless else f"flags |= {flag}"]
            case s.Answer(bias, corrected):
                return [f"return {text(bias)}, {text(corrected)}, flags"]
            case s.Follow(outcome, course, inputs):
                columns = f", {inputs}[1:]" if self.columns else ""
                lines = [f"{outcome} = self.{course}.update({self.step}{inputs}[0], reading{columns})"]
                return [*lines, "flags |= result[2]"] if outcome == "result" else lines
            case s.Fork():
                return ["self.twin = copy.deepcopy(self.now)"]
            case s.Finish():
                return ["return *result[:2], flags"]
            case s.CallHelper(helper, arguments):
                given = ", ".join(map(text, arguments))
                return [f"{helper.gives}, {helper.second} = {helper.name}({given})"]

    def inside(self, statements):
        return [f"    {line}" for statement in statements for line in self.statement(statement)]
