"""The program in Python for comparison, and the self-test that is written with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..records.gate import Doubt, Gate
from .finished import Firmware
from .target import Target


@dataclass
class ReferenceRows:
    """Samples as the effects see a block; ``block[column]``, `steps`, `seconds`, `elapsed` as in `records.Block`."""

    values: Mapping[Any, np.ndarray]
    temperature: np.ndarray
    steps: np.ndarray
    seconds: np.ndarray
    elapsed: np.ndarray
    segment_key: int | None
    record: Any
    zero: float = 0.0
    even_step: None = None
    """Steps are taken one by one."""

    def __len__(self) -> int:
        return len(self.temperature)

    def __getitem__(self, column: Any) -> np.ndarray:
        return self.values[column]

    def elapsed_at(self, number: int) -> float:
        """One of `elapsed` [s]."""
        return float(self.elapsed[number])


def reference_bias(
    target: Target,
    parts: Sequence[tuple[Any, np.ndarray]],
    temperature: np.ndarray,
    columns: Mapping[Any, np.ndarray],
    seconds: np.ndarray,
    steps: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Bias of each sample, shape (n,), and what its parts reach without their signs, both in the unit of the reading.

    `target` (Target). `parts` (sequence of (effect, coefficients)): Effects that `correct` removes, and the
    coefficients of their columns. `temperature` (array of shape (n,)). `columns` (dict of column name -> array of shape
    (n,)). `seconds` (array of shape (n,)): Time since the first fitted row [s]. `steps` (array of shape (n,)): Time
    since the sample before [s].
    """
    elapsed = seconds - seconds[0]
    began = target.absolute_zero()
    record = SimpleNamespace(times=SimpleNamespace(between=lambda later, earlier: began))
    values = {target.temperature_name: temperature, **columns}
    block = ReferenceRows(
        values=values,
        temperature=temperature,
        steps=steps,
        seconds=seconds,
        elapsed=elapsed,
        segment_key=None,
        record=record,
    )
    bias, size = np.zeros(len(temperature)), np.zeros(len(temperature))
    for effect, weights in parts:
        part, _ = effect.columns(block, None)
        part = np.asarray(part).reshape(len(temperature), -1)
        bias += part @ np.asarray(weights)
        size += np.abs(part) @ np.abs(weights)
    return bias, float(size.max(initial=0.0))


SAMPLES = 160
TOLERANCE = {"float": 1e-5, "double": 1e-12}
"""Largest error, as a share of the range of the bias in the self-test."""
MISSING = (40, 41, 97)
"""Samples without a temperature."""


@dataclass(frozen=True)
class Inputs:
    """Samples of the self-test, as the device holds them, shape (SAMPLES,) each."""

    temperature: np.ndarray
    """As the code takes it: the last good one where it is missing."""
    columns: dict[Any, np.ndarray]
    steps: np.ndarray
    """Time since the update before [s], whole microseconds."""
    microseconds: tuple[int, ...]

    def measured(self) -> list[float | None]:
        """The temperature as `update` is given it; None where it is missing."""
        return [None if k in MISSING else float(value) for k, value in enumerate(self.temperature)]


@dataclass(frozen=True)
class Trial:
    """The self-test: every language runs it, and compares."""

    given: Inputs
    bias: np.ndarray
    """As Python computes it, shape (SAMPLES,)."""
    flags: np.ndarray
    """Expected flags of each sample."""
    tolerance: float
    """Largest allowed error of the bias."""


def inputs(firmware: Firmware, columns: Mapping[Any, np.ndarray], usual_step: float) -> Inputs:
    """A wander through the fitted range of temperatures and a little beyond; columns are drawn from given values."""
    target = firmware.target
    rng = np.random.default_rng(20)
    low, high = firmware.limits
    wander = np.cumsum(rng.normal(0.0, 1.0, SAMPLES))
    wander = (wander - wander.min()) / np.ptp(wander)
    temperature = _held(low + (high - low) * (1.1 * wander - 0.05), target.single)
    for row in MISSING:
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


class Courses(NamedTuple):
    """Output of the gates for the samples of the self-test, shape (SAMPLES,) each."""

    now: tuple[np.ndarray, dict[Any, np.ndarray]]
    """Temperature and columns as they are taken."""
    twin: tuple[np.ndarray, dict[Any, np.ndarray]]
    """With other values in the place of doubtful ones."""
    held: np.ndarray
    doubted: np.ndarray
    """True if each input has a twin, shape (SAMPLES, inputs)."""
    believed: np.ndarray
    """True if the doubt of each ends, shape (SAMPLES, inputs)."""


def courses(firmware: Firmware, given: Inputs) -> Courses:
    """Judge the inputs as `update` does."""
    target, times = firmware.target, np.cumsum(given.steps)
    max_gap = np.inf if target.longest_step is None else target.longest_step
    held = np.zeros(SAMPLES, bool)
    doubted, believed = np.zeros((2, SAMPLES, len(firmware.guard.motions)), bool)
    values = [given.temperature, *given.columns.values()]
    now, twin = [column.copy() for column in values], [column.copy() for column in values]
    for number, motion in enumerate(firmware.guard.motions):
        rows = np.setdiff1d(np.arange(SAMPLES), MISSING) if number == 0 else np.arange(SAMPLES)
        said = Gate(motion, max_gap).many(values[number][rows], times[rows])
        if said is None:
            continue
        now[number][rows], known = said.value, np.isfinite(said.twin)
        twin[number][rows] = np.where(known, said.twin, said.value)
        held[rows] |= said.held
        doubted[rows, number], believed[rows, number] = known, said.believed
    lost = set(np.flatnonzero(now[0] != values[0]).tolist())  # rows in which the temperature is held back
    for row in MISSING:  # the last good one stands in, and the twin wanders off
        now[0][row] = twin[0][row] = now[0][row - 1]
        for motion in firmware.guard.motions[:1]:
            gone = times[row] - times[max(set(range(row)) - set(MISSING) - lost)]
            far = min(motion.farthest * gone / motion.step, motion.spread)
            twin[0][row] += far if 2 * now[0][row] > motion.low + motion.high else -far
            doubted[row, 0] = True
    pairs = [(course[0], dict(zip(given.columns, course[1:], strict=True))) for course in (now, twin)]
    return Courses(pairs[0], pairs[1], held, doubted, believed)


def expected_flags(firmware: Firmware, given: Inputs, judged: Courses, apart: np.ndarray) -> np.ndarray:
    """Flags of each sample, by their names' bits; `apart` is the difference of the two courses' biases."""
    bits = {name: bit for name, bit, _ in firmware.flags()}
    low, high = (firmware.target.held(value) for value in firmware.limits)
    T = judged.now[0]
    outside = (low > T) | (high < T)
    for low, high in firmware.gaps:
        outside |= (firmware.target.held(low) < T) & (firmware.target.held(high) > T)
    flags = np.where(outside, bits["OUTSIDE_RANGE"], 0)
    flags[list(MISSING)] |= bits["NO_TEMPERATURE"]
    if firmware.guard.motions:
        guard, times = firmware.guard, np.cumsum(given.steps)
        doubt = Doubt(len(guard.motions), guard.deviation, guard.memory)
        flags[judged.held] |= bits["JUMP"]
        flags[doubt.rows(judged.doubted, judged.believed, apart, times) > guard.deviation] |= bits["DOUBTFUL"]
    if "WASHOUT" in bits:
        elapsed = np.cumsum(given.steps) - given.steps[0]
        flags[elapsed < firmware.guard.memory] |= bits["WASHOUT"]
    return flags


def tolerance(firmware: Firmware, bias: np.ndarray, size: float) -> float:
    """Largest allowed error: the promised share of the range, or some units of the last digit of what is summed."""
    eps = np.finfo(np.float32 if firmware.target.single else np.float64).eps
    return float(max(TOLERANCE[firmware.target.dtype] * np.ptp(bias), 8 * eps * size))
