"""Everything that is tried, and what each explanation would gain by chance: its price and its error probability."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from ..effects import Delay, Effect, Periodic
from ..records import seconds_of
from .anywhere import DATED, Shifts, dated, delays, filtered, louder, tries, waves
from .blocks import said
from .levels import DIFFERENT, IN_GAPS, LEVEL, LOOKS, OF_PRODUCTS, SCATTER, TIE
from .likelihood import Comparison, Fit
from .pool import Explanation, Key, Pool

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
    """Gain in log likelihood, less where few stretches of the record make it, or copies of its column gain as well."""
    score: float
    """The gain less its price."""
    tuning: float
    """What of that is the price of tuned parameters."""
    p_value: float
    """Error probability, the whole family having been tried."""
    uneven: bool = False
    """Whether the likelihood alone would prove it, but a few stretches of time decide."""
    copied: bool = False
    """Whether it would be proven, but copies of its column moved in time explain nearly as much."""

    @property
    def proven(self) -> bool:
        """Whether the likelihood proves it."""
        return self.p_value <= LEVEL and self.score > 0

    @property
    def key(self) -> Key:
        """Kind and column."""
        return self.explanation.key

    def as_likely(self, best: Tried) -> bool:
        """Whether it scores as much as the best, or would if no tuned parameter had a price."""
        return (
            self.score > 0 and max(self.score - best.score, self.score + self.tuning - best.score - best.tuning) >= -TIE
        )


class Family:
    """The explanations that are compared; each has the number that it has in the comparison.

    `pool` (Pool). `judged` (Comparison): Gets the columns of every explanation. `anywhere` (collection of str): Kinds
    that are looked for at every row, period or delay.
    """

    def __init__(self, pool: Pool, judged: Comparison, anywhere: Collection[str]):
        self.pool, self.judged, self.anywhere = pool, judged, anywhere
        self.tried: list[Explanation] = []
        """The explanations, those of the pool without their columns, see `Pool.with_columns`."""
        self.coarse: list[np.ndarray] = []
        """Columns of the explanations, as data not learned from are judged on."""
        for group in pool.groups():
            for i in self.add(group):
                self.tried[i] = self.tried[i].forgotten()
        self.unseen = IN_GAPS * _of_gaps(pool, judged)
        """Log likelihood that one explanation may gain by what the temperature did in gaps."""
        keys = [explanation.key for explanation in self.tried]
        self.sizes = {key: keys.count(key) for key in dict.fromkeys(keys)}
        every = {WAVE: judged.n, **tries(judged.n)}  # every row, every period
        self.sizes |= {key: size for key, size in every.items() if key[0] in anywhere}
        self.n_tests = LOOKS * sum(min(size, DIFFERENT) for size in self.sizes.values())
        if Delay.kind in anywhere:
            late: Key = (Delay.kind, None)
            self.sizes[late] = self.sizes.get(late, 0) + 2 * self.shifts.most  # and between rows
        self.tests = {key: max(self.n_tests, LOOKS * size) for key, size in self.sizes.items()}
        """What the error probability of one test is multiplied with (Bonferroni), by kind and column."""

    def add(self, explanations: Sequence[Explanation]) -> list[int]:
        """Further explanations; returns their numbers."""
        self.judged.explanations += [None] * (len(self.tried) - len(self.judged.explanations))
        self.judged.add([explanation.columns for explanation in explanations])
        self.tried += explanations
        self.coarse += [self.pool.coarse(explanation.columns) for explanation in explanations]
        return list(range(len(self.tried) - len(explanations), len(self.tried)))

    def add_anywhere(self) -> None:
        """The best moments of all rows, wave of all periods and delay, under wandering and under white noise.

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
            begun.update((said(e.effect), e) for e in dated(pool, judged, theta, rows, self.anywhere))
            if Periodic.kind in self.anywhere:
                unmade.update((said(effect), effect) for effect in waves(pool, judged, theta, rows))
            if Delay.kind in self.anywhere and self.shifts.most:
                unmade.update((said(effect), effect) for effect in delays(pool, self.shifts, judged, theta, rows))
        self.add([*begun.values(), *pool.of(list(unmade.values()))])

    @cached_property
    def shifts(self) -> Shifts:
        """The temperature at every delay."""
        return Shifts(self.judged, self.pool.temperature, self.pool.data.segment, self.pool.rows.weight)

    def alive(self) -> list[int]:
        """Numbers of explanations that say something beside the present base."""
        return [i for i in range(len(self.judged.explanations)) if self.judged.width(i)]

    def price(self, i: int) -> float:
        """What an explanation's columns, tuned parameters and the choice of them gain by chance (Schwarz 1978)."""
        return self.price_of_columns(self.judged.width(i)) + self.price_of_tuning(i)

    def price_of_columns(self, width: int) -> float:
        """What so many columns gain by chance."""
        return 0.5 * math.log(self.judged.n) * width

    def seen(self, full: float, i: int) -> float:
        """The log likelihood that an explanation gains, less what it may tell of gaps that nobody saw.

        It may by the temperature, or at moments or periods that were looked for.
        """
        effect = self.tried[i].effect
        sought = self.tried[i].key[0] in ANYWHERE or not effect.of_time_alone
        return full - self.unseen if sought and not effect.inputs() else full

    def price_of_tuning(self, i: int) -> float:
        """What the tuned parameters and the choice of them gain by chance."""
        tried = self.tried[i]
        return max(0.5 * math.log(self.judged.n) * tried.n_tuned, math.log(self.sizes.get(tried.key, 1)))

    @property
    def looks(self) -> int:
        """How often the whole family has been tried: beside each number of causes so far."""
        return 1 + len(self.judged.causes)

    def p_value(self, gain: float, i: int, found: int | None = None) -> float:
        """Error probability of an explanation, the whole family having been tried (Wilks 1938; Bonferroni).

        It was tried beside each number of terms up to those `found`, all so far by default.
        """
        explanation = self.tried[i]
        chance = chdtrc(explanation.columns.shape[1], 2 * max(gain, 0.0))
        looks = self.looks if found is None else 1 + found
        return float(min(1.0, looks * self.tests.get(explanation.key, 1.0) * chance))

    def weighed(self, i: int, fit: Fit) -> Tried:
        """An explanation with what speaks for it: its fit beside the base."""
        full = self.seen(fit.level - self.judged.base.level, i) / self._louder(i, fit)
        gain = full / max(1.0, self._scatter(i, fit, full) / self.usual_scatter(i))
        chance = self.p_value(gain, i)
        return Tried(
            explanation=self.tried[i],
            number=i,
            gain=gain,
            score=gain - self.price(i),
            tuning=self.price_of_tuning(i),
            p_value=chance,
            uneven=chance > LEVEL >= self.p_value(full, i),
        )

    def _louder(self, i: int, fit: Fit) -> float:
        """How much louder than its noise the record is around a wave."""
        effect = self.tried[i].effect
        if not isinstance(effect, Periodic):
            return 1.0
        return louder(self.judged, fit.theta, 2 * np.pi * self.pool.spacing / seconds_of(effect.period, "period"))

    def _scatter(self, i: int, fit: Fit, gain: float) -> float:
        """How unevenly the evidence for an explanation lies over the record; 0 where it does not matter."""
        if gain <= self.price(i) or self.tried[i].effect.of_time_alone:  # what lies in one stretch is decided there
            return 0.0
        return self.judged.scatter(i, fit.theta)

    def usual_scatter(self, i: int) -> float:
        """Scatter up to which evidence counts in full, the benefit of the doubt.

        Products with a recorded column, of which there are most, have none.
        """
        explanation = self.tried[i]
        return OF_PRODUCTS if explanation.effect.is_product and explanation.key[1] is not None else SCATTER


def _of_gaps(pool: Pool, judged: Comparison) -> float:
    """Log likelihood that what the temperature did in gaps may make, by its share of all that is to be explained."""
    rows = float(pool.data.counts.sum())
    moved = pool.felt_in_gaps / rows / judged.unit**2
    white, structure = judged.innovation, judged.unexplained() - judged.innovation
    if not moved > 0 or not structure > 0:
        return 0.0
    return rows * moved / (2 * white * float(np.median(pool.data.counts))) * min(1.0, moved / structure)
