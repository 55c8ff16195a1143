"""Looks at values and times: whether values stay near each other, their mean, spread and range; steps of times."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Summed(NamedTuple):
    """What some values come to; the mean is no number where one of them is none."""

    mean: float
    squares: float
    """Sum of the squared deviations from the mean."""
    low: float
    high: float


def stay_within(values: Floats, most: float) -> bool:
    """Whether no step from a value to the next is larger than `most`; not so where one is missing (NaN)."""
    steps = values[1:] - values[:-1]
    return bool(steps.max(initial=0.0) <= most and steps.min(initial=0.0) >= -most)


def summed(values: Floats) -> Summed:
    """What one value or more come to, shape (n,)."""
    mean = float(values.sum() / len(values))
    if np.isnan(mean):
        return Summed(mean, mean, mean, mean)
    centred = values - mean
    return Summed(mean, float(centred @ centred), float(values.min()), float(values.max()))


def are_apart(ticks: NDArray[Any], step: float) -> bool:
    """Whether each time is exactly a step later than the one before; integers or floats, shape (n,)."""
    return bool((np.diff(ticks) == step).all())


def steps_between(ticks: NDArray[Any], per_second: int, out: Floats) -> None:
    """Steps from each of the times to the next [s], shape (n - 1,); no two may lie too far apart for a difference."""
    np.divide(ticks[1:] - ticks[:-1], per_second, out=out)
