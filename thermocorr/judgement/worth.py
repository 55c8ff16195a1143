"""What is worth adding: of all that is there, what lowers the error on later data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..effects import Covariate, LaggedCovariate, SeveralSteps
from ..effects.grids import time_grid
from ..effects.protocol import Effect
from .anywhere import DATED
from .levels import BETWEEN_ROWS, GAIN, LITTLE, NEAR_ROWS, SHARP, TINY
from .out_of_sample import Worth
from .pool import Pool
from .search import Search, Term


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A term, in the form in which it helps most, and what it is worth."""

    term: Term
    effect: Effect
    worth: Worth


def by_worth(pool: Pool, terms: Sequence[Term], search: Search) -> tuple[list[Cause], list[Cause]]:
    """What is worth adding, in the order in which it lowers the error most, and what is there and too small."""
    left = [_Offer(pool, term, search) for term in terms]
    held, causes = pool.out_of_sample, list[Cause]()
    while left:
        best = max((offer for offer in left if offer.weigh(held)), key=lambda offer: offer.worth.later, default=None)
        if best is None:
            break
        left.remove(best)
        causes.append(best.cause)
        held = held.with_columns(best.columns)
    for offer in left:
        offer.weigh(held)
    return causes, [offer.cause for offer in left]


class _Offer:
    """A term in the forms that it may have."""

    def __init__(self, pool: Pool, term: Term, search: Search):
        effect = term.tried.explanation.effect
        self.term, self.always = term, effect.is_product or effect.kind == "hysteresis"
        self.moment = _moment(pool, effect)
        alike = [t for t in term.alike if not t.explanation.in_model and t.key[0] not in DATED]
        forms = _forms(pool, effect)
        made = [pool.coarse(each.columns) for each in pool.of(forms)]
        self.forms = [
            (effect, search.coarse(term.tried)),
            *((t.explanation.effect, search.coarse(t)) for t in alike),
            *zip(forms, made, strict=True),
        ]

    def weigh(self, held) -> bool:
        """Whether it is worth adding beside a model; in the form that helps most, a wider one by `GAIN` more."""
        worths = [held.worth([columns], self.moment)[0] for _, columns in self.forms]
        best = 0
        for k in range(1, len(worths)):
            if worths[k].later > worths[best].later + GAIN:
                best = k
        (self.effect, self.columns), self.worth = self.forms[best], worths[best]
        return self.worth.adds(self.always)

    @property
    def cause(self) -> Cause:
        return Cause(term=self.term, effect=self.effect, worth=self.worth)


def _moment(pool: Pool, effect: Effect) -> float | None:
    """Share of the record before the last moment at which an effect begins or ends; None for one without."""
    if effect.kind not in (*DATED, SeveralSteps.kind):
        return None
    seconds = effect.seconds_
    return pool.share_before(max(seconds) if isinstance(seconds, list | tuple) else seconds)


def _forms(pool: Pool, effect: Effect) -> list[Effect]:
    """Other forms of a recorded column: at once, and with a spectrum of lags, as a further thermometer has it."""
    if not isinstance(effect, Covariate | LaggedCovariate):
        return []
    power = effect.get_params(deep=False).get("power", 1)
    spectrum = time_grid(pool.record, 2.0, 0.2, 4.0)
    forms = [LaggedCovariate(effect.column, [float(tau) for tau in spectrum], power=power)]
    return forms


def is_between_rows(term: Term, pool: Pool) -> bool:
    """Whether a cause is a trace of what the temperature did between its rows.

    It needs nothing but the temperature, as does all that it cannot be told from, and is no lead or delay of many rows;
    it explains no more than that may make, and helps little. Where the temperature turns as sharply as it moves, it may
    help more; and what helps nowhere at all, and does not look ahead, may be what a jump makes.
    """
    effects = [t.explanation.effect for t in (term.tried, *term.alike)]
    near = NEAR_ROWS * pool.record.usual_step()
    if not all(effect.of_temperature_alone and effect.moves_by() <= near for effect in effects):
        return False
    worth = pool.out_of_sample.worth([pool.coarse(term.tried.explanation.columns)])[0]
    helped, between, (curve, jump) = min(worth.later, worth.blocks), pool.between_rows, BETWEEN_ROWS
    sharp = between.turning > SHARP
    most = jump if helped < TINY and sharp and not effects[0].foresees else curve
    return helped < (1.0 if sharp else LITTLE) and term.size <= most * between.curve
