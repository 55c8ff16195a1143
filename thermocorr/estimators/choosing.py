"""Choice of time constants in a fit."""

from __future__ import annotations

import warnings
from dataclasses import replace
from numbers import Integral
from typing import Any

from sklearn.base import clone

from ..effects.products import CoarseProducts
from ..effects.wrap import as_effects
from ..records import Record, RecordWarning
from .features import DiffusiveFeatures
from .reading import Reading
from .thermometers import Thermometers
from .time_constants.search import SearchSettings, TimeConstantChoice, search, spectrum_table
from .time_constants.spectrum import POOL_SIZE


def beside_products(plain: DiffusiveFeatures) -> DiffusiveFeatures:
    """A model with products of a coarse grid as its last columns: lags chosen beside these do not imitate them."""
    beside: DiffusiveFeatures = clone(plain)
    return beside.set_params(effects=[*as_effects(beside.effects), ("products", CoarseProducts())])


def count_to_choose(given: Any) -> int | None:
    """Number of time constants to choose: None where it is open, 0 where they are given.

    Raises ValueError for anything else.
    """
    if isinstance(given, str) and given == "auto":
        return None
    if isinstance(given, bool) or (isinstance(given, Integral) and not 1 <= int(given) <= POOL_SIZE):
        raise ValueError(
            f"The 'time_constants' parameter must be 'auto', a number to choose from 1 to {POOL_SIZE}, or a list of "
            f"times. Got {given!r} instead."
        )
    return int(given) if isinstance(given, Integral) else 0


def choose(model: Any, record: Record, reading: Reading) -> TimeConstantChoice | None:
    """Choose the time constants of an unfitted model from a record; None where they are given."""
    count = count_to_choose(model.time_constants)
    if count == 0:
        return None
    further = Thermometers.of(model.temperature).further
    together = None if count is None else count * (1 + len(further))
    settings = SearchSettings(count=together)
    plain = model._unfitted_features(()).set_params(products=False)
    found = search(beside_products(plain) if model.products else plain, record, reading, settings)
    spectrum = None
    if found.factored is not None and found.reference is not None:
        table = spectrum_table(found.factored, found.reference)
        spectrum = {str(name): column.to_numpy() for name, column in table.items()}
    return replace(found, factored=None, spectrum=spectrum)  # the factors hold the record: it would stay in memory


def choose_again(model: Any, believed: Record) -> TimeConstantChoice | None:
    """Choose once more, from the readings that gaps do not spoil."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)  # they were said the first time
        return choose(model, believed, Reading.of(None, None, believed))


def penalty(model: Any) -> float:
    """The ridge penalty of a fit: that given, or the search's."""
    if model.alpha != "auto":
        return float(model.alpha)
    return 0.0 if model.search_ is None else float(model.search_.alpha)
