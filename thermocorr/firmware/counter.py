"""Time on the device: whole samples or whole microseconds, so that no digit is lost however long it runs."""

from __future__ import annotations

import math

from .language import Operations
from .program import Program
from .target import MICROSECONDS

YEARS_OF_A_COUNTER = 100
_YEAR = 365.25 * 86_400.0
_ALMOST = {True: 1e-9, False: 1e-3}
"""Share of a sample (of a microsecond) by which a moment may miss it through rounding, for a fixed period or not."""


class TimeCounter:
    """Declares the counter that effects of time need, once, and gives them the time in the form they ask for."""

    def __init__(self, program: Program):
        self.program = program
        self.target = program.target
        self.counter = ""

    @property
    def used(self) -> bool:
        """Whether an effect of time has asked."""
        return bool(self.counter)

    @property
    def counter_type(self) -> str:
        """C type of the counter."""
        if self.target.period is None:
            return "int64_t"
        return "int32_t" if 2**31 * self.target.period > YEARS_OF_A_COUNTER * _YEAR else "int64_t"

    def count(self) -> str:
        """The counter: samples, or microseconds, since the origin."""
        if not self.counter:
            what = "number of the next sample" if self.target.fixed else "microseconds"
            after_end = self.target.continues and self.target.fixed
            since = "since the last fitted row" if after_end else "since the first fitted row"
            name = "sample" if self.target.fixed else "microseconds"
            self.counter = self.program.member(name, f"{what} {since}", ctype=self.counter_type)
            if self.target.first_count:
                self.program.add("init", f"{self.counter} = INT64_C({self.target.first_count});")
        return self.counter

    def seconds(self) -> str:
        """Local variable: time since the first fitted row [s]."""
        cost = Operations(1) if self.target.fixed else Operations(divisions=1)
        target, now = self.target, f"({self.target.dtype}){self.count()}"
        origin = target.origin
        if target.fixed:
            assert target.period is not None
            expression = f"{now} * {self.program.shared('period', target.period, 's, sampling period')}"
        else:
            expression = f"{now} / {target.number(MICROSECONDS)}"
        if origin:
            expression += f" + {self.program.shared('origin', origin, 's, first sample since the first fitted row')}"
        return self.program.local("seconds", expression, cost)

    def reached(self, moment: float) -> str:
        """C condition: the time since the first fitted row is at least `moment` [s]."""
        tick = self.target.period or 1 / MICROSECONDS
        count = math.ceil((moment - self.target.origin) / tick - _ALMOST[self.target.fixed])
        limit = 2**31 - 1 if self.counter_type == "int32_t" else 2**62
        return f"{self.count()} >= {'INT32_C' if limit < 2**31 else 'INT64_C'}({min(max(count, -limit), limit)})"


def settling(program: Program, washout: float) -> None:
    """Count down the stretch after a start that is flagged [s]."""
    target = program.target
    if washout <= 0 or not target.begins:
        return
    program.flags_washout = True
    if target.period is None:
        count = math.ceil(washout * MICROSECONDS - _ALMOST[False])
        left = program.member("settling", "microseconds until the start is forgotten", ctype="uint64_t")
        program.add_to_stage(0, "begin", f"{left} = UINT64_C({count});")
        program.add_to_stage(0, "advance", f"{left} -= step_us < {left} ? step_us : {left};")
        program.add("store", f"if ({left} > 0) {{")
    else:
        count = min(math.ceil(washout / target.period - _ALMOST[True]), 2**32 - 1)
        left = program.member("settling", "samples until the start is forgotten", ctype="uint32_t")
        program.add_to_stage(0, "begin", f"{left} = UINT32_C({count});")
        program.add("store", f"if ({left} > 0) {{", f"    --{left};")
    program.add("store", f"    result.flags |= {target.macro('WASHOUT')};", "}")
