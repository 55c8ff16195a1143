"""Stretches of time in which a model fails, on the axis of a picture."""

from __future__ import annotations

from ..estimators.verdicts import VERDICTS
from .protocols import DiagnosisLike
from .timeline import TimeLine

WORSE = 1.5
"""A stretch is shown as failing above this ratio of its share of the excess error to its share of the samples."""


def stretches(diagnosis: DiagnosisLike, timeline: TimeLine) -> list[tuple[float, float]]:
    """Places on the axis of the stretches of time in which a model fails [s]; neighbours are joined.

    None where the diagnosis finds nothing missing, or where runs overlap in time, so that a time has several places.
    """
    where = diagnosis.where
    if VERDICTS[diagnosis.verdict].calm or timeline.overlapping:
        return []
    chosen = where[(where["aspect"] == "time") & (where["lift"] > WORSE)]
    joined: list[tuple[float, float]] = []
    for low, high in sorted(zip(chosen["low"], chosen["high"], strict=True)):
        first, last = timeline.interval(low, high)
        if joined and first - joined[-1][1] < 0.02 * timeline.span:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined
