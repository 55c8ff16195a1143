"""Words that remember: lag, previous, play, delayed, decays. Each says a value and how far it is off from it.

What a word says is what it follows and a difference: T(t - d) is T and ``late``, the play is T and its ``lead``. So the
columns T(t - d) - T and p - T are one small number each, and no digit is lost on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..effects.expressions import Decays, Delayed, Lag, Play, Word
from ..equations import LagState, decays
from .lagbank import LagInput
from .part import Polynomial
from .statements import Assign, Bracketed, Choice, Costed, Formula, If, Number, Operations, Whole

LONGEST_DELAY = 4096
"""Samples that a delay may reach back to: 16 kB in single precision."""
_FORGOTTEN = 1e-9
"""Decays below it at the end of the fit are nothing in single precision."""

Later = Callable[[int], Any]
"""What a word says in the next stage: a polynomial, or a list of them."""


@dataclass(frozen=True)
class Followed:
    """What a word follows, as the code holds it."""

    value: Formula
    change: Callable[[], Formula]
    """Reads the local variable: change since the sample before, 0 where a segment begins."""
    counted_from: float
    """What the value lacks of the one that the effect means."""
    said: str
    unit: str


class Words:
    """Writes words into a program; `composer` knows its values."""

    def __init__(self, composer: Any):
        self.composer, self.program, self.target = composer, composer.program, composer.program.target
        self._followed: dict[Hashable, Followed] = {}

    def follow(self, word: Word, p: Polynomial, state: Any, name: str, stage: int) -> Later:
        """Let a word follow a value; `state` is what it ended the fit with, for a program that continues it."""
        if isinstance(word, Lag):
            return self._lag(word, p, state, name, stage)
        if isinstance(word, Play):
            return self._play(word, p, state, stage)
        if isinstance(word, Delayed):
            return self._delayed(word, p, state, name, stage)
        assert isinstance(word, Decays)
        return self._decays(word)

    def previous(self, p: Polynomial, state: Any, name: str, stage: int) -> Polynomial:
        """The value less its change."""
        given = self._following(p, state, name, stage)
        said = f"change of {given.said}"
        return p - self.composer.atom(("change", p.moving.key()), given.change, said, given.unit)

    def _following(self, p: Polynomial, ended: float | None, name: str, stage: int) -> Followed:
        """How to follow a value: an input is remembered already, for any other the code keeps the one before."""
        program, composer = self.program, self.composer
        if (given := composer.input_of(p)) is not None:
            return Followed(given.value, lambda: program.change(given), 0.0, given.said, given.unit)
        p = composer.as_one(p, name, stage)
        if (key := p.moving.key()) not in self._followed:
            value, alone = composer.said(p.moving).value, p.alone()
            unit = "" if alone is None else composer.atoms[alone].unit
            before = program.member(f"{name}_before", f"{value} at the sample before")
            if ended is not None:
                at_end = program.constant(f"{name}_at_end", ended - p.constant, "of the fit")
                program.init.add(Assign(before, at_end))
            program.store.add(Assign(before, value))
            moved = program.name(f"{name}_moved")

            def change() -> Costed:
                return Costed(Choice(program.first(), Number(0.0), value - before), Operations(adds=1))

            said = f"{name} ({value})"
            reads = partial(program.local, moved, change, stage)
            self._followed[key] = Followed(value, reads, p.constant, said, unit)
        return self._followed[key]

    def _lag(self, word: Lag, p: Polynomial, state: LagState | None, name: str, stage: int) -> Later:
        """Eqs. (19) (25)."""
        given = self._following(p, None if state is None else state.temperature, name, stage)
        source, taus = LagInput(given.value, given.said, given.change, given.unit or "1"), word.time_constants
        group = self.composer.lags.request(source, taus, word.hold, state, given.counted_from, stage)

        def later(_: int) -> list[Polynomial]:
            return [self._lagged(place, tau, given) for place, tau in zip(group.columns(taus), taus, strict=True)]

        return later

    def _lagged(self, place: Formula, tau: float, given: Followed) -> Polynomial:
        return self.composer.atom(place, lambda: place, f"lag of {given.said}, {tau:.6g} s", given.unit)

    def _play(self, word: Play, p: Polynomial, state: float | None, stage: int) -> Later:
        """The play operator; its position is counted as the value is."""
        program, composer = self.program, self.composer
        value = composer.said(composer.as_one(p, "play", stage).moving).value
        play = program.member("play", f"position of the play of width {word.width:.6g}, as {value}")
        half = program.shared("half_width", word.width / 2, "of the play")
        if state is not None:
            ended = program.constant("play_at_end", state - p.constant, "of the fit")
            program.init.add(Assign(play, ended))
        if self.target.begins:
            program.stage(stage).begin.add(Assign(play, value))
        upper = If(play > value + half, [Assign(play, value + half)])
        moved = If(play < value - half, [Assign(play, value - half)], otherwise=upper)
        program.stage(stage).advance.add(moved, cost=Operations(adds=4))

        def lead() -> Costed:
            return Costed(play - value, Operations(adds=1))

        return lambda after: p + composer.local(play, "lead", after, lead, self.target.degree)

    def _delayed(self, word: Delayed, p: Polynomial, state: Any, name: str, stage: int) -> Later:
        """A ring of the last values; a straight line between two of them."""
        program, target, composer = self.program, self.target, self.composer
        if target.period is None:
            raise ValueError(
                f"A delay of {word.delay:.6g} s ({name}) cannot be exported for steps that are known only at run time: "
                "how many samples it must remember has no bound. Give a sampling_period, or leave the effect out and "
                "fit again."
            )
        whole = math.floor(word.delay / target.period + 1e-9)
        between = max(word.delay / target.period - whole, 0.0)
        between = between if between > 1e-9 else 0.0
        length = whole + (between > 0)
        if length > LONGEST_DELAY:
            raise ValueError(
                f"A delay of {word.delay:.6g} s ({name}) would need {length} values at a sampling period of "
                f"{target.period:.6g} s; {LONGEST_DELAY} is the limit of an export. Export for a longer sampling "
                "period, or leave the effect out and fit again."
            )
        given = composer.input_of(p)
        value = given.value if given else composer.said(composer.as_one(p, name, stage).moving).value
        counted_from = 0.0 if given else p.constant
        ring = program.member("ring", f"{value}, the last {length} samples", length)
        oldest = program.member("oldest", f"where in {ring.name} the oldest stands", kind="uint32")
        if state is not None:
            ago = target.period * np.arange(length - 1, -1, -1.0)  # from the oldest to the last fitted row
            past = np.interp(state.elapsed[-1] - ago, state.elapsed, state.temperature) - counted_from
            at_end = program.constant("ring_at_end", past, "of the fit")
            program.init.loop(length, lambda j: [Assign(ring[j], at_end[j])])
        if target.begins:
            program.stage(stage).begin.loop(length, lambda j: [Assign(ring[j], value)])
        earlier, next_one = ring[oldest], oldest + Whole(1)
        step_on = Choice(next_one < Whole(length), next_one, Whole(0))
        program.store.add(Assign(earlier, value), *([Assign(oldest, step_on)] if length > 1 else []))

        def late(after: int) -> Costed:
            if not between:
                return Costed(earlier - value, Operations(adds=1))
            share = program.constant("share", between, "of a sample that the delay is longer")
            later = Costed(value if whole == 0 else ring[step_on])
            following = program.local(program.name("following"), lambda: later, after)
            lag = Bracketed(following - value) + share * (earlier - following)
            return Costed(lag, Operations.of(products=1, sums=3))

        unit = given.unit if given else ""
        return lambda after: p + composer.local(ring, "late", after, partial(late, after), unit)

    def _decays(self, word: Decays) -> Later:
        """Eq. (18): decays belong to fitted segments, so that only a program that continues the last one has them."""
        target, nothing = self.target, Polynomial({})
        if not target.continues:
            return lambda _: [nothing for _, taus in word.of_segments for _ in taus]
        last = len(target.fitted_history.record.segments) - 1
        taus = np.array(dict(word.of_segments).get(last, ()))
        left = decays(np.array([target.segment_elapsed]), taus)[0]
        felt = left > (_FORGOTTEN if target.single else 0.0)
        source = LagInput(None, "decay of the start", None, "1")
        group = self.composer.lags.request(source, taus[felt], end=LagState(left[felt], 0.0))

        def later(_: int) -> list[Polynomial]:
            columns = []
            for key, of_segment in word.of_segments:
                for j, tau in enumerate(of_segment):
                    known = key == last and felt[j]
                    columns.append(self._decay(group.columns([tau])[0]) if known else nothing)
            return columns

        return later

    def _decay(self, place: Formula) -> Polynomial:
        return self.composer.atom(place, lambda: place, "a decay")
