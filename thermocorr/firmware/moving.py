"""C of effects of how the temperature moves: rate, delay, hysteresis, hinge."""

from __future__ import annotations

import math

import numpy as np

from ..effects import Delay, Hinge, Hysteresis, Rate
from .emitters import Finish, Part, emits
from .lagbank import Source
from .thermal_parts import AMBIENT, change

LONGEST_DELAY = 4096
"""Samples that a delay may reach back to: 16 kB in single precision."""


@emits(Rate)
def rate(part: Part) -> Finish | None:
    """``(T - T before) / dt``, or ``- d/tau`` of a lag difference d, eq. (17)."""
    program, effect, target = part.program, part.effect, part.program.target
    c, tau = float(part.coefficients[0]), effect.time_constant_
    moved = change(program)
    if tau is not None:
        group = part.lags.request(AMBIENT, [tau], end=part.state)
        return lambda: program.weigh(part.name("rate"), [c / -tau], group.columns([tau]), part.per("K"))
    if target.period is not None:
        weight = program.constant(part.name("rate"), c / target.period, part.per("K"))
        program.add("output", f"bias += {weight} * {moved};")
    else:
        weight = program.constant(part.name("rate"), c, part.per("(K/s)"))
        zero = target.number(0.0)
        program.add("output", f"bias += step > {zero} ? {weight} * ({moved} / step) : {zero};")
    return None


@emits(Delay)
def delay(part: Part) -> None:
    """``T(t - d) - T(t)`` from a ring of the last temperatures; a straight line between two of them."""
    program, effect, target = part.program, part.effect, part.program.target
    if target.period is None:
        raise ValueError(
            f"The effect {effect.label()!r} cannot be exported for steps that are known only at run time: how many "
            "samples it must remember has no bound. Give a sampling_period, or leave the effect out and fit again."
        )
    whole = math.floor(effect.delay_ / target.period + 1e-9)
    between = max(effect.delay_ / target.period - whole, 0.0)
    between = between if between > 1e-9 else 0.0
    length = whole + (between > 0)
    if length > LONGEST_DELAY:
        raise ValueError(
            f"The effect {effect.label()!r} would need {length} temperatures at a sampling period of "
            f"{target.period:.6g} s; {LONGEST_DELAY} is the limit of an export. Export for a longer sampling period, "
            "or leave the effect out and fit again."
        )
    ring = program.member(part.name("ring"), f"temperatures of the last {length} samples", length)
    oldest = program.member(part.name("oldest"), f"where in {ring[3:]} the oldest stands", ctype="uint32_t")
    if part.continues:
        ago = target.period * np.arange(length - 1, -1, -1.0)  # from the oldest to the last fitted row
        known = part.state
        past = np.interp(known.elapsed[-1] - ago, known.elapsed, known.temperature)
        table = program.constant(part.name("ring_at_end"), past, "unit of the temperature")
        program.add("init", f"{ring}[j] = {table}[j];", times=length)
    if target.begins:
        program.add("begin", f"{ring}[j] = temperature;", times=length, counted=False)
    weight = program.constant(part.name("delay"), float(part.coefficients[0]), part.per("K"))
    earlier = f"{ring}[{oldest}]"
    if not between:
        program.add("output", f"bias += {weight} * ({earlier} - temperature);")
    else:
        share = program.constant(part.name("share"), between, "of a sample that the delay is longer")
        name = part.name("later")
        next_place = f"{oldest} + 1 < {length} ? {oldest} + 1 : 0"
        later = "temperature" if whole == 0 else f"{ring}[{next_place}]"
        program.add("output", f"const {target.dtype} {name} = {later};", counted=False)
        program.add(
            "output", f"bias += {weight} * (({name} - temperature) + {share} * ({earlier} - {name}));"
        )  # fmt: skip
    program.add("store", f"{earlier} = temperature;", counted=False)
    if length > 1:
        program.add("store", f"{oldest} = {oldest} + 1 < {length} ? {oldest} + 1 : 0;", counted=False)


@emits(Hysteresis)
def hysteresis(part: Part) -> None:
    """The play operator; its position is counted from near T0."""
    program, effect = part.program, part.effect
    deviation = program.deviation()
    play = program.member(part.name("play"), f"position of the play of width {effect.width:.6g} K, less near T0 [K]")
    half = program.constant(part.name("half_width"), effect.width / 2, "K")
    if part.continues:
        ended = float(part.state) - program.target.reference_temperature
        program.add("init", f"{play} = {program.constant(part.name('play_at_end'), ended, 'K')};")
    if program.target.begins:
        program.add("begin", f"{play} = {deviation};")
    program.add(
        "advance",
        f"if ({play} < {deviation} - {half}) {{",
        f"    {play} = {deviation} - {half};",
        f"}} else if ({play} > {deviation} + {half}) {{",
        f"    {play} = {deviation} + {half};",
        "}",
    )
    weight = program.constant(part.name("hysteresis"), float(part.coefficients[0]), part.per("K"))
    program.add("output", f"bias += {weight} * ({play} - {deviation});")


@emits(Hinge)
def hinge(part: Part) -> Finish:
    """``max(T - knee, 0)`` or ``min(T - knee, 0)``, and its lags."""
    program, effect, target = part.program, part.effect, part.program.target
    deviation = program.deviation()
    knee = program.constant(part.name("knee"), effect.knee - target.reference_temperature, "K, knee less near T0")
    side, zero = (">" if effect.side == "above" else "<"), target.number(0.0)
    text = f"{deviation} {side} {knee} ? {deviation} - {knee} : {zero}"
    value = program.local(part.name("hinge"), text)
    c, taus = part.coefficients, effect.time_constants_
    weight = program.constant(part.name("hinge_weight"), float(c[0]), part.per("K"))
    program.add("output", f"bias += {weight} * {value};")
    if not len(taus):
        return lambda: None
    key = f"{'max' if effect.side == 'above' else 'min'}(T - {float(effect.knee)!r}, 0)"
    before = program.member(part.name("hinge_before"), f"{key} at the sample before [K]")
    if part.continues:
        ended = program.constant(part.name("hinge_at_end"), part.state.temperature, "K")
        program.add("init", f"{before} = {ended};")
    program.add("store", f"{before} = {value};", counted=False)
    source = Source(key, f"{value} - {before}", "K")
    group = part.lags.request(source, taus, effect.hold, "rest", part.state)
    return lambda: program.weigh(part.name("mu"), c[1:], group.columns(taus), part.per("K"))
