"""Intervals of `Diagnosis.where`, which are written for people, as numbers."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from .protocols import DiagnosisLike
from .timeline import TimeLine, time_text

WORSE = 1.5
"""Share of the excess error over the share of the samples from which on a stretch is shown as failing."""
YEARLY = 200 * 86_400.0
"""Span of a record above which dates are written with their year [s]."""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


def ends(interval: str) -> tuple[float, float]:
    """Both ends of ``20.1 to 22.4``, ``0 to 2 h``, ``3.2 s to 9 s`` or of two dates (then in seconds since 1970)."""
    low, _, high = interval.partition(" to ")
    return _end(low), _end(high)


def short_ends(interval: str, span: float) -> tuple[str, str]:
    """Both ends of an interval, as short as they are readable; of dates, which stretch over `span` seconds in all."""
    low, _, high = interval.removeprefix("periods of ").partition(" to ")
    seconds = high.endswith(" s")
    return _short(low, seconds, span), _short(high, seconds, span)


def _short(text: str, seconds: bool, span: float) -> str:
    if re.match(r"\d{4}-\d\d-\d\d", text):
        return pd.Timestamp(text).strftime("%d %b %Y" if span > YEARLY else "%d %b %H:%M")
    return time_text(float(text.removesuffix(" s"))) if seconds else text


def _end(text: str) -> float:
    if re.match(r"\d{4}-\d\d-\d\d", text):
        return pd.Timestamp(text).value / 1e9
    found = _NUMBER.search(text)
    return float(found.group()) if found else np.nan


def stretches(diagnosis: DiagnosisLike, timeline: TimeLine) -> list[tuple[float, float]]:
    """Places on the axis of the stretches of time in which a model fails [s]; neighbours are joined.

    None where the diagnosis finds nothing missing, or where runs overlap in time, so that a time has several places.
    """
    where = diagnosis.where
    if diagnosis.verdict == "nothing missing" or timeline.overlapping:
        return []
    chosen = where[(where["condition"] == "time") & (where["lift"] > WORSE)]
    zero = timeline.first / 1e9 if timeline.dates else 0.0
    found = sorted((low - zero, high - zero) for low, high in map(ends, chosen["interval"]))
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
