"""Reading = base + device + contributions + noise: where a simulated reading is put together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from ._heat import Array, scan

# Each part of a record has its own random stream: changing one part leaves the others as they were.
STREAMS = (
    "temperature",
    "humidity",
    "pressure",
    "supply",
    "noise",
    "coloured_noise",
    "times",
    "contributions",
    "mains",
)  # new ones go to the end: the place in this list is part of the seed


def stream(seed: int, run: int, part: str) -> np.random.Generator:
    """Random generator of one part of one run."""
    return np.random.default_rng([seed, run, STREAMS.index(part)])


def coloured_noise(rng: np.random.Generator, time: Array, deviation: float, correlation_time: float) -> Array:
    """First-order autoregressive noise at any times [s]: correlation exp(-|t - s|/correlation_time)."""
    decay = np.exp(-np.diff(time) / correlation_time)[:, None]
    white = rng.standard_normal(time.size)
    later = scan(decay, np.sqrt(1 - decay**2) * white[1:, None], white[:1])[:, 0]
    return deviation * np.concatenate([white[:1], later])


def compose_reading(
    device: Array, contributions: Mapping[str, Array], noise: Array, base: float = 0.0
) -> tuple[Array, dict[str, Array]]:
    """Add up a reading and keep its parts.

    `device` (ndarray of shape (n,)): Thermal bias of the device. `contributions` (mapping of str to ndarray of shape
    (n,)): Further effects that a thermal model does not know; each becomes a column of the truth. `noise` (ndarray of
    shape (n,)): White noise. `base` (float, default=0.0): The unbiased reading U0. Returns reading (ndarray of shape
    (n,)): what the logger keeps. Returns truth (dict of str to ndarray): "noise_free", "device", one entry per
    contribution, "noise"; noise_free + noise is the reading.
    """
    noise_free = base + device + sum(contributions.values(), np.zeros_like(device))
    return noise_free + noise, {"noise_free": noise_free, "device": device, **contributions, "noise": noise}


def truth_frame(parts: Mapping[str, Array], index: pd.Index, attrs: Mapping[str, Any]) -> pd.DataFrame:
    """Parts of a simulated reading as columns, with the true parameters in `attrs`."""
    frame = pd.DataFrame(dict(parts), index=index)
    for key, value in attrs.items():
        frame.attrs[key] = value
    return frame
