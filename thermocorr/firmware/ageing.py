"""C of effects of time: drift, ageing, a coefficient that ages, steps, periods."""

from __future__ import annotations

import math

from ..effects import Drift, LogAgeing, Periodic, SensitivityDrift, Step
from ..effects.time import DAY
from .emitters import Part, emits
from .target import MICROSECONDS

_TURN = 2**64


@emits(Drift)
def drift(part: Part) -> None:
    """``(t - centre) / day``; the centre goes into the constant."""
    program, c = part.program, float(part.coefficients[0]) / DAY
    program.bias_constant -= c * part.effect.centre_
    seconds = part.clock.seconds()
    program.add("output", f"bias += {program.constant(part.name('drift'), c, part.per('s'))} * {seconds};")


@emits(LogAgeing)
def log_ageing(part: Part) -> None:
    """``log(1 + t/t0)``, at rest before the fitted record."""
    program, effect, target = part.program, part.effect, part.program.target
    c = float(part.coefficients[0])
    program.bias_constant -= c * effect.mean_
    seconds = part.clock.seconds()
    onset = program.constant(part.name("onset"), effect.onset_, "s")
    weight = program.constant(part.name("ageing"), c, part.per(""))
    logarithm = f"{target.call('log1p')}({seconds} / {onset})"
    zero = target.number(0.0)
    program.add("output", f"bias += {weight} * ({seconds} > {zero} ? {logarithm} : {zero});")


@emits(SensitivityDrift)
def sensitivity_drift(part: Part) -> None:
    """``(t - centre) / day (T - T0)``."""
    program, effect = part.program, part.effect
    c = float(part.coefficients[0]) / DAY
    shift = program.target.reference_temperature - effect.reference_temperature_
    weight = program.constant(part.name("ageing_slope"), c, part.per("(K s)"))
    centre = program.constant(part.name("ageing_centre"), -c * effect.centre_, part.per("K"))
    deviation, seconds = program.deviation(), part.clock.seconds()
    if shift:
        rest = program.constant(part.name("ageing_t0"), shift, "K, near T0 less T0")
        deviation = f"({deviation} + {rest})"
    program.add("output", f"bias += ({weight} * {seconds} + {centre}) * {deviation};")


@emits(Step)
def step(part: Part) -> None:
    """A jump at a whole number of samples or microseconds."""
    program = part.program
    weight = program.constant(part.name("step"), float(part.coefficients[0]), part.per(""))
    reached = part.clock.reached(part.effect.seconds_)
    program.add("output", f"if ({reached}) {{", f"    bias += {weight};", "}")


@emits(Periodic)
def periodic(part: Part) -> None:
    """Harmonics of a period.

    In single precision the phase is a whole number, computed from the counter anew at every sample: a share of a turn
    in 64 bits where the sampling period is fixed (the product wraps at a turn by itself), the remainder of the time in
    microseconds where it is not. Neither runs away, and higher harmonics follow from the first by the addition
    theorem. In double precision the angle is computed as in Python, whose own rounding grows with the time.
    """
    program, effect, target, orders = part.program, part.effect, part.program.target, part.effect.harmonics
    began = target.absolute_zero() % effect.period_
    sine, cosine = target.call("sin"), target.call("cos")
    angle, T = part.name("angle"), target.dtype
    if target.single:
        if target.period is not None:
            stride = round(target.period / effect.period_ * _TURN) % _TURN
            start = round((began + target.origin) / effect.period_ * _TURN) % _TURN
            count = f"(uint64_t)(int64_t){part.clock.count()}"
            phase = f"(uint32_t)(({count} * UINT64_C({stride}) + UINT64_C({start})) >> 32)"
            unit = program.shared("turn", 2.0 * math.pi / 2**32, "rad, turn/2^32")
        else:
            period = round(effect.period_ * MICROSECONDS)
            start = round((began + target.origin) * MICROSECONDS) % period
            length, ahead = f"INT64_C({period})", f"INT64_C({period + start})"  # never negative, before the fit too
            phase = f"({part.clock.count()} % {length} + {ahead}) % {length}"
            unit = program.constant(part.name("radians"), 2.0 * math.pi / period, "rad/us")
        whole = part.name("phase")
        ctype = "uint32_t" if target.fixed else "int64_t"
        program.add("output", f"const {ctype} {whole} = {phase};", counted=False)
        program.add("output", f"const {T} {angle} = ({T}){whole} * {unit};")
    else:
        turn = program.constant(part.name("omega"), 2.0 * math.pi / effect.period_, "rad/s")
        zero = program.constant(part.name("began"), began, "s, phase of the first fitted row")
        program.add("output", f"const {T} {angle} = {turn} * ({zero} + {part.clock.seconds()});")
    for h in range(1, orders + 1):
        s, c = (part.name(f"{wave}_{h}") for wave in ("sin", "cos"))
        if h > 1 and target.single:
            s1, c1, s0, c0 = (part.name(f"{wave}_{i}") for i in (1, h - 1) for wave in ("sin", "cos"))
            values = f"{s0} * {c1} + {c0} * {s1}", f"{c0} * {c1} - {s0} * {s1}"
        else:
            of = angle if h == 1 else f"{target.number(h)} * {angle}"
            values = f"{sine}({of})", f"{cosine}({of})"
        program.add("output", *(f"const {T} {x} = {value};" for x, value in zip((s, c), values, strict=True)))
        for wave, weight in zip((s, c), part.coefficients[2 * h - 2 : 2 * h], strict=True):
            name = program.constant(f"{wave}_weight", float(weight), part.per(""))
            program.add("output", f"bias += {name} * {wave};")
