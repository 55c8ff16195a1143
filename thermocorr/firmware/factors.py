"""Decay and gain of a lag, as `thermocorr.equations.lags` has them: tables, or a C helper for steps not known before.

A recursion has the decay ``a`` or the loss ``1 - a`` as its factor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from ..equations.lags import Hold, decay_and_gain
from .language import Operations
from .program import Program
from .statements import NOTHING, CLine, Index

Form = Literal["loss", "decay"]
_LOSS = """\
static {T} lag_{form}({T} step, {T} tau, {T} *{form})
{{
    const {T} ratio = step / tau;
    {T} gain;

    if (ratio < {tenth}) {{ /* tanh(x)/x as a continued fraction, Abramowitz & Stegun 4.5.70 */
        const {T} half = {half} * ratio;
        const {T} square = half * half;
        const {T} above = {ten} * square + {big};
        gain = above / (((square + {mid}) * square + {big}) + half * above);
        *{form} = {small_form};
    }} else {{
        *{form} = {large_form};
        gain = {large_gain};
    }}
    return gain;
}}
"""
_COST = Operations(multiply_adds=6, adds=1, divisions=2, calls=1)
"""The larger number of each kind of the two ways."""


class Factors(NamedTuple):
    """C expressions for a turn of the loop over lags."""

    before: Callable[[Index], list[str]]
    """Statements that a turn begins with."""
    factor: Callable[[Index], str]
    gain: Callable[[Index], str] | None
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
    table = program.constant(f"gain{part}", gain, "(1 - exp(-dt/tau)) tau/dt") if driven else ""
    return Factors(lambda _: [], lambda j: f"{factor}[{j}]", (lambda j: f"{table}[{j}]") if driven else None, NOTHING)


def _of_steps(program: Program, taus: str, driven: bool, form: Form) -> Factors:
    helper, T, step = _helper(program, form), program.target.dtype, program.step()

    def before(j: Index) -> list[str]:
        call = f"{helper}({step}, {taus}[{j}], &{form});"
        return [f"{T} {form};", f"const {T} gain = {call}" if driven else f"(void){call}"]

    return Factors(before, lambda _: form, (lambda _: "gain") if driven else None, _COST)


def _helper(program: Program, form: Form) -> str:
    """The C function that computes the factors of a step; returns its name."""
    name = f"lag_{form}"
    if name not in program.helpers:
        n, loss = program.target.number, form == "loss"
        text = _LOSS.format(
            T=program.target.dtype,
            form=form,
            tenth=n(0.1),
            half=n(0.5),
            ten=n(10.0),
            big=n(105.0),
            mid=n(45.0),
            small_form="ratio * gain" if loss else f"{n(1.0)} - ratio * gain",
            large_form=f"-{program.call('expm1')}(-ratio)" if loss else f"{program.call('exp')}(-ratio)",
            large_gain="(*loss) / ratio" if loss else f"({n(1.0)} - *decay) / ratio",
        )
        program.helpers[name] = CLine(text, _COST)
    return name
