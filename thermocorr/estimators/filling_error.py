"""What filled cells may be wrong by, as the bias feels it: at once, and late, after the cells are known again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..equations.lags import followed_error
from ..records import Record
from .input_law import InputLaw

SPOILT = 0.3
"""Share of the residuals' standard deviation from which a reading is neither learned from nor judged: it would raise
the variance there by a tenth."""


class FillingError:
    """Propagates the errors of filled cells through a model's static law and lags.

    Parameters
    ----------
    laws : sequence of InputLaw
        Of the columns that may be filled.
    """

    def __init__(self, laws: Sequence[InputLaw]):
        self.laws = laws

    def of_rows(
        self,
        values: Mapping[Any, np.ndarray],
        errors: Mapping[Any, np.ndarray],
        steps: np.ndarray,
        states: Sequence[np.ndarray] | None = None,
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Standard deviation of the bias by cells filled in consecutive rows, or before them.

        Parameters
        ----------
        values : mapping of column to array of shape (n,)
            Filled; NaN where a cell is missing all the same.
        errors : mapping of column to array of shape (n,)
            Standard deviation of each filled cell, NaN for others.
        steps : array of shape (n,)
            Time since the row before [s].
        states : sequence of arrays, optional
            Covariance of each column's error and of what its lags feel of it, after the rows before; None for none.

        Returns
        -------
        error : array of shape (n,)
            0 where no filled cell is felt; infinite where it cannot be told.
        states : list of arrays
        """
        total, after = np.zeros(len(steps)), []
        for i, law in enumerate(self.laws):
            value, error = np.asarray(values[law.column], float), np.asarray(errors[law.column], float)
            covariance = _nothing(law) if states is None else states[i]
            covariance = _propagated(law, value, error, steps, covariance, total)
            after.append(covariance)
        return np.sqrt(total), after

    def of_record(self, record: Record) -> np.ndarray:
        """`of_rows` of all rows of a record, shape (n_rows,)."""
        result = np.zeros(record.n_rows)
        nothing = np.full(record.n_rows, np.nan)
        for start, stop, _ in record.segments:
            rows = record.rows(start, stop)
            values = {law.column: np.asarray(record.columns[law.column][rows], float) for law in self.laws}
            errors = {law.column: record.filled.get(law.column, nothing)[rows] for law in self.laws}
            result[rows] = self.of_rows(values, errors, record.times.steps(rows))[0]
        return result


def _nothing(law: InputLaw) -> np.ndarray:
    """Covariance of no error of a column, and of what its lags feel."""
    return np.zeros((len(law.weights) + 1, len(law.weights) + 1))


def _propagated(
    law: InputLaw, values: np.ndarray, errors: np.ndarray, steps: np.ndarray, covariance: np.ndarray, total: np.ndarray
) -> np.ndarray:
    """Add the variance of the bias to `total`; returns the covariance after the last row.

    The error of a column wanders while it is filled, and each lag follows it.
    """
    filled, missing = np.isfinite(errors), np.isnan(values)
    k = 0 if covariance.any() else int(np.argmax(filled)) if filled.any() else len(steps)
    while k < len(steps):
        covariance = followed_error(covariance, max(steps[k], 0.0), law.time_constants)
        if filled[k]:
            covariance[0, 0] = max(covariance[0, 0], errors[k] ** 2)
        elif not missing[k]:
            covariance[0, :] = covariance[:, 0] = 0.0
        weights = np.concatenate(([law.slope(values[k]) - law.weights.sum()], law.weights))
        found = float(weights @ covariance @ weights)
        total[k] += max(found, 0.0) if law.known else np.inf if filled[k] else 0.0
        if not (filled[k] or missing[k]) and float(weights**2 @ np.diag(covariance)) <= law.least**2:
            covariance = _nothing(law)
        k += 1
        if not covariance.any():  # nothing until the next one that is filled
            later = np.flatnonzero(filled[k:])
            k = k + int(later[0]) if len(later) else len(steps)
    return covariance
