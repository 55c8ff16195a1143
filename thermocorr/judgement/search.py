"""The search: a set of terms, one score, moves that raise it.

The score of a set is the log likelihood of the record under it, its noise estimated anew, less a price for each term:
what its columns, its tuned numbers and the places at which it was sought gain by chance (Schwarz 1978). Terms are
added, one or two at once, tuned, dropped and exchanged until nothing gains. What is added must be proven: its error
probability, the whole family having been tried, is below `LEVEL`, given all others that are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtrc
from sklearn.base import clone

from ..effects import Covariate, Delay, Interaction, LaggedCovariate, LaggedModulation, Periodic
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..model.averages import averaged_copies, key_of
from ..model.out_of_sample import GAIN, OutOfSample, Worth
from ..model.surrogates import moved
from ..output.words import effect_text
from ..records import Record
from .levels import (
    ALIKE,
    DIFFERENT,
    FINE,
    FRUITLESS,
    HELPFUL,
    INFLATION,
    LEVEL,
    LOOKS,
    NEARLY,
    ROUNDED_OFF,
    SHARES,
    SPEAKS,
    TIE,
)
from .scan import DATED, Shifts, dated, delays, filtered, is_shown, tries, waves
from .score import Comparison, Fit
from .terms import Explanation, Key, Pool


def together(thermometers: pd.DataFrame) -> float:
    """Rms of the reading by all thermometers' errors."""
    return float(np.sqrt((thermometers["wandering"] ** 2).sum())) if len(thermometers) else 0.0


@dataclass(frozen=True, kw_only=True)
class Copies:
    """Gains of time-shifted copies of an effect's columns.

    A few slow swings go with a few others by chance, whatever noise is assumed. What the copies gain in log likelihood
    is what such swings gain of a record that has nothing to do with them: half a unit for each column where the noise
    is as it seems, and ten times as much where the record has structure that no cause explains. Evidence is divided by
    it (genomic control: Devlin & Roeder, Biometrics 55, 1999; Ebisuzaki, Journal of Climate 10, 1997).
    """

    inflation: float
    """Gain of the copies in log likelihood over what noise that is as it seems would give them."""
    help: float
    """The most that one of them helps on later stretches [dB]."""

    @classmethod
    def of(cls, pool: Pool, judged: Comparison, held: OutOfSample, number: int, effect: Effect) -> Copies:
        """Copies of an effect; `number` is its own."""
        names = [
            name for name in effect.inputs() if name in pool.record.columns and name != pool.record.temperature_name
        ]
        records, columns = moved(pool.record, names), []
        # As many copies are walked through together as make four million rows.
        while together := _columns_of(islice(records, max(1, (1 << 22) // pool.record.n_rows)), effect):
            columns += [pool.rows.weighed(part, out=part) for part in together]
        other, first = judged.copy(), len(judged.explanations)
        other.add(columns)
        which = range(first, len(other.explanations))
        gains, width = other.gained_given(number, which), sum(map(other.width, which))
        helped = max(worth.both for worth in held.worth([pool.coarse(part) for part in columns]))
        return cls(inflation=float(2 * gains.sum() / max(width, 1)), help=helped)

    @property
    def excess(self) -> float:
        """Divisor of the evidence."""
        return max(1.0, self.inflation / INFLATION)


def _columns_of(records: Iterable[Record], effect: Effect) -> list[np.ndarray]:
    """Averaged columns of an effect in some records."""
    copies = [(record, clone(effect)) for record in records]
    for record, copied in copies:
        copied.learn(record)
    return averaged_copies(copies, FINE) if copies else []


WAVE: Key = (Periodic.kind, None)
ANYWHERE = (*DATED, Periodic.kind, Delay.kind)
"""Kinds that are looked for at every row, at every period and at every delay of whole rows."""


@dataclass(frozen=True, kw_only=True)
class Tried:
    """An explanation with what speaks for it."""

    explanation: Explanation
    number: int
    """Among the explanations of the comparison."""
    gain: float
    """Gain in log likelihood, less where copies of its column gain as well."""
    score: float
    """The gain less its price."""
    tuning: float
    """What of that is the price of tuned parameters."""
    p_value: float
    """P-value, the whole family having been tried."""
    copied: bool = False
    """True if it would be proven, but copies of its column moved in time explain nearly as much."""

    @property
    def proven(self) -> bool:
        """True if the likelihood proves it."""
        return self.p_value <= LEVEL and self.score > 0

    @property
    def key(self) -> Key:
        """Kind and column."""
        return self.explanation.key

    def as_likely(self, best: Tried) -> bool:
        """True if it scores nearly as much as the best."""
        return (
            self.score > 0 and max(self.score - best.score, self.score + self.tuning - best.score - best.tuning) >= -TIE
        )


class Family:
    """The explanations that are compared, numbered.

    `pool` (Pool). `judged` (Comparison): Gets the columns of every explanation. `anywhere` (collection of str): Kinds
    that are looked for at every row, period or delay.
    """

    def __init__(self, pool: Pool, judged: Comparison, anywhere: Collection[str], say: Callable[[str], None]):
        self.pool, self.judged, self.anywhere = pool, judged, anywhere
        self.tried: list[Explanation] = []
        """The explanations, those of the pool without their columns, see `Pool.with_columns`."""
        self.coarse: list[np.ndarray] = []
        """Columns of the explanations, as data not learned from are judged on."""
        for group in pool.groups():
            say(f"trying {effect_text(group[0].effect)}")
            for i in self.add(group):
                self.tried[i] = self.tried[i].forgotten()
        keys = [explanation.key for explanation in self.tried]
        self.sizes = {key: keys.count(key) for key in dict.fromkeys(keys)}
        every = {WAVE: judged.n, **tries(judged.n)}  # every row, every period
        self.sizes |= {key: size for key, size in every.items() if key[0] in anywhere}
        self.n_tests = LOOKS * sum(min(size, DIFFERENT) for size in self.sizes.values())
        if Delay.kind in anywhere:
            late: Key = (Delay.kind, None)
            self.sizes[late] = self.sizes.get(late, 0) + 2 * self.shifts.most  # and between rows
        self.tests = {key: max(self.n_tests, LOOKS * size) for key, size in self.sizes.items()}
        """What the p-value of one test is multiplied with (Bonferroni), by kind and column."""

    def add(self, explanations: Sequence[Explanation]) -> list[int]:
        """Further explanations; returns their numbers."""
        self.judged.explanations += [None] * (len(self.tried) - len(self.judged.explanations))
        self.judged.add([explanation.columns for explanation in explanations])
        self.tried += explanations
        self.coarse += [self.pool.coarse(explanation.columns) for explanation in explanations]
        return list(range(len(self.tried) - len(explanations), len(self.tried)))

    def add_anywhere(self) -> None:
        """The best moments, wave and delay of all.

        Each of them once. Under the noise that stands alone where white noise is as likely: it would say the same.
        """
        judged, pool = self.judged, self.pool
        begun: dict[str, Explanation] = {}
        unmade: dict[str, Effect] = {}
        noises = [judged.base.theta]
        if judged.base.level - judged.white > TIE:
            noises.append(judged.only_white())
        for theta in noises if self.anywhere else ():
            rows = filtered(judged, theta)
            begun.update((key_of(e.effect), e) for e in dated(pool, judged, theta, rows, self.anywhere))
            if Periodic.kind in self.anywhere:
                unmade.update((key_of(effect), effect) for effect in waves(pool, judged, theta, rows))
            if Delay.kind in self.anywhere and self.shifts.most:
                unmade.update((key_of(effect), effect) for effect in delays(pool, self.shifts, judged, theta, rows))
        self.add([*begun.values(), *pool.of(list(unmade.values()))])

    @cached_property
    def shifts(self) -> Shifts:
        """The temperature at every delay."""
        return Shifts(self.judged, self.pool.temperature, self.pool.data.segment, self.pool.rows.weight)

    def alive(self) -> list[int]:
        """Numbers of explanations that say something given the present base."""
        return [i for i in range(len(self.judged.explanations)) if self.judged.width(i)]

    def price(self, i: int) -> float:
        """Chance gain of an explanation's parameters (Schwarz 1978)."""
        return self.price_of_columns(self.judged.width(i)) + self.price_of_tuning(i)

    def price_of_columns(self, width: int) -> float:
        """Gain of a number of columns by chance."""
        return 0.5 * math.log(self.judged.n) * width

    def price_of_tuning(self, i: int) -> float:
        """Gain of the tuned parameters and their choice by chance."""
        tried = self.tried[i]
        return max(0.5 * math.log(self.judged.n) * tried.n_tuned, math.log(self.sizes.get(tried.key, 1)))

    @property
    def looks(self) -> int:
        """How often the family was tried: once per cause."""
        return 1 + len(self.judged.causes)

    def p_value(self, gain: float, i: int, found: int | None = None) -> float:
        """P-value within the family (Wilks 1938; Bonferroni).

        It was tried with each number of terms up to those `found`, all so far by default.
        """
        explanation = self.tried[i]
        chance = chdtrc(explanation.columns.shape[1], 2 * max(gain, 0.0))
        looks = self.looks if found is None else 1 + found
        return float(min(1.0, looks * self.tests.get(explanation.key, 1.0) * chance))

    def weighed(self, i: int, fit: Fit) -> Tried:
        """An explanation with its evidence given the base."""
        gain = fit.level - self.judged.base.level
        return Tried(
            explanation=self.tried[i],
            number=i,
            gain=gain,
            score=gain - self.price(i),
            tuning=self.price_of_tuning(i),
            p_value=self.p_value(gain, i),
        )


@dataclass(frozen=True, kw_only=True)
class Term:
    """A term of the set, and its rivals."""

    tried: Tried
    """Besides all other terms."""
    alike: tuple[Tried, ...]
    lag_below: float = 0.0
    """Largest lag that the record leaves possible for an effect at once [s]; 0 where it says nothing."""


LATE_FORM = {Covariate.kind: LaggedCovariate.kind, Interaction.kind: LaggedModulation.kind}
"""Effects at once, and their late forms: with no lag these are the same, so no record excludes them."""


class Search:
    """Finds the terms.

    `pool` (Pool). `anywhere` (collection of str): Kinds that are looked for at every row, period or delay. `say`
    (callable): Called with what is being tried.
    """

    def __init__(
        self, pool: Pool, anywhere: Collection[str] = ANYWHERE, say: Callable[[str], None] = lambda text: None
    ):
        self.pool, self.record, self.say = pool, pool.record, say
        self.judged = pool.compared(pool.base)
        self.family = Family(pool, self.judged, anywhere, say)
        self.copies: dict[Key, Copies] = {}
        self.helpful: list[int] = []
        """Numbers of recorded columns that were taken in for their help on later data."""
        self.fruitless = 0
        """Terms in a row that were worth nothing on later data."""
        self.last: list[Tried] = []
        """What was tried last, best first."""

    # ---- one look at everything ------------------------------------------------------------------------------------
    def look(self, judged: Comparison, tuning: bool = True, best_of: int | None = None) -> list[Tried]:
        """The best of each kind and column, given a state."""
        family = self.family
        family.judged = judged
        alive = family.alive()
        first: dict[int, None] = {}
        keys = [explanation.key for explanation in family.tried]
        for gains in judged.screen_twice():
            rank = {i: gains[i] - family.price(i) for i in alive}
            best = {keys[i]: i for i in sorted(alive, key=rank.__getitem__)}
            order = sorted(best.values(), key=lambda i: -rank[i])
            first.update(dict.fromkeys(order[:best_of]))
        found = self._weighed(judged, list(first))
        if tuning:
            found += self._tuned(judged, found)
        return sorted(found, key=lambda t: -t.score)

    def _weighed(self, judged: Comparison, which: Sequence[int]) -> list[Tried]:
        fits = judged.refit(which)
        return [self._discounted(self.family.weighed(i, fit)) for i, fit in zip(which, fits, strict=True)]

    def _discounted(self, t: Tried) -> Tried:
        """An explanation, discounted by its shifted copies."""
        copies = self.copies.get(t.key)
        if copies is None or copies.excess == 1:
            return t
        gain = t.gain / copies.excess
        chance = self.family.p_value(gain, t.number)
        copied = chance > LEVEL >= t.p_value
        return replace(t, gain=gain, score=gain + t.score - t.gain, p_value=chance, copied=copied)

    def _tuned(self, judged: Comparison, found: Sequence[Tried]) -> list[Tried]:
        """The best few kinds with tuned parameters."""
        able = [t for t in found if t.score > 0 and not t.explanation.in_model]
        able.sort(key=lambda t: -t.score)
        # The parameters of the best four kinds are tuned in each turn.
        kinds = list(dict.fromkeys(t.key for t in able))[:4]
        laws = {t.explanation.law: t for t in reversed(able) if t.key in kinds}
        bare = judged.copy()
        near = [retuned(self.pool, bare, t.explanation, SHARES) for t in laws.values()]
        return self._weighed(judged, self.family.add([each for each in near if each is not None]))

    # ---- the search ------------------------------------------------------------------------------------------------
    def run(self, most: int | None = None) -> None:
        """Find the set, of `most` terms."""
        if self.pool.rows.exact:
            return
        self._take_helpful()
        seen, settled = set[frozenset[int]](), False
        while len(self.judged.adopted) != most and not self.rounded and self.fruitless < FRUITLESS:
            self.family.judged = self.judged
            self.family.add_anywhere()
            self.last = self.look(self.judged)
            if self.last:
                self.say(f"best so far: {effect_text(self.last[0].explanation.effect)}")
            best = self._best()
            if best is None:
                if settled or not self._settle():
                    break
                settled = True
                continue
            self.judged.adopt(best.number)
            self._tune([best.number])
            self._drop()
            now = frozenset(self.judged.adopted)
            if now in seen:
                break
            seen.add(now)
            settled = False
        self.family.judged = self.judged

    def _held(self) -> OutOfSample:
        """The user's model with the terms so far."""
        coarse = [self.family.coarse[number] for number in self.judged.adopted]
        return self.pool.out_of_sample.with_columns(np.column_stack(coarse)) if coarse else self.pool.out_of_sample

    def _worth(self, held: OutOfSample, which: Sequence[int]) -> dict[int, Worth]:
        """Out-of-sample gain of explanations added to a model."""
        moments = {i: self.pool.moment(self.family.tried[i].effect) for i in which}
        found = dict[int, Worth]()
        for moment in set(moments.values()):
            own = [i for i in which if moments[i] == moment]
            found |= dict(zip(own, held.worth([self.family.coarse[i] for i in own], moment), strict=True))
        return found

    def _take_helpful(self) -> None:
        """Take in columns that later data confirm.

        Noise that wanders can make what a slow column makes, and a large cause next to a poor law is not proven.
        """
        held, refused = self.pool.out_of_sample, set[Any]()
        while True:
            tried, coarse = self.family.tried, self.family.coarse
            which = [i for i in self.family.alive() if tried[i].key[1] is not None and not tried[i].effect.is_product]
            which = [i for i in which if tried[i].key[1] not in refused]
            worths = dict(zip(which, held.worth([coarse[i] for i in which]), strict=True))
            best = max(which, key=lambda i: worths[i].both, default=None)
            if best is None or worths[best].both < HELPFUL:
                return
            near = [
                i for i in which if tried[i].key[1] == tried[best].key[1] and worths[i].both > worths[best].both - GAIN
            ]
            likeliest = max(self._weighed(self.judged, near), key=lambda t: t.score)
            best = likeliest.number
            copies = Copies.of(self.pool, self.judged, held, best, tried[best].effect)
            if worths[best].both <= copies.help or likeliest.score < SPEAKS:
                refused.add(tried[best].key[1])
                continue
            self.helpful.append(best)
            self.judged.adopt(best)
            held = held.with_columns(coarse[best])

    def _best(self) -> Tried | None:
        """The likeliest proven term that is worth most.

        A recorded column must also outdo copies of it moved in time.
        """
        held = self._held()
        while True:
            proven = [t for t in self.last if t.proven]
            worths = self._worth(held, [t.number for t in proven])
            helping = [t for t in proven if worths[t.number].adds()]
            least = NEARLY * max((worths[t.number].rank for t in helping), default=0.0)
            best = next((t for t in helping if worths[t.number].rank >= least), proven[0] if proven else None)
            if proven and proven[0].explanation.in_model:
                best = proven[0]  # what the model has already comes first where it is likeliest
            if best is None or best.key[1] is None or best.key in self.copies:
                self.fruitless = 0 if best in helping else self.fruitless + 1
                return best
            self.copies[best.key] = Copies.of(self.pool, self.judged, held, best.number, best.explanation.effect)
            self.last = sorted(map(self._discounted, self.last), key=lambda t: -t.score)

    def _settle(self) -> bool:
        """Exchange, tune and drop terms; returns whether anything gained."""
        before = self.judged
        self._exchange()
        self._tune(list(self.judged.adopted))
        self._drop()
        return self.judged is not before

    def _tune(self, which: Sequence[int]) -> None:
        """Tune the parameters of terms given the others."""
        for number in which:
            term = self.family.tried[number]
            if term.in_model or not term.n_tuned:
                continue
            rest = self.judged.dropped(self.judged.adopted.index(number))
            self.family.judged = rest
            # The last steps are fine: what inexact parameters leave would look like a further cause.
            there = retuned(self.pool, rest.copy(), self.pool.with_columns([term])[0], (*SHARES, 0.01, 0.003))
            if there is None:
                continue
            new = self.family.add([there])[0]
            if not rest.width(new):
                continue
            rest.adopt(new)
            if rest.base.level > self.judged.base.level + 0.1:
                self.judged = rest
                self.helpful = [new if each == number else each for each in self.helpful]

    def _drop(self) -> None:
        """Drop terms not proven given the others."""
        while len(self.judged.adopted) > 1:
            chances = []
            for k, number in enumerate(self.judged.adopted):
                if number in self.helpful:
                    continue
                rest = self.judged.dropped(k, tried=False)
                gain = self.judged.base.level - rest.base.level
                price = self.family.price_of_columns(self._width(k)) + self.family.price_of_tuning(number)
                chances.append((self.family.p_value(gain, number, 0) if gain > price else 1.0, k))
            worst, k = max(chances, default=(0.0, 0))
            if worst <= LEVEL:
                return
            self.judged = self.judged.dropped(k)

    def _width(self, k: int) -> int:
        part = self.judged.causes[k]
        return int(part.stop - part.start)

    def _exchange(self) -> None:
        """Exchange a term for a likelier one."""
        for number in list(reversed(self.judged.adopted)):
            if len(self.judged.adopted) < 2 or number not in self.judged.adopted or number in self.helpful:
                continue
            k = self.judged.adopted.index(number)
            rest = self.judged.dropped(k)
            own = self.judged.base.level - rest.base.level
            own -= self.family.price_of_columns(self._width(k)) + self.family.price_of_tuning(number)
            best = next((t for t in self.look(rest, tuning=False, best_of=3) if t.proven), None)
            law = self.family.tried[number].law
            if best is not None and best.score > own + TIE and best.explanation.law != law:
                rest.adopt(best.number)
                self.judged = rest

    # ---- what was found --------------------------------------------------------------------------------------------
    def terms(self) -> list[Term]:
        """The terms, each given the others, with rivals."""
        found = []
        for k, number in enumerate(self.judged.adopted):
            rest = self.judged.dropped(k)
            tried = self.look(rest, tuning=False)
            self.family.judged = rest
            me = self._weighed(rest, [number])[0]
            rivals = [t for t in tried if t.key != me.key and t.as_likely(me)]
            alike = [t for t in rivals if rest.overlap(number, t.number) > ALIKE]
            at_once = next((t for t in alike if LATE_FORM.get(t.key[0]) == me.key[0] and t.key[1] == me.key[1]), None)
            if at_once is not None:
                alike, me = [t for t in alike if t is not at_once], at_once
            late = LATE_FORM.get(str(me.key[0])), me.key[1]
            alike = [t for t in alike if t.key != late]
            found.append(
                Term(
                    tried=replace(me, explanation=self.pool.with_columns([me.explanation])[0]),
                    alike=tuple(alike),
                    lag_below=self._lag_below(rest, me, late) if late[0] else 0.0,
                )
            )
        self.family.judged = self.judged
        return found

    def _lag_below(self, rest: Comparison, me: Tried, late: tuple[str | None, Any]) -> float:
        """Least lag that the record excludes [s]."""
        gains = rest.screen(rest.refit([me.number])[0].theta)
        taus = {
            float(tau[0]): float(gains[i])
            for i, each in enumerate(self.family.tried[: len(gains)])
            if each.key == late and rest.width(i) and len(tau := _lags(each.effect)) == 1
        }
        # 1.92: half of 3.84, the 95 % point of chi-square with one degree of freedom.
        possible = [tau for tau, gain in taus.items() if gain > gains[me.number] - 1.92]
        return float(min((tau for tau in taus if tau > max(possible, default=0.0)), default=0.0))

    def coarse(self, tried: Tried) -> np.ndarray:
        """Columns of an explanation, averaged for unseen data."""
        return self.family.coarse[tried.number]

    @property
    def rounded(self) -> bool:
        """True if what is left is the reading's rounding."""
        left = self.judged.unit * float(np.sqrt(self.judged.unexplained()))
        return bool(left <= ROUNDED_OFF * self.pool.rounding / np.sqrt(12))


def _lags(effect: Any) -> np.ndarray:
    """Time constants of a late form [s]."""
    return seconds_array(effect.time_constants if hasattr(effect, "time_constants") else [effect.time_constant])


# ---- the moves ------------------------------------------------------------------------------------------------------
def retuned(pool: Pool, rest: Comparison, explanation: Explanation, shares: Sequence[float]) -> Explanation | None:
    """An explanation with tuned parameters; None for no gain.

    `rest` is the base that it joins; what else is tried there is forgotten. See `Effect.nearby`.
    """
    rest.explanations = []
    rest.add([each.columns for each in pool.with_columns([explanation])])
    theta = rest.refit([0])[0].theta
    most, best = rest.screen(theta)[0], explanation
    rounding = 1e-3  # gains as small come from rounding: a step may lie anywhere between two rows
    for share in shares:
        near = pool.of(best.effect.nearby(pool.record, share))
        near = [each for each in near if is_shown(pool, each.effect)]
        if not near:
            break
        rest.explanations = []
        rest.add([each.columns for each in near])
        gains = rest.screen(theta)
        if gains.max() > most + rounding:
            first = int(np.argmax(gains > gains.max() - rounding))
            most, best = gains[first], near[first]
    return None if best is explanation else best
