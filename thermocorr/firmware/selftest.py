"""The self-test: a C program with inputs, and the bias that Python computes for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .finished import Firmware

SAMPLES = 160
TOLERANCE = {"float": 1e-5, "double": 1e-12}
"""Largest error, as a share of the range of the bias in the self-test."""
_MISSING = (40, 41, 97)
"""Samples without a temperature."""


@dataclass(frozen=True)
class Inputs:
    """Samples of the self-test, as the C type holds them, shape (SAMPLES,) each."""

    temperature: np.ndarray
    """As the code takes it: the last good one where it is missing."""
    columns: dict[Any, np.ndarray]
    steps: np.ndarray
    """Time since the update before [s], whole microseconds."""
    microseconds: tuple[int, ...]


def inputs(firmware: Firmware, columns: Mapping[Any, np.ndarray], usual_step: float) -> Inputs:
    """A wander through the fitted range of temperatures and a little beyond; columns are drawn from given values."""
    target = firmware.target
    rng = np.random.default_rng(20)
    low, high = firmware.limits
    wander = np.cumsum(rng.normal(0.0, 1.0, SAMPLES))
    wander = (wander - wander.min()) / np.ptp(wander)
    temperature = _held(low + (high - low) * (1.1 * wander - 0.05), target.single)
    for row in _MISSING:
        temperature[row] = temperature[row - 1]
    drawn = {
        name: _held(
            np.asarray(columns[name])[np.linspace(0, len(columns[name]) - 1, SAMPLES).astype(int)], target.single
        )
        for name in firmware.program.columns
    }
    longest = min(2.0 * usual_step, target.longest_step or np.inf)
    ticks = tuple(max(1, int(step * 1e6)) for step in rng.uniform(0.2 * longest, longest, SAMPLES))
    steps = np.full(SAMPLES, target.period) if target.fixed else np.array(ticks) / 1e6
    return Inputs(temperature, drawn, steps, ticks)


def _held(values: np.ndarray, single: bool) -> np.ndarray:
    return np.array(values, np.float32 if single else np.float64).astype(float)


def expected_flags(firmware: Firmware, given: Inputs, washout: float) -> np.ndarray:
    """Flags of each sample, by their names' bits."""
    bits = {name: bit for name, bit, _ in firmware.flags()}
    low, high = (firmware.target.held(value) for value in firmware.limits)
    T = given.temperature
    flags = np.where((low > T) | (high < T), bits["OUTSIDE_RANGE"], 0)
    flags[list(_MISSING)] |= bits["NO_TEMPERATURE"]
    if "WASHOUT" in bits and not firmware.target.continues:
        elapsed = np.cumsum(given.steps) - given.steps[0]
        flags[elapsed < washout] |= bits["WASHOUT"]
    return flags


def tolerance(firmware: Firmware, bias: np.ndarray, size: float) -> float:
    """Largest allowed error: the promised share of the range, or some units of the last digit of what is summed."""
    eps = np.finfo(np.float32 if firmware.target.single else np.float64).eps
    return float(max(TOLERANCE[firmware.target.dtype] * np.ptp(bias), 8 * eps * size))


def test_program(firmware: Firmware, given: Inputs, bias: np.ndarray, flags: np.ndarray, size: float) -> str:
    """Text of `<name>_test.c`; its exit status is 0 where bias, correction, flags and the state's size agree."""
    t, T, names = firmware.target, firmware.target.dtype, list(firmware.program.columns)
    temperature = [f"({T})NAN" if k in _MISSING else t.number(v) for k, v in enumerate(given.temperature)]
    columns = [t.number(given.columns[name][k]) for k in range(SAMPLES) for name in names]
    update = ["&state", *([] if t.fixed else ["steps[k]"]), "temperatures[k]", "reading"]
    update += [f"columns + k * {t.macro('COLUMNS')}"] if names else []
    start = ", 0" if firmware.clock.used and not t.continues else ""
    return "\n".join(
        [
            f"/* Self-test: build with {t.name}.c and run; status 0 is a pass. The bias was computed in Python.",
            " * Made by thermocorr. */",
            f'#include "{t.name}.h"',
            "",
            "#include <math.h>",
            "#include <stdio.h>",
            "",
            f"#define SAMPLES {SAMPLES}",
            "",
            _table(T, "temperatures", temperature),
            *([_table(T, "columns", columns)] if names else []),
            *([] if t.fixed else [_table("uint64_t", "steps", [f"UINT64_C({us})" for us in given.microseconds])]),
            _table(T, "biases", [t.number(value) for value in bias]),
            _table("uint32_t", "flags", [f"{flag}u" for flag in flags]),
            "",
            "int main(void)",
            "{",
            f"    const {T} reading = {t.number(1.0)};",
            f"    const {T} tolerance = {t.number(tolerance(firmware, bias, size))};",
            f"    {T} largest = {t.number(0.0)};",
            "    int wrong = 0;",
            f"    {t.name}_state state;",
            "",
            f"    {t.name}_init(&state{start});",
            "    for (int k = 0; k < SAMPLES; ++k) {",
            f"        const {t.name}_result result = {t.name}_update({', '.join(update)});",
            f"        const {T} error = {t.call('fabs')}(result.bias - biases[k]);",
            "        largest = error > largest ? error : largest;",
            "        if (!(error <= tolerance) || result.flags != flags[k] ||",
            "            result.corrected < reading - result.bias || result.corrected > reading - result.bias) {",
            "            ++wrong;",
            "        }",
            "    }",
            f"    if (sizeof(state) > {t.macro('STATE_BYTES')}) {{",
            "        ++wrong;",
            "    }",
            f'    printf("{t.name}: %s, %d of %d samples wrong, largest error %.3g, allowed %.3g\\n",',
            '           wrong ? "FAILED" : "passed", wrong, SAMPLES, (double)largest, (double)tolerance);',
            "    return wrong ? 1 : 0;",
            "}",
            "",
        ]
    )


def _table(ctype: str, name: str, numbers: list[str]) -> str:
    rows = [", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    return f"static const {ctype} {name}[{len(numbers)}] = {{\n    " + ",\n    ".join(rows) + "\n};"
