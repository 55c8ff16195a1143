"""C of effects of recorded columns: at once, late, and as a partner of the temperature.

Columns are counted from a usual value, so that single precision keeps the digits of a pressure of 1013.25 hPa that
moves by 0.1 hPa, or of its square.
"""

from __future__ import annotations

import math

from ..effects import Covariate, Interaction, LaggedCovariate
from .emitters import Finish, Part, emits
from .lagbank import Source
from .program import Input
from .thermal_parts import horner, shifted


def input_of(part: Part) -> Input:
    """The column that an effect reads; the root of the mean of its power is a usual value of it."""
    effect = part.effect
    power = getattr(effect, "power", 1)
    mean = float(effect.mean_)
    near = mean if power == 1 else math.copysign(abs(mean) ** (1 / power), mean)
    part.program.column_power = max(part.program.column_power, power)
    return part.program.column(effect.column, near)


def add_power(part: Part, given: Input, coefficient: float) -> None:
    """Add ``coefficient (column^power - mean)`` to the bias, as a polynomial of the centred column."""
    program, effect = part.program, part.effect
    constant, *rest = shifted({effect.power: coefficient}, given.reference)
    program.bias_constant += constant - coefficient * float(effect.mean_)
    unit = part.per(f"({given.said})^i") + f", i-th power of {given.said} less a usual value"
    value = horner(program, rest, program.centred(given), part.name("covariate"), unit)
    program.add("output", f"bias += {value};")


@emits(Covariate)
def covariate(part: Part) -> None:
    """A column acts at once."""
    add_power(part, input_of(part), float(part.coefficients[0]))


@emits(LaggedCovariate)
def lagged_covariate(part: Part) -> Finish:
    """A column acts at once and late: lags of its power."""
    program, effect = part.program, part.effect
    given = input_of(part)
    add_power(part, given, float(part.coefficients[0]))
    if effect.power == 1:
        source = Source(given.said, f"{given.value} - {given.previous}", f"unit of {given.said}")
    else:
        _, *rest = shifted({effect.power: 1.0}, given.reference)
        text = horner(program, rest, program.centred(given), part.name("power"), f"{given.said} less a usual value")
        value = program.local(part.name("powered"), text)
        before = program.member(part.name("powered_before"), f"{given.said}^{effect.power} less a constant")
        if part.continues:
            ended = part.state.temperature - given.reference**effect.power
            program.add("init", f"{before} = {program.constant(part.name('powered_at_end'), ended, 'of the fit')};")
        program.add("store", f"{before} = {value};", counted=False)
        key = f"{given.said}^{effect.power}"
        source = Source(key, f"{value} - {before}", f"unit of {given.said}^{effect.power}")
    counted_from = 0.0 if effect.power == 1 else given.reference**effect.power
    group = part.lags.request(source, effect.time_constants_, effect.hold, "rest", part.state, counted_from)
    per = part.per(f"({given.said})^{effect.power}")
    return lambda: program.weigh(
        part.name("mu"), part.coefficients[1:], group.columns(effect.time_constants_), per
    )  # fmt: skip


@emits(Interaction)
def interaction(part: Part) -> None:
    """``c (T - T0) (x - mean)``, with what the references of the code leave of T0 and of the mean."""
    program, effect = part.program, part.effect
    given = input_of(part)
    c = float(part.coefficients[0])
    shift_t = program.target.reference_temperature - effect.reference_temperature_
    shift_x = given.reference - float(effect.mean_)
    program.bias_constant += c * shift_t * shift_x
    weight = program.constant(part.name("interaction"), c, part.per(f"(K {given.said})"))
    x, deviation = program.centred(given), program.deviation()
    slope = f"{weight} * {deviation}"
    if shift_t:
        slope += f" + {program.constant(part.name('interaction_t0'), c * shift_t, part.per(f'({given.said})'))}"
    text = f"({slope}) * {x}"
    if shift_x:
        text += f" + {program.constant(part.name('interaction_mean'), c * shift_x, part.per('K'))} * {deviation}"
    program.add("output", f"bias += {text};")
