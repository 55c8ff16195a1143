"""Uncertainty budgets after the GUM."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import betainccinv, betaincinv

from ..records import Record
from ..records.numbers import unit_text
from .uncertainty import ErrorWalk, JointErrors, Reference, Sensor


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
    every = pd.Series(np.arange(n), index=index)
    if rows is None:
        return every.to_numpy()
    if isinstance(rows, bool):
        raise TypeError("true or false is no row")
    ends = [rows.start, rows.stop] if isinstance(rows, slice) else np.ravel(rows).tolist()
    places = index is None or all(end is None or isinstance(end, int) for end in ends)  # true and false are too
    listed = rows if isinstance(rows, slice | str) or np.ndim(rows) == 0 else np.asarray(rows)
    return np.atleast_1d((every.iloc if places else every.loc)[listed])


COLUMNS = (
    "quantity", "estimate", "standard uncertainty", "unit", "degrees of freedom", "sensitivity", "contribution",
    "share", "type",
)  # fmt: skip


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
    """Input quantities and uncertainty of one value, GUM 5.1 and G.4.

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
        """One line: ``corrected = 103.957 12(13) mV, k = 1.96, 95 %``."""
        note = "" if self.status == "signed" else f", {self.status}"
        return f"{self.name} = {self.short()}, k = {self.k:.2f}, {100 * self.coverage:g} %{note}"

    def short(self) -> str:
        """Value and expanded uncertainty in its last digits: ``103.957 12(13) mV``."""
        return f"{concise(self.value, self.U)} {unit_text(self.unit)}".strip()

    def _cells(self, line: BudgetLine) -> tuple[str, ...]:
        total = self.u**2 or 1.0
        # More than a thousand degrees of freedom are printed as infinite: k differs by 0.1 % then.
        return (
            line.quantity,
            "" if np.isnan(line.estimate) else f"{line.estimate:.9g}",
            f"{line.uncertainty:.3g}",
            line.unit,
            "infinite" if line.dof > 1000.0 else f"{line.dof:.0f}" if line.dof >= 10 else f"{line.dof:.1f}",
            f"{line.sensitivity:.4g}",
            f"{line.contribution:.3g}",
            f"{100 * line.contribution**2 / total:.1f} %",
            line.type,
        )


def effective_dof(
    variances: Sequence[Any], dofs: Sequence[float], causes: Sequence[str] | None = None
) -> np.ndarray | float:
    """Degrees of freedom of a sum of variances, GUM (G.2b).

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
    """Half width in standard uncertainties, Student's t, GUM G.3.

    By the beta distribution of t² / (dof + t²) and its complement: exact in every version of scipy.
    """
    known = np.clip(dof, 1.0, 1e9)
    found = np.sqrt(known * betaincinv(0.5, known / 2, coverage) / betainccinv(known / 2, 0.5, coverage))
    return float(found) if np.ndim(dof) == 0 else np.asarray(found)


def concise(value: float, U: float) -> str:
    """``103.957 12(13)``, as GUM 7.2.2 writes it."""
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


PARTS = ("noise", "level", "coefficients", "wander", "sensor", "reference", "structure")
"""What an uncertainty consists of: columns ``u_...`` of `Uncertainty.frame`."""
CAUSES = {
    "noise": "noise", "wander": "wander", "structure": "wander", "level": "bias", "coefficients": "bias",
    "sensor": "sensor", "reference": "reference",
}  # fmt: skip
"""Parts that are estimates of the same thing: their variances have their degrees of freedom together."""
MOST_ROWS = 5000
"""Rows of a covariance matrix at most: a matrix of that many has 200 MB."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Uncertainty:
    """Corrected readings with uncertainties, after the GUM.

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
    sensor_own: np.ndarray
    """Variance from the thermometer that each row has for itself, shape (n,)."""
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
        return np.asarray(np.sqrt(sum(self.variances.values())))

    @property
    def dof(self) -> np.ndarray:
        """Effective degrees of freedom, Welch and Satterthwaite, shape (n,)."""
        variances = [self.variances[part] for part in PARTS]
        return np.asarray(effective_dof(variances, [self._dof_of(p) for p in PARTS], [CAUSES[p] for p in PARTS]))

    def frame(self) -> pd.DataFrame:
        """One row per reading: corrected, u, dof, k, U, interval, parts.

        All but dof, k and status in the unit of the reading.
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
        """Budget of one row, or of the mean of several.

        Parameters
        ----------
        rows : int, label, slice or sequence, optional
            Integers are places, counted from 0; anything else is a label of the index. All by default.

        Raises
        ------
        ValueError
            Where there are no such rows, and where none of them has an uncertainty.
        """
        at = self._rows(rows)
        mean = self._mean_variances(at)
        unit = self.model.reading_.unit
        lines = [
            *(
                BudgetLine(quantity=name, estimate=estimate, uncertainty=mean[part] ** 0.5, unit=unit,
                     dof=self._dof_of(part), sensitivity=sensitivity, cause=CAUSES[part])
                for part, name, estimate, sensitivity in (
                    ("noise", "reading, white noise", float(np.mean(self.corrected[at] + self.bias[at])), 1.0),
                    ("wander", "reading, wandering noise", np.nan, 1.0),
                    ("coefficients", "bias, coefficients", float(np.mean(self.bias[at])), -1.0),
                    ("level", "bias, level", np.nan, -1.0),
                    ("structure", "effects that may be missing", np.nan, 1.0),
                )
            ),
            self._sensor_line(mean["sensor"], unit),
            BudgetLine(quantity="reference of the level", estimate=np.nan, uncertainty=self.reference.uncertainty,
                 unit=unit, dof=self.reference.dof, type="B" if self.reference.declared else "B, not declared"),
        ]  # fmt: skip
        return Budget(
            name="corrected" if len(at) == 1 else f"mean of {len(at)} corrected",
            value=float(np.mean(self.corrected[at])), unit=unit, lines=tuple(lines), coverage=self.coverage,
            status=self._status_of(at),
        )  # fmt: skip

    def mean(self, rows: Any = None) -> Budget:
        """Mean of some corrected readings, as a budget.

        Level and coefficients do not become better by averaging, noise that remembers does so slowly.
        """
        return self.budget(rows)

    def covariance(self, rows: Any) -> np.ndarray:
        """Covariance of some corrected readings, shape (m, m).

        Raises
        ------
        ValueError
            For more than `MOST_ROWS` rows, and as `budget`.
        """
        at = self._rows(rows)
        if len(at) > MOST_ROWS:
            raise ValueError(f"A covariance matrix of {len(at)} rows is too large: choose at most {MOST_ROWS}.")
        chosen = self._chosen(at)
        through = chosen.columns @ self.joint.half
        total = through @ through.T + self.joint.noise.covariance(chosen.seconds, chosen.runs)
        own = self.sensor_own[at]
        bias = (self.variances["level"] + self.variances["coefficients"])[at] - np.einsum("ij,ij->i", through, through)
        for variance in (
            self.variances["sensor"][at] - own,
            self.variances["structure"][at],
            bias,
        ):  # whole records err alike
            each = np.sqrt(np.maximum(variance, 0.0))
            total = total + each[:, None] * each
        return np.asarray(total + np.diag(own) + self.reference.uncertainty**2)

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
        """The mean of some rows as a signed value.

        Raises
        ------
        ValueError
            As `to_csv`.
        """
        self.require_signed()
        found = self.budget(rows)
        if found.status != "signed" and not self.allow_missing:
            raise ValueError(
                f"Some of these rows are not signed: {found.status}. Choose others (see the status in frame()), or "
                "pass allow_missing=True to have them all the same, marked as what they are."
            )
        return str(found)

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
        count = int((self.status[known] == "signed").sum())
        said = "signed" if count == len(known) else f"{count} of them signed"
        if self.why_provisional:
            said = f"provisional: {self.why_provisional}"
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
            "level": self.joint.dof, "coefficients": self.joint.dof,
            "sensor": np.inf, "reference": self.reference.dof,
        }[part]  # fmt: skip

    def _rows(self, rows: Any) -> np.ndarray:
        """Numbers of the rows that have an uncertainty."""
        at = asked_rows(rows, len(self.corrected), self.index)
        if not len(at):
            raise ValueError(f"No row is asked for: {rows!r:.80} is empty.")
        known = at[np.isfinite(self.u[at])]
        if not len(known):
            reasons = ", ".join(sorted(set(map(str, self.status[at]))))
            raise ValueError(f"None of these {len(at)} rows has an uncertainty: {reasons}. See the status in frame().")
        return np.asarray(known)

    def _mean_variances(self, at: np.ndarray) -> dict[str, float]:
        """Variance of each part of the mean of some rows."""
        if len(at) == 1:
            return {part: float(variance[at[0]]) for part, variance in self.variances.items()}
        chosen = self._chosen(at)
        Z = chosen.columns.mean(axis=0)
        white, wander = self.joint.noise.of_mean(chosen.seconds, chosen.runs)
        through = Z @ self.joint.half
        level = float(through @ ErrorWalk(self.model, self.joint, removed=True).level) ** 2
        distance = float(Z @ self.joint.coef - np.mean(self.bias[at]))
        rest = max(float(through @ through) - level, 0.0) + distance**2 + self.joint.representation
        together = {part: float(np.mean(np.sqrt(self.variances[part][at]))) ** 2 for part in PARTS}
        own = self.sensor_own[at]
        together["sensor"] = float(
            np.mean(np.sqrt(np.maximum(self.variances["sensor"][at] - own, 0.0))) ** 2 + own.sum() / len(at) ** 2
        )
        return together | {
            "noise": white, "wander": wander, "level": level, "coefficients": rest,
        }  # fmt: skip

    def _sensor_line(self, variance: float, unit: str) -> BudgetLine:
        offset = self.sensor.offset  # in K, whatever the thermometer shows
        if offset > 0 and not (self.sensor.own_noise or self.sensor.time_constant):
            return BudgetLine(quantity="thermometer, change since learning", estimate=0.0, uncertainty=offset,
                        unit="K", sensitivity=variance**0.5 / offset, type="B")  # fmt: skip
        declared = variance > 0 or self.sensor != Sensor()
        return BudgetLine(quantity="thermometer", estimate=np.nan, uncertainty=variance**0.5, unit=unit,
                    type="B" if declared else "B, not declared")  # fmt: skip

    def _status_of(self, at: np.ndarray) -> str:
        said = pd.unique(pd.Series(self.status[at]))
        return "signed" if list(said) == ["signed"] else next(text for text in said if text != "signed")

    def _chosen(self, at: np.ndarray) -> Chosen:
        """Parts of the covariances between some rows."""
        place = np.full(len(self.corrected), -1)
        place[at] = np.arange(len(at))
        seconds, runs = np.zeros(len(at)), np.zeros(len(at), int)
        columns = np.zeros((len(at), len(self.joint.coef)))
        labels: dict[object, int] = {}
        for block, _, _, errors in ErrorWalk(self.model, self.joint, removed=True).blocks(self.record):
            wanted = place[block.rows]
            inside, into = wanted >= 0, wanted[wanted >= 0]
            run = block.record.segments[block.segment].run
            runs[into] = labels.setdefault(run, len(labels))
            seconds[into], columns[into] = block.seconds[inside], errors.columns[inside]
        return Chosen(seconds, runs, columns)


class Chosen(NamedTuple):
    """Some rows of a record."""

    seconds: np.ndarray
    """Time since the fitted record began [s], shape (m,)."""
    runs: np.ndarray
    """Number of the run, shape (m,)."""
    columns: np.ndarray
    """What the coefficients are multiplied by, shape (m, 1 + p)."""
