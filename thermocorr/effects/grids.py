"""Ranges of parameters that make sense for a record: times, temperatures, means."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..records import Record

_SAMPLE = 20_000
"""Rows that are enough for quantiles."""


def time_grid(record: Record, steps: float, share: float, ratio: float = 2.0, limit: float = np.inf) -> list[float]:
    """Times from `steps` usual steps to `share` of the longest segment (at most `limit`) [s], `ratio` apart."""
    low = steps * record.usual_step()
    high = min(share * record.longest_read(), limit)
    if high < low:
        return []
    count = int(np.log(high / low) / np.log(ratio) + 1e-9) + 1
    return [_three_digits(low * ratio**k) for k in range(count)]


def temperature_quantiles(record: Record, shares: Any) -> np.ndarray:
    """Temperatures below which the given shares of the rows lie; long records are thinned."""
    stride = max(1, record.n_used // _SAMPLE)
    return np.asarray(np.quantile(np.concatenate([block.temperature[::stride] for block in record.blocks()]), shares))


def time_quantiles(record: Record, shares: Any) -> np.ndarray:
    """Times since the record began before which the given shares of the rows lie [s]; rows themselves, not between."""
    stride = max(1, record.n_used // _SAMPLE)
    seconds = np.concatenate([block.seconds[::stride] for block in record.blocks()])
    return np.asarray(np.quantile(seconds, shares, method="nearest"))


def mean_seconds(record: Record) -> float:
    """Mean time of the rows since the record began [s]."""
    return sum(float(block.seconds.sum()) for block in record.blocks()) / record.n_used


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")
