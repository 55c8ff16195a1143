"""The C helper for steps known only at run time: decay and gain of a lag, as `thermocorr.equations.lags` has them."""

from __future__ import annotations

from .language import Operations
from .program import Program

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
_COST = Operations(multiply_adds=6, adds=1, divisions=2, calls=1)
"""The larger number of each kind of the two ways."""


def lag_factors(program: Program, first: str) -> str:
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
        program.helpers[name] = (text, _COST)
    return name
