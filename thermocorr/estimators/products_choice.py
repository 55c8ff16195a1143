"""`products="auto"`: whether products of lags are worth their columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects.products import CoarseProducts
from ..effects.wrap import as_effects
from ..equations import TriangularFactor, solve_ridge
from ..records import Record, RecordError
from ..records.thinned import ThinnedLog, thinned
from .features import DiffusiveFeatures
from .time_constants.search import Factored, SearchSettings, TimeConstantChoice, factors_of, learned, search

MOST_ROWS = 20_000
"""Rows that are enough to decide on: longer records are averaged over short stretches. What products add is slow."""
BLOCKS = 10
"""Blocks of time that follow on a first one: those of the later half are foretold, from everything before them. From
less, so many products foretell nonsense."""
CLEARLY = 0.95
"""Errors with products over those without, of the later blocks on the average and of the fit, up to which they are
taken: what is foretold better by chance is not fitted better."""
EACH = 0.995
"""Errors on each later block, likewise. Chosen on simulated devices with a hidden effect, strengths 2 and 0.5 (seeds
302 to 305): 24 of 24 that have products get them, and 10 of 552 others; on other seeds (330 to 333) 24 of 24, and 2 of
552. Of eight measured records, whose error on the rest they raise by half, none (`benchmarks/chosen_products.py`)."""

ROUNDED = 1e-9
"""Errors over the spread of the readings, up to which they are rounding: an exact record has nothing left to tell."""


def beside_products(plain: DiffusiveFeatures) -> DiffusiveFeatures:
    """A model with products of a coarse grid as its last columns: lags chosen beside these do not imitate them."""
    beside: DiffusiveFeatures = clone(plain)
    return beside.set_params(effects=[*as_effects(beside.effects), ("products", CoarseProducts())])


def with_products_or_without(plain: DiffusiveFeatures, X: Any, y: Any, settings: SearchSettings) -> TimeConstantChoice:
    """The choice of time constants for a model of lags, or, where it is clearly better, for one with their products.

    Parameters
    ----------
    plain : DiffusiveFeatures
        The model without lags and products.
    X, y, settings : see `search`
    """
    found = search(plain, X, y, settings)
    if not products_help(plain, X, y, found, settings):
        return found
    return replace(search(beside_products(plain), X, y, settings), products=True)


def products_help(
    plain: DiffusiveFeatures, X: Any, y: Any, found: TimeConstantChoice, settings: SearchSettings
) -> bool:
    """Whether the lags that were found fit and foretell clearly better beside products, every later block of them."""
    assert found.factored is not None
    whole, taus = found.factored.record, [found.time_constants, *found.further.values()]
    if not any(map(len, taus)):
        return False
    features = beside_products(plain)
    if whole.n_used > MOST_ROWS and whole.weight is None and not hasattr(whole, "sweep_effects"):
        X, y = _in_fewer_rows(whole, X)
        features.set_params(screen=False, fill=None)  # it was screened, and filled
    try:
        record, reading = learned(features, X, y)
    except RecordError:  # too short for so many columns
        return False
    factored = factors_of(features, record, reading, np.unique(np.concatenate(taus)), replace(settings, cv=BLOCKS))
    layout, products = factored.layout, features.effect_list()[-1].n_columns()
    lags = layout.columns([i for i, tau in enumerate(layout.grid) if tau in taus[layout.owner[i]]])
    alpha = found.alpha * reading.n_readings / found.factored.reading.n_readings
    without = [*range(1, layout.n_free - products), *lags]
    beside = [*range(1, layout.n_free), *lags]
    now, before = _later_errors(factored, (beside, without), alpha)
    if len(now) < 2 or not before.min() > ROUNDED * reading.std:
        return False
    if not ((now <= EACH * before).all() and np.mean(now / before) <= CLEARLY):
        return False
    return _error(factored.whole, factored.whole, beside, alpha) <= CLEARLY * _error(
        factored.whole, factored.whole, without, alpha
    )


def _later_errors(factored: Factored, models: Sequence[Sequence[int]], alpha: float) -> np.ndarray:
    """Rms error of models, lists of columns, on each block of the later half, foretold from what is before it."""
    dead = factored.columns.dead(factored.record, factored.folds)
    sides = factored.folds.sides(factored.chunks, factored.layout.n_free)
    sides = [each for each in sides if each.fold >= len(factored.folds) // 2]
    return np.array(
        [
            [_error(s.learned, s.tested, [c for c in columns if c not in dead[s.fold]], alpha) for s in sides]
            for columns in models
        ]
    )


def _error(learned: TriangularFactor, tested: TriangularFactor, columns: Sequence[int], alpha: float) -> float:
    """Rms error, on the rows of one factor, of columns whose coefficients another one tells."""
    chosen = [0, *columns, learned.r.shape[1] - 1]
    found = solve_ridge(learned.select(chosen), alpha)
    missed = tested.r[:, chosen] @ np.concatenate(([-found.intercept], -found.coef, [1.0]))
    return float(np.linalg.norm(missed) / np.sqrt(tested.n_rows))


def _in_fewer_rows(record: Record, X: Any) -> tuple[ThinnedLog, pd.Series]:
    """Averages over short stretches of a record, and of its readings."""
    short, _ = thinned(record, {}, MOST_ROWS)
    return ThinnedLog(short, dict(getattr(X, "attrs", {}))), pd.Series(np.asarray(short.reading))
