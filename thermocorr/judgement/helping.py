"""Naming a suspect beside other causes: the model is fitted with it, and judged on held-out blocks of time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects.grids import longest_segment
from ..estimators.regressor import DynamicBiasRegressor
from .adding import N_BLOCKS, held_out_blocks, with_missing
from .trial import LEVEL, Key, Suspect, Trial, key_of

SMALLEST_SHARE = 0.3
"""A suspect that explains a smaller share of the structured variance is not tried on held-out blocks."""
CLEAR_HELP = 0.8
"""Held-out error with the suspect, over the error without it, must not exceed this for the suspect to be named."""
IN_EVERY_BLOCK = 0.99
"""This ratio must not exceed this in any single block: a cause helps throughout, a coincidence here and there."""
TRIED = 3
"""Suspects of each list that are fitted and judged on held-out blocks."""


def helping(model: DynamicBiasRegressor, X: Any, y: Any, trial: Trial, suspects: Sequence[Suspect]) -> list[Suspect]:
    """The suspect whose addition lowers the error on held-out blocks most, if it lowers it clearly, and in every block.

    This decides where much of the structure has other causes. For each block, the model is fitted again without it,
    time constants included. The first suspects are tried, and those that help most while the time constants stay
    fixed. Effects of time alone are not tried: wandering noise looks like them.
    """
    before = held_out_blocks(model, X, y)
    tried = [s for s in suspects[:TRIED] if s.supported() and s.share >= SMALLEST_SHARE and not s.effect.of_time_alone]
    alpha = model.alpha_ * len(trial.data.reading) / model.reading_.n_readings
    ranked = [trial.suspect(i) for i in _by_blocks(trial, alpha, model.washout_)]
    tried += [s for s in ranked if s.key[1] is not None][:TRIED] + [s for s in ranked if s.key[1] is None][:1]
    found: list[tuple[float, int]] = []
    for i, suspect in enumerate(tried):
        if suspect.p_value <= LEVEL:
            ratios = held_out_blocks(with_missing(model, clone(suspect.effect)), X, y) / before
            if np.nanmax(ratios) <= IN_EVERY_BLOCK:  # a cause helps throughout, a coincidence here and there
                found.append((float(ratios[-1]), i))
    return [tried[min(found)[1]]] if found and min(found)[0] <= CLEAR_HELP else []


def _by_blocks(trial: Trial, alpha: float, washout: float) -> list[int]:
    """Candidates that help the model's own part most on blocks of time held out, best first.

    One of each kind and column; `alpha` is the ridge penalty, `washout` how long a start-up is felt [s].
    """
    data = trial.data
    felt = min(washout, longest_segment(trial.record) / 10)
    started = data.seconds - data.seconds[np.searchsorted(data.segment, data.segment)] >= felt
    best: dict[Key, tuple[float, int]] = {}
    for i, effect in enumerate(trial.candidates):
        if effect.of_time_alone:
            continue
        columns = np.column_stack((trial.own, trial.columns[i]))
        left = held_out_sum_of_squares(columns, data.reading, started, alpha)
        best[key_of(effect)] = min(best.get(key_of(effect), (np.inf, -1)), (left, i))
    return [i for _, i in sorted(best.values())]


def held_out_sum_of_squares(columns: np.ndarray, reading: np.ndarray, scored: np.ndarray, alpha: float) -> float:
    """What a ridge fit leaves of the `scored` rows of blocks of time that it did not see; column 0 is the constant."""
    scales = np.linalg.norm(columns[:, 1:] - columns[:, 1:].mean(axis=0), axis=0) / np.sqrt(len(columns))
    scaled = columns / np.concatenate(([1.0], np.where(scales > 0, scales, 1.0)))
    penalty = alpha * np.diag([0.0, *np.ones(len(scales))])
    edges = np.linspace(0, len(reading), N_BLOCKS + 1).astype(int)
    grams = [scaled[low:high].T @ scaled[low:high] for low, high in pairwise(edges)]
    moments = [scaled[low:high].T @ reading[low:high] for low, high in pairwise(edges)]
    gram, moment = sum(grams) + penalty, sum(moments)
    left = 0.0
    for (low, high), block_gram, block_moment in zip(pairwise(edges), grams, moments, strict=True):
        coef = np.linalg.lstsq(gram - block_gram, moment - block_moment, rcond=1e-12)[0]
        left += float(np.sum((reading[low:high] - scaled[low:high] @ coef)[scored[low:high]] ** 2))
    return left
