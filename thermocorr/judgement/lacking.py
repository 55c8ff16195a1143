"""What the model's own lags lack: a lag, a delay or a rate, judged beside them alone.

Other causes are judged beside many lags, so that a poor thermal part makes none of them look guilty. Here the many lags
make room for the model's few, with the causes that were found, and what these few leave is looked at.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ..effects import CATALOGUE
from ..effects.protocol import Effect
from ..estimators.regressor import DynamicBiasRegressor
from .blocks import averaged
from .causes import Cause, Search
from .levels import FINE, THERMAL, TIE
from .pool import Pool, own_thermal


def lacking(model: DynamicBiasRegressor, pool: Pool, causes: list[Cause], exclude: Collection[str]) -> list[Cause]:
    """At most one more cause: what the model's lags lack most, if it is proven and worth a word."""
    kinds = [kind for kind in THERMAL if kind not in exclude]
    candidates: list[Effect] = [effect for kind in kinds for effect in CATALOGUE[kind].candidates(pool.record)]
    own = own_thermal(model)
    for effect in own:
        effect.learn(pool.record)
    columns = [part * pool.weight[:, None] for part in averaged(pool.record, own, FINE).columns]
    columns += [cause.tried.explanation.columns for cause in causes]
    thin = pool.beside(np.column_stack([pool.weight, *columns]), pool.of(candidates))
    search = Search(thin)
    tried = [t for t in search.look() if t.proven]
    if not tried:
        return []
    alike = tuple(t for t in tried if t.key != tried[0].key and t.score >= tried[0].score - TIE)
    others = tuple(t for t in tried if t.key != tried[0].key)
    return [Cause(tried=tried[0], alike=alike, others=others, share=search.share(tried[0]))]
