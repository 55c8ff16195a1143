"""Time on the device: whole samples or whole microseconds, so that no digit is lost however long it runs."""

from __future__ import annotations

import math

from .formulas import Choice, Converted, Formula, Kept, Kind, Number, Variable, Whole, binary
from .operations import Costed, Operations
from .program import Program
from .statements import Assign, If, Raise, Statement
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
        self.counter: Kept | None = None

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
    def kind(self) -> Kind:
        """Kind of the counter."""
        return "int32" if self.bits == 32 else "int64"

    def count(self) -> Kept:
        """Read the counter: samples, or microseconds, since the origin."""
        if self.counter is None:
            what = "number of the next sample" if self.target.fixed else "microseconds"
            after_end = self.target.continues and self.target.fixed
            since = "since the last fitted row" if after_end else "since the first fitted row"
            name = "sample" if self.target.fixed else "microseconds"
            self.counter = self.program.member(name, f"{what} {since}", kind=self.kind)
            if self.target.first_count:
                self.program.init.add(Assign(self.counter, Whole(self.target.first_count, "int64")))
        return self.counter

    def seconds(self) -> Variable:
        """Read the local variable: time since the first fitted row [s]."""
        return self.program.local("seconds", self._seconds)

    def _seconds(self) -> Costed:
        target, now = self.target, Converted("number", self.count())
        if target.period is not None:
            cost = Operations(1)
            seconds = now * self.program.shared("period", target.period, "s, sampling period")
        else:
            cost = Operations(divisions=1)
            seconds = now / Number(MICROSECONDS)
        if origin := target.origin:
            seconds += self.program.shared("origin", origin, "s, first sample since the first fitted row")
        return Costed(seconds, cost)

    def reached(self, moment: float) -> Formula:
        """Condition: the time since the first fitted row is at least `moment` [s]."""
        tick = self.target.period or 1 / MICROSECONDS
        count = math.ceil((moment - self.target.origin) / tick - _ALMOST[self.target.fixed])
        limit = 2**31 - 1 if self.bits == 32 else 2**62
        return binary(self.count(), ">=", Whole(min(max(count, -limit), limit), self.kind))


def settling(program: Program, washout: float) -> None:
    """Count down the stretch after a start that is flagged [s]."""
    target = program.target
    if washout <= 0 or not target.begins:
        return
    program.flags_washout = True
    stage = program.stage(0)
    if target.period is None:
        count = math.ceil(washout * MICROSECONDS - _ALMOST[False])
        left = program.member("settling", "microseconds until the start is forgotten", kind="uint64")
        stage.begin.add(Assign(left, Whole(count, "uint64")))
        step = Variable("step_us")
        stage.advance.add(Assign(left, Choice(step < left, step, left), "-"))
        then: list[Statement] = []
    else:
        count = min(math.ceil(washout / target.period - _ALMOST[True]), 2**32 - 1)
        left = program.member("settling", "samples until the start is forgotten", kind="uint32")
        stage.begin.add(Assign(left, Whole(count, "uint32")))
        then = [Assign(left, Whole(1), "-")]
    program.store.add(If(left > Whole(0), [*then, Raise("WASHOUT")]))
