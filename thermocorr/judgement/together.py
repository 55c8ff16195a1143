"""Causes that were found one after the other and are one: many steps, a wave and its harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sklearn.base import clone

from ..effects import Disturbance, Periodic, SeveralSteps, Step
from ..records import Record, seconds_of
from .found import FoundSuspect
from .levels import HARMONICS, SEVERAL


def as_one(found: Sequence[FoundSuspect], record: Record) -> list[FoundSuspect]:
    """The causes, those that are one in the place of the first of them."""
    return _waves(_steps(list(found)), record)


def _steps(found: list[FoundSuspect]) -> list[FoundSuspect]:
    """Many steps and disturbances as one cause, several steps."""
    steps = [cause for cause in found if cause.effect.kind in (Step.kind, Disturbance.kind)]
    if len(steps) < SEVERAL:
        return found
    ends = [cause.effect.get_params().get(name) for cause in steps for name in ("time", "start", "end")]
    effect = SeveralSteps(sorted({time for time in ends if time is not None}))
    return _joined(found, steps, replace(steps[0], effect=effect, confusable_with=(), in_model=False))


def _waves(found: list[FoundSuspect], record: Record) -> list[FoundSuspect]:
    """A wave and those of its harmonics that were found by themselves as one cause."""
    apart = 1 / (2 * record.longest_read())  # frequencies that the record tells from one another
    waves = [cause for cause in found if isinstance(cause.effect, Periodic)]
    waves.sort(key=lambda cause: -_period(cause))
    while waves:
        slowest, *waves = waves
        overtones = {id(wave): _harmonic(slowest, wave, apart) for wave in waves}
        if any(overtones.values()):
            own = [cause for cause in found if cause is slowest or overtones.get(id(cause), 0)]
            highest = max(overtones.get(id(cause), 1) * cause.effect.harmonics for cause in own)
            wave = replace(slowest, effect=clone(slowest.effect).set_params(harmonics=highest))
            found = _joined(found, own, wave)
            waves = [wave for wave in waves if not overtones[id(wave)]]
    return found


def _harmonic(slowest: FoundSuspect, wave: FoundSuspect, apart: float) -> int:
    """Which multiple of a wave's frequency another one has, as far as the record can tell; 0 for none."""
    multiple = round(_period(slowest) / _period(wave))
    off = abs(1 / _period(wave) - multiple / _period(slowest))
    return multiple if 1 < multiple <= HARMONICS and off < apart else 0


def _period(wave: FoundSuspect) -> float:
    return seconds_of(wave.effect.period, "period")


def _joined(found: Sequence[FoundSuspect], own: Sequence[FoundSuspect], one: FoundSuspect) -> list[FoundSuspect]:
    """The causes with some of them as one, in the place of the first."""
    together = replace(
        one,
        standing="proven",
        share=min(sum(cause.share for cause in own), 1.0),
        gain_db=sum(cause.gain_db for cause in own),  # each was judged beside those before it
        later_db=sum(cause.later_db for cause in own),
        p_value=max(cause.p_value for cause in own),
        when=tuple(sorted(interval for cause in own for interval in cause.when)),
    )
    ours = {id(cause) for cause in own}
    return [together if cause is own[0] else cause for cause in found if cause is own[0] or id(cause) not in ours]
