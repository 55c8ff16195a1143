"""First-order lags of a program and their factors, in single and double precision.

A recursion has the decay ``a`` or the loss ``1 - a`` as its factor.

In double precision the recursion is that of `thermocorr.equations.lags`, operation for operation. In single precision
``d = a d - g change`` would lose the answer where tau >> dt: the rounded a stands for another time constant, and a
change of d below half a unit of its last digit is lost at every sample. There the code subtracts the increment
``(1 - a) d + g change``, whose factor 1 - a keeps its own seven digits, and hands what rounding took on to the next
sample (Kahan, Communications of the ACM 8 (1965) 40): two multiply-adds and three additions for a lag.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from ..equations.lags import Hold, decay_and_gain
from .program import Program
from .statements import (
    NOTHING,
    Assign,
    Bracketed,
    CallHelper,
    Declare,
    Formula,
    Helper,
    If,
    Item,
    Kept,
    Local,
    Number,
    Operations,
    Output,
    Statement,
    Variable,
    Whole,
    behind,
)
from .target import Target

Form = Literal["loss", "decay"]
_COST = Operations(multiply_adds=6, adds=1, divisions=2, calls=1)
"""The larger number of each kind of the two ways."""


class Factors(NamedTuple):
    """Factors that a turn of the loop over lags reads."""

    before: Callable[[Formula], list[Statement]]
    """Statements that a turn begins with."""
    factor: Callable[[Formula], Formula]
    gain: Callable[[Formula], Formula] | None
    """What the change of the input is multiplied by; None: 1."""
    cost: Operations


def lag_factors(program: Program, taus: np.ndarray, hold: str, form: Form, part: str) -> Factors:
    """Factors of lags with time constants `taus` [s]; `hold` is "" for a decay, which follows nothing."""
    period, driven = program.target.period, hold == "first_order"
    if period is None:
        return _of_steps(program, program.constant(f"time_constants{part}", taus, "s"), driven, form)
    rule: Hold = "first_order" if driven else "zero_order"
    decay, gain = decay_and_gain(np.full(len(taus), period), taus, rule)
    if form == "loss":
        loss = -np.expm1(-period / taus)
        factor = program.constant(f"loss{part}", loss, "1 - exp(-dt/tau)")
        gain = loss * taus / period
    else:
        factor = program.constant(f"decay{part}", decay, "exp(-dt/tau)")
    if not driven:
        return Factors(lambda _: [], lambda j: factor[j], None, NOTHING)
    table = program.constant(f"gain{part}", gain, "(1 - exp(-dt/tau)) tau/dt")
    return Factors(lambda _: [], lambda j: factor[j], lambda j: table[j], NOTHING)


def _of_steps(program: Program, taus: Variable, driven: bool, form: Form) -> Factors:
    helper, step = _helper(program, form), program.step()

    def before(j: Formula) -> list[Statement]:
        return [CallHelper(helper, (step, taus[j]), used=driven)]

    return Factors(before, lambda _: Variable(form), (lambda _: Variable("gain")) if driven else None, _COST)


def _helper(program: Program, form: Form) -> Helper:
    """The function that computes the factors of a step."""
    name = f"lag_{form}"
    if name not in program.helpers:
        ratio, gain, half, square, above = map(Variable, ("ratio", "gain", "half", "square", "above"))
        one, factor, loss = Number(1.0), Output(form), form == "loss"
        exact = -program.call("expm1", -ratio) if loss else program.call("exp", -ratio)
        below = Bracketed((square + Number(45.0)) * square + Number(105.0)) + half * above
        small = [
            Local("half", Number(0.5) * ratio),
            Local("square", half * half),
            Local("above", Number(10.0) * square + Number(105.0)),
            Assign(gain, above / below),
            Assign(factor, ratio * gain if loss else one - ratio * gain),
        ]
        large = [Assign(factor, exact), Assign(gain, (Bracketed(factor) if loss else one - factor) / ratio)]
        note = "tanh(x)/x as a continued fraction, Abramowitz & Stegun 4.5.70"
        body: list[list[Statement]] = [
            [Local("ratio", Variable("step") / Variable("tau")), Declare("gain")],
            [If(ratio < Number(0.1), small, large, note)],
        ]
        program.helpers[name] = Helper(name, ("step", "tau"), gives="gain", second=form, body=body)
    return program.helpers[name]


@dataclass(frozen=True)
class LagInput:
    """Input of a lag."""

    value: Formula
    """The input, which tells lags of equal input."""
    said: str
    """For comments."""
    change: Callable[[], Formula]
    """Reads the local variable: change of the input since the sample before."""
    unit: str


@dataclass
class Group:
    """Lags of one input."""

    source: LagInput
    hold: str
    stage: int
    time_constants: set[float] = field(default_factory=set)
    """[s]."""
    array: Kept = field(init=False)

    def columns(self, time_constants: Sequence[float]) -> list[Item]:
        """Places of the lag differences, after the bank has been emitted."""
        order = sorted(self.time_constants)
        return [self.array[Whole(order.index(float(tau)))] for tau in time_constants]


class LagBank:
    """Collects requests, then writes one array and one loop (or two) for each group."""

    def __init__(self, program: Program):
        self.program = program
        self.groups: dict[tuple[Formula, str], Group] = {}

    def request(
        self, source: LagInput, time_constants: Sequence[float], hold: str = "first_order", stage: int = 0
    ) -> Group:
        """Ask for lags."""
        group = self.groups.setdefault((source.value, hold), Group(source, hold, stage))
        group.time_constants.update(map(float, time_constants))
        return group

    def emit(self, stage: int) -> None:
        """Write members and recursions of a stage."""
        for number, group in enumerate(self.groups.values()):
            taus = np.array(sorted(group.time_constants))
            if group.stage == stage and len(taus):
                self._emit(group, taus, "" if number == 0 else f"_{number + 1}")

    def _emit(self, group: Group, taus: np.ndarray, suffix: str) -> None:
        program, target, n = self.program, self.program.target, len(taus)
        times = ", ".join(f"{tau:.6g}" for tau in taus)
        comment = f"{group.source.said}: tau = {times} s [{group.source.unit}]"
        lag = group.array = program.member(f"lag{suffix}", comment, n)
        begin = program.stage(group.stage).begin
        if target.longest_step is not None:  # rest: what `init` does before the first sample
            begin.loop(n, lambda j: [Assign(lag[j], Number(0.0))])
        fast = n_plain(group, taus, target)
        self._recursion(group, taus, suffix, 0, fast)
        self._recursion(group, taus, suffix, fast, n)

    def _recursion(self, group: Group, taus: np.ndarray, suffix: str, low: int, high: int) -> None:
        """Eq. (25) of lags `low` to `high` of a group, all of one form."""
        if low == high:
            return
        program, target, n, array = self.program, self.program.target, high - low, group.array
        stage = program.stage(group.stage)
        change = group.source.change()
        compensated = low >= n_plain(group, taus, target)
        form: Form = "loss" if target.single or compensated else "decay"
        part = ("_fast" if high < len(taus) else "_slow" if low else "") + suffix
        factors = lag_factors(program, taus[low:high], group.hold, form, part)
        cost = Operations.of(1 + (factors.gain is not None), 1 + (form == "loss")) + factors.cost
        rest = program.member(f"rest{part}", f"what rounding took from {array.name}", n) if compensated else None
        if rest is not None and target.longest_step is not None:
            stage.begin.loop(n, lambda j: [Assign(rest[j], Number(0.0))])

        def turn(j: Formula) -> list[Statement]:
            lag, note = array[behind(j, low)], "eq. (25)"
            kept = factors.factor(j) * lag
            driven = factors.gain(j) * change if factors.gain else change
            if rest is not None:
                increment, following = Variable("increment"), Variable("next")
                recursion: list[Statement] = [
                    Local("increment", rest[j] + kept + driven, note=note),
                    Local("next", lag - increment),
                    Assign(rest[j], Bracketed(following - lag) + increment),
                    Assign(lag, following),
                ]
            elif form == "loss":
                recursion = [Assign(lag, kept + driven, "-", note)]
            else:
                recursion = [Assign(lag, kept - driven, note=note)]
            return [*factors.before(j), *recursion]

        stage.advance.loop(n, turn, cost + Operations(adds=3) if compensated else cost)


def n_plain(group: Group, taus: np.ndarray, target: Target) -> int:
    """Number of lags, from the fastest, that need no compensated sum."""
    if not target.single:
        return len(taus)
    if target.period is None:
        return 0
    # tau/dt from which single precision is compensated: below it, rounding adds up to less than 16 * 2^-24 = 1e-6
    return int(np.searchsorted(taus, 16.0 * target.period))
