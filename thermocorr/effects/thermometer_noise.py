"""A thermometer that is noisy or coarse: its readings before and after know the temperature better."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..equations import lag_differences
from ..records import Block, Record, seconds_of
from ..records.numbers import span_text
from .grids import time_grid
from .lead import elapsed, parts_of, rows_until, temperatures
from .protocol import Effect, EffectInfo, time_text

REACH = 36.0
"""Spans after which a later temperature no longer counts: rounding (exp(-36) = 2e-16)."""


class ThermometerNoise(Effect):
    """Temperature averaged over a while before and after, less that of now [K]: what noise and steps hide.

    The weights fall exponentially to both sides, ``exp(-abs(t' - t) / span)``: the best estimate of a temperature that
    wanders as a random walk and is read in white noise (the smoother of Wiener; for even steps and variances q of a
    step and s^2 of the noise, ``span = s step / sqrt(q)``). It is the mean of a first-order lag and of the same lag run
    backwards in time. After the last sample of a segment, and before the first, T stays as it was.

    A stream does not know what comes later, so there is no live correction with it and no C code; both refuse it. For
    those, average several readings of the thermometer, or take a better one.

    Parameters
    ----------
    span : float or time span
        Time in which the weights fall to 1/e [s].

    Raises
    ------
    ValueError
        By `learn`, for a span that is not a positive time.

    References
    ----------
    N. Wiener, Extrapolation, Interpolation and Smoothing of Stationary Time Series, MIT Press 1949.
    """

    kind = "thermometer_noise"
    of_temperature_alone = True
    thermal_rank = 4
    of_thermometer = True
    foresees = True
    instead = "Fit without it, and give each row the mean of several readings of the thermometer, or take a finer one."
    learned = {"span_": "positive"}
    info = EffectInfo(
        physics="The thermometer is noisy, or reads in steps: the instrument, which has mass, follows the steadier "
        "temperature that lies behind its readings.",
        bench_check="Put a second, finer thermometer beside it, or read it several times a row: the difference is its "
        "noise; averages of many of its readings take the error with them.",
        formula="smooth[span] = weighted mean of T, weights exp(-|t' - t| / span) before and after, - T",
        parameters={"span": "s"},
        tuned=("span",),
        example={"span": 300.0},
        place=1.7,
    )

    def __init__(self, span: Any):
        self.span = span

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Spans from one step to a fiftieth of the longest segment."""
        return [cls(span) for span in time_grid(record, 1.0, 0.02, 1.6)]

    def learn(self, record: Record) -> None:
        """Convert the span to seconds."""
        self.span_ = seconds_of(self.span, "span")

    def names(self) -> list[str]:
        """``smooth[300 s]``."""
        return [f"smooth[{time_text(self.span_)}]"]

    def units(self) -> list[str]:
        """K."""
        return ["K"]

    def memory(self) -> float:
        """Span [s]."""
        return self.span_

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Temperature averaged over rows before and after, less that of now [K], shape (n,)."""
        span, after, last, ahead = np.array([self.span_]), np.zeros(0), np.inf, None
        all_rows = rows_until(block, REACH * self.span_)
        step = block.record.times.step_of(all_rows)
        for rows in parts_of(all_rows, len(block))[::-1]:
            T = temperatures(block, rows)[::-1]  # from the last row to the first
            if step is None:
                until = elapsed(block, rows)[::-1]
                steps, last = np.diff(-until, prepend=-last), until[-1]
            else:
                steps = np.full(len(T), step)
            found, ahead = lag_differences(T, steps, span, ahead)
            after = found[::-1, 0]
        before, state = lag_differences(block.temperature, block.steps, span, state)
        return (before[:, 0] + after) / 2, state

    def label(self) -> str:
        """``thermometer noise: 300 s``."""
        return f"thermometer noise: {time_text(seconds_of(self.span, 'span'))}"

    def title(self) -> str:
        """``thermometer noise: 5 min``."""
        return f"thermometer noise: {span_text(seconds_of(self.span, 'span'))}"
