"""Decay and gain of a lag, as `thermocorr.equations.lags` has them: tables, or a helper for steps not known before.

A recursion has the decay ``a`` or the loss ``1 - a`` as its factor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from ..equations.lags import Hold, decay_and_gain
from .formulas import Bracketed, Formula, Number, Output, Variable
from .operations import NOTHING, Operations
from .program import Program
from .statements import Assign, CallHelper, Declare, Helper, If, Local, Statement

Form = Literal["loss", "decay"]
_COST = Operations(multiply_adds=6, adds=1, divisions=2, calls=1)
"""The larger number of each kind of the two ways."""


class Factors(NamedTuple):
    """What a turn of the loop over lags reads."""

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
