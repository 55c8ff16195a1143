"""Frame of every program: `init`, and the checks of inputs in `update`."""

from __future__ import annotations

import math

from .finished import Firmware
from .program import Stage
from .statements import (
    TURN,
    Answer,
    Assign,
    Call,
    Choice,
    Converted,
    Declare,
    Formula,
    If,
    Kept,
    Largest,
    Local,
    Loop,
    Number,
    Raise,
    Raised,
    Statement,
    Unary,
    Variable,
    Whole,
    binary,
)
from .target import LONGEST_STEP_US, MICROSECONDS

_SPANS, _KELVINS = 1000.0, 1000.0
"""A temperature so many fitted spans (at least so many kelvins) from T0 is a fault of the thermometer.

It counts as missing: taken as it is, the rounding of such a jump there and back would stay in the slow lags.
"""
_TEMPERATURE, _READING, _STEP, _BIAS = map(Variable, ("temperature", "reading", "step_us", "bias"))
_LAST, _STARTED = Kept("temperature"), Kept("started")
_COLUMN, _LAST_COLUMN = Variable("column")[TURN], Kept("column")[TURN]


def starting(firmware: Firmware) -> list[Statement]:
    """Statements of `init`, which has the argument ``start`` if `Firmware.asks_start`."""
    steps: list[Statement] = []
    for member in firmware.members():
        place, zero = Kept(member.name), Number(0.0) if member.kind == "number" else Whole(0)
        if member.length is None:
            steps.append(Assign(place, zero))
        else:
            steps.append(Loop(member.length, [Assign(place[TURN], zero)]))
    if firmware.asks_start:
        steps.append(Assign(firmware.clock.count(), Variable("start")))
    return steps


def updating(firmware: Firmware) -> list[list[Statement]]:
    """Statements of `update`, in sections; before them ``bias`` is the constant term, and no flag is raised.

    Arguments: ``step_us`` where the period is not fixed, ``temperature``, ``reading``, and ``columns`` where there are.
    """
    p = firmware.program
    first = [_first(firmware)]
    if p.asks_first or any(stage.begin or stage.advance for stage in p.stages):
        first.insert(0, Local("first", binary(_STARTED, "==", Whole(0)), "truth"))
    stages = [statement for stage in p.stages for statement in _stage(stage)]
    low, high = map(Number, firmware.limits)
    outside = binary(binary(_TEMPERATURE, "<", low), "or", binary(_TEMPERATURE, ">", high))
    raised = Raise("OUTSIDE_RANGE")
    beyond = [If(outside, [raised])]
    for low, high in (map(Number, gap) for gap in firmware.gaps):
        beyond.append(If(binary(_TEMPERATURE, ">", low), [If(binary(_TEMPERATURE, "<", high), [raised])]))
    answer = Answer(_BIAS, _READING - _BIAS)
    last = [*beyond, *p.store, *_remember(firmware), *_tick(firmware), answer]
    return [_inputs(firmware), first, stages, list(p.output), last]


def _stage(stage: Stage) -> list[Statement]:
    """Local variables, then what remembers: the first sample has nothing to advance from."""
    first, begin, advance = Variable("first"), list(stage.begin), list(stage.advance)
    if begin:
        return [*stage.locals, If(first, begin, advance)]
    return [*stage.locals, *([If(Unary("not", first), advance)] if advance else [])]


def _remember(firmware: Firmware) -> list[Statement]:
    """Keep the inputs of this sample for the next."""
    columns = len(firmware.program.columns)
    keep = [Loop(columns, [Assign(_LAST_COLUMN, _COLUMN)])] if columns else []
    return [Assign(_LAST, _TEMPERATURE), *keep]


def _tick(firmware: Firmware) -> list[Statement]:
    """Count a sample; the counter stands still at its end."""
    clock = firmware.clock
    if not (clock.used and firmware.target.fixed):
        return []
    return [If(clock.count() < Largest(clock.kind), [Assign(clock.count(), Whole(1), "+")])]


def _absurd(firmware: Firmware, value: Formula, power: int, largest: float) -> Formula:
    """Condition: an input is missing, or so large that its power has no place."""
    held = 1e37 if firmware.target.single else 1e300
    limit = Number(float(f"{min(largest, held ** (1 / power)):.3g}"))
    return Unary("not", Call("is_within", (value, limit)))


def _inputs(firmware: Firmware) -> list[Statement]:
    """The last good value stands in for an input that is missing."""
    t, p = firmware.target, firmware.program
    low, high = firmware.limits
    hottest = abs(t.reference_temperature) + max(_SPANS * (high - low), _KELVINS)
    steps = [] if t.fixed else _step(firmware)
    absurd = _absurd(firmware, _TEMPERATURE, p.highest_power, hottest)
    steps.append(If(absurd, [Raise("NO_TEMPERATURE"), Assign(_TEMPERATURE, _LAST)]))
    if p.columns:
        # A column beyond it counts as missing; so does an input whose highest power the device could not hold
        absurd = _absurd(firmware, _COLUMN, p.highest_power, 1e12)
        bad = absurd if t.fixed else binary(absurd, "or", Raised(("BAD_STEP",)))
        missing = Raise("NO_COLUMN", unless="" if t.fixed else "BAD_STEP")
        take = [Assign(_COLUMN, Variable("columns")[TURN]), If(bad, [missing, Assign(_COLUMN, _LAST_COLUMN)])]
        steps += [Declare("column", len(p.columns)), Loop(len(p.columns), take)]
    not_finite = Unary("not", Call("is_within", (_READING, Largest("number"))))
    return [*steps, If(not_finite, [Raise("NO_READING")])]


def _step(firmware: Firmware) -> list[Statement]:
    """A step that cannot be is left out, with its sample; a long one begins a segment."""
    t, clock = firmware.target, firmware.clock
    bad = binary(binary(_STEP, "==", Whole(0)), "or", binary(_STEP, ">", Whole(LONGEST_STEP_US, "uint64")))
    left_out = If(_STARTED, [Raise("BAD_STEP"), Assign(_TEMPERATURE, _LAST)])
    steps: list[Statement] = [If(bad, [Assign(_STEP, Whole(0)), left_out])]
    if t.longest_step is not None:
        gap = Whole(math.floor(t.longest_step * MICROSECONDS), "uint64")
        steps.append(If(binary(_STEP, ">", gap), [Assign(_STARTED, Whole(0), note="a new segment")]))
    if clock.used:
        early = clock.count() < Largest("int64") / Whole(2)
        steps.append(Assign(clock.count(), Choice(early, Converted("int64", _STEP), Whole(0)), "+"))
    return steps


def _first(firmware: Firmware) -> Statement:
    """Nothing is corrected before a first sample with all inputs."""
    missing = ("NO_TEMPERATURE", "NO_COLUMN") if firmware.program.columns else ("NO_TEMPERATURE",)
    wait = [Raise("NOT_STARTED"), *_tick(firmware), Answer(Number(0.0), _READING)]
    begin = [If(Raised(missing), wait), Assign(_STARTED, Whole(1)), *_remember(firmware)]
    return If(binary(_STARTED, "==", Whole(0)), begin)
