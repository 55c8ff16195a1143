"""Vocabulary of an effect's formula, evaluated on blocks.

An effect's formula stands in one place, `Effect.signals(x)`, as an expression over `x`: ``x.T``, ``x["humidity"]``,
``x.seconds``, ``x.exp(...)``, and the words with a memory, ``x.lag(...)``, ``x.previous(...)``, ``x.play(...)``,
``x.delayed(...)``. Whoever runs it decides what `x` is: arrays of a block of rows (here), symbols that live
samples and C are written (`expressions`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..equations import decays, lag_differences
from ..equations.compiled import play
from ..equations.lags import FELT
from ..records import Block

Numbers = Sequence[float] | np.ndarray


class DelayState(NamedTuple):
    """Samples of the last `delay` seconds, and one before."""

    elapsed: np.ndarray
    temperature: np.ndarray
    """Values of what is delayed."""


class Signals:
    """The vocabulary of `Effect.signals`, besides arithmetic."""

    T: Any
    """Ambient temperature."""
    seconds: Any
    """Time since the fitted record began [s]."""
    elapsed: Any
    """Time since the segment began [s]."""
    step: Any
    """Time since the sample before [s]; 1 where a segment begins."""

    def __getitem__(self, column: object) -> Any:
        """A recorded column; name it in `Effect.inputs` too."""
        raise NotImplementedError

    def exp(self, value: Any) -> Any:
        """e^value."""
        raise NotImplementedError

    def log(self, value: Any) -> Any:
        """Natural logarithm."""
        raise NotImplementedError

    def log1p(self, value: Any) -> Any:
        """log(1 + value), natural."""
        raise NotImplementedError

    def sqrt(self, value: Any) -> Any:
        """Square root."""
        raise NotImplementedError

    def sin(self, value: Any) -> Any:
        """Sine of an angle [rad]."""
        raise NotImplementedError

    def cos(self, value: Any) -> Any:
        """Cosine of an angle [rad]."""
        raise NotImplementedError

    def maximum(self, one: Any, other: Any) -> Any:
        """The larger of two."""
        raise NotImplementedError

    def minimum(self, one: Any, other: Any) -> Any:
        """The smaller of two."""
        raise NotImplementedError

    def where(self, condition: Any, one: Any, other: Any) -> Any:
        """`one` where the condition holds (``x.T > 20``), else `other`."""
        raise NotImplementedError

    def angle(self, period: float) -> Any:
        """Phase of absolute time in a `period` [rad]."""
        raise NotImplementedError

    def wave(self, period: float) -> tuple[Any, Any]:
        """Sine and cosine of the `angle` of a `period` [s]."""
        angle = self.angle(period)
        return self.sin(angle), self.cos(angle)

    def lag(self, value: Any, time_constants: Numbers, hold: str = "first_order") -> list[Any]:
        """Lag differences of a value, eqs. (19) (25).

        Bodies begin at rest with the first value of a segment.
        """
        raise NotImplementedError

    def previous(self, value: Any) -> Any:
        """The value one sample earlier."""
        raise NotImplementedError

    def play(self, value: Any, width: float) -> Any:
        """Play operator: follows a value at half the width."""
        raise NotImplementedError

    def delayed(self, value: Any, delay: float) -> Any:
        """The value `delay` seconds ago, interpolated."""
        raise NotImplementedError

    def decays(self, of_segments: Mapping[int, Numbers]) -> list[Any]:
        """Start-up decays exp(-elapsed/tau), eq. (18), per segment."""
        raise NotImplementedError

    def change_rate(self, value: Any) -> Any:
        """Change since the sample before, per second [1/s]."""
        return (value - self.previous(value)) / self.step


def joined(states: Sequence[Any]) -> Any:
    """States of an effect's words, joined into one."""
    return None if not states else states[0] if len(states) == 1 else tuple(states)


def parted(state: Any) -> list[Any]:
    """The joined state, word by word; empty at a start."""
    return [] if state is None else list(state) if type(state) is tuple else [state]


class BlockSignals(Signals):
    """A block of rows: values are arrays of shape (n,).

    `block` (Block). `state` (object): What `state` gave after the block before; None where a segment begins.
    """

    exp, log, log1p, sqrt = np.exp, np.log, np.log1p, np.sqrt  # type: ignore[assignment]  # ufuncs can be called
    sin, cos = np.sin, np.cos  # type: ignore[assignment]
    maximum, minimum = np.maximum, np.minimum  # type: ignore[assignment]
    where = staticmethod(np.where)  # type: ignore[assignment]

    def __init__(self, block: Block, state: Any):
        self.block = block
        self._before = iter(parted(state))
        self._after: list[Any] = []

    def state(self) -> Any:
        """The state after the block."""
        return joined(self._after)

    @property
    def T(self) -> Any:
        """Ambient temperature."""
        return self.block.temperature

    @property
    def seconds(self) -> Any:
        """Time since the fitted record began [s]."""
        return self.block.seconds

    @property
    def elapsed(self) -> Any:
        """Time since the segment began [s]."""
        return self.block.elapsed

    @property
    def step(self) -> Any:
        """Time since the sample before [s]."""
        return self.block.steps

    def __getitem__(self, column: object) -> Any:
        try:
            return self.block[column]
        except KeyError:
            raise ValueError(
                f"A formula uses the column {column!r}, which its effect's `inputs` do not name."
            ) from None

    def angle(self, period: float) -> Any:
        return self._angle(period, self.block.seconds)

    def _angle(self, period: float, seconds: Any) -> Any:
        began = self.block.record.times.between(self.block.zero, 0) % period
        return 2.0 * math.pi / period * (began + seconds)

    def lag(self, value: Any, time_constants: Numbers, hold: str = "first_order") -> list[Any]:
        before, taus = next(self._before, None), np.asarray(time_constants, float)
        differences, after = lag_differences(value, self.block.steps, taus, before, hold=hold)  # type: ignore[arg-type]
        self._after.append(after)
        return list(differences.T)

    def previous(self, value: Any) -> Any:
        first = next(self._before, value[0])
        self._after.append(float(value[-1]))
        return np.concatenate(((first,), value[:-1]))

    def play(self, value: Any, width: float) -> Any:
        position = float(next(self._before, value[0]))
        followed = play(np.asarray(value - width / 2), np.asarray(value + width / 2), position)
        self._after.append(float(followed[-1]))
        return followed

    def delayed(self, value: Any, delay: float) -> Any:
        before, now = next(self._before, None), self.block.elapsed
        known = DelayState(now, value)
        if before is not None:
            known = DelayState(np.concatenate((before.elapsed, now)), np.concatenate((before.temperature, value)))
        oldest = max(np.searchsorted(known.elapsed, now[-1] - delay, side="right") - 1, 0)
        self._after.append(DelayState(known.elapsed[oldest:].copy(), known.temperature[oldest:].copy()))
        return np.interp(now - delay, *known)  # left of all samples: the first value

    def decays(self, of_segments: Mapping[int, Numbers]) -> list[Any]:
        own = list(decays(self.block.elapsed, felt_decays(self.block, of_segments)).T)  # eq. (18)
        columns: list[Any] = []
        for key, taus in of_segments.items():
            columns += own if own and key == self.block.segment_key else [0.0] * len(taus)
        return columns


def felt_decays(block: Block, of_segments: Mapping[int, Numbers]) -> NDArray[Any]:
    """Time constants of the decays that a block still feels [s]."""
    taus = np.asarray(() if block.segment_key is None else of_segments.get(block.segment_key, ()), float)
    return taus if len(taus) and block.elapsed_at(0) <= FELT * taus.max() else np.zeros(0)
