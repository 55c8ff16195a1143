"""The self-test: a C program with inputs, and the bias that Python computes for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .writer import Source

SAMPLES = 160
TOLERANCE = {"float": 1e-5, "double": 1e-12}
"""Of the range of the bias in the self-test."""
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


def inputs(source: Source, columns: Mapping[Any, np.ndarray], usual_step: float) -> Inputs:
    """A wander through the fitted range of temperatures and a little beyond; columns are drawn from given values."""
    target = source.target
    rng = np.random.default_rng(20)
    low, high = source.limits
    wander = np.cumsum(rng.normal(0.0, 1.0, SAMPLES))
    wander = (wander - wander.min()) / np.ptp(wander)
    temperature = _held(low + (high - low) * (1.1 * wander - 0.05), target.single)
    for row in _MISSING:
        temperature[row] = temperature[row - 1]
    drawn = {
        name: _held(np.asarray(columns[name])[np.linspace(0, len(columns[name]) - 1, SAMPLES).astype(int)], target.single)
        for name in source.program.columns
    }
    ticks = tuple(max(1, round(step * 1e6)) for step in rng.uniform(0.3, 2.0, SAMPLES) * usual_step)
    steps = np.full(SAMPLES, target.period) if target.fixed else np.array(ticks) / 1e6
    return Inputs(temperature, drawn, steps, ticks)


def _held(values: np.ndarray, single: bool) -> np.ndarray:
    return np.array(values, np.float32 if single else np.float64).astype(float)


def expected_flags(source: Source, given: Inputs, washout: float) -> np.ndarray:
    """Flags of each sample, by their names' bits."""
    bits = {name: bit for name, bit, _ in source.flags()}
    low, high = (source.target.held(value) for value in source.limits)
    T = given.temperature
    flags = np.where((low > T) | (high < T), bits["OUTSIDE_RANGE"], 0)
    flags[list(_MISSING)] |= bits["NO_TEMPERATURE"]
    if not source.target.continues:
        elapsed = np.cumsum(given.steps) - given.steps[0]
        flags[elapsed < washout] |= bits["WASHOUT"]
    return flags


def tolerance(source: Source, bias: np.ndarray) -> float:
    """Largest allowed error: the promised share of the range, or four units of the largest bias's last digit."""
    eps = np.finfo(np.float32 if source.target.single else np.float64).eps
    return float(max(TOLERANCE[source.target.dtype] * np.ptp(bias), 4 * eps * np.abs(bias).max(initial=0.0)))


def test_program(source: Source, given: Inputs, bias: np.ndarray, flags: np.ndarray) -> str:
    """Text of `<name>_test.c`; its exit status is 0 where bias, correction, flags and size agree."""
    t, T, names = source.target, source.target.dtype, list(source.program.columns)
    temperature = [f"({T})NAN" if k in _MISSING else t.number(v) for k, v in enumerate(given.temperature)]
    columns = [t.number(given.columns[name][k]) for k in range(SAMPLES) for name in names]
    update = ["&state", *([] if t.fixed else ["steps[k]"]), "temperatures[k]", "reading"]
    update += [f"columns + k * {t.macro('COLUMNS')}"] if names else []
    start = ", 0" if source.clock.used and not t.continues else ""
    return "\n".join(
        [
            f"/* Self-test: build with {t.name}.c and run; status 0 is a pass. The bias was computed in Python. */",
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
            f"    const {T} tolerance = {t.number(tolerance(source, bias))};",
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
