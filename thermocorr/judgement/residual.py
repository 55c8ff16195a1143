"""What a model leaves of the readings, in the rows that the judgement works on."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..estimators.holdout import rms
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Record
from ..records.thinned import Thinned, ThinnedLog, row_means


def residuals_of(model: DynamicBiasRegressor, X: Any, y: Any, record: Record) -> tuple[np.ndarray, float]:
    """Residual of each row of the judged record, NaN where there is none, and the rms residual of single readings.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted.
    X, y : as for `DynamicBiasRegressor.evaluate_blocks`
    record : Record
        What `suspect_record` made of X and y.
    """
    refused = np.concatenate([np.zeros(0, np.intp), *(found.rows for found in record.refused if model.screen)])
    if not isinstance(record, Thinned):
        residual = np.array(model.residuals(X, y), float)
        residual[refused] = np.nan
        return residual, rms(residual)
    if isinstance(X, ThinnedLog):
        residual = np.array(model.residuals(X, y), float)
        return residual, single_rms(residual, record)
    sums, counts, squares, n = np.zeros(record.n_rows), np.zeros(record.n_rows), 0.0, 0
    places = None
    for block, values in model.evaluated_blocks(X, y):
        if places is None and block.record.order is not None:
            places = np.empty(block.record.n_rows, np.intp)
            places[block.record.order] = np.arange(block.record.n_rows)
        rows = np.arange(block.record.n_rows)[block.rows] if places is not None else np.arange(block.start, block.stop)
        residual = values["residual"]
        if len(refused):
            residual = np.where(np.isin(rows, refused), np.nan, residual)
        known = residual[np.isfinite(residual)]
        squares, n = squares + float(known @ known), n + len(known)
        row_means(record, rows if places is None else places[rows], residual, sums, counts)
    averages = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return averages, float(np.sqrt(squares / max(n, 1)))


def single_rms(residual: np.ndarray, record: Thinned) -> float:
    """Rms residual of single readings, from that of averages and what they do not show."""
    known = np.isfinite(residual)
    return float(np.sqrt(np.average(residual[known] ** 2, weights=record.counts[known]) + record.unseen))
