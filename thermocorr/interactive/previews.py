"""What a suspect would take away, before it is added."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..effects import ThermalLag
from ..effects.protocol import Effect
from ..estimators.holdout import rms
from ..judgement.refine import with_missing
from ..records.numbers import scale_of
from .learning import Fitted
from .tiles import Store
from .wording import figure

AFTER, TAKEN = "preview after", "preview taken"
"""Names of curves: the residual that an effect would leave, and what it would take away."""


def preview_of(found: Fitted, effect: Effect, store: Store) -> dict[str, Any]:
    """Fit the model with one effect more, its time constants held, and put its curves beside those there are.

    Returns dict: curves (names in the store), before and after (rms residual of the rows that are learned from),
    label.
    """
    extended = with_missing(found.model, effect)
    if not isinstance(effect, ThermalLag):
        extended.set_params(**found.model.chosen())
    extended.set_params(alpha=found.model.alpha_).fit(found.data.X, found.data.learned)
    rows = store.get(found.curves["row"]).astype(int)
    after = extended.evaluate(found.data.X, found.data.y)["residual"].to_numpy(float)[rows]
    before = np.asarray(store.get(found.curves["residual"]))
    learned = np.isfinite(found.data.learned.to_numpy(float)[rows]) & np.isfinite(after) & np.isfinite(before)
    found.curves |= {AFTER: store.put(after), TAKEN: store.put(before - after)}
    errors = rms(before[learned]), rms(after[learned])
    scale = scale_of(errors, found.model.reading_.unit)
    return {
        "curves": {name: found.curves[name] for name in (AFTER, TAKEN)},
        "before": figure(errors[0], scale),
        "after": figure(errors[1], scale),
        "label": effect.label(),
    }
