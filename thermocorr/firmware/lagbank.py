"""All first-order lags of a program: those of equal input, hold and start stand in one array and are computed once.

In double precision the recursion is that of `thermocorr.equations.lags`, operation for operation. In single precision
``d = a d - g change`` would lose the answer where tau >> dt: the rounded a stands for another time constant, and a
change of d below half a unit of its last digit is lost at every sample. There the code subtracts the increment
``(1 - a) d + g change``, whose factor 1 - a keeps its own seven digits, and hands what rounding took on to the next
sample (Kahan, Communications of the ACM 8 (1965) 40): two multiply-adds and three additions for a lag.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..equations import LagState
from ..equations.lags import Hold, decay_and_gain
from .factors import lag_factors
from .language import Operations
from .program import Program
from .target import Target

COMPENSATED_FROM = 16.0
"""tau/dt from which single precision is compensated: below it, rounding adds up to less than 16 * 2^-24 = 1e-6."""


@dataclass(frozen=True)
class LagInput:
    """What a lag follows."""

    key: str
    change: str
    """Local variable: change of the input since the sample before; "" for a decay, which follows nothing."""
    unit: str


@dataclass
class Group:
    """Lags of one input."""

    source: LagInput
    hold: str
    start: str
    """"rest", or the C expression with which each lag difference starts."""
    stage: int
    ends: dict[float, float] = field(default_factory=dict)
    """Time constant [s] -> lag difference at the end of the fit."""
    array: str = ""

    def columns(self, time_constants: Sequence[float]) -> list[str]:
        """C expressions of lag differences, after the bank has been emitted."""
        order = sorted(self.ends)
        return [f"{self.array}[{order.index(float(tau))}]" for tau in time_constants]


class LagBank:
    """Collects requests, then writes one array and one loop (or two) for each group."""

    def __init__(self, program: Program):
        self.program = program
        self.groups: dict[tuple[str, str, str], Group] = {}

    def request(
        self,
        source: LagInput,
        time_constants: Sequence[float],
        hold: str = "first_order",
        start: str = "rest",
        end: LagState | None = None,
        counted_from: float = 0.0,
        stage: int = 0,
    ) -> Group:
        """Ask for lags; `end` is their state at the end of the fit, for a program that continues it.

        The C type rounds the last input, which the code counts from `counted_from`. The lagged value must not move by
        that, so the lag differences take it up.
        """
        group = self.groups.setdefault((source.key, hold, start), Group(source, hold, start, stage))
        last = 0.0 if end is None else end.temperature - counted_from
        rounded_off = last - self.program.target.held(last)
        for j, tau in enumerate(time_constants):
            group.ends[float(tau)] = 0.0 if end is None else float(end.lag_difference[j]) + rounded_off
        return group

    def emit(self, stage: int) -> None:
        """Write members and recursions of a stage."""
        for number, group in enumerate(self.groups.values()):
            taus = np.array(sorted(group.ends))
            if group.stage == stage and len(taus):
                self._emit(group, taus, "" if number == 0 else f"_{number + 1}")

    def _emit(self, group: Group, taus: np.ndarray, suffix: str) -> None:
        program, target, n = self.program, self.program.target, len(taus)
        name = "lag" if group.source.change else "decay"
        times = ", ".join(f"{tau:.6g}" for tau in taus)
        group.array = program.member(f"{name}{suffix}", f"{group.source.key}: tau = {times} s [{group.source.unit}]", n)
        if target.continues:
            ended = program.constant(f"{name}_at_end{suffix}", [group.ends[t] for t in taus], group.source.unit)
            program.add("init", f"{group.array}[j] = {ended}[j];", times=n)
        if target.begins and group.start != "rest":
            program.add_to_stage(group.stage, "begin", f"{group.array}[j] = {group.start};", times=n)
        elif target.longest_step is not None:  # what `init` does before the first sample
            program.add_to_stage(group.stage, "begin", f"{group.array}[j] = {target.number(0.0)};", times=n)
        change = group.source.change
        fast = n_plain(group, taus, target)
        self._recursion(group, taus, change, suffix, 0, fast)
        self._recursion(group, taus, change, suffix, fast, n)

    def _recursion(self, group: Group, taus: np.ndarray, change: str, suffix: str, low: int, high: int) -> None:
        """Lags `low` to `high` of a group, all of one form."""
        if low == high:
            return
        program, target, n = self.program, self.program.target, high - low
        compensated = low >= n_plain(group, taus, target)
        first = "loss" if target.single or compensated else "decay"
        part = ("_fast" if high < len(taus) else "_slow" if low else "") + suffix
        lag = f"{group.array}[j + {low}]" if low else f"{group.array}[j]"
        lines, factor, gain = self._factors(group, taus[low:high], first, part)
        driven = f" + {gain}{change}" if change else ""
        products, sums = 1 + bool(gain), 1 + bool(change)
        cost = Operations.of(products, sums)
        for helper, (_, inside) in program.helpers.items():
            cost = cost + inside if any(f"{helper}(" in line for line in lines) else cost
        if compensated:
            rest = program.member(f"rest{part}", f"what rounding took from {group.array[3:]}", n) + "[j]"
            if target.longest_step is not None:
                program.add_to_stage(group.stage, "begin", f"{rest} = {target.number(0.0)};", times=n)
            cost = cost + Operations(adds=3)
            lines += [
                f"const {target.dtype} increment = {rest} + {factor} * {lag}{driven}; /* eq. (25) */",
                f"const {target.dtype} next = {lag} - increment;",
                f"{rest} = (next - {lag}) + increment;",
                f"{lag} = next;",
            ]
        elif first == "loss":
            lines.append(f"{lag} -= {factor} * {lag}{driven}; /* eq. (25) */")
        else:
            cost = cost if gain or not change else Operations(1)
            lines.append(f"{lag} = {factor} * {lag}{driven.replace(' + ', ' - ')}; /* eq. (25) */")
        if n == 1 and len(lines) > 1:
            lines = ["{", *(f"    {line}" for line in lines), "}"]
        program.add_to_stage(group.stage, "advance", *lines, times=n, cost=cost)

    def _factors(self, group: Group, taus: np.ndarray, first: str, part: str) -> tuple[list[str], str, str]:
        """Lines that come before a recursion; its factor (the loss 1 - a or the decay a); its gain with " * "."""
        program, target = self.program, self.program.target
        driven = bool(group.source.change) and group.hold == "first_order"
        if target.period is None:
            helper, T = lag_factors(program, first), target.dtype
            tau = program.constant(f"time_constants{part}", taus, "s")
            call = f"{helper}(step, {tau}[j], &{first});"
            return (
                [f"{T} {first};", f"const {T} gain = {call}" if driven else f"(void){call}"],
                first,
                "gain * " * driven,
            )
        hold: Hold = "first_order" if group.hold == "first_order" else "zero_order"
        decay, gain = decay_and_gain(np.full(len(taus), target.period), taus, hold)
        if first == "loss":
            loss = -np.expm1(-target.period / taus)
            factor = program.constant(f"loss{part}", loss, "1 - exp(-dt/tau)")
            gain = loss * taus / target.period
        else:
            factor = program.constant(f"decay{part}", decay, "exp(-dt/tau)")
        if not driven:
            return [], f"{factor}[j]", ""
        return [], f"{factor}[j]", program.constant(f"gain{part}", gain, "(1 - exp(-dt/tau)) tau/dt") + "[j] * "


def n_plain(group: Group, taus: np.ndarray, target: Target) -> int:
    """How many of the lags, from the fastest, need no compensation."""
    if not group.source.change:
        return 0
    if not target.single:
        return len(taus)
    if target.period is None:
        return 0
    return int(np.searchsorted(taus, COMPENSATED_FROM * target.period))
