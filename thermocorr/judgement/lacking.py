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
from .causes import Search
from .choice import Cause
from .levels import FINE, THERMAL, TIE
from .likelihood import Comparison
from .pool import own_thermal


def lacking(model: DynamicBiasRegressor, search: Search, causes: list[Cause], exclude: Collection[str]) -> list[Cause]:
    """At most one more cause: what the model's lags lack most, if it is proven and worth a word."""
    pool = search.pool
    own = own_thermal(model)
    for effect in own:
        effect.learn(pool.record)
    columns = [part * pool.weight[:, None] for part in averaged(pool.record, own, FINE).columns]
    thin = np.column_stack([pool.weight, *columns, *(cause.tried.explanation.columns for cause in causes)])
    most = search.judged.total - Comparison(pool.reading, thin, pool.data.segment).total
    if most < search.too_small / 2:  # the many lags themselves gain no more than that
        return []
    kinds = [kind for kind in THERMAL if kind not in exclude]
    candidates: list[Effect] = [effect for kind in kinds for effect in CATALOGUE[kind].candidates(pool.record)]
    beside = Search(pool.beside(thin, pool.of(candidates)))
    tried = [t for t in beside.look() if t.proven]
    if not tried:
        return []
    others = tuple(t for t in tried if t.key != tried[0].key)
    alike = {t.key: t for t in reversed(others) if t.score >= tried[0].score - TIE}
    return [Cause(tried=tried[0], alike=tuple(alike.values()), others=others, share=beside.share(tried[0]))]
