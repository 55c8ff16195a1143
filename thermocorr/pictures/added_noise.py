"""Where a correction adds noise: at short averaging times the thermometer's own noise comes in through fast lags."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..equations import allan_deviation
from ..records import Log
from ..records.errors import printable
from ..records.numbers import quantity_texts, span_text
from .allan_deviation import LOOKED_AT, AllanDisplay
from .walk import Walk, regressor_of

WORTH_A_WORD = 1.05
"""Allan deviation after over before, from which the correction adds noise: ten per cent of the variance."""
KNOWN = 30
"""Degrees of freedom from which the two are compared: their ratio is known far better than either, since they share
their noise."""


def added_noise(model: Any, X: Any, y: Any) -> str:
    """A sentence on the averaging times at which a correction adds noise, and the column that does it; "" for none.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted; or a search with a ``best_estimator_``.
    X, y : as for `DynamicBiasRegressor.evaluate`
        A frame or an array.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(2000, seed=1)
    >>> X, y = record[["temperature"]], record["reading"]
    >>> added_noise(DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y), X, y)
    ''
    """
    fitted = regressor_of(model)
    return added_noise_shown(AllanDisplay.from_estimator(fitted, X, y), fitted, X)


def added_noise_shown(display: AllanDisplay, model: Any, X: Any) -> str:
    """What `added_noise` says, from a display of what the model makes of X; no column is named for a log in a file."""
    before, after = display.before, display.after
    n = min(len(before.deviation), len(after.deviation))
    ratio = after.deviation[:n] / np.maximum(before.deviation[:n], 1e-300)
    worse = (ratio > WORTH_A_WORD) & (np.minimum(before.degrees_of_freedom, after.degrees_of_freedom)[:n] >= KNOWN)
    if not worse.any():
        return ""
    at = int(np.argmax(np.where(worse, ratio, 0.0)))
    tau, last = float(after.averaging_times[at]), float(after.averaging_times[:n][worse].max())
    now, then = quantity_texts([after.deviation[at], before.deviation[at]], display.unit, 2)
    said = (
        f"At averaging times up to {_times(last, display)} the correction adds noise: Allan deviation "
        f"{now} after and {then} before at {_times(tau, display)}"
    )
    if isinstance(X, Log):
        return f"{said}."
    through = _loudest(model, X, tau / float(after.averaging_times[0]))
    return printable(f"{said}, most of it through {through}, which passes on the noise of its input.")


def _times(seconds: float, display: AllanDisplay) -> str:
    return f"{seconds:.0f} samples" if display.samples else span_text(seconds)


def _loudest(model: Any, X: Any, n_rows: float) -> str:
    """Name of the column whose contribution has the largest Allan deviation at an averaging time [rows]."""
    record = Walk(model, X).record
    longest = record.longest()
    rows = record.rows(longest.start, min(longest.stop, longest.start + LOOKED_AT))
    columns = np.asarray(model.features_.transform(X.iloc[rows] if hasattr(X, "iloc") else X[rows]), float)
    removed = np.concatenate(
        [np.full(effect.n_columns(), effect.removed_by_correct) for effect in model.features_.effect_list()]
    )
    made = columns * model.coef_ * removed
    sizes = [allan_deviation(part[np.isfinite(part)], 1.0, [round(n_rows)]).deviation for part in made.T]
    return str(model.features_.get_feature_names_out()[int(np.argmax([s[0] if len(s) else 0.0 for s in sizes]))])
