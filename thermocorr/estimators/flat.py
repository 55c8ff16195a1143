"""Columns that never change, and what goes on inside the device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..effects import Covariate, InitialTransient, Interaction, LaggedCovariate, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import Walked
from ..records import Block, Record
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


class Inner(NamedTuple):
    """Temperatures inside of the device in the rows of a block, one column for each time constant."""

    block: Block
    temperature: np.ndarray
    """psi_j + psi_0j of eqs. (17) (18): what the part of the device with this time constant feels, shape (n, J)."""
    start: np.ndarray
    """psi_0j of eq. (18): what is left of its unknown temperature at the start of the segment, shape (n, J) [K]."""
    difference: np.ndarray
    """Psi_j of eq. (19): how much warmer it is than the ambient, shape (n, J) [K]."""


def lags_of(model: Any) -> tuple[np.ndarray, slice]:
    """Time constants [s] of a fitted model's lags, and which coefficients they have; none where it has no lags."""
    lag, columns = _of_kind(model, ThermalLag)
    return np.zeros(0) if lag is None else lag.time_constants_, columns


def _of_kind(model: Any, kind: type[Effect]) -> tuple[Any, slice]:
    """The first effect of a kind, None where there is none, and which of all columns it has."""
    at = 0
    for effect in model.features_.effect_list():
        if type(effect) is kind:
            return effect, slice(at, at + effect.n_columns())
        at += effect.n_columns()
    return None, slice(0, 0)


def inner_blocks(model: Any, steps: Iterator[Walked]) -> Iterator[Inner]:
    """Inner temperatures of a fitted model along a walk through a record.

    The start of a part follows from its two coefficients, psi_0j = nu_j / mu_j: where mu_j is small against its
    standard error, it is as uncertain as their ratio.

    `model` (DynamicBiasRegressor): Fitted, with lags of the temperature. `steps` (iterator of Walked): Of all effects
    of the model. Raises ValueError for a model without lags: a static model knows of nothing inside.
    """
    taus, lags = lags_of(model)
    if not len(taus):
        raise ValueError("The model has no lags: a static model knows of no temperature inside of the device.")
    mu = model.coef_[lags]
    start, decays = _of_kind(model, InitialTransient)
    weights = np.zeros((decays.stop - decays.start, len(taus)))
    if start is not None:
        own = np.concatenate([*start.decays_.values(), np.zeros(0)])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = model.coef_[decays, None] / mu
        weights = np.where((own[:, None] == taus) & (mu != 0), ratio, 0.0)
    for step in steps:
        psi_0 = step.columns[:, decays] @ weights  # eq. (18)
        difference = step.columns[:, lags] + psi_0  # eq. (19)
        yield Inner(step.block, difference + step.block.temperature[:, None], psi_0, difference)
