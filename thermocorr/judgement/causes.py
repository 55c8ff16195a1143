"""Causes, one after the other: every explanation is compared with every other, the best is taken in, and so on.

Two questions are asked of each. Is it there: how much does the likelihood of the record gain, its noise estimated
anew? And what is it worth: how far does the error fall on data that it was not learned from?
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from .anywhere import MANY
from .chance import HelpOfNoise
from .choice import (
    Cause,
    Tried,
    chosen,
    first_of_each,
    needed,
    plainer_than,
    says_the_same,
    started,
    still_helping,
    still_sought,
    superfluous,
    trifling,
    worth_beside,
)
from .copies import Copies, Imitations
from .family import ANYWHERE, Family
from .levels import (
    FINER,
    GAIN,
    LEAST_STRUCTURE,
    LEVEL,
    LOOKS,
    MOST,
    MOST_STEPS,
    ROUNDED_OFF,
    SETTLED,
    SHARES,
    TIE,
    TUNED,
    WITHIN,
)
from .nearby import move_again, moved
from .pairs import may_hide, pairs
from .pool import Key, Pool
from .worth import HeldOut, Worth


class Search:
    """Finds causes one after the other.

    `pool` (Pool). `anywhere` (collection of str): Kinds that are looked for at every row, period or delay. `small`
    (float): Twice the log likelihood up to which what a better thermal part could do without is too small for a word.
    """

    def __init__(self, pool: Pool, anywhere: Collection[str] = ANYWHERE, small: float = 0.0):
        self.pool, self.record = pool, pool.record
        self.judged = pool.compared(pool.base)
        self.family = Family(pool, self.judged, anywhere, small)
        white = self.judged.innovation
        self.structured = max(self.judged.unexplained() - white, LEAST_STRUCTURE * white)
        """Mean square beside the base, beyond the noise that nothing foresees."""
        self.held = self.first_held = HeldOut(pool.coarse(pool.reading[:, None]), pool.coarse(pool.base))
        self.imitations = Imitations(pool)
        self.copies: dict[Key, Copies] = {}
        """Copies of columns that were compared with theirs beside the present base."""
        self._chance: HelpOfNoise | None = None
        self.moved_beside: set[tuple[int, int]] = set()
        """Causes that were to be moved, each with the number of causes beside which it was tried."""
        self.any_moved = False
        """Whether a cause was moved, so that what each is worth is not what it was when it was found."""
        self.paired = False
        """Whether a cause was proven with another one only."""
        self.half_a_pair = False
        """Whether the last cause was: the other one, not the start of the record, is what it was proven with."""

    def causes(self) -> tuple[list[Cause], list[Tried]]:
        """The causes, and what was tried last."""
        found: list[Cause] = []
        if self.pool.rows.exact:
            return [], []
        while True:
            steps = sum(cause.tried.key in MANY for cause in found)
            tried = still_sought(self.believed(self.look(), found), found, steps)
            tried, best, rivals = self._choice(tried, found)
            alone, self.half_a_pair = best is not None, False
            if not alone:
                best, rivals = self._of_a_pair()
            enough = self.rounded or len(found) - steps == MOST
            if best is None or enough or (found and trifling(best, self.share(best), self.record)):
                return self._needed(found), tried
            gain = best.score + self.family.price(best.number)
            if move_again(self.pool, self.judged, found, best.key, gain, self.moved_beside):
                self._held_anew(found)
                continue
            if best.proven and alone:  # else the likelihood has nothing to say on its parameters
                best = (self._tuned([best], FINER) or [best])[0]
            same = says_the_same(self.judged, best, rivals)
            plainer = plainer_than(best, same)
            if plainer is not None:
                best, same = plainer, says_the_same(self.judged, plainer, [*rivals, best])
            alike = first_of_each([*same, *superfluous(self.judged, best, same, rivals)])
            others = [t for t in tried if t.key != best.key]
            self.family.keep_only({best.number, *(t.number for t in (*first_of_each(tried), *alike))})
            found.append(self._taken_in(best, alike, others))
            if best.key in MANY:
                least = max((t.score for t in others if t.key not in MANY), default=0.0)
                found += self._further_steps(MOST_STEPS - steps - 1, least)

    def _held_anew(self, found: Sequence[Cause]) -> None:
        """Judge on data not learned from beside causes that were moved."""
        coarse = [self.pool.coarse(cause.tried.explanation.columns) for cause in found]
        self.held, self.any_moved = self.first_held.with_columns(np.column_stack(coarse)), True

    def _choice(self, tried: Sequence[Tried], found: Sequence[Cause]) -> tuple[list[Tried], Tried | None, list[Tried]]:
        """What was tried, the best, or none, and its rivals.

        A recorded column is compared with copies of it moved in time before it is chosen.
        """
        tried = list(tried)
        start, alike = started(tried)
        if start is not None and not self.half_a_pair:
            return tried, start, alike
        while True:
            best, rivals = chosen(tried, self.by_chance, lambda t: self.share(t) >= SETTLED)
            if best is None:
                return tried, None, []
            best = self.imitations.behind(best, rivals, found, self.left)
            if best.key[1] is None or best.key in self.copies:
                return tried, best, rivals
            copies = Copies.of(self.pool, self.judged, self.held, best.number, best.explanation.effect)
            outdone = any(copies.outdone_by(t.worth) for t in tried if t.key == best.key and t.proven)
            self.copies[best.key] = replace(copies, outdone=outdone)
            tried = sorted((self._beside_copies(t) if t.key == best.key else t for t in tried), key=lambda t: -t.score)

    def _beside_start(self, tried: Sequence[Tried]) -> list[Tried]:
        """What was tried; what a better thermal part would explain, as likely as it is beside all the start may be.

        A lead looks like the start of a device that was not at rest, while nothing but the first rows speaks for it.
        """
        start = next((i for i in self.family.alive() if self.family.tried[i].is_start), None)
        thermal = [t for t in tried if t.proven and t.explanation.effect.thermal_rank]
        if start is None or not thermal:
            return list(tried)
        gains = self.judged.gained_beside(start, [t.number for t in thermal])
        beside = dict(zip([t.number for t in thermal], gains.tolist(), strict=True))
        return [self._with_gain(t, beside[t.number]) if t.number in beside else t for t in tried]

    def _with_gain(self, t: Tried, gain: float) -> Tried:
        """An explanation that gains no more than that in log likelihood."""
        score = min(t.score, gain - self.family.price(t.number))
        chance = max(t.p_value, self.family.p_value(gain, t.number))
        return replace(t, score=score, full=min(t.full, score), p_value=chance)

    def _of_a_pair(self) -> tuple[Tried | None, list[Tried]]:
        """The plainer one of two that hide one another, proven together, and its rivals beside the other; or None."""
        family, judged = self.family, self.judged
        alive = [i for i in family.alive() if family.tried[i].key[0] not in ANYWHERE and not family.tried[i].is_start]
        near, n_pairs = pairs(judged, family.tried, [i for i in alive if may_hide(family.tried[i])])
        if not near:
            return None, []
        most, tests = near[0], family.looks * (family.n_tests + LOOKS * n_pairs)
        width = judged.width(most.first) + judged.width(most.second)
        chance = float(tests * chdtrc(width, 2 * max(most.gain, 0.0)))
        together = np.column_stack((family.coarse[most.first], family.coarse[most.second]))
        if chance > LEVEL or self.held.worth([together])[0].both < GAIN:
            return None, []
        gains = {pair.first: pair.gain - family.price(pair.second) for pair in near if pair.second == most.second}
        other = [pair.first for pair in near if pair.second == most.second and pair.gain >= most.gain - TIE]
        both = [
            replace(t, p_value=chance, score=gains[t.number] - family.price(t.number)) for t in self._weighed(other)
        ]
        self.half_a_pair = both[0].proven
        self.paired |= self.half_a_pair
        return (both[0], both[1:]) if both[0].proven else (None, [])

    def _beside_copies(self, t: Tried) -> Tried:
        """An explanation, its evidence divided by what copies of its column explain more than noise gives them."""
        copies = self.copies.get(t.key)
        if copies is None or copies.excess == 1:
            return t
        price, outdoes = self.family.price(t.number), copies.outdone_by(t.worth)
        gain, full = (t.score + price) / copies.excess, (t.full + price) / copies.excess
        chance = self.family.p_value(gain, t.number)
        if outdoes:
            return replace(t, p_value=chance, outdoes=True)
        copied = chance > LEVEL >= t.p_value
        return replace(t, score=gain - price, full=full - price, p_value=chance, copied=copied)

    @property
    def rounded(self) -> bool:
        """Whether what is left is no more than the rounding of the reading, which follows all that the reading does."""
        left = self.judged.unit * float(np.sqrt(self.judged.unexplained()))
        return bool(left <= ROUNDED_OFF * self.pool.rounding / np.sqrt(12))

    def believed(self, tried: Sequence[Tried], found: Sequence[Cause]) -> Sequence[Tried]:
        """What was tried, less what may be traces of the thermometers' errors where these are as large."""
        return self.imitations.taken_out(tried, found, self.left)

    @property
    def left(self) -> float:
        """Standard deviation of the structure that is left, in the unit of the reading."""
        return self.judged.unit * float(np.sqrt(max(self.judged.unexplained() - self.judged.innovation, 0.0)))

    def _taken_in(self, best: Tried, alike: Sequence[Tried] = (), others: Sequence[Tried] = ()) -> Cause:
        """What was chosen, as a cause; it is part of the base from now on."""
        number, share, size = len(self.judged.causes), self.share(best), self.size(best)
        best = replace(best, explanation=self.pool.with_columns([best.explanation])[0])
        cause = Cause(tried=best, alike=tuple(alike), others=tuple(others), share=share, size=size, adopted=number)
        self.judged.adopt(best.number)
        self.held = self.held.with_columns(self.family.coarse[best.number])
        return cause

    def _further_steps(self, most: int, least: float) -> list[Cause]:
        """Steps and disturbances one after the other, as long as each is proven and likelier than any other kind."""
        found: list[Cause] = []
        kinds = [kind for kind, _ in MANY if kind in self.family.anywhere]
        while len(found) < most:
            tried = self._weighed(self.family.add_dated(kinds))
            best = max(tried, key=lambda t: t.score, default=None)
            if best is None or not best.proven or best.score < least:
                break
            found.append(self._taken_in(best))
        return found

    def _needed(self, found: list[Cause]) -> list[Cause]:
        """The causes that are needed beside the later ones; where some are not, the others are weighed anew."""
        if len(found) < 2 and not self.paired:
            return found
        kept = needed(self.judged, found, self._chance_of)
        coarse = [self.pool.coarse(c.tried.explanation.columns) for c in kept]
        helping = still_helping(kept, self.first_held, coarse)
        if len(helping) == len(found) and not self.any_moved:
            return found
        return worth_beside([kept[k] for k in helping], self.first_held, [coarse[k] for k in helping])

    def _chance_of(self, gain: float, cause: Cause) -> float:
        """Error probability of a cause that gains so much beside all others, as unevenly as when it was found."""
        number = cause.tried.number
        gain /= max(1.0, cause.tried.scatter / self.family.usual_scatter(number))
        return self.family.p_value(gain, number, cause.adopted)

    def look(self) -> list[Tried]:
        """The best of each kind and column beside the present base, best first."""
        self.copies = {}
        self.family.add_anywhere()
        alive = self.family.alive()
        screened = self.judged.screen_twice()
        worths = self._worths(alive)
        ranks = [{i: gains[i] - self.family.price(i) for i in alive} for gains in screened]
        ranks.append({i: worths[i].both for i in alive if worths[i].both >= GAIN})
        keys = [explanation.key for explanation in self.family.tried]
        best = [{keys[i]: i for i in sorted(rank, key=rank.__getitem__)} for rank in ranks]
        first = dict.fromkeys(i for of_each in best for i in of_each.values())
        found = self._weighed(list(first), worths)
        found = self._beside_start([*found, *self._tuned(found)])
        return sorted(found, key=lambda tried: -tried.score)

    def share(self, tried: Tried) -> float:
        """Share of the structured variance, at the start, that an explanation takes away from the present base."""
        return float(np.clip(self._taken(tried) / max(self.structured, 1e-300), 0.0, 1.0))

    def size(self, tried: Tried) -> float:
        """Standard deviation of what an explanation takes away from the present base, in the unit of the reading."""
        return self.judged.unit * float(np.sqrt(max(self._taken(tried), 0.0)))

    def _taken(self, tried: Tried) -> float:
        return self.judged.unexplained() - self.judged.unexplained(tried.number)

    def by_chance(self, tried: Tried) -> bool:
        """Whether noise like the base's gives some explanation or other so much help in more than a few records."""
        if self._chance is None or self._chance.held is not self.held:
            self._chance = HelpOfNoise(self.pool, self.judged, self.held, self.family.tried, self.family.coarse)
        return self._chance.gives(tried.key, tried.worth)

    def _weighed(self, which: Sequence[int], worths: dict[int, Worth] | None = None) -> list[Tried]:
        worths, fits = worths or self._worths(which), self.judged.refit(which)
        weighed = [self.family.weighed(i, fit, worths[i]) for i, fit in zip(which, fits, strict=True)]
        return [self._beside_copies(tried) for tried in weighed]

    def _worths(self, which: Sequence[int]) -> dict[int, Worth]:
        return dict(zip(which, self.held.worth([self.family.coarse[i] for i in which]), strict=True))

    def _tuned(self, found: Sequence[Tried], shares: Sequence[float] = SHARES) -> list[Tried]:
        """The best few kinds with their parameters moved to where they explain most.

        What the likelihood does not speak for on the grid is not proven between its points either.
        """
        least = WITHIN * max((t.score for t in found), default=0.0)
        able = [t for t in found if (t.score > max(least, 0.0) or len(found) == 1) and not t.explanation.in_model]
        able.sort(key=lambda t: -t.score)
        kinds = [t.key for t in first_of_each(able)[:TUNED]]
        laws = {t.explanation.law: t for t in reversed(able) if t.key in kinds}
        moved = [self._moved(tried, shares) for tried in laws.values()]
        which = [i for i in moved if i is not None]
        return self._weighed(which) if which else []

    def _moved(self, tried: Tried, shares: Sequence[float]) -> int | None:
        found = moved(self.pool, self.judged.without(()), self.family.tried[tried.number], shares)
        return None if found is None else self.family.add([found])[0]
