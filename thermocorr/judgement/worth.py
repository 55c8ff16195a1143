"""What is worth adding: of all that is there, what lowers the error on later data."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..effects import CATALOGUE, Covariate, Hysteresis, LaggedCovariate
from ..effects.grids import time_grid
from ..effects.protocol import Effect
from .anywhere import DATED
from .levels import CLEAR, GAIN
from .out_of_sample import OutOfSample, Worth
from .pool import Pool
from .search import Search, Term


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A term, in the form in which it helps most, and what it is worth."""

    term: Term
    effect: Effect
    worth: Worth
    moment: float | None
    """Share of the record before the last moment at which it begins or ends; None for kinds without one."""
    evenly: bool
    """Whether it must help evenly: a product, or what has memory."""


def by_worth(pool: Pool, terms: Sequence[Term], search: Search) -> tuple[list[Cause], list[Cause]]:
    """What is worth adding, what lowers the error most first, and what is there and too small.

    One is added after the other, or two at once where one hides what the other is worth; and left out again where it is
    worth nothing beside those that came later.
    """
    kept, left, held = list[_Offer](), [_Offer(pool, term, search) for term in terms], pool.out_of_sample
    while left:
        able = [offer for offer in left if offer.weigh(held)]
        best = [max(able, key=lambda offer: offer.worth.rank)] if able else _best_pair(left, held)
        if not best:
            break
        kept += best
        left = [offer for offer in left if offer not in best]
        held = held.with_columns(np.column_stack([offer.columns for offer in best]))
    for offer in list(kept):
        if not offer.weigh(_beside(pool, kept, offer)):
            kept.remove(offer)
            left.append(offer)
    for offer in (*kept, *left):
        offer.weigh(_beside(pool, kept, offer))
    kept.sort(key=lambda offer: -offer.worth.rank)
    return [offer.cause for offer in kept], [offer.small for offer in left if offer.term.tried.proven]


def _best_pair(left: Sequence[_Offer], held: OutOfSample) -> list[_Offer]:
    """The two of which each is worth most beside the other, or none."""
    best, most = list[_Offer](), 0.0
    for one, other in combinations(left, 2):
        if one.weigh(held.with_columns(other.columns)) and other.weigh(held.with_columns(one.columns)):
            rank = min(one.worth.rank, other.worth.rank)
            best, most = ([one, other], rank) if rank > most else (best, most)
    return best


def _beside(pool: Pool, kept: Sequence[_Offer], one: _Offer) -> OutOfSample:
    """The user's model with all that is kept but for one."""
    columns = [offer.columns for offer in kept if offer is not one]
    return pool.out_of_sample.with_columns(np.column_stack(columns)) if columns else pool.out_of_sample


def lacking(pool: Pool, exclude: Collection[str]) -> list[Cause]:
    """What the model's own lags lack: at most one lag, delay, rate or lead, if it helps much.

    Other effects are judged beside many lags, so that a poor thermal part makes none of them look guilty. Where none
    was found, what the model's few lags leave is looked at.
    """
    if pool.rows.exact:
        return []
    kinds = [kind for name, kind in CATALOGUE.items() if kind.thermal_rank and name not in exclude]
    thermal = pool.unmade([effect for kind in kinds for effect in kind.candidates(pool.record)])
    search = Search(pool.beside(np.column_stack((pool.own, *pool.start)), thermal), anywhere=())
    search.run(most=1)
    return [cause for cause in by_worth(pool, search.terms(), search)[0] if cause.worth.both >= CLEAR]


class _Offer:
    """A term in the forms that it may have."""

    def __init__(self, pool: Pool, term: Term, search: Search):
        effect = term.tried.explanation.effect
        self.term = term
        self.evenly = effect.is_product or isinstance(effect, Hysteresis)
        self.moment, self.columns = pool.moment(effect), search.coarse(term.tried)
        alike = [t for t in term.alike if not t.explanation.in_model and t.key[0] not in DATED]
        forms = _forms(pool, effect)
        made = [pool.coarse(each.columns) for each in pool.of(forms)]
        self.forms = [
            (effect, search.coarse(term.tried)),
            *((t.explanation.effect, search.coarse(t)) for t in alike),
            *zip(forms, made, strict=True),
        ]

    def weigh(self, held: OutOfSample) -> bool:
        """Whether it is worth adding beside a model, in the form that clearly helps most."""
        worths = [held.worth([columns], self.moment)[0] for _, columns in self.forms]
        best = 0
        for k in range(1, len(worths)):
            if min(worths[k].later - worths[best].later, worths[k].both - worths[best].both) > GAIN:
                best = k
        (self.effect, self.columns), self.worth, self.plain = self.forms[best], worths[best], worths[0]
        if not self.term.tried.proven and self.worth.both < CLEAR:
            return False
        spoilt = self.moment is None and self.worth.blocks < -GAIN
        return self.worth.adds(self.evenly) and not spoilt

    @property
    def cause(self) -> Cause:
        """It, where it is worth adding; as it was found is among what it cannot be told apart from."""
        return Cause(term=self.term, effect=self.effect, worth=self.worth, moment=self.moment, evenly=self.evenly)

    @property
    def small(self) -> Cause:
        """It, as it was found."""
        return Cause(term=self.term, effect=self.forms[0][0], worth=self.plain, moment=self.moment, evenly=self.evenly)


def _forms(pool: Pool, effect: Effect) -> list[Effect]:
    """Another form of a recorded column: with a spectrum of lags, as a further thermometer has it."""
    if not isinstance(effect, Covariate | LaggedCovariate):
        return []
    power = effect.get_params(deep=False).get("power", 1)
    spectrum = time_grid(pool.record, 2.0, 0.2, 4.0)
    return [LaggedCovariate(effect.column, [float(tau) for tau in spectrum], power=power)]
