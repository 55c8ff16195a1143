"""Temperatures inside of the device, as a fitted model has them: eqs. (17) to (19)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..effects import InitialTransient, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import Walked
from ..records import Block


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

    The start of a part follows from its two coefficients, psi_0j = nu_j / mu_j: where mu_j is small beside its standard
    error, it is as uncertain as their ratio.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted, with lags of the temperature.
    steps : iterator of Walked
        Of all effects of the model.

    Raises
    ------
    ValueError
        For a model without lags: a static model knows of nothing inside.
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
