"""The last word of held-out blocks of time, where much of the structure has other causes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects.grids import longest_segment
from ..estimators.regressor import DynamicBiasRegressor
from .adding import held_out_rms, with_missing
from .trial import LEVEL, Key, Suspect, Trial, key_of

SMALLEST_SHARE = 0.3
"""Share below which a suspect is not tried on held-out blocks."""
CLEAR_HELP = 0.8
"""Held-out error with a suspect over that without, up to which it is named although other structure is left."""
TRIED = 3
"""Suspects that are tried so."""


def helping(model: DynamicBiasRegressor, X: Any, y: Any, trial: Trial, suspects: Sequence[Suspect]) -> list[Suspect]:
    """The suspect whose addition lowers the error on held-out blocks most, if it lowers it clearly.

    The last word where much of the structure has other causes: the model is fitted anew, time constants and all,
    without each block. Tried are the first suspects, and those that seem to help most with the time constants held.
    """
    before = held_out_rms(model, X, y)
    tried = [s for s in suspects[:TRIED] if s.supported() and s.share >= SMALLEST_SHARE]
    share = len(trial.data.reading) / model.reading_.n_readings
    tried += [trial.suspect(i) for i in _by_blocks(trial, model.alpha_ * share, model.washout_)[:TRIED]]
    tried = [suspect for suspect in tried if suspect.p_value <= LEVEL]
    found = [held_out_rms(with_missing(model, clone(suspect.effect)), X, y) for suspect in tried]
    best = int(np.argmin(found)) if found else -1
    return [tried[best]] if found and found[best] <= CLEAR_HELP * before else []


def _by_blocks(trial: Trial, alpha: float, washout: float) -> list[int]:
    """Candidates that help the model's own part most on blocks of time held out, best first.

    One of each kind and column; `alpha` is the ridge penalty, `washout` how long a start-up is felt [s].
    """
    data = trial.data
    felt = min(washout, longest_segment(trial.record) / 10)
    started = data.seconds - data.seconds[np.searchsorted(data.segment, data.segment)] >= felt
    best: dict[Key, tuple[float, int]] = {}
    for i, effect in enumerate(trial.candidates):
        columns = np.column_stack((trial.own, trial.columns[i]))
        left = held_out_sum_of_squares(columns, data.reading, started, alpha)
        best[key_of(effect)] = min(best.get(key_of(effect), (np.inf, -1)), (left, i))
    return [i for _, i in sorted(best.values())]


def held_out_sum_of_squares(
    columns: np.ndarray, reading: np.ndarray, scored: np.ndarray, alpha: float, n_blocks: int = 5
) -> float:
    """What a ridge fit leaves of the `scored` rows of blocks of time that it did not see; column 0 is the constant."""
    scales = np.linalg.norm(columns[:, 1:] - columns[:, 1:].mean(axis=0), axis=0) / np.sqrt(len(columns))
    scaled = columns / np.concatenate(([1.0], np.where(scales > 0, scales, 1.0)))
    penalty = alpha * np.diag([0.0, *np.ones(len(scales))])
    edges = np.linspace(0, len(reading), n_blocks + 1).astype(int)
    grams = [scaled[low:high].T @ scaled[low:high] for low, high in pairwise(edges)]
    moments = [scaled[low:high].T @ reading[low:high] for low, high in pairwise(edges)]
    gram, moment = sum(grams) + penalty, sum(moments)
    left = 0.0
    for (low, high), block_gram, block_moment in zip(pairwise(edges), grams, moments, strict=True):
        coef = np.linalg.lstsq(gram - block_gram, moment - block_moment, rcond=1e-12)[0]
        left += float(np.sum((reading[low:high] - scaled[low:high] @ coef)[scored[low:high]] ** 2))
    return left
