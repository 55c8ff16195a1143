"""A backward check: causes that later ones make superfluous, and what the others are worth without them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .choice import Cause, harms
from .dated import MANY
from .levels import GAIN, LATE, LEVEL, OUTWEIGHS
from .likelihood import Comparison
from .worth import HeldOut


def first_proven(
    judged: Comparison,
    causes: list[Cause],
    price: Callable[[int], float],
    p_value: Callable[[float, Cause], float],
) -> list[Cause]:
    """The causes, where the first is proven, before or beside the others; none where it is not.

    Of two products each makes the other look like noise: neither is proven before the other is taken in. `price` gives
    what an explanation gains by chance, `p_value` the error probability of a gain in log likelihood by a cause.
    """
    if not causes or causes[0].tried.proven:
        return causes
    first, own = causes[0].tried, [cause.adopted for cause in causes]
    gain = judged.level_with(own) - judged.level_with(own[1:])
    score = gain - price(first.number)
    tried = replace(first, score=score, full=score, p_value=p_value(gain, causes[0]))
    return [replace(causes[0], tried=tried), *causes[1:]] if tried.proven else []


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


def still_helping(causes: Sequence[Cause], start: HeldOut, coarse: Sequence[np.ndarray]) -> list[int]:
    """Which causes stay where all are weighed beside all others, numbers in `causes`.

    What was taken in because it helped may do harm beside what was found after it: it stood for that. So may a recorded
    column that was proven; it stays where it would be accused if it were found now (`harms`), and beside `LATE` others
    where its evidence outweighs any harm. What depends on time alone was not taken in for its help. Parameters as of
    `worth_beside`.
    """
    kept = list(range(len(causes)))
    while len(kept) > 1:
        weighed = worth_beside([causes[k] for k in kept], start, [coarse[k] for k in kept])
        late = sum(cause.tried.key not in MANY for cause in weighed) > LATE
        worths = {k: c.tried.worth.both for k, c in zip(kept, weighed, strict=True) if _stood_for_more(c, late)}
        worst = min(worths, key=worths.__getitem__, default=None)
        if worst is None:
            break
        kept.remove(worst)
    return kept


def _stood_for_more(cause: Cause, late: bool) -> bool:
    """Whether a cause, with what it is worth beside all others, is no longer one."""
    tried = cause.tried
    if tried.proven:
        spoilt = tried.key[1] is not None and tried.worth.both <= -GAIN and tried.score < OUTWEIGHS
        return harms(tried) or (late and spoilt)
    return tried.worth.both < GAIN and not tried.explanation.effect.of_time_alone


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
