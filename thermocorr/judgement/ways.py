"""The way from one cause to the next: where it led about, another one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence

from ..effects import SensitivityStep, Step
from .causes import Search
from .choice import Cause, Tried, bent, harms
from .dated import MANY
from .levels import FEW_CAUSES, MANY_CAUSES, MOST, SPEAKS_PLAINLY, TIE, WAYS
from .pool import Key, Pool


def searched(pool: Pool, anywhere: Collection[str]) -> tuple[Search, list[Cause], list[Tried]]:
    """A search, its causes, and what was tried last.

    What is taken in first decides what is left for the next. Two effects at once may look like a third one, and what
    that leaves like several more. Where many causes were found and leave noise that wanders, the search is begun with
    one that cannot be told from the first, came next to it, was found later, or came after that, be it proven only
    beside what is found then; fewer causes that are likelier stand. A column that is late may have taken part of
    another cause upon itself, a drift: the search is begun with the column as it is, and as many causes that are
    likelier stand. So may a change of the law at a row, which is a step where a sensitivity drifts; and whatever was
    found first, where a product has greater but uneven evidence. Where none was found, a column that is proven may have
    been refused for the harm that it does while a drift is missing: the search is begun with it, and several causes
    that are likelier stand.
    """
    start, ways = Search(pool, anywhere), _Ways()
    search = start.anew()
    causes, last = search.causes(hopeless=ways.lead_nowhere)
    best, most = (search, causes, last), _value(search, causes)
    for first, more in _other_firsts(causes, last).items():
        if more < 0 and not best[0].judged.wanders:  # nothing is left that fewer causes could explain
            break
        other, ways.most = start.anew(), len(best[1]) + more
        found, tried = other.causes(first=first, hopeless=ways.lead_nowhere)
        several = len(found) > (0 if causes else 1)
        if several and len(found) <= ways.most and _value(other, found) > most:
            best, most = (other, found, tried), _value(other, found)
    return best


class _Ways:
    """What ways have come to: another one need not go on from where one of them was already."""

    def __init__(self) -> None:
        self.most = math.inf
        """Causes beyond which a way is of no use."""
        self.levels: dict[frozenset[tuple[Key, int]], float] = {}
        """Log likelihood of the record with causes of so many kinds and columns, the greatest so far."""

    def lead_nowhere(self, search: Search, found: Sequence[Cause]) -> bool:
        """Whether a way was there already, with causes of the same kinds that are as likely, or there are too many."""
        there = frozenset(Counter(cause.tried.key for cause in found).items())
        level, before = search.judged.base.level, self.levels.get(there, -math.inf)
        if before >= level - TIE:
            return True
        self.levels[there] = max(level, before)
        return _lasting(found) > self.most and _lasting(search.proven_beside(found)) > self.most


def _lasting(causes: Sequence[Cause]) -> int:
    """How many causes there are, but for steps and disturbances: a better cause makes superfluous many of them."""
    return sum(cause.tried.key not in MANY for cause in causes)


def _other_firsts(causes: Sequence[Cause], last: Sequence[Tried]) -> dict[Key, int]:
    """What the search may begin with instead, and how many more causes than now it may then end with."""
    if not causes:
        refused = [t for t in last if t.proven and harms(t)]
        return {t.key: MOST for t in sorted(refused, key=lambda t: -t.score)[:1]}
    if len(causes) < 2 or len({cause.tried.key for cause in causes}) > MANY_CAUSES:
        return {}
    plain = [t.key for cause in causes for t in cause.others if t.proven and _nearly_as_it_is(cause.tried, t)]
    plain += [t.key for t in _uneven_products(causes[0])[:1]]
    others: list[Key] = []
    if len(causes) > FEW_CAUSES:
        next_best = sorted(causes[0].others, key=lambda t: -t.score)
        later = [cause.tried for cause in causes[1:]]
        others = [t.key for t in (*causes[0].alike[:1], *next_best[:1], *later, *next_best[1:])]
    firsts = [key for key in dict.fromkeys((*plain, *others)) if key != causes[0].tried.key]
    return {key: 0 if key in plain else -1 for key in firsts[:WAYS]}


def _uneven_products(first: Cause) -> list[Tried]:
    """Products that explain more of the record as a whole than what was taken in first, the best first.

    Where another product is missing, too, the evidence for each lies as unevenly as what both multiply.
    """
    better = [t for t in first.others if t.explanation.effect.is_product and t.full > first.tried.full]
    return sorted(better, key=lambda t: -t.full)


def _nearly_as_it_is(tried: Tried, plain: Tried) -> bool:
    """Whether the column as it is explains much of what it explains late or bent, or a step much of a change of law."""
    of_law = tried.key[0] == SensitivityStep.kind and plain.key[0] == Step.kind
    return (of_law or bent(tried, plain)) and plain.score >= SPEAKS_PLAINLY * tried.score


def _value(search: Search, causes: Sequence[Cause]) -> float:
    """Log likelihood of the record with these causes, less what their columns and choice would gain by chance."""
    level = search.judged.level_with([cause.adopted for cause in causes])
    return level - sum(search.family.price_in_base(cause.tried.number, cause.adopted) for cause in causes)
