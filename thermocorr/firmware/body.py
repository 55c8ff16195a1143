"""The source of an export: constants, init, update."""

from __future__ import annotations

import math

from .finished import Firmware
from .language import comment
from .program import Constant, Stage
from .target import MICROSECONDS

LONGEST_STEP_US = 10**14
_LARGEST_INPUT = 1e12
"""A column beyond it counts as missing; so does an input whose highest power the C type could not hold."""
_SPANS, _KELVINS = 1000.0, 1000.0
"""A temperature so many fitted spans (at least so many kelvins) from T0 is a fault of the thermometer.

It counts as missing: taken as it is, the rounding of such a jump there and back would stay in the slow lags.
"""


def source(firmware: Firmware) -> str:
    """Text of `<name>.c`."""
    body = [*_init(firmware), "", *_update(firmware)]
    return "\n".join(
        [
            f"/* Made by thermocorr; see {firmware.target.name}.h. */",
            f'#include "{firmware.target.name}.h"',
            "",
            "#include <float.h>",
            *(["#include <math.h>"] if firmware.program.calls_libm else []),
            "",
            "#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)",
            "#error Roundings are carried on and missing inputs told by comparisons: build without fast mathematics",
            "#endif",
            "",
            *(_declare(firmware, constant) for constant in firmware.program.constants),
            "",
            f"static int is_within({firmware.target.dtype} value, {firmware.target.dtype} limit)",
            "{",
            "    return value >= -limit && value <= limit; /* false for NaN */",
            "}",
            "",
            *(helper.text for helper in firmware.program.helpers.values()),
            *body,
            "",
        ]
    )


def _declare(firmware: Firmware, constant: Constant) -> str:
    numbers = [firmware.target.number(value) for value in constant.values]
    T, said = firmware.target.dtype, comment(constant.comment)
    if not constant.table:
        return f"static const {T} {constant.name} = {numbers[0]}; /* {said} */"
    rows = [", ".join(numbers[i : i + 4]) for i in range(0, len(numbers), 4)]
    inside = ",\n    ".join(rows)
    return f"static const {T} {constant.name}[{len(numbers)}] = {{ /* {said} */\n    {inside}\n}};"


def _init(firmware: Firmware) -> list[str]:
    t, zero = firmware.target, firmware.target.number(0.0)
    lines = []
    for m in firmware.members():
        value = zero if m.ctype == t.dtype else "0"
        if m.length is None:
            lines.append(f"    s->{m.name} = {value};")
        else:
            lines += [f"    for (int j = 0; j < {m.length}; ++j) {{", f"        s->{m.name}[j] = {value};", "    }"]
    if firmware.clock.used and not t.continues:
        lines.append(f"    {firmware.clock.counter} = start;")
    lines += [f"    {text}" for text in firmware.program.init.texts]
    if t.continues:
        lines.append("    s->started = 1;")
    return [firmware.init_signature(), "{", *lines, "}"]


def _update(firmware: Firmware) -> list[str]:
    t, p = firmware.target, firmware.program
    low, high = (t.number(value) for value in firmware.limits)
    stages = [text for stage in p.stages for text in _stage(stage)]
    body = [f"{t.name}_result result;", f"{t.dtype} bias = {firmware.bias_constant};"]
    body += ["", *_inputs(firmware), ""]
    if p.asks_first or any(stage.begin or stage.advance for stage in p.stages):
        body.append("const int first = s->started == 0;")
    body += [*_first(firmware), "", *stages]
    body += ["", *p.output.texts, ""]
    body += [f"if (temperature < {low} || temperature > {high}) {{"]
    body += [f"    result.flags |= {t.macro('OUTSIDE_RANGE')};", "}"]
    body += [*p.store.texts, "s->temperature = temperature;"]
    if p.columns:
        body += [f"for (int j = 0; j < {len(p.columns)}; ++j) {{", "    s->column[j] = column[j];", "}"]
    body += [*_tick(firmware), "result.bias = bias;", *p.close.texts, "return result;"]
    return [firmware.update_signature(), "{", *(f"    {line}" if line else "" for line in body), "}"]


def _stage(stage: Stage) -> list[str]:
    """Local variables, then what remembers: the first sample has nothing to advance from."""
    texts = stage.locals.texts
    begin, advance = ([f"    {text}" for text in block.texts] for block in (stage.begin, stage.advance))
    if begin and advance:
        return [*texts, "if (first) {", *begin, "} else {", *advance, "}"]
    if begin or advance:
        return [*texts, "if (first) {" if begin else "if (!first) {", *begin, *advance, "}"]
    return texts


def _tick(firmware: Firmware) -> list[str]:
    if not (firmware.clock.used and firmware.target.fixed):
        return []
    largest = f"INT{firmware.clock.bits}_MAX"
    return [f"if ({firmware.clock.counter} < {largest}) {{", f"    ++{firmware.clock.counter};", "}"]


def _limit(firmware: Firmware, power: int, largest: float) -> str:
    """Literal of the largest usable input."""
    held = 1e37 if firmware.target.single else 1e300
    return firmware.target.number(float(f"{min(largest, held ** (1 / power)):.3g}"))


def _inputs(firmware: Firmware) -> list[str]:
    t, p = firmware.target, firmware.program
    low, high = firmware.limits
    hottest = abs(t.reference_temperature) + max(_SPANS * (high - low), _KELVINS)
    lines = ["result.flags = 0;"]
    if not t.fixed:
        lines += [f"if (step_us == 0 || step_us > UINT64_C({LONGEST_STEP_US})) {{", "    step_us = 0;"]
        lines += ["    if (s->started) {", f"        result.flags |= {t.macro('BAD_STEP')};"]
        lines += ["        temperature = s->temperature;", "    }", "}"]
        if t.longest_step is not None:
            gap = math.floor(t.longest_step * MICROSECONDS)
            lines += [f"if (step_us > UINT64_C({gap})) {{", "    s->started = 0; /* a new segment */", "}"]
        if firmware.clock.used:
            lines.append(
                f"{firmware.clock.counter} += {firmware.clock.counter} < INT64_MAX / 2 ? (int64_t)step_us : 0;"
            )
    lines += [f"if (!is_within(temperature, {_limit(firmware, p.highest_power, hottest)})) {{"]
    lines += [f"    result.flags |= {t.macro('NO_TEMPERATURE')};", "    temperature = s->temperature;", "}"]
    if p.columns:
        n = len(p.columns)
        lines += [f"{t.dtype} column[{n}];", f"for (int j = 0; j < {n}; ++j) {{", "    column[j] = columns[j];"]
        bad_step = "" if t.fixed else f" || (result.flags & {t.macro('BAD_STEP')}) != 0"
        lines += [f"    if (!is_within(column[j], {_limit(firmware, p.highest_power, _LARGEST_INPUT)}){bad_step}) {{"]
        if t.fixed:
            lines += [f"        result.flags |= {t.macro('NO_COLUMN')};"]
        else:
            lines += [
                f"        result.flags |= (result.flags & {t.macro('BAD_STEP')}) != 0 ? 0u : {t.macro('NO_COLUMN')};"
            ]
        lines += ["        column[j] = s->column[j];", "    }", "}"]
    lines += [f"if (!is_within(reading, {t.largest})) {{", f"    result.flags |= {t.macro('NO_READING')};", "}"]
    return lines


def _first(firmware: Firmware) -> list[str]:
    t, p = firmware.target, firmware.program
    missing = t.macro("NO_TEMPERATURE") + (f" | {t.macro('NO_COLUMN')}" if p.columns else "")
    missing = f"({missing})" if p.columns else missing
    lines = ["if (s->started == 0) {", f"    if ((result.flags & {missing}) != 0) {{"]
    lines += [f"        result.flags |= {t.macro('NOT_STARTED')};"]
    lines += [f"        {line}" for line in _tick(firmware)]
    lines += [f"        result.bias = {t.number(0.0)};", "        result.corrected = reading;"]
    lines += ["        return result;", "    }", "    s->started = 1;", "    s->temperature = temperature;"]
    if p.columns:
        lines += [f"    for (int j = 0; j < {len(p.columns)}; ++j) {{", "        s->column[j] = column[j];", "    }"]
    return [*lines, "}"]
