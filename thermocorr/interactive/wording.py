"""Places, spans and moments of a log as they are said on the screen and typed by a person."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from ..pages import figures
from ..pages.html import percent_text, quantity
from ..records.numbers import Scale, span_texts
from .learning import Fitted


def axis_of(found: Fitted) -> figures.Axis:
    """The axis of time on which a fitted arrangement is drawn; its x is left empty."""
    return figures.axis_of(found.timeline, np.zeros(0))


def moment_words(found: Fitted, places: np.ndarray, seconds: np.ndarray) -> str:
    """From when to when two rows lie: places in the order of time, and seconds since the first row."""
    line = found.timeline
    if line.samples:
        return f"samples {places[0] + 1} to {places[1] + 1}"
    if line.dates:
        first, last = (pd.Timestamp(moment).round("s") for moment in line.times(seconds))
        start, end = f"{first:%Y-%m-%d %H:%M:%S}", f"{last:%Y-%m-%d %H:%M:%S}"
        return f"{start} to {end.removeprefix(f'{first:%Y-%m-%d} ')}"
    return f"{' to '.join(span_texts(seconds[:2]))} after the first row"


def chosen_lags(given: str) -> Any:
    """How many time constants to choose, "auto", or which: as a person types it."""
    words = given.strip()
    if words == "auto":
        return words
    return int(words) if words.isascii() and words.isdigit() and len(words) < 4 else spans(words)


def sentence(error: BaseException) -> str:
    """What an error says, in one line; the kind of error where it is none that was made for people."""
    said = " ".join(str(error).split())
    if isinstance(error, ValueError | TypeError | OSError) and said:
        return said
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def spans(given: str) -> list[float | str]:
    """Time constants as a person types them: ``60, 15min, 2h``; ValueError for what is none."""
    found: list[float | str] = []
    for part in (word.strip() for word in given.split(",")):
        if not part:
            continue
        try:
            seconds: float | str = float(part)
        except ValueError:
            seconds = part
        if isinstance(seconds, float) and not (math.isfinite(seconds) and seconds > 0):
            raise ValueError(f"{part!r} is no time constant. Write such as 60, 15min, 2h.")
        found.append(seconds)
    if not found:
        raise ValueError("Say how many time constants to choose (6), auto, or which: 60, 15min, 2h.")
    return found


def figure(value: float | None, scale: Scale, digits: int = 4) -> dict[str, Any] | None:
    """A number as text with a unit that suits it and its neighbours, and as it is; None for one that nobody knows."""
    if value is None or not math.isfinite(value):
        return None
    return {"text": quantity(float(value), digits=digits, scale=scale), "value": float(value)}


def share(value: float) -> dict[str, Any]:
    """A share; of what nobody knows it is nothing."""
    known = float(value) if math.isfinite(value) else 0.0
    return {"text": percent_text(known), "value": known}


def gain(value: float) -> dict[str, Any] | None:
    """Decibels, with their sign."""
    if not math.isfinite(value):
        return None
    return {"text": f"{value:+.1f}\u00a0dB".replace("-", "\u2212"), "value": float(value)}


def fall(after: float | None, before: float | None) -> dict[str, Any] | None:
    """By how many decibels an error has changed: negative is good."""
    if not (after and before) or not (math.isfinite(after) and math.isfinite(before)):
        return None
    return gain(20 * math.log10(after / before))
