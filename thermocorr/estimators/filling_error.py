"""What filled cells may be wrong by, as the bias feels it: at once, and late, after the cells are known again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..effects import Covariate, StaticPolynomial, ThermalLag
from ..effects.expressions import reads_temperature
from ..effects.protocol import Effect
from ..equations.lags import followed_error
from ..records import Record

FELT = 0.05
"""Share of the residuals' standard deviation below which a late error is forgotten."""
SPOILT = 0.3
"""Share of the residuals' standard deviation from which on a reading is neither learned from nor judged: it would raise
the variance there by a tenth."""


@dataclass(frozen=True)
class _Law:
    """How the bias depends on one column."""

    column: Any
    powers: tuple[tuple[int, float, float], ...]
    """Power, coefficient and origin of each static term."""
    time_constants: np.ndarray
    weights: np.ndarray
    """Time constants [s] and coefficients of the lags."""
    least: float
    """What the bias need not be told of."""
    known: bool
    """False where some other effect reads the column."""

    def slope(self, value: float) -> float:
        """Change of the static law with the column."""
        if np.isnan(value):
            return 0.0
        return sum(power * weight * (value - origin) ** (power - 1) for power, weight, origin in self.powers)

    def nothing(self) -> np.ndarray:
        """Covariance of no error."""
        return np.zeros((len(self.weights) + 1, len(self.weights) + 1))


class FillingError:
    """Propagates the errors of filled cells through a model's static law and lags.

    Parameters
    ----------
    effects : sequence of Effect
        Learned.
    coef : array of shape (n_columns,)
    temperature : column
        The ambient temperature.
    columns : sequence of columns
        Those that may be filled.
    deviation : float
        Standard deviation of the residuals, beside which late errors are forgotten.
    """

    def __init__(
        self, effects: Sequence[Effect], coef: np.ndarray, temperature: Any, columns: Sequence[Any], deviation: float
    ):
        edges = np.cumsum([0, *(len(effect.names()) for effect in effects)])
        parts = [(effect, coef[low:high]) for effect, low, high in zip(effects, edges, edges[1:], strict=False)]
        self.laws = [_law(column, parts, temperature, FELT * deviation) for column in columns]

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
            covariance = law.nothing() if states is None else states[i]
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


def _propagated(
    law: _Law, values: np.ndarray, errors: np.ndarray, steps: np.ndarray, covariance: np.ndarray, total: np.ndarray
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
            covariance = law.nothing()
        k += 1
        if not covariance.any():  # nothing until the next one that is filled
            later = np.flatnonzero(filled[k:])
            k = k + int(later[0]) if len(later) else len(steps)
    return covariance


def _law(column: Any, parts: Sequence[tuple[Effect, np.ndarray]], temperature: Any, least: float) -> _Law:
    powers: list[tuple[int, float, float]] = []
    taus, weights, known = [], [], True
    for effect, coef in parts:
        if isinstance(effect, StaticPolynomial) and column == temperature:
            powers += [
                (power, float(weight), float(effect.reference_temperature_))
                for power, weight in zip(effect.powers(), coef, strict=True)
            ]
        elif isinstance(effect, ThermalLag) and column == temperature and effect.form == "unit_gain":
            taus += effect.time_constants_.tolist()
            weights += coef.tolist()
        elif isinstance(effect, Covariate) and effect.column == column:
            powers.append((effect.power, float(coef[0]), 0.0))
            if len(coef) > 1 and effect.power == 1:
                taus += list(getattr(effect, "time_constants_", ()))
                weights += coef[1:].tolist()
            known &= len(coef) == 1 or effect.power == 1
        elif column in effect.inputs() or (column == temperature and reads_temperature(effect)):
            known = known and not coef.any()
    return _Law(column, tuple(powers), np.array(taus, float), np.array(weights, float), least, known)
