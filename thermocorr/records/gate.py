"""The gate of one input: which later values are credible.

No input moves faster than in the fitted record by more than a margin. A value that does is held back, and the last one
stands in its place, until the next one speaks for it: one that returns was a fault of one row; one that stays away is
accepted, and doubted. The model then goes on with it, and a second time with the last value from before (its `twin`):
the doubtful values may have added the difference to the bias, now or in what the device remembers of them. A doubt ends
when the input is back, by a jump or all the way, or after `ACCEPTED` steps away in the fitted range, pauses not counted
and the last one without a jump: then the room has really moved. An input that stands still to the last digit for much
longer than it ever did is doubted too, but for the ends of its range.

A value is judged by those before it alone, so that a stream, a block and a whole record say the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .record import Record, holes
from .times import Floats
from .types import Number, Positive, Size

JUMP = "jump"
"""Flag of a row in which an input is held back; reason why a fitted row is left out."""
MARGIN = 2.0
"""How much faster than in the fitted record an input may move, and how much longer it may stand still."""
ACCEPTED = 30.0
"""Usual steps after which an input that has not come back is accepted."""
MOST_JUMPS, APART, LOUD = 10, 3.0, 5.0
"""Jumps of a fitted input at most that may be there and back again; how far apart they are from its other moves; size
of the farthest move over the rms one, below which none is looked for."""
AGREED, DOUBTED, ACCEPTED_AGAIN = range(3)
"""How an input stands while there are two courses."""
CHUNK = 1 << 16
NAN = math.nan


@dataclass(frozen=True)
class Motion:
    """Motion of an input in the fitted record."""

    low: Number
    high: Number
    """Range of its values."""
    spread: Size
    """Their standard deviation."""
    farthest: Size
    """The farthest that it moved in a usual step."""
    rest: Size
    """The longest that it stood still [s]."""
    step: Positive
    """The usual step [s]."""
    jumps: bool = field(default=False, compare=False, repr=False)
    """True if the farthest move was so far that it may have been a jump."""

    @classmethod
    def of(cls, record: Record, column: Any) -> Motion:
        """Learn an input's motion from a record."""
        farthest, rest, squares = 0.0, 0.0, 0.0
        for moves, still in _moves(record, column):
            farthest = max(farthest, float(moves.max(initial=0.0)), -float(moves.min(initial=0.0)))
            rest, squares = max(rest, still), squares + float(moves @ moves)
        known = record.moments(column)
        size = float(np.sqrt(squares / max(known.n, 1)))
        return cls(known.low, known.high, known.std, farthest, rest, record.usual_step(), farthest > LOUD * size)

    @property
    def move(self) -> float:
        """The farthest that it may move in a usual step."""
        return MARGIN * self.farthest

    @property
    def longest_rest(self) -> float:
        """The longest that it may stand still [s]."""
        # An input may stand still for three usual steps in any case.
        return MARGIN * self.rest + 3.0 * self.step


def _moves(record: Record, column: Any) -> Iterator[tuple[Floats, float]]:
    """Usual and largest movement per row, longest rest [s]."""
    step, even = record.usual_step(), record.times.even_step is not None and not len(record.skipped)
    for segment in record.segments:
        value, since = np.nan, np.nan
        for start in range(segment.start, segment.stop, CHUNK):
            rows = record.kept(start, min(start + CHUNK, segment.stop))
            values = np.asarray(record.columns[column][rows], float)
            if not len(values):
                continue
            begins = value != value
            moves, rest = np.diff(values, prepend=values[0] if begins else value), 0.0
            still = not moves[int(begins) :].all()
            seconds = record.times.seconds(rows, record.first_stamp()) if still or not even else None
            if still and seconds is not None:
                stood = _stood(moves, seconds, seconds[0] if since != since else since)
                rest, since = float((seconds - stood).max()), float(stood[-1])
            elif seconds is not None:
                since = float(seconds[-1])
            if seconds is not None and not even:
                moves[1:] /= np.maximum(np.diff(seconds) / step, 1.0)
            yield moves, rest
            value = float(values[-1])
            since = since if seconds is not None else np.nan


def excursions(record: Record, column: Any, motion: Motion, max_gap: float) -> NDArray[np.intp]:
    """Rows of excursions that jump away and back.

    A few of its moves, an even number up to `MOST_JUMPS`, are `APART` times as far as the next one: 0.2 % of records
    whose moves have a tail like the inverse cube have such two. The gate without these finds what returns.
    """
    none = np.zeros(0, np.intp)
    if not motion.jumps:
        return none
    top = np.concatenate([np.abs(moves) for moves, _ in _moves(record, column)])
    if len(top) <= MOST_JUMPS:
        return none
    top = np.sort(np.partition(top, -MOST_JUMPS - 1)[-MOST_JUMPS - 1 :])[::-1]
    usual = next((top[k] for k in range(MOST_JUMPS, 0, -2) if top[k - 1] > APART * top[k]), None)
    if usual is None:
        return none
    run, usually, away = object(), replace(motion, farthest=float(usual)), [none]
    for segment in record.segments:
        if segment.run != run:
            run, gate = segment.run, Gate(usually, max_gap)
        places = record.kept_places(segment.start, segment.stop)
        rows = record.rows_at(places)
        values = np.asarray(record.columns[column][rows], float)
        said = gate.many(values, record.times.seconds(rows, record.first_stamp()))
        if said is None:
            continue
        for first, behind in zip(*holes(np.flatnonzero(np.isfinite(said.twin))), strict=True):
            if behind < len(places) and not said.accepted[behind]:
                away.append(places[first:behind])
    return np.concatenate(away)


def _stood(moves: Floats, seconds: Floats, since: float) -> Floats:
    """Start of each row's rest [s]; `since` continues the last."""
    last = np.maximum.accumulate(np.where(moves != 0.0, np.arange(len(moves)), -1))
    return np.where(last >= 0, seconds[last], since)


class Judged(NamedTuple):
    """Result of a gate for a row, or for consecutive rows."""

    value: Any
    """The value; the last one that was accepted where it is held back."""
    twin: Any
    """What might stand there instead, where the value is held back or doubted; NaN elsewhere."""
    held: Any
    """True if it is held back."""
    accepted: Any
    """True if a doubt ends with this row because the input has stayed away."""


class Gate:
    """Judges the values of one input, row after row.

    `motion` (Motion). `max_gap` (float): After a longer step the next value is judged like a first one [s].
    """

    __slots__ = (
        "_move", "_rest", "_step", "at", "away_for", "began", "calm", "last", "level", "max_gap", "motion", "odd",
        "seen", "since",
    )  # fmt: skip

    def __init__(self, motion: Motion, max_gap: float):
        self.motion, self.max_gap = motion, max_gap
        self._move, self._step, self._rest = motion.move, motion.step, motion.longest_rest
        self.put(EMPTY)

    def put(self, state: tuple[float, ...]) -> None:
        """Go on where `state` was taken; `EMPTY` before the first value."""
        self.last, self.at, self.seen, self.odd, self.level, self.began, self.away_for, self.since = state
        self.calm = self.odd == 0.0 and self.level != self.level  # nothing is held back or doubted

    def state(self) -> tuple[float, ...]:
        """All that is remembered.

        The last value that was accepted, its time and that of the last row [s], how far a value that is held back lies
        away (0 for none), the last value before a doubt and its time [s], how many usual steps it has been away since,
        pauses left out, since when the input stands still [s].
        """
        seen = self.at if self.calm else self.seen
        return self.last, self.at, seen, self.odd, self.level, self.began, self.away_for, self.since

    def one(self, value: float, time: float) -> Judged | None:
        """Judge one row; None where its value is credible."""
        passed, away = time - self.at, value - self.last
        if self.calm and passed <= self._step and -self._move <= away <= self._move:
            self.last, self.at = value, time
            if away:
                self.since = time
                return None
            rests = time - self.since <= self._rest or self._at_end(value)
            return None if rests else Judged(value, self._moved(value), False, False)
        seen = self.at if self.calm else self.seen
        if passed <= self.max_gap:
            reach = self._move * (passed / self._step if passed > self._step else 1.0)
            last, before = self.last, self.at
            other = last + math.copysign(self.motion.farthest, away)
        else:  # a first value: near the fitted range, or held back too
            low, high = self.motion.low, self.motion.high
            last, before, reach = min(max(value, low), high), time, max(high - low, self._move)
            self.level, self.since, away, passed = NAN, time, value - last, 0.0
            other = low if away > 0 else high  # it may be anywhere
            if not time - seen <= self.max_gap:
                self.odd = 0.0
        self.seen, jumps = time, away > reach or -away > reach
        if jumps:
            if self.level != self.level and not away * self.odd > 0.0:
                self.odd, self.calm = away, False
                return Judged(last, other, True, False)
            if self.level != self.level:
                self.level, self.began, self.away_for = last, before, 0.0
        accepted = False
        if self.level == self.level:
            self.away_for += min(passed / self._step, 1.0)  # a pause says nothing
            far, inside = abs(value - self.level), self.motion.low <= value <= self.motion.high
            if far <= self._move or (jumps and far <= self._move * (time - self.began) / self._step):
                self.level = NAN  # it is back
            elif self.away_for > ACCEPTED and inside and not jumps:
                self.level, accepted = NAN, True
        if value != self.last:
            self.since = time
        self.last, self.at, self.odd, self.calm = value, time, 0.0, self.level != self.level
        if self.level == self.level:
            return Judged(value, self.level, False, False)
        stands = time - self.since > self._rest and not self._at_end(value)
        return Judged(value, self._moved(value) if stands else NAN, False, accepted) if accepted or stands else None

    def _at_end(self, value: float) -> bool:
        """True if an input may rest here, as rain at zero."""
        return value == self.motion.low or value == self.motion.high

    def _moved(self, value: float) -> float:
        """Range of an input that stands still: it widens."""
        middle = (self.motion.low + self.motion.high) / 2
        return value + math.copysign(self.motion.spread, value - middle)

    def many(self, values: Floats, times: Floats) -> Judged | None:
        """Judge consecutive rows at `times` [s]; None for no finding."""
        n, moves = len(values), np.diff(values, prepend=self.last)
        if self.calm and self.max_gap == np.inf and moves.max() <= self._move >= -moves.min() and moves.all():
            self.put((float(values[-1]), float(times[-1]), NAN, 0.0, NAN, NAN, 0.0, float(times[-1])))
            return None
        steps = np.diff(times, prepend=self.at)
        far = ~(np.abs(moves) <= self._move * np.maximum(steps / self._step, 1.0)) | (steps > self.max_gap)
        stood = _stood(moves, times, self.since)
        stands = (times - stood > self._rest) & (values != self.motion.low) & (values != self.motion.high)
        odd = np.append(np.flatnonzero(far | stands), n)
        if self.calm and odd[0] == n:
            self._put(values, times, stood, n - 1)
            return None
        found, any_said, k = Judged(values.copy(), np.full(n, NAN), np.zeros(n, bool), np.zeros(n, bool)), False, 0
        while k < n:
            if k and self.calm and self.at == times[k - 1] and self.since == stood[k - 1]:
                ahead = int(odd[np.searchsorted(odd, k)])
                if ahead > k:
                    self._put(values, times, stood, ahead - 1)
                    k = ahead
                    continue
            said = self.one(float(values[k]), float(times[k]))
            if said is not None:
                any_said = True
                for column, own in zip(found, said, strict=True):
                    column[k] = own
            k += 1
        return found if any_said else None

    def _put(self, values: Floats, times: Floats, stood: Floats, k: int) -> None:
        """Continue behind row `k`, with nothing held or doubted."""
        time = float(times[k])
        self.put((float(values[k]), time, time, 0.0, NAN, NAN, 0.0, float(stood[k])))


EMPTY = (NAN, NAN, NAN, 0.0, NAN, NAN, 0.0, NAN)
"""What a `Gate` remembers before the first value."""


class Doubt:
    """Doubted inputs, row by row: two courses of the model.

    An input is doubted from a row in which it has a twin until it is accepted, or until the two courses are one again:
    they have agreed for as long as the effects remember. So a belief ends the doubt of its own input alone.

    `inputs` (int): How many there are. `deviation` (float): Standard deviation of the residuals. `memory` (float): How
    long the effects remember [s].
    """

    def __init__(self, inputs: int, deviation: float, memory: float):
        # Two courses of the inputs agree that differ by less than a millionth of the residuals' deviation.
        self.inputs, self.agrees, self.memory = inputs, 1e-6 * deviation, memory
        self.put()

    def put(self, state: tuple[tuple[int, ...], float] | None = None) -> None:
        """Go on where `state` was taken; with one course for None."""
        self.stands, self.apart = state or ((AGREED,) * self.inputs, -math.inf)

    def state(self) -> tuple[tuple[int, ...], float]:
        """Status of each input; time of the last difference [s]."""
        return self.stands, self.apart

    def rows(self, doubted: Any, accepted: Any, difference: Floats, seconds: Floats) -> Floats:
        """Change of the bias by doubtful inputs, shape (n,).

        `doubted`, `accepted` (array of bool, shape (n, inputs)): Whether each input has a twin, and whether its doubt
        ends. `difference` (array, shape (n,)): Of the biases of the two courses. `seconds` (array, shape (n,)): Times.
        """
        found = np.abs(difference)
        found[np.isnan(found)] = np.inf
        k = np.arange(len(found))
        apart = np.maximum.accumulate(np.where((found > self.agrees) | doubted.any(axis=1), k, -1))
        apart_at = np.where(apart >= 0, seconds[apart], self.apart)
        agreed = (seconds - apart_at > self.memory)[:, np.newaxis]
        events = np.select([doubted, agreed, accepted], [DOUBTED, AGREED, ACCEPTED_AGAIN], -1)
        last = np.maximum.accumulate(np.where(events >= 0, k[:, np.newaxis], -1), axis=0)
        stands = np.where(last >= 0, np.take_along_axis(events, last, 0), self.stands)
        self.stands, self.apart = tuple(stands[-1].tolist()), float(apart_at[-1])
        counts = (stands == DOUBTED).any(axis=1) | ~(stands == ACCEPTED_AGAIN).any(axis=1)  # so before all of them
        return np.where(counts, found, 0.0)

    def over(self) -> bool:
        """True if the two courses are one again."""
        return self.stands == (AGREED,) * self.inputs
