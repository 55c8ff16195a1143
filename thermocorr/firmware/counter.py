"""Time on the device: whole samples or whole microseconds, so that no digit is lost however long it runs."""

from __future__ import annotations

import math

from .language import Operations
from .program import Member, Place, Program
from .statements import CLine
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
        self.counter: Member | None = None

    @property
    def used(self) -> bool:
        """Whether an effect of time has asked."""
        return self.counter is not None

    @property
    def bits(self) -> int:
        """Width of the counter."""
        fits = self.target.period is not None and 2**31 * self.target.period > YEARS_OF_A_COUNTER * _YEAR
        return 32 if fits else 64

    @property
    def counter_type(self) -> str:
        """C type of the counter."""
        return f"int{self.bits}_t"

    def count(self) -> Member:
        """Read the counter: samples, or microseconds, since the origin."""
        if self.counter is None:
            what = "number of the next sample" if self.target.fixed else "microseconds"
            after_end = self.target.continues and self.target.fixed
            since = "since the last fitted row" if after_end else "since the first fitted row"
            name = "sample" if self.target.fixed else "microseconds"
            self.counter = self.program.member(name, f"{what} {since}", ctype=self.counter_type)
            if self.target.first_count:
                self.program.init.add(f"{self.counter} = INT64_C({self.target.first_count});")
        return self.counter

    def seconds(self) -> Place:
        """Read the local variable: time since the first fitted row [s]."""
        return self.program.local("seconds", self._seconds)

    def _seconds(self) -> CLine:
        target, now = self.target, f"({self.target.dtype}){self.count()}"
        if target.period is not None:
            cost = Operations(1)
            expression = f"{now} * {self.program.shared('period', target.period, 's, sampling period')}"
        else:
            cost = Operations(divisions=1)
            expression = f"{now} / {target.number(MICROSECONDS)}"
        if origin := target.origin:
            expression += f" + {self.program.shared('origin', origin, 's, first sample since the first fitted row')}"
        return CLine(expression, cost)

    def reached(self, moment: float) -> str:
        """C condition: the time since the first fitted row is at least `moment` [s]."""
        tick = self.target.period or 1 / MICROSECONDS
        count = math.ceil((moment - self.target.origin) / tick - _ALMOST[self.target.fixed])
        limit = 2**31 - 1 if self.bits == 32 else 2**62
        return f"{self.count()} >= INT{self.bits}_C({min(max(count, -limit), limit)})"


def settling(program: Program, washout: float) -> None:
    """Count down the stretch after a start that is flagged [s]."""
    target = program.target
    if washout <= 0 or not target.begins:
        return
    program.flags_washout = True
    if target.period is None:
        count = math.ceil(washout * MICROSECONDS - _ALMOST[False])
        left = program.member("settling", "microseconds until the start is forgotten", ctype="uint64_t")
        program.stage(0).begin.add(f"{left} = UINT64_C({count});")
        program.stage(0).advance.add(f"{left} -= step_us < {left} ? step_us : {left};")
        program.store.add(f"if ({left} > 0) {{")
    else:
        count = min(math.ceil(washout / target.period - _ALMOST[True]), 2**32 - 1)
        left = program.member("settling", "samples until the start is forgotten", ctype="uint32_t")
        program.stage(0).begin.add(f"{left} = UINT32_C({count});")
        program.store.add(f"if ({left} > 0) {{", f"    --{left};")
    program.store.add(f"    result.flags |= {target.macro('WASHOUT')};", "}")
