"""`Uncertainty`: corrected readings with everything that a metrologist puts under them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ...records import Record
from ...records.units import difference_unit
from .budget import Budget, Line, coverage_factor
from .declared import Reference, Sensor
from .joint import JointErrors
from .rows import ErrorWalk

PARTS = ("noise", "level", "coefficients", "wander", "sensor", "reference", "structure", "extrapolation")
"""What an uncertainty consists of: columns ``u_...`` of `Uncertainty.frame`."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Uncertainty:
    """Corrected readings of a record with their uncertainties, after the GUM (JCGM 100:2008).

    Made by `DynamicBiasRegressor.uncertainty`.
    """

    model: Any
    """The fitted `DynamicBiasRegressor`."""
    joint: JointErrors
    record: Record
    index: Any
    corrected: np.ndarray
    """Shape (n,), in the unit of the reading; NaN where there is none."""
    bias: np.ndarray
    """What was taken away, shape (n,)."""
    variances: dict[str, np.ndarray]
    """Variance of each of `PARTS` in each row, shape (n,)."""
    shared: np.ndarray
    """Covariance of the bias with the noise of its row, shape (n,)."""
    status: np.ndarray
    """"signed", "provisional", or why a row deserves no trust, shape (n,)."""
    sensor: Sensor
    reference: Reference
    coverage: float
    why_provisional: str
    """What keeps the record from being signed; "" where nothing does."""
    allow_missing: bool

    @property
    def u(self) -> np.ndarray:
        """Combined standard uncertainty of each row, shape (n,)."""
        return np.asarray(np.sqrt(np.maximum(sum(self.variances.values()) - 2 * self.shared, 0.0)))

    @property
    def dof(self) -> np.ndarray:
        """Effective degrees of freedom of each row (Welch and Satterthwaite), shape (n,)."""
        spread = np.zeros(len(self.corrected))
        for part, variance in self.variances.items():
            spread += variance**2 / self._dof_of(part)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(spread > 0, sum(self.variances.values()) ** 2 / spread, np.inf))

    def frame(self) -> pd.DataFrame:
        """One row for each reading: corrected, u, dof, k, U, low, high, a column for each part, status.

        All but dof, k and status in the unit of the reading. `u` is less than the root of the sum of squares of its
        parts shortly after the fitted record, where the bias and the noise err alike.
        """
        u, dof = self.u, self.dof
        k = coverage_factor(dof, self.coverage)
        columns: dict[str, Any] = {
            "corrected": self.corrected, "u": u, "dof": dof, "k": k, "U": k * u,
            "low": self.corrected - k * u, "high": self.corrected + k * u,
        }  # fmt: skip
        columns |= {f"u_{part}": np.sqrt(variance) for part, variance in self.variances.items()}
        return pd.DataFrame({**columns, "status": self.status}, index=self.index)

    def budget(self, rows: Any = None) -> Budget:
        """Budget of one row (a number, or a label of the index), or of the mean of several (a slice; all by default).

        Raises
        ------
        ValueError
            Where none of the rows has an uncertainty.
        """
        at = self._rows(rows)
        mean = self._mean_variances(at)
        unit = self.model.reading_.unit
        kelvin = difference_unit(self.model.reading_.temperature_unit)
        lines = [
            *(
                Line(quantity=name, estimate=estimate, uncertainty=mean[part] ** 0.5, unit=unit, dof=self._dof_of(part),
                     sensitivity=sensitivity)
                for part, name, estimate, sensitivity in (
                    ("noise", "reading, unforeseen noise", float(np.mean(self.corrected[at] + self.bias[at])), 1.0),
                    ("wander", "reading, wandering noise", np.nan, 1.0),
                    ("coefficients", "bias, coefficients", float(np.mean(self.bias[at])), -1.0),
                    ("level", "bias, level", np.nan, -1.0),
                    ("extrapolation", "bias, beyond the fitted temperatures", np.nan, -1.0),
                    ("structure", "effects that may be missing", np.nan, 1.0),
                )
            ),
            self._sensor_line(mean["sensor"], kelvin, unit),
            Line(quantity="reference of the level", estimate=np.nan, uncertainty=self.reference.uncertainty, unit=unit,
                 dof=self.reference.dof, type="B" if self.reference.declared else "B, not declared"),
        ]  # fmt: skip
        return Budget(
            name="corrected" if len(at) == 1 else f"mean of {len(at)} corrected",
            value=float(np.mean(self.corrected[at])), unit=unit, lines=tuple(lines), coverage=self.coverage,
            status=self._status_of(at),
        )  # fmt: skip

    def mean(self, rows: Any = None) -> Budget:
        """Mean of the corrected readings of a slice: a `Budget`, whose `value`, `u`, `dof`, `k` and `U` are the mean's.

        Level and coefficients do not become better by averaging, noise that remembers does so slowly.
        """
        return self.budget(rows)

    def covariance(self, rows: Any) -> np.ndarray:
        """Covariance matrix of the corrected readings of some rows, shape (m, m)."""
        at = self._rows(rows)
        seconds, Z = self._seconds(at), self._columns(at)
        lag = seconds[:, None] - seconds
        through = Z @ self.joint.half
        size = self.joint.noise.size(seconds)
        noise = self.joint.noise.white_covariance(lag) + self.joint.noise.wander_covariance(lag)
        total = through @ through.T + size[:, None] * size * noise
        alike = Z @ self.joint.last @ self.joint.fading(seconds).T
        for part in ("sensor", "structure", "extrapolation"):  # whole records err alike
            each = np.sqrt(self.variances[part][at])
            total = total + each[:, None] * each
        distance = np.sqrt(np.maximum(self.variances["level"] + self.variances["coefficients"], 0.0))[at]
        rest = np.maximum(distance**2 - np.einsum("ij,ij->i", through, through), 0.0) ** 0.5
        total = total + rest[:, None] * rest + self.reference.uncertainty**2 - alike - alike.T
        return np.asarray(total)

    def to_csv(self, path: Any) -> None:
        """Write the frame as CSV.

        Raises
        ------
        ValueError
            Where the uncertainty is provisional, unless ``allow_missing=True`` was given.
        """
        self.require_signed()
        self.frame().to_csv(path)

    def certificate(self, rows: Any = None) -> str:
        """The mean of some rows as a signed value, with its budget.

        Raises
        ------
        ValueError
            As `to_csv`.
        """
        self.require_signed()
        return str(self.budget(rows))

    def require_signed(self) -> None:
        """Refuse to sign what is provisional."""
        if self.why_provisional and not self.allow_missing:
            raise ValueError(
                f"The uncertainty is provisional: {self.why_provisional} Add what is missing, or pass "
                "allow_missing=True to have it all the same, marked as provisional."
            )

    def __str__(self) -> str:
        known = np.flatnonzero(np.isfinite(self.u))
        if not len(known):
            return "No row has an uncertainty: see the status in frame()."
        middle = int(known[len(known) // 2])
        one = self.budget(middle)
        said = "signed" if not self.why_provisional else f"provisional: {self.why_provisional}"
        return (
            f"{len(known)} corrected readings, {said}\n"
            f"one of them: {one.short()}, k = {one.k:.2f}\n"
            f"mean of all: {self.budget().short()}"
        )

    __repr__ = __str__

    def _dof_of(self, part: str) -> float:
        noise = self.joint.noise
        return {
            "noise": noise.white_dof, "wander": noise.wander_dof, "structure": noise.wander_dof,
            "level": self.joint.dof, "coefficients": self.joint.dof, "extrapolation": self.joint.dof,
            "sensor": np.inf, "reference": self.reference.dof,
        }[part]  # fmt: skip

    def _rows(self, rows: Any) -> np.ndarray:
        """Numbers of the rows that are meant and have an uncertainty."""
        n = len(self.corrected)
        if rows is None:
            at = np.arange(n)
        elif isinstance(rows, slice):
            at = np.arange(n)[rows] if self.index is None else np.arange(n)[self._positions(rows)]
        elif isinstance(rows, (int, np.integer)) and not isinstance(rows, bool):
            at = np.arange(n)[[int(rows)]]
        elif np.ndim(rows) == 1 and not isinstance(rows, str):
            at = np.arange(n)[np.asarray(rows)]
        elif self.index is not None:
            at = np.atleast_1d(np.arange(n)[self.index.get_loc(rows)])
        else:
            raise ValueError(f"Rows must be a number, a slice or row numbers. Got {rows!r} instead.")
        at = at[np.isfinite(self.u[at])]
        if not len(at):
            raise ValueError("None of these rows has an uncertainty: see the status in frame().")
        return np.asarray(at)

    def _positions(self, rows: slice) -> slice:
        ends = [each for each in (rows.start, rows.stop) if each is not None]
        if all(isinstance(each, (int, np.integer)) for each in ends):
            return rows
        positions: slice = self.index.slice_indexer(rows.start, rows.stop, rows.step)
        return positions

    def _mean_variances(self, at: np.ndarray) -> dict[str, float]:
        """Variance of each part of the mean of some rows."""
        if len(at) == 1:
            result = {part: float(variance[at[0]]) for part, variance in self.variances.items()}
            return result | {"wander": max(result["wander"] - 2 * float(self.shared[at[0]]), 0.0)}
        Z = self._columns(at).mean(axis=0)
        seconds = np.sort(self._seconds(at))
        white, wander = self.joint.noise.of_mean(seconds)
        alike = float(Z @ self.joint.last @ self.joint.fading(seconds).mean(axis=0))
        through = Z @ self.joint.half
        walk = ErrorWalk(self.model, self.joint, removed=True)
        level = float(through @ walk.level) ** 2
        distance = float(Z @ self.joint.coef - np.mean(self.bias[at]))
        rest = max(float(through @ through) - level, 0.0) + distance**2 + self.joint.representation
        together = {part: float(np.mean(np.sqrt(self.variances[part][at]))) ** 2 for part in PARTS}
        return together | {
            "noise": white, "wander": max(wander - 2 * alike, 0.0), "level": level, "coefficients": rest,
        }  # fmt: skip

    def _sensor_line(self, variance: float, kelvin: str, unit: str) -> Line:
        offset = self.sensor.offset
        if offset > 0 and not (self.sensor.own_noise or self.sensor.time_constant):
            return Line(quantity="thermometer, change since learning", estimate=0.0, uncertainty=offset, unit=kelvin,
                        sensitivity=variance**0.5 / offset, type="B")  # fmt: skip
        declared = variance > 0 or self.sensor != Sensor()
        return Line(quantity="thermometer", estimate=np.nan, uncertainty=variance**0.5, unit=unit,
                    type="B" if declared else "B, not declared")  # fmt: skip

    def _status_of(self, at: np.ndarray) -> str:
        said = pd.unique(pd.Series(self.status[at]))
        return "signed" if list(said) == ["signed"] else next(text for text in said if text != "signed")

    def _seconds(self, at: np.ndarray) -> np.ndarray:
        seconds = np.full(len(self.corrected), np.nan)
        zero = self.joint.history.zero
        for block in self.record.blocks(zero=zero):
            seconds[block.rows] = block.seconds
        return np.asarray(seconds[at])

    def _columns(self, at: np.ndarray) -> np.ndarray:
        """What the coefficients are multiplied by in some rows, shape (m, 1 + p)."""
        place = np.full(len(self.corrected), -1)
        place[at] = np.arange(len(at))
        result = np.zeros((len(at), len(self.joint.coef)))
        for block, _, errors in ErrorWalk(self.model, self.joint, removed=True).blocks(self.record):
            wanted = place[block.rows]
            result[wanted[wanted >= 0]] = errors.columns[wanted >= 0]
        return result
