"""Effects that differ in their time constants alone, as one effect: its lags run side by side.

The recursion of one lag waits for its last result; four of them take hardly longer than one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sklearn.base import clone

from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..records import Record

TIMES = "time_constants"
Wanted = tuple[Record, Effect, range]
"""An effect that has learned a record, and where its columns belong among all that are asked for."""


@dataclass(frozen=True)
class Bank:
    """An effect that is walked through a record, for one that is asked for or for several."""

    record: Record
    effect: Effect
    places: Sequence[Sequence[int]]
    """Where each of its columns belongs among all that are asked for."""


def banks(wanted: Sequence[Wanted]) -> list[Bank]:
    """What to walk through records, so that all columns that are asked for are there."""
    groups: dict[object, list[Wanted]] = {}
    for number, each in enumerate(wanted):
        groups.setdefault(_alike(each) if vars(type(each[1])).get("lags_apart") else number, []).append(each)
    return [bank for group in groups.values() for bank in _joined(group)]


def _alike(wanted: Wanted) -> tuple[object, ...]:
    """What effects that are walked together have in common: all but their time constants, of which each has some."""
    record, effect, _ = wanted
    given = effect.get_params(deep=False)
    return id(record), type(effect), np.size(given.pop(TIMES)) > 0, str(sorted(given.items()))


def _joined(group: Sequence[Wanted]) -> list[Bank]:
    """One bank for effects that differ in their time constants; one for each where names do not tell columns apart."""
    record, first, _ = group[0]
    if len(group) > 1:
        times = {time for _, effect, _ in group for time in seconds_array(getattr(effect, TIMES)).tolist()}
        joined = clone(first).set_params(**{TIMES: sorted(times)})
        joined.learn(record)
        places: dict[str, list[int]] = {}
        for _, effect, own in group:
            for name, place in zip(effect.names(), own, strict=True):
                places.setdefault(name, []).append(place)
        names = joined.names()
        if len(set(names)) == len(names) and set(names) == set(places):
            return [Bank(record, joined, [places[name] for name in names])]
    return [Bank(record, effect, [[place] for place in own]) for record, effect, own in group]
