"""Budgets after the GUM, and the rows that they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.special import betainccinv, betaincinv


def asked_rows(rows: Any, n: int, index: pd.Index | None) -> np.ndarray:
    """Numbers of the rows meant, increasing, each once.

    Integers are places, counted from 0, in slices too; anything else is a label of the index.

    `rows` (None, int, slice, label, or sequence of int, bool or labels): None: all. `n` (int): Rows there are.
    `index` (Index or None): Their labels. Raises ValueError for what names no row; the message says what was given,
    and what there is.
    """
    try:
        found = _found(rows, n, index)
    except (IndexError, KeyError, TypeError, ValueError) as error:
        labels = "" if index is None else f", or labels from {index[0]} to {index[-1]}"
        raise ValueError(
            f"There are no such rows: {rows!r:.80}. Give places from 0 to {n - 1}{labels}: one, a slice or a list."
        ) from error
    return np.unique(found)


def _found(rows: Any, n: int, index: pd.Index | None) -> np.ndarray:
    every = np.arange(n)
    if rows is None:
        return every
    if isinstance(rows, bool):
        raise TypeError("true or false is no row")
    if isinstance(rows, int | np.integer):
        return every[[int(rows)]]
    if isinstance(rows, slice):
        ends = [end for end in (rows.start, rows.stop) if end is not None]
        if index is None or all(isinstance(end, int | np.integer) for end in ends):
            return every[rows]
        return np.asarray(every[index.slice_indexer(rows.start, rows.stop, rows.step)])
    if isinstance(rows, str) or np.ndim(rows) == 0:
        if index is None:
            raise KeyError(rows)
        return np.atleast_1d(every[index.get_loc(rows)])
    given = np.asarray(rows)
    if given.dtype == bool or np.issubdtype(given.dtype, np.integer):
        return np.asarray(every[given])
    if index is None:
        raise KeyError(rows)
    places = index.get_indexer(pd.Index(rows))
    if (places < 0).any():
        raise KeyError(rows)
    return np.asarray(every[places])


COLUMNS = (
    "quantity", "estimate", "standard uncertainty", "unit", "degrees of freedom", "sensitivity", "contribution",
    "share", "type",
)  # fmt: skip
LARGE = 1000.0
"""Degrees of freedom from which they are printed as infinite: k differs by 0.1 % then."""

KNOTS = 257
"""Degrees of freedom at which Student's t is computed for many rows, even in their inverse roots."""


@dataclass(frozen=True, kw_only=True)
class BudgetLine:
    """One input quantity of a budget."""

    quantity: str
    estimate: float
    """NaN for a correction whose estimate is no number of its own."""
    uncertainty: float
    """Standard uncertainty, in `unit`."""
    unit: str
    dof: float = np.inf
    sensitivity: float = 1.0
    """Unit of the result per `unit`."""
    type: str = "A"
    """"A" from the data, "B" declared; "B, not declared" counts as zero."""
    cause: str = ""
    """Lines with the same one rest on one estimate: their variances share its degrees of freedom."""

    @property
    def contribution(self) -> float:
        """Standard uncertainty of the result that comes from this quantity."""
        return abs(self.sensitivity) * self.uncertainty


@dataclass(frozen=True, kw_only=True, repr=False)
class Budget:
    """Input quantities of one corrected value, and what they make of its uncertainty (GUM, JCGM 100:2008, 5.1 and G.4).

    The quantities are uncorrelated.
    """

    name: str
    value: float
    unit: str
    lines: tuple[BudgetLine, ...]
    coverage: float
    status: str

    @property
    def u(self) -> float:
        """Combined standard uncertainty, GUM (10)."""
        return float(np.sqrt(sum(line.contribution**2 for line in self.lines)))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom, GUM (G.2b), by Welch and Satterthwaite."""
        variances = [line.contribution**2 for line in self.lines]
        causes = [line.cause or f"line {i}" for i, line in enumerate(self.lines)]
        return float(effective_dof(variances, [line.dof for line in self.lines], causes))

    @property
    def k(self) -> float:
        """Coverage factor."""
        return float(coverage_factor(self.dof, self.coverage))

    @property
    def U(self) -> float:
        """Expanded uncertainty."""
        return self.k * self.u

    def frame(self) -> pd.DataFrame:
        """One row for each quantity, columns `COLUMNS`."""
        total = self.u**2 or 1.0
        rows = [
            (each.quantity, each.estimate, each.uncertainty, each.unit, each.dof, each.sensitivity, each.contribution,
             each.contribution**2 / total, each.type)
            for each in self.lines
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def __str__(self) -> str:
        table = pd.DataFrame([self._cells(line) for line in self.lines], columns=list(COLUMNS))
        return f"{table.to_string(index=False)}\n{self.result()}"

    __repr__ = __str__

    def result(self) -> str:
        """The value with its uncertainty in one line: ``corrected = 103.957 12(13) mV, k = 1.96, 95 %``."""
        note = "" if self.status == "signed" else f", {self.status}"
        return f"{self.name} = {self.short()}, k = {self.k:.2f}, {100 * self.coverage:g} %{note}"

    def short(self) -> str:
        """Value and expanded uncertainty in its last digits: ``103.957 12(13) mV``."""
        return f"{concise(self.value, self.U)} {self.unit}".strip()

    def _cells(self, line: BudgetLine) -> tuple[str, ...]:
        total = self.u**2 or 1.0
        return (
            line.quantity,
            "" if np.isnan(line.estimate) else f"{line.estimate:.9g}",
            f"{line.uncertainty:.3g}",
            line.unit,
            "infinite" if line.dof > LARGE else f"{line.dof:.0f}" if line.dof >= 10 else f"{line.dof:.1f}",
            f"{line.sensitivity:.4g}",
            f"{line.contribution:.3g}",
            f"{100 * line.contribution**2 / total:.1f} %",
            line.type,
        )


def effective_dof(
    variances: Sequence[Any], dofs: Sequence[float], causes: Sequence[str] | None = None
) -> np.ndarray | float:
    """Degrees of freedom of a sum of variances, GUM (G.2b); those of one cause are added before.

    `variances` (sequence of float or of arrays of shape (n,)). `dofs` (sequence of float). `causes` (sequence of str,
    optional): By default each has its own.
    """
    together: dict[str, list[Any]] = {}
    for i, (variance, dof) in enumerate(zip(variances, dofs, strict=True)):
        known = together.setdefault(str(i) if causes is None else causes[i], [0.0, dof])
        known[0] = known[0] + np.asarray(variance, float)
    total = sum(variance for variance, _ in together.values())
    spread = sum(variance**2 / dof for variance, dof in together.values())
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(spread > 0, total**2 / np.where(spread > 0, spread, 1.0), np.inf)
    return float(found) if np.ndim(found) == 0 else np.asarray(found)


def coverage_factor(dof: np.ndarray | float, coverage: float) -> np.ndarray | float:
    """Half width of a central interval in standard uncertainties: Student's t, GUM G.3.

    For many rows it is interpolated between `KNOTS` degrees of freedom, to nine digits.
    """
    known = np.minimum(np.maximum(dof, 1.0), 1e9)
    place = np.asarray(known**-0.5)
    low, high = np.nanmin(place, initial=np.inf), np.nanmax(place, initial=0.0)
    if place.size <= KNOTS or not low < high:
        value = _student(known, coverage)
        return float(value) if np.ndim(dof) == 0 else np.asarray(value)
    knots = np.linspace(low, high, KNOTS)
    logarithm = CubicSpline(knots, np.log(_student(knots**-2.0, coverage)))
    return np.asarray(np.exp(logarithm(place)))


def _student(dof: np.ndarray, coverage: float) -> np.ndarray:
    """Student's t by the beta distribution of t² / (dof + t²) and its complement: exact in every version of scipy."""
    return np.asarray(np.sqrt(dof * betaincinv(0.5, dof / 2, coverage) / betainccinv(dof / 2, 0.5, coverage)))


def concise(value: float, U: float) -> str:
    """``103.957 12(13)``: two digits of uncertainty, digits in groups of three (GUM 7.2.2, ISO 80000-1)."""
    if not (np.isfinite(value) and np.isfinite(U)):
        return f"{value:.6g}"
    if U <= 0:
        return f"{value:.9g}(0)"
    place = int(np.floor(np.log10(U))) - 1
    digits = round(U / 10.0**place)
    if digits == 100:
        place, digits = place + 1, 10
    if place >= 0:
        return f"{round(value / 10**place) * 10**place:.0f}({digits * 10**place:.0f})"
    whole, _, fraction = f"{value:.{-place}f}".partition(".")
    grouped = " ".join(fraction[i : i + 3] for i in range(0, len(fraction), 3))
    if -place <= 1:  # 250.1(1.2)
        return f"{whole}.{grouped}({digits / 10.0**-place:.{-place}f})"
    return f"{whole}.{grouped}({digits})"
