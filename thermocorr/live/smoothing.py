"""What a live corrector may report beside the corrected reading: its moving average and a slowly tracked U0."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from ..records import seconds_of


class MovingAverage:
    """Mean of the last `count` values, eq. (26): looking back only, since a stream has no future.

    NaN leave it as it is, and get NaN.
    """

    def __init__(self, count: int):
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(f"The 'average' parameter must be a number of samples, at least 1. Got {count!r} instead.")
        self.count = int(count)
        self.values: deque[float] = deque(maxlen=self.count)

    def reset(self) -> None:
        """Forget all values."""
        self.values.clear()

    def one(self, value: float) -> float:
        """The mean, after one more value."""
        if math.isnan(value):
            return math.nan
        self.values.append(value)
        return math.fsum(self.values) / len(self.values)

    def many(self, values: np.ndarray) -> np.ndarray:
        """The mean after each of many values, shape (n,)."""
        result = np.full(len(values), np.nan)
        known = np.flatnonzero(np.isfinite(values))
        if len(known):
            line = np.concatenate((np.array(self.values), values[known]))
            offset = float(np.median(line))  # small numbers keep their digits
            sums = _window_sums(line - offset, self.count)[len(self.values) :]
            counts = np.minimum(np.arange(len(self.values), len(line)) + 1, self.count)
            result[known] = sums / counts + offset
            self.values.extend(values[known][-self.count :].tolist())
        return result


def _window_sums(values: np.ndarray, count: int) -> np.ndarray:
    """Sums over the last `count` values, of fewer at the beginning, shape (n,).

    A window is the end of one stretch of `count` values and the beginning of the next (van Herk 1992, Pattern
    Recognition Letters 13, 517): nothing is subtracted, so an absurd value is gone when it has left the window.
    """
    n, count = len(values), min(count, len(values))
    stretches = np.zeros((-(-n // count) + 1, count))
    stretches.ravel()[count : count + n] = values  # a stretch of zeros before the first
    beginnings = np.cumsum(stretches, axis=1).ravel()[count : count + n]
    ends = np.cumsum(stretches[:, ::-1], axis=1)[:, ::-1].ravel()
    after = np.arange(1, n + 1)  # where the window begins
    return np.where((after + count) % count == 0, beginnings, beginnings + ends[after])


class Tracker:
    """Mean under an exponential weight of the time since: ``u += (1 - exp(-dt/tau)) (value - u)``.

    Parameters
    ----------
    time_constant : float or time span
        tau [s].
    start : float
        u before the first value.
    """

    def __init__(self, time_constant: Any, start: float):
        self.time_constant = seconds_of(time_constant, "track")
        self.start = float(start)
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self.value = self.start
        self.last: float | None = None

    def one(self, seconds: float, value: float, trusted: bool) -> float:
        """The mean, after a value that came at `seconds`; one that is not trusted changes nothing."""
        if trusted:
            if self.last is not None and seconds > self.last:
                self.value -= math.expm1((self.last - seconds) / self.time_constant) * (value - self.value)
            self.last = seconds
        return self.value

    def many(self, seconds: np.ndarray, values: np.ndarray, trusted: np.ndarray) -> np.ndarray:
        """The mean after each of many values, shape (n,)."""
        rows = zip(seconds.tolist(), values.tolist(), trusted.tolist(), strict=True)
        return np.array([self.one(*row) for row in rows], float)
