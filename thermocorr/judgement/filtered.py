"""Noise that an instrument's own filter or averaging makes, which is no missing effect."""

from __future__ import annotations

import numpy as np

from ..equations.noise import whittle
from .left_levels import (
    BELOW_FILTER,
    FEWEST_BELOW,
    FILTER_LENGTH,
    FILTER_SHARE,
    FILTER_TAILS,
    FILTER_WHITE,
    FLAT,
    HARDLY_A_FILTER,
)
from .likelihood import Comparison


def filter_memory(judged: Comparison, steps: float) -> float:
    """How long noise remembers that is white below the frequencies of a filter of a few samples [rows]; else 0.

    A filter leaves no white noise beside it; an unknown cause that comes and goes as quickly has the instrument's, if
    that is not far below it. What is switched has two levels, or rare large steps, where a filter's noise is Gaussian.

    Parameters
    ----------
    judged : Comparison
    steps : float
        Samples of the record in each of its rows.
    """
    theta, times = judged.base.theta, judged.bands.times
    fast = np.where(steps * times <= FILTER_LENGTH, theta[1:], 0.0)
    if fast.sum() < FILTER_SHARE * theta[1:].sum() or not fast.any():
        return 0.0
    if not all(FILTER_TAILS[0] < _fourth_moment(rows) < FILTER_TAILS[1] for rows in _beside(judged)):
        return 0.0
    memory = float(np.exp(np.average(np.log(times), weights=fast)))
    if theta[0] > FILTER_WHITE * theta.sum() and steps * memory > HARDLY_A_FILTER:
        return 0.0
    low = judged.bands.middle < 1 / (BELOW_FILTER * memory)
    share, power = judged.share[low], judged.bands.sums(judged.left(theta) ** 2)[low, None]
    if share.sum() < FEWEST_BELOW:
        return 0.0
    level = np.full_like(power, power.sum() / share.sum())
    gained = whittle(share, power, judged.S(theta)[low, None]) - whittle(share, power, level)
    return memory if gained[0] < FLAT else 0.0


def _beside(judged: Comparison) -> tuple[np.ndarray, np.ndarray]:
    """What the base leaves of each row, and its steps from row to row."""
    left = judged.bands.back(judged.left(judged.base.theta)[:, None])[:, 0]
    return left, np.diff(left)


def _fourth_moment(values: np.ndarray) -> float:
    """Fourth moment over the squared second: 3 of Gaussian noise, 1 of two levels, many of rare ones."""
    squares = np.square(values - values.mean())
    return float(np.mean(squares**2) / max(float(np.mean(squares)) ** 2, 1e-300))
