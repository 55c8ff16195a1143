"""Recorded numbers that never change beyond their rounding: nothing can be learned about what they do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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
SMALLEST_SIZE = 1e-3
"""Smaller numbers count as this large: a constant less its mean is rounding about zero.

Not larger, for a temperature may come in volts of a thermocouple or amperes of a sensor.
"""


def resolved(low: float, high: float) -> float:
    """To how much numbers between two limits can be resolved, in their unit."""
    return RESOLVED_SHARE * max(abs(low), abs(high), SMALLEST_SIZE)


def is_flat(low: float, high: float) -> bool:
    """Whether numbers between two limits never change beyond their rounding."""
    return high - low <= resolved(low, high)


def flat_text(low: float, high: float, n_rows: int) -> str:
    """What was found of numbers that are flat; follows on "The temperature never changes"."""
    if low == high:
        return f": it is {low:.6g} in all {n_rows} rows"
    return (
        f" beyond its rounding: its span is {high - low:.2g} about {low:.6g} in all {n_rows} rows, where a number of "
        f"this size can be resolved to about {resolved(low, high):.1g}"
    )


def flat_effects(record: Record, effects: Sequence[Effect]) -> list[Any]:
    """Effects, of some learned ones, whose recorded column never changes beyond its rounding.

    They get no coefficient (`thermocorr.estimators.fitting.sweep_effects`). A user's own effects may make anything of a
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
