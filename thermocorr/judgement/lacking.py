"""What the model's own lags lack: a lag, a delay, a rate or a lead, judged beside them alone; so with its decays.

Other causes are judged beside many lags, so that a poor thermal part makes none of them look guilty. Where none was
found, the many lags make room for the model's few, and what these leave is looked at. Beside a cause that is missing,
the model's lags made up for it as well as they could: they would be found wanting without need.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from sklearn.base import clone

from ..effects import CATALOGUE, InitialTransient
from ..effects.protocol import Effect
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Record
from .blocks import averaged_columns
from .causes import Search
from .choice import Cause, first_of_each
from .directions import orthonormal
from .levels import FINE, GAIN, OF_MUCH, SIZEABLE, START_TOLD, TIE
from .pool import Pool
from .residual import residuals_of
from .starts import OwnStart


def lacking(model: DynamicBiasRegressor, search: Search, exclude: Collection[str]) -> list[Cause]:
    """At most one cause: what the model's lags lack most, if it is proven, and is much of what is left or helps."""
    pool = search.pool
    if pool.rows.exact or search.rounded:
        return []
    small, thin = _small(pool), np.column_stack([_own_lags(model, pool), *pool.start])
    most = search.judged.total - pool.compared(thin).total
    if most < small / 2:  # the many lags themselves gain no more than that
        return []
    kinds = [effect for kind, effect in CATALOGUE.items() if effect.thermal_rank and kind not in exclude]
    candidates: list[Effect] = [effect for kind in kinds for effect in kind.candidates(pool.record)]
    beside = Search(pool.beside(thin, pool.unmade(candidates)), anywhere=(), small=small)
    tried = [t for t in beside.believed(beside.look(), ()) if t.proven]
    if not tried:
        return []
    near = first_of_each([t for t in tried if t.score >= tried[0].score - TIE])
    best = min(near, key=lambda t: t.explanation.effect.thermal_rank)
    others = tuple(t for t in tried if t.key != best.key)
    alike, share = tuple(t for t in near if t.key != best.key), beside.share(best)
    if share < OF_MUCH and max(t.worth.both for t in near) < GAIN:
        return []
    return [Cause(tried=best, alike=alike, others=others, share=share, size=beside.size(best))]


def start_lacking(
    model: DynamicBiasRegressor, read: Record, search: Search, causes: Sequence[Cause], exclude: Collection[str]
) -> list[Cause]:
    """At most one cause: a start that was taken for the model's, where the model's decays miss much of it.

    A search holds decays up to a share of the record for the model's, whether it has as slow ones or not. `read` is the
    record as the model reads it, whose residual must be larger than the noise by what is worth a word.
    """
    pool = search.pool
    starts = [cause.tried for cause in causes if cause.tried.explanation.is_start]
    taken = [t for t in starts if isinstance(t.explanation.effect, InitialTransient)]
    own = [effect for effect in model.features_.effect_list() if isinstance(effect, InitialTransient)]
    if not taken or InitialTransient.kind in exclude:
        return []
    decays: list[Effect] = [OwnStart(effect, which=slice(1), beyond=1.0) for effect in own]
    for effect in decays:
        effect.learn(pool.record)
    held = [orthonormal(part, START_TOLD) for part in averaged_columns(pool.record, decays, FINE)]
    thin = np.column_stack([_own_lags(model, pool), *map(pool.rows.weighed, held)])
    missed = [replace(each, in_model=False) for each in pool.unmade([clone(t.explanation.effect) for t in taken])]
    beside = Search(pool.beside(thin, missed), anywhere=())
    small = _small(pool) / 2
    tried = [t for t in beside.look() if not t.explanation.in_model and t.proven]
    tried = [t for t in tried if t.score > small or t.worth.both >= GAIN]
    if not tried or _beyond_noise(model, read, search) < SIZEABLE:
        return []
    share, size = beside.share(tried[0]), beside.size(tried[0])
    return [Cause(tried=tried[0], alike=(), others=(), share=share, size=size)]


def _beyond_noise(model: DynamicBiasRegressor, read: Record, search: Search) -> float:
    """Rms of the model's residual beyond the noise of one sample, over that noise."""
    counts = float(np.median(search.pool.data.counts))
    noise = search.judged.unit * float(np.sqrt(search.judged.innovation * counts))
    rms = residuals_of(model, read, search.pool.record)[1]
    return float(np.sqrt(max(rms**2 - noise**2, 0.0)) / noise)


def _own_lags(model: DynamicBiasRegressor, pool: Pool) -> np.ndarray:
    """Columns of the model but for its decays, and the constant, as they are judged, shape (n, p)."""
    own = [clone(effect) for effect in model.features_.effect_list() if not isinstance(effect, InitialTransient)]
    for effect in own:
        effect.learn(pool.record)
    return np.column_stack([pool.rows.constant, *map(pool.rows.weighed, averaged_columns(pool.record, own, FINE))])


def _small(pool: Pool) -> float:
    """Twice the log likelihood in white noise up to which what the model lacks is too small for a word."""
    rows = float(np.median(pool.data.counts)) * float(np.sum(pool.rows.weight**2))  # in each, the usual noise
    return rows * SIZEABLE**2
