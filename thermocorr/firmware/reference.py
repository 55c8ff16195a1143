"""What the code has to reproduce: the bias by the effects themselves, for a sequence of samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

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
    parts: Sequence[tuple[Any, np.ndarray, Any]],
    temperature: np.ndarray,
    columns: Mapping[Any, np.ndarray],
    seconds: np.ndarray,
    steps: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Bias of each sample, shape (n,), and what its parts reach without their signs, both in the unit of the reading.

    Parameters
    ----------
    target : Target
        Says whether the samples follow the fitted record.
    parts : sequence of (effect, coefficients, state)
        Effects that `correct` removes, the coefficients of their columns, and their states before the first sample.
    temperature : array of shape (n,)
    columns : dict of column name -> array of shape (n,)
    seconds : array of shape (n,)
        Time since the first fitted row [s].
    steps : array of shape (n,)
        Time since the sample before [s]; the first since the last fitted row, where the samples follow.
    """
    elapsed = seconds - seconds[0]
    key = None
    if target.continues:
        elapsed = elapsed + target.segment_elapsed + steps[0]
        key = len(target.fitted_history.record.segments) - 1
    began = target.absolute_zero() if target.history is not None else np.nan
    record = SimpleNamespace(times=SimpleNamespace(between=lambda later, earlier: began))
    values = {target.temperature_name: temperature, **columns}
    block = ReferenceRows(
        values=values,
        temperature=temperature,
        steps=steps,
        seconds=seconds,
        elapsed=elapsed,
        segment_key=key,
        record=record,
    )
    bias, size = np.zeros(len(temperature)), np.zeros(len(temperature))
    for effect, weights, state in parts:
        part, _ = effect.columns(block, state)
        part = np.asarray(part).reshape(len(temperature), -1)
        bias += part @ np.asarray(weights)
        size += np.abs(part) @ np.abs(weights)
    return bias, float(size.max(initial=0.0))
