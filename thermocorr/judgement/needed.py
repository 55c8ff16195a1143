"""A backward check: causes that later ones make superfluous, and what the others are worth without them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .choice import Cause
from .levels import LEVEL
from .likelihood import Comparison
from .worth import HeldOut


def needed(judged: Comparison, causes: Sequence[Cause], p_value: Callable[[float, Cause], float]) -> list[Cause]:
    """The causes that are still proven beside all others that are kept.

    `p_value` gives the error probability of a gain in log likelihood by a cause. Slow lags of
    the model that only help make no proven cause superfluous: the likelihood does not speak for them.
    """
    causes = [cause for cause in causes if cause.tried.proven or not cause.tried.explanation.in_model]
    by_number = {cause.adopted: cause for cause in causes}
    kept = list(by_number)
    doubtful = list(kept)
    while doubtful:
        level = judged.level_with(kept)
        others = {k: [other for other in kept if other != k] for k in doubtful if by_number[k].tried.proven}
        gains = {k: level - judged.level_with(beside) for k, beside in others.items()}
        p_values = {k: p_value(gain, by_number[k]) for k, gain in gains.items()}
        failed = [k for k, p in p_values.items() if p > LEVEL]
        if failed:  # one at a time: where two say the same, neither is needed beside the other
            kept.remove(max(failed, key=p_values.__getitem__))
        elif len(doubtful) == len(kept):
            break
        doubtful = [k for k in failed if k in kept] or list(kept)
    return [by_number[k] for k in kept]


def worth_beside(causes: Sequence[Cause], start: HeldOut, coarse: Sequence[np.ndarray]) -> list[Cause]:
    """The causes with what each is worth beside all others, rather than beside those that were found before it.

    `start` is the base of the start; `coarse` holds the columns of each cause as data not learned from are judged on.
    """
    weighed = []
    for k, cause in enumerate(causes):
        others = [columns for i, columns in enumerate(coarse) if i != k]
        held = start.with_columns(np.column_stack(others)) if others else start
        weighed.append(replace(cause, tried=replace(cause.tried, worth=held.worth([coarse[k]])[0])))
    return weighed
