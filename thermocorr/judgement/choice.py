"""Which of several explanations is the cause, and what it cannot be told from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects import Periodic
from ..records import Record
from ..records.history import Thinned
from .anywhere import MANY
from .levels import (
    ALIKE,
    CLEAR,
    EVEN,
    EVIDENT,
    GAIN,
    HALF,
    LATE,
    LEAST,
    LEVEL,
    MOST_STEPS,
    MOST_WAVES,
    NEAR,
    OUTWEIGHS,
    SPEAKS,
    STRONG,
    TIE,
    TRIFLE,
    TRIFLING_HELP,
)
from .likelihood import Comparison
from .pool import Explanation, Key
from .worth import HeldOut, Worth


def says_the_same(judged: Comparison, best: Tried, rivals: Sequence[Tried]) -> list[Tried]:
    """Rivals of other kinds that could make most of what the best one makes of the reading."""
    return [t for t in rivals if t.key != best.key and judged.overlap(best.number, t.number) > ALIKE]


def superfluous(judged: Comparison, best: Tried, same: Sequence[Tried], rivals: Sequence[Tried]) -> list[Tried]:
    """Rivals as likely as the best one, of another kind, of whose gain it leaves less than half.

    They say something else of the reading, and yet one of the two is enough.
    """
    known = {best.key, *(t.key for t in same)}
    asked = [t for t in rivals if t.key not in known and t.score >= best.score - TIE]
    if not asked or not best.score > 0:
        return []
    beside = judged.gained_beside(best.number, [t.number for t in asked])
    alone = judged.screen(judged.base.theta, [t.number for t in asked])
    return [t for t, left, own in zip(asked, beside, alone, strict=True) if left < HALF * own]


WAVE: Key = (Periodic.kind, None)


@dataclass(frozen=True, kw_only=True)
class Tried:
    """An explanation with what speaks for it."""

    explanation: Explanation
    number: int
    """Among the explanations of the comparison."""
    score: float
    """Gain in log likelihood, less what its columns and the choice of its parameters would gain by chance."""
    full: float
    """Score of the record as a whole, also where a few stretches decide it."""
    as_law: float
    """As `full`, whatever copies of its column explain: how likely it is among the laws of one column."""
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
    def sure(self) -> bool:
        """Whether its evidence is strong, and lies evenly over the record."""
        return self.score >= STRONG and self.scatter <= EVEN

    @property
    def key(self) -> Key:
        """Kind and column."""
        return self.explanation.key

    @property
    def size(self) -> tuple[int, int]:
        """Number of columns, and of parameters that are tuned: what makes one explanation plainer than another."""
        return int(self.explanation.columns.shape[1]), self.explanation.n_tuned


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


def still_sought(tried: Sequence[Tried], found: Sequence[Cause], steps: int) -> list[Tried]:
    """What was tried, less kinds found often enough; of recorded columns, late, only those of sure evidence.

    `steps` of the causes found are steps or disturbances.
    """
    waves, late = sum(cause.tried.key == WAVE for cause in found), len(found) - steps >= LATE
    enough = [*(MANY if steps >= MOST_STEPS else ()), *([WAVE] if waves >= MOST_WAVES else ())]
    return [t for t in tried if t.key not in enough and (t.sure or not late or t.key[1] is None)]


def trifling(t: Tried, share: float, record: Record) -> bool:
    """Whether an explanation may be what averages have spoilt in the causes found: next to nothing, in averages."""
    return isinstance(record, Thinned) and share < TRIFLE and t.worth.mean < TRIFLING_HELP


def started(tried: Sequence[Tried]) -> tuple[Tried | None, list[Tried]]:
    """The start of the record, which the model has, where it is proven and nothing proven is likelier; and its rivals.

    Hardly any device is at rest when a record begins: what depends on time alone must be likelier by half a tie.
    """
    start = max((t for t in tried if t.proven and t.explanation.is_start), key=lambda t: t.score, default=None)
    if start is None:
        return None, []
    least = {True: start.score + TIE / 2, False: start.score}
    if any(t.named and not harms(t) and t.score > least[t.explanation.effect.of_time_alone] for t in tried):
        return None, []
    return start, [t for t in tried if as_likely(t, start) and t.score > 0]


def chosen(
    tried: Sequence[Tried], by_chance: Callable[[Tried], bool], settles: Callable[[Tried], bool]
) -> tuple[Tried | None, list[Tried]]:
    """The cause to take in, if there is one, and its rivals: what is as good, or nearly.

    What is proven comes before what only helps; of what is proven, what helps on later data comes first. Among what
    helps nearly as much the likelihood decides; between two laws of one column in the record as a whole, since how
    evenly its evidence lies, and what its copies explain, are questions to the column, not to its law. A recorded
    column that does harm on later stretches and on held-out blocks alike is accused only where its evidence is
    strong and even, lest the noise is not what it is thought to be; a product with a column that is worth nothing
    on either, where it is strong.

    Where nothing is proven and nothing helps much, what depends on time alone may be what wanders: see `_settling`.
    """
    proven = [t for t in tried if t.named and not harms(t)]
    helpful = [t for t in proven if t.worth.both >= GAIN]
    if not proven:
        helpful = [t for t in tried if t.worth.both >= _enough(t) and _spoken_for(t) and not by_chance(t)]
    if not proven and not helpful:
        return _settling(tried, settles)
    least = NEAR * max((t.worth.both for t in helpful), default=-np.inf)
    near = [t for t in helpful if t.worth.both >= least] or proven
    best = max(near, key=lambda t: t.score)
    if best.explanation.effect.of_time_alone:  # what it is worth says little: it spoils the worth of others, too
        best = max(proven, key=lambda t: t.score)
    recorded = [t for t in near if t.key[1] is not None and t.worth.both >= best.worth.both]
    if best.key[1] is None and helpful:  # a recorded column before a kind that says nearly the same
        best = max((t for t in recorded if t.score >= best.score - TIE), key=lambda t: t.score, default=best)
    if best.key[1] is not None:  # a column as it is before the same one bent or late; likelier, where it helps less
        plainer = [t for t in proven if bent(best, t)]
        enough = [t for t in plainer if max(t.score - best.score, t.as_law - best.as_law) >= -TIE * (t in near)]
        best = max(enough, key=lambda t: t.score, default=best)
    rivals = [
        t
        for t in tried
        if (as_likely(t, best) and t.score > 0)
        or (best in helpful and _spoken_for(t) and t.worth.both >= NEAR * best.worth.both)
    ]
    return best, rivals


def as_likely(t: Tried, best: Tried) -> bool:
    """Whether an explanation scores as much as the best, or would if no tuned parameter had a price.

    A plainer one comes first for it, but the record does not tell them apart.
    """
    return max(t.score - best.score, t.score + t.tuning - best.score - best.tuning) >= -TIE


def _settling(tried: Sequence[Tried], settles: Callable[[Tried], bool]) -> tuple[Tried | None, list[Tried]]:
    """What depends on time alone and leaves nothing that wanders, and what is as likely; None where there is none.

    A weak drift is not proven beside noise that may wander as slowly. Where it is far likelier than such noise, settles
    all of it, and later data do not speak against it, it is what a user has to know.
    """
    slow = [t for t in tried if t.explanation.effect.of_time_alone and t.worth.both >= LEAST and t.score >= EVIDENT]
    best = max((t for t in slow if settles(t)), key=lambda t: t.score, default=None)
    return best, [] if best is None else [t for t in tried if t.score >= max(best.score - TIE, 0.0)]


def bent(t: Tried, plain: Tried) -> bool:
    """Whether an explanation takes the column of a plain one less plainly: bent, late, or as a product."""
    return t.key[1] is not None and t.key[1] == plain.key[1] and t.size > plain.size


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


def harms(t: Tried) -> bool:
    """Whether data that were not learned from speak against a recorded column; it must be clear but for a product."""
    if t.key[1] is None or max(t.worth.later, t.worth.blocks) >= 0:
        return False
    if t.explanation.effect.is_product:
        return t.score < STRONG
    return t.worth.mean <= -GAIN and not t.sure


def _enough(t: Tried) -> float:
    """Help from which what is not proven is named [dB]; columns of other places and products may help by chance."""
    return CLEAR if t.key[1] is not None or t.explanation.effect.is_product else GAIN


def _spoken_for(t: Tried) -> bool:
    """Whether help alone may name it: not rejected by the likelihood, and not of time alone.

    For a product, help is no proof (`Effect.is_product`): the likelihood must speak for it, and no column be recorded.
    """
    effect = t.explanation.effect
    if effect.is_product:
        return t.score > 0 and t.key[1] is None
    return t.score >= SPEAKS and not effect.of_time_alone


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
