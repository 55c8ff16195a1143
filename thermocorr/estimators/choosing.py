"""How a regressor comes by its time constants, where its user leaves them to the data."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np

from ..records import Log, Record, RecordWarning
from .products_choice import beside_products, with_products_or_without
from .thermometers import Thermometers
from .time_constants.resolution import spectrum_table
from .time_constants.search import SearchSettings, TimeConstantChoice, search
from .time_constants.spectrum import POOL_SIZE


def count_to_choose(given: Any) -> int | None:
    """How many time constants to choose, from the parameter: None leaves their number open, 0 where they are given.

    Raises ValueError for what is none of these.
    """
    if isinstance(given, str) and given == "auto":
        return None
    if isinstance(given, bool) or (isinstance(given, Integral) and not 1 <= int(given) <= POOL_SIZE):
        raise ValueError(
            f"The 'time_constants' parameter must be 'auto', a number to choose from 1 to {POOL_SIZE}, or a list of "
            f"times. Got {given!r} instead."
        )
    return int(given) if isinstance(given, Integral) else 0


def choose(model: Any, X: Any, y: Any, say: Callable[[str], None] = lambda text: None) -> TimeConstantChoice | None:
    """Choose the time constants of an unfitted model from a record; None where they are given."""
    count = count_to_choose(model.time_constants)
    if count == 0 or model.prior is not None:
        return None
    say("choosing time constants")
    further = Thermometers.of(model.temperature).further
    together = None if count is None else count * (1 + len(further))
    settings = SearchSettings(count=together, say=say, sweeps=model.sweeps)
    plain = model.unfitted_features(()).set_params(products=False)
    if model.products == "auto" and model.degree > 1:  # a linear law was not asked for
        found = with_products_or_without(plain, X, y, settings)
    else:
        products = False if model.products == "auto" else model.products
        found = replace(search(beside_products(plain) if products else plain, X, y, settings), products=products)
    spectrum = None
    if found.factored is not None and found.reference is not None:
        table = spectrum_table(found.factored, found.reference)
        spectrum = {str(name): column.to_numpy() for name, column in table.items()}
    return replace(found, factored=None, spectrum=spectrum)  # the factors hold the record: it would stay in memory


def chosen_products(model: Any) -> bool | int:
    """The parameter `products` of a model whose time constants are chosen; nothing is added where they are given."""
    found: TimeConstantChoice | None = getattr(model, "search_", None)
    products: bool | int = model.products if model.products != "auto" else found is not None and found.products
    return products


def choose_again(
    model: Any, X: Any, record: Record, believed: Record, say: Callable[[str], None]
) -> TimeConstantChoice | None:
    """Choose once more, from the readings that neither filled cells nor gaps spoil: the first choice had to use all.

    The first choice where none are spoilt, where readings have weights, and for a log that is read in pieces.
    """
    first: TimeConstantChoice | None = model.search_
    if first is None or believed is record or isinstance(X, Log) or record.weight is not None:
        return first
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)  # they were said the first time
        return choose(model, X, np.asarray(believed.reading, float), say)


def penalty(model: Any) -> float:
    """The ridge penalty of a fit: that given, or the search's."""
    if model.alpha != "auto":
        return float(model.alpha)
    return 0.0 if model.search_ is None else float(model.search_.alpha)
