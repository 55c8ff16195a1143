"""Stretches of time in which a model fails, on the axis of a picture."""

from __future__ import annotations

import numpy as np

from .protocols import DiagnosisLike
from .timeline import TimeLine

WORSE = 1.5
"""A stretch is shown as failing above this ratio of its share of the excess error to its share of the samples."""


def stretches(diagnosis: DiagnosisLike, timeline: TimeLine) -> list[tuple[float, float]]:
    """Places on the axis of the stretches of time in which a model fails [s]; neighbours are joined.

    None where the diagnosis finds nothing missing, or where runs overlap in time, so that a time has several places.
    """
    where = diagnosis.where
    if diagnosis.verdict == "nothing missing" or timeline.overlapping:
        return []
    chosen = where[(where["aspect"] == "time") & (where["lift"] > WORSE)]
    zero = timeline.first / 1e9 if timeline.dates else 0.0
    found = sorted((low - zero, high - zero) for low, high in zip(chosen["low"], chosen["high"], strict=True))
    begins = timeline.starts - timeline.shifts  # seconds at which each segment begins
    joined: list[tuple[float, float]] = []
    for low, high in found:
        segment = np.clip(np.searchsorted(begins, (low, high), side="right") - 1, 0, None)
        first, last = np.array((low, high)) + timeline.shifts[segment]
        if joined and first - joined[-1][1] < 0.02 * timeline.span:
            joined[-1] = (joined[-1][0], float(last))
        else:
            joined.append((float(first), float(last)))
    return joined
