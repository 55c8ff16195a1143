"""Causes, one after the other: every explanation is compared with every other, the best is taken in, and so on.

Two questions are asked of each. Is it there: how much does the likelihood of the record gain, its noise estimated
anew? And what is it worth: how far does the error fall on data that it was not learned from?
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from .alike import says_the_same, superfluous
from .chance import HelpOfNoise
from .choice import Cause, Tried, bent, chosen, first_of_each, plainer_than, started, still_sought, trifling, unrecorded
from .copies import Copies
from .dated import MANY
from .family import ANYWHERE, Family
from .imitations import Imitations
from .levels import (
    FINER,
    GAIN,
    HALF,
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
from .likelihood import Fit
from .nearby import move_again, moved, moved_for_another
from .needed import first_proven, needed, still_helping, worth_beside
from .pairs import may_hide, pairs
from .plain_steps import with_plain_steps
from .pool import Key, Pool
from .worth import HeldOut, Worth


class Search:
    """Finds causes one after the other.

    Parameters
    ----------
    pool : Pool
    anywhere : collection of str
        Kinds that are looked for at every row, period or delay.
    small : float
        Twice the log likelihood up to which what a better thermal part could do without is too small for a word.
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
        self.moved_for: set[tuple[int, int]] = set()
        """Causes that were to be moved for what is found next."""
        self.was: tuple[int, Cause, Fit] | None = None
        """Place of the last one that was, and cause and fit as they were, until something is found beside it."""
        self.any_moved = False
        """Whether a cause was moved, so that what each is worth is not what it was when it was found."""
        self.paired = False
        """Whether a cause was proven with another one only."""
        self.half_a_pair = False
        """Whether the last cause was: the other one, not the start of the record, is what it was proven with."""
        self._first_look: list[Tried] | None = None

    def anew(self) -> Search:
        """Another search of the same causes that has found none; both must not have begun. The first look is shared."""
        if self._first_look is None and not self.pool.rows.exact:
            self._first_look = self.look()
        other = copy(self)
        other.judged, other.moved_beside, other.moved_for, other.copies = self.judged.copy(), set(), set(), {}
        other.family = self.family.beside(other.judged)
        return other

    def causes(
        self, first: Key | None = None, hopeless: Callable[[Search, Sequence[Cause]], bool] = lambda *_: False
    ) -> tuple[list[Cause], list[Tried]]:
        """The causes, and what was tried last; with `first`, the first one is of that kind, or there are none.

        There are none, either, where those found so far are `hopeless`.
        """
        found: list[Cause] = []
        if self.pool.rows.exact:
            return [], []
        while True:
            steps = sum(cause.tried.key in MANY for cause in found)
            looked = self._first_look if self._first_look is not None and not found else self.look()
            tried = still_sought(self.believed(looked, found), found, steps)
            if first is not None and not found:
                of_kind = [t for t in tried if t.key == first]
                best = self._choice(of_kind, found)[1] or next(iter(of_kind), None)
                rivals = [t for t in tried if best is not None and t.score >= best.score - TIE]
            else:
                tried, best, rivals = self._choice(tried, found)
            alone, self.half_a_pair = best is not None, False
            if not alone and self._moved_for_another(found, tried):
                continue
            if not alone and (found or first is None):
                best, rivals = self._of_a_pair()
            enough = self.rounded or len(found) - steps == MOST
            if best is None or enough or (found and trifling(best, self.share(best), self.record)):
                self._put_back(found)
                found = found if first is None else first_proven(self.judged, found, self.family.price, self._chance_of)
                plain = with_plain_steps(self.pool, self.family, found)
                self.any_moved |= [*map(id, plain)] != [*map(id, found)]
                return self._needed(plain), tried
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
            self.was = None
            if best.key in MANY:
                least = max((t.score for t in others if t.key not in MANY), default=0.0)
                found += self._further_steps(MOST_STEPS - steps - 1, least)
            if hopeless(self, found):
                return [], tried

    def _moved_for_another(self, found: list[Cause], tried: Sequence[Tried]) -> bool:
        """Whether a cause was moved for what may be found next; or back, where nothing was found."""
        if self.was is not None:
            self._put_back(found)
            return True
        refused, fit = {t.key for t in tried if t.proven}, self.judged.base
        there = moved_for_another(self.pool, self.family, found, refused, self.moved_for)
        if there is not None:
            self.was = *there, fit
            self._held_anew(found)
        return there is not None

    def _put_back(self, found: list[Cause]) -> None:
        """Move the cause back that was moved last, if nothing was found beside it."""
        if self.was is None:
            return
        (place, before, fit), self.was = self.was, None
        if self.judged.moves(before.adopted, before.tried.explanation.columns, -np.inf):  # as many columns as before
            found[place], self.judged.base = before, fit
            self._held_anew(found)

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
            best = self._likelier(best, rivals, [t for t in tried if t.key == best.key])
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

    def _likelier(self, best: Tried, rivals: Sequence[Tried], own: Sequence[Tried]) -> Tried:
        """Best proven rival that is likelier than every explanation of the kind and helps half as much; or `best`.

        The same column bent or late must be likelier by more than a tie, whatever copies explain; what needs no
        recorded column, and helps no more, by a tie.
        """
        score, full, least = max(t.score for t in own), max(t.full for t in own), HALF * best.worth.mean
        law = max(t.as_law for t in own)
        more = [min(t.score - score, t.full - full) for t in rivals]
        more = [min(m, t.as_law - law) - TIE if bent(t, best) else m for t, m in zip(rivals, more, strict=True)]
        likelier = [t for t, m in zip(rivals, more, strict=True) if t.proven and m > 0 and t.worth.mean >= least]
        likelier = [t for t in likelier if t.score >= score + TIE or not unrecorded(t, best)]
        same = says_the_same(self.judged, best, likelier)
        return max(same, key=lambda t: t.score, default=best)

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

    def proven_beside(self, found: Sequence[Cause]) -> list[Cause]:
        """The causes that are not made superfluous by later ones."""
        return needed(self.judged, found, self._chance_of)

    def _needed(self, found: list[Cause]) -> list[Cause]:
        """The causes that are needed beside the later ones; where some are not, the others are weighed anew."""
        if len(found) < 2 and not self.paired:
            return found
        kept = self.proven_beside(found)
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
