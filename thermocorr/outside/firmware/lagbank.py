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

from ...equations import LagState
from ...equations.lags import decay_and_gain
from .language import Operations, count_operations
from .program import Program
from .target import Target

COMPENSATED_FROM = 16.0
"""tau/dt from which single precision is compensated: below it, rounding adds up to less than 16 * 2^-24 = 1e-6."""


@dataclass(frozen=True)
class Source:
    """What a lag follows."""

    key: str
    change: str
    """C expression: change of the input since the sample before; "" for a decay, which follows nothing."""
    unit: str


@dataclass
class Group:
    """Lags of one input."""

    source: Source
    hold: str
    start: str
    """"rest", or the C expression with which each lag difference starts."""
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
        source: Source,
        time_constants: Sequence[float],
        hold: str = "first_order",
        start: str = "rest",
        end: LagState | None = None,
        counted_from: float = 0.0,
    ) -> Group:
        """Ask for lags; `end` is their state at the end of the fit, for a program that continues it.

        The C type rounds the last input, which the code counts from `counted_from`. The lagged value must not move by
        that, so the lag differences take it up.
        """
        group = self.groups.setdefault((source.key, hold, start), Group(source, hold, start))
        last = 0.0 if end is None else end.temperature - counted_from
        rounded_off = last - self.program.target.held(last)
        for j, tau in enumerate(time_constants):
            group.ends[float(tau)] = 0.0 if end is None else float(end.lag_difference[j]) + rounded_off
        return group

    def emit(self) -> None:
        """Write members and recursions."""
        for number, group in enumerate(self.groups.values()):
            taus = np.array(sorted(group.ends))
            if len(taus):
                self._emit(group, taus, "" if number == 0 else f"_{number + 1}")

    def _emit(self, group: Group, taus: np.ndarray, suffix: str) -> None:
        program, target, n = self.program, self.program.target, len(taus)
        name = "lag" if group.source.change else "decay"
        times = ", ".join(f"{tau:.6g}" for tau in taus)
        group.array = program.member(f"{name}{suffix}", f"{group.source.key}: tau = {times} s [{group.source.unit}]", n)
        if target.continues:
            ended = program.constant(f"{name}_at_end{suffix}", [group.ends[t] for t in taus], group.source.unit)
            program.add("init", f"{group.array}[j] = {ended}[j];", times=n)
        elif group.start != "rest":
            program.add("begin", f"{group.array}[j] = {group.start};", times=n)
        change = group.source.change
        if change and change != "change":
            program.add("advance", f"const {target.dtype} change{suffix} = {change};")
            change = f"change{suffix}"
        fast = n_plain(group, taus, target)
        self._recursion(group, taus, change, suffix, 0, fast)
        self._recursion(group, taus, change, suffix, fast, n)

    def _recursion(self, group: Group, taus: np.ndarray, change: str, suffix: str, low: int, high: int) -> None:
        if low == high:
            return
        program, target, n = self.program, self.program.target, high - low
        compensated = low >= n_plain(group, taus, target)
        part = ("_fast" if high < len(taus) else "_slow" if low else "") + suffix
        lag = f"{group.array}[j + {low}]" if low else f"{group.array}[j]"
        follows = bool(change)
        held = group.hold == "zero_order"
        lines = []
        if target.fixed:
            assert target.period is not None
            first = "loss" if target.single or compensated else "decay"
            decay, gain = decay_and_gain(np.full(n, target.period), taus[low:high], group.hold)  # type: ignore[arg-type]
            loss = -np.expm1(-target.period / taus[low:high])
            factor = program.constant(
                f"{first}{part}", loss if first == "loss" else decay, "1 - exp(-dt/tau)" if first == "loss" else "exp(-dt/tau)"
            ) + "[j]"  # fmt: skip
            if target.single and group.hold == "first_order":
                gain = loss * taus[low:high] / target.period
            if follows and not held:
                gained = program.constant(f"gain{part}", gain, "(1 - exp(-dt/tau)) tau/dt") + "[j]"
        else:
            first = "loss" if target.single or compensated else "decay"
            helper = _factors(program, first)
            tau = program.constant(f"time_constants{part}", taus[low:high], "s")
            factor, gained = first, "gain"
            lines.append(f"{target.dtype} {first};")
            text = f"{helper}(step, {tau}[j], &{first});"
            lines.append(f"const {target.dtype} gain = {text}" if follows and not held else f"(void){text}")
        driven = "" if not follows else f" + {change}" if held else f" + {gained} * {change}"
        if compensated:
            rest = program.member(f"rest{part}", f"what rounding took from {group.array[3:]}", n) + "[j]"
            lines += [
                f"const {target.dtype} increment = {rest} + {factor} * {lag}{driven};  /* eq. (25) */",
                f"const {target.dtype} next = {lag} - increment;",
                f"{rest} = (next - {lag}) + increment;",
                f"{lag} = next;",
            ]
        elif first == "loss":
            lines.append(f"{lag} -= {factor} * {lag}{driven};  /* eq. (25) */")
        else:
            lines.append(f"{lag} = {factor} * {lag}{driven.replace(' + ', ' - ')};  /* eq. (25) */")
        if n == 1 and len(lines) > 1:
            lines = ["{", *(f"    {line}" for line in lines), "}"]
        program.add("advance", *lines, times=n)


def n_plain(group: Group, taus: np.ndarray, target: Target) -> int:
    """How many of the lags, from the fastest, need no compensation."""
    if not group.source.change:
        return 0
    if not target.single:
        return len(taus)
    if target.period is None:
        return 0
    return int(np.searchsorted(taus, COMPENSATED_FROM * target.period))


_LOSS = """\
static {T} lag_{first}({T} step, {T} tau, {T} *{first})
{{
    const {T} ratio = step / tau;
    {T} gain;

    if (ratio < {tenth}) {{ /* tanh(x)/x as a continued fraction, Abramowitz & Stegun 4.5.70 */
        const {T} half = {half} * ratio;
        const {T} square = half * half;
        const {T} above = {ten} * square + {big};
        gain = above / (((square + {mid}) * square + {big}) + half * above);
        *{first} = {small_form};
    }} else {{
        *{first} = {large_form};
        gain = {large_gain};
    }}
    return gain;
}}
"""


def _factors(program: Program, first: str) -> str:
    """The helper that computes the factors of a step known only at run time; returns its name."""
    target = program.target
    name = f"lag_{first}"
    if name not in program.helpers:
        n = target.number
        loss = first == "loss"
        text = _LOSS.format(
            T=target.dtype,
            first=first,
            tenth=n(0.1),
            half=n(0.5),
            ten=n(10.0),
            big=n(105.0),
            mid=n(45.0),
            small_form="ratio * gain" if loss else f"{n(1.0)} - ratio * gain",
            large_form=f"-{target.call('expm1')}(-ratio)" if loss else f"{target.call('exp')}(-ratio)",
            large_gain="*loss / ratio" if loss else f"({n(1.0)} - *decay) / ratio",
        ).replace("*loss / ratio", "(*loss) / ratio")
        common = [line for line in text.splitlines() if "ratio = step" in line]
        inside = text.splitlines()
        small = inside[inside.index(next(i for i in inside if "tanh" in i)) + 1 : _index(inside, "} else {")]
        large = inside[_index(inside, "} else {") + 1 : _index(inside, "return gain")]
        program.helpers[name] = (text, _cost(common) + _cost(small).most(_cost(large)))
    return name


def _index(lines: list[str], mark: str) -> int:
    return next(i for i, line in enumerate(lines) if mark in line)


def _cost(lines: list[str]) -> Operations:
    return sum((count_operations(line.replace("*loss", "loss").replace("*decay", "decay")) for line in lines), Operations())
