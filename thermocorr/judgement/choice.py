"""Which of several explanations is the cause, and what it cannot be told from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects import Periodic
from ..records import Record
from ..records.history import Thinned
from .levels import ALIKE, CLEAR, GAIN, LEVEL, NEAR, SPEAKS, STRONG, TIE, TRIFLE, TRIFLING_HELP
from .likelihood import Comparison
from .pool import Explanation, Key
from .worth import HeldOut, Worth


def says_the_same(judged: Comparison, best: Tried, rivals: Sequence[Tried]) -> list[Tried]:
    """Rivals of other kinds that could make most of what the best one makes of the reading."""
    return [t for t in rivals if t.key != best.key and judged.overlap(best.number, t.number) > ALIKE]


WAVE: Key = (Periodic.kind, None)


@dataclass(frozen=True, kw_only=True)
class Tried:
    """An explanation with what speaks for it."""

    explanation: Explanation
    number: int
    """Among the explanations of the comparison."""
    score: float
    """Gain in log likelihood, less what its columns and the choice of its parameters would gain by chance."""
    p_value: float
    """Error probability, the whole family having been tried."""
    worth: Worth
    scatter: float
    """How unevenly its evidence lies over the record, 1 as noise would have it; 0 where that does not matter."""
    uneven: bool
    """Whether the likelihood alone would prove it, but a few stretches of time decide."""
    tuning: float = 0.0
    """What the score has lost for parameters that were tuned."""
    copied: bool = False
    """Whether it would be proven, but copies of its column moved in time explain nearly as much."""
    outdoes: bool = False
    """Whether it helps more than any of these copies, be it proven or not."""

    @property
    def proven(self) -> bool:
        """Whether the likelihood proves it."""
        return self.p_value <= LEVEL and self.score > 0

    @property
    def named(self) -> bool:
        """Whether it can be a cause whatever else is proven."""
        return self.proven or (self.outdoes and self.score > 0)

    @property
    def key(self) -> Key:
        """Kind and column."""
        return self.explanation.key


@dataclass(frozen=True, kw_only=True)
class Cause:
    """An explanation that was taken in, and those that cannot be told apart from it."""

    tried: Tried
    alike: tuple[Tried, ...]
    others: tuple[Tried, ...]
    """Rejected alternatives, best first."""
    share: float
    """Share of the structured variance that it explains."""
    size: float
    """Standard deviation of what it explains, in the unit of the reading."""
    adopted: int = -1
    """Number among the explanations that the comparison has adopted; -1 for none."""


def first_of_each(ranked: Iterable[Tried]) -> list[Tried]:
    """The first of each kind and column."""
    best: dict[Key, Tried] = {}
    for tried in ranked:
        best.setdefault(tried.key, tried)
    return list(best.values())


def trifling(t: Tried, share: float, record: Record) -> bool:
    """Whether an explanation may be what averages have spoilt in the causes found: next to nothing, in averages."""
    return isinstance(record, Thinned) and share < TRIFLE and t.worth.mean < TRIFLING_HELP


def chosen(tried: Sequence[Tried]) -> tuple[Tried | None, list[Tried]]:
    """The cause to take in, if there is one, and its rivals: what is as likely, or nearly.

    Of what is proven, or helps more than any copy of its column, what helps on later data comes first; among what helps
    nearly as much, the likelihood decides. Where there is none, what helps clearly. What depends on time alone is
    chosen by the likelihood: what it is worth says little, for it spoils the worth of others, too.
    """
    named = [t for t in tried if t.named and not harms(t)] or [
        t for t in tried if t.worth.both >= CLEAR and _may_be_named_for_help(t)
    ]
    most = max((t.worth.both for t in named), default=0.0)
    near = [t for t in named if most < GAIN or t.worth.both >= NEAR * most]
    best = max(near, key=lambda t: t.score, default=None)
    if best is not None and best.explanation.effect.of_time_alone:
        best = max(named, key=lambda t: t.score)
    if best is None:
        return None, []
    if best.key[1] is None and most >= GAIN:  # a recorded column before a kind that says nearly the same
        columns = [t for t in near if t.key[1] is not None and t.worth.both >= best.worth.both]
        best = max((t for t in columns if t.score >= best.score - TIE), key=lambda t: t.score, default=best)
    least = NEAR * best.worth.both if best.worth.both >= GAIN else np.inf
    rivals = [
        t
        for t in tried
        if (as_likely(t, best) and t.score > 0) or (t.worth.both >= least and _may_be_named_for_help(t))
    ]
    return best, rivals


def as_likely(t: Tried, best: Tried) -> bool:
    """Whether an explanation scores as much as the best, or would if no tuned parameter had a price.

    A plainer one comes first for it, but the record does not tell them apart.
    """
    return max(t.score - best.score, t.score + t.tuning - best.score - best.tuning) >= -TIE


def plainer_than(best: Tried, same: Sequence[Tried]) -> Tried | None:
    """The column that is added as it is and says what a product with a column says, helping nearly as much; or None.

    A product goes on growing beyond the record, where both factors are larger than any that was seen: of a voltmeter's
    hot 70 % a product with another meter's temperature made 0.55 ppm on the cold rest, the room as it is 0.35
    (`benchmarks/real_diagnosis.py`; of 36 simulated records with a product or a column hidden, seeds 139, 166 and 167,
    none was told otherwise).
    """
    if not best.explanation.effect.is_product or best.key[1] is None:
        return None
    least = NEAR * best.worth.both
    added = [t for t in same if t.key[1] is not None and not t.explanation.effect.is_product]
    return max((t for t in added if t.worth.both >= least), key=lambda t: t.score, default=None)


def _may_be_named_for_help(t: Tried) -> bool:
    """Whether the likelihood does not reject it, and it is no product and not of time alone."""
    return t.score >= SPEAKS and not (t.explanation.effect.is_product or t.explanation.effect.of_time_alone)


def harms(t: Tried) -> bool:
    """Whether data that were not learned from speak against a recorded column; it must be clear but for a product.

    Strong evidence outweighs it.
    """
    if t.key[1] is None or max(t.worth.later, t.worth.blocks) >= 0:
        return False
    return t.score < STRONG and (t.explanation.effect.is_product or t.worth.mean <= -GAIN)


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
