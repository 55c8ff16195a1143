"""Coverage of the inputs: recorded columns that never change, and temperatures at which a record has not been.

A row can lie between the lowest and the highest temperature and still be far from any of them, as between two plateaus:
a hidden extrapolation. Its leverage in the static law is larger there than that of any row of the record (Montgomery,
Peck & Vining, Introduction to Linear Regression Analysis, section 3.8).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from ..effects import Covariate, Interaction, LaggedCovariate
from ..effects.protocol import Effect
from ..records import Record
from ..records.errors import quoted

RESOLVED_SHARE = 1e-9
"""Share of its size to which a recorded number can be resolved, at best.

Nobody measures a part in 1e9 of a temperature, and few of anything: a microkelvin at 300 K is three times that. What a
constant number shows below it is rounding: a double ends at 2e-16 of its size, and what sums and differences make of
that stays below 1e-12. A coefficient for it is the noise of the reading divided by rounding: 1e25 per kelvin.
With half or twice of it nothing changes: between rounding and the finest thermometers there are three decades.
"""


def resolved(low: float, high: float) -> float:
    """To how much numbers between two limits can be resolved, in their unit."""
    # Smaller numbers count as this large: a constant less its mean is rounding about zero. Not larger, for a
    # temperature may come in volts of a thermocouple or amperes of a sensor.
    return RESOLVED_SHARE * max(abs(low), abs(high), 1e-3)


def is_flat(low: float, high: float) -> bool:
    """True if numbers between two limits never change beyond their rounding."""
    return high - low <= resolved(low, high)


def flat_text(low: float, high: float, n_rows: int) -> str:
    """Description of constant numbers, to follow "The temperature never changes"."""
    if low == high:
        return f": it is {low:.6g} in all {n_rows} rows"
    return (
        f" beyond its rounding: its span is {high - low:.2g} about {low:.6g} in all {n_rows} rows, where a number of "
        f"this size can be resolved to about {resolved(low, high):.1g}"
    )


def flat_effects(record: Record, effects: Sequence[Effect]) -> list[Any]:
    """Effects, of some learned ones, whose recorded column never changes beyond its rounding.

    They get no coefficient (`thermocorr.model.fitting.sweep_effects`). A user's own effects may make anything of a
    column and are not among them.
    """
    found = []
    for effect in effects:
        if type(effect) in (Covariate, LaggedCovariate, Interaction):
            values = record.moments(effect.column, getattr(effect, "power", 1))
            if is_flat(values.low, values.high):
                found.append(effect)
    return found


def flat_columns(record: Record, effects: Sequence[Effect]) -> list[str]:
    """A sentence on each recorded column that never changes beyond its rounding, although effects wait for it."""
    said = {}
    for column in dict.fromkeys(effect.column for effect in flat_effects(record, effects)):
        values = record.moments(column)
        said[column] = (
            f"The column {quoted(column)} never changes{flat_text(values.low, values.high, record.n_used)}. Nothing "
            "can be learned about its effect, whose coefficients are 0. Leave it out, or record while the column moves."
        )
    return list(said.values())


BINS = 100
"""Parts of the range of temperatures; what a part holds counts as its middle."""
FARTHER = 10.0
"""Leverage between the temperatures of a record, over the largest at any of them, from which a law is not determined:
there, it is more than three times as uncertain as wherever the record has been."""


class Coverage(NamedTuple):
    """Range of the temperatures, its gaps, and the degree of the static law that they determine."""

    degree: int
    """The highest power of the static law that they do, at most the one that is wanted."""
    gaps: tuple[tuple[float, float], ...]
    """Stretches between them in which one power more, by which the law could be checked, would not be known."""

    @classmethod
    def of(cls, record: Record, degree: int) -> Coverage:
        """Of the temperatures of a record, in one pass."""
        name = record.temperature_name
        moments = record.moments(name)
        edges = np.linspace(moments.low, moments.high, BINS + 1)
        if degree < 1 or not moments.low < moments.high:
            return cls(degree, ())
        counts = np.zeros(BINS, int)
        for values in record.chunks(record.columns[name]):
            known = values[np.isfinite(values)]
            part = ((known - moments.low) * (BINS / (moments.high - moments.low))).astype(np.intp)
            counts += np.bincount(np.minimum(part, BINS - 1), minlength=BINS)
        empty = counts == 0
        if not empty.any():
            return cls(degree, ())
        while degree > 1 and _leverage(counts, degree)[empty].max() > FARTHER:
            degree -= 1
        unknown = empty & (_leverage(counts, degree + 1) > FARTHER)
        ends = np.flatnonzero(np.diff(unknown, prepend=False, append=False)).reshape(-1, 2)
        return cls(degree, tuple((float(edges[low]), float(edges[high])) for low, high in ends))


def _leverage(counts: np.ndarray, degree: int) -> np.ndarray:
    """Leverage of each bin's middle in a law of that degree, over the largest of those that hold rows, shape (BINS,).

    Infinite where the bins that hold rows do not determine the law.
    """
    middle = (np.arange(BINS) + 0.5) / (BINS / 2) - 1
    basis = legendre.legvander(middle, degree)
    rows = np.sqrt(counts)[:, None] * basis
    half = np.asarray(np.linalg.qr(rows, mode="r"))
    sizes = np.abs(np.diag(half))
    if not sizes.min() > 1e-9 * sizes.max():
        return np.where(counts > 0, 1.0, np.inf)
    found = np.sum(np.linalg.solve(half.T, basis.T) ** 2, axis=0)
    return np.asarray(found / found[counts > 0].max())
