"""Samples of a stream, and its answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..equations import MovingAverage
from ..model import DynamicBiasRegressor
from ..model.uncertainty import ErrorWalk
from ..records import History, RecordError
from ..records.errors import quoted
from ..records.numbers import as_numbers, as_pandas, is_frame, numeric_column, numeric_reading
from ..records.read import check_dates, out_of_reach
from ..records.record import Flags
from ..records.screen import Limits
from ..records.times import BEYOND
from ..records.types import LARGEST

NO_TEMPERATURE = "no temperature"
"""Flag of a sample that lacks a temperature, or a column that the model needs."""


class Corrected(NamedTuple):
    """Result for one sample."""

    corrected: float
    """Reading less bias, eq. (24); NaN without a reading."""
    bias: float
    """What was taken away; NaN without a temperature."""
    flags: tuple[str, ...]
    """Every reason for distrust, the weightiest first; empty where there is none."""
    smoothed: float = math.nan
    """Moving average of the corrected reading, eq. (26); NaN unless asked for."""
    reference: float = math.nan
    """Tracked U0; NaN unless asked for."""
    u: float = math.nan
    """Standard uncertainty of the corrected reading; NaN unless asked for."""
    u_smoothed: float = math.nan
    """Standard uncertainty of the moving average; NaN unless both are asked for."""

    @property
    def flag(self) -> str:
        """The first reason for distrust, or ""."""
        return self.flags[0] if self.flags else ""


COLUMNS = {"flag": "flags"}
"""Name of a result -> attribute of `Answers`, where they differ."""


class Answers:
    """Results for many samples, column by column."""

    def __init__(self, n: int):
        self.corrected, self.bias, self.smoothed, self.reference = (np.full(n, np.nan) for _ in range(4))
        self.u, self.u_smoothed = (np.full(n, np.nan) for _ in range(2))
        self.flags = Flags(n)

    def frame(self, X: Any, names: Sequence[str]) -> pd.DataFrame:
        """The columns of these names, with the index of X."""
        result = {name: getattr(self, COLUMNS.get(name, name)) for name in names}
        result["flag"] = self.flags.column()
        return pd.DataFrame(result, index=X.index if isinstance(X, pd.DataFrame) else None)

    def spread(self, why: np.ndarray, reference: float) -> Answers:
        """Columns with gaps for rows without answers."""
        out, kept = Answers(len(why)), why == ""
        for name, column in vars(self).items():
            getattr(out, name)[kept] = column
        out.flags[~kept] = why[~kept]
        last = np.maximum.accumulate(np.where(kept, np.arange(len(kept)), -1))
        out.reference = np.where(last < 0, reference, out.reference[last])
        return out


def one_number(value: Any) -> float:
    """A float, NaN for None; errors for anything else."""
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else RecordError
        raise kind(
            "A sample's temperature, reading and columns must be numbers, None or NaN where there is none. "
            f"Got {value!r:.60} instead."
        ) from None


def _through(values: Any, door: Callable[[Any], Any]) -> np.ndarray:
    """Values as floats; infinite ones are missing."""
    values = as_pandas(values)
    if getattr(getattr(values, "dtype", None), "kind", "") != "f":
        return np.array(door(values), float)
    given = np.asarray(values, float)
    odd = np.abs(given) > LARGEST
    if not odd.any():
        return np.array(door(values), float)
    found = np.array(door(values.mask(odd) if isinstance(values, pd.Series) else np.where(odd, np.nan, given)), float)
    absurd = (odd & np.isfinite(given)).reshape(found.shape)
    found[absurd] = given.reshape(found.shape)[absurd]
    return found


def readings(y: Any, X: Any) -> np.ndarray:
    """Readings as floats, row by row as X."""
    return _through(y, lambda values: numeric_reading(values, X))


def column_of(X: Any, name: Any, role: Any) -> np.ndarray:
    """A column as floats, NaN for missing ones."""
    if is_frame(X) and (name not in X.columns or X[name].ndim != 1):
        return np.array(numeric_column(X, name, role), float)  # a sentence about what is wrong
    values = X[name][:] if is_frame(X) else X[:, name]
    return _through(values, lambda each: as_numbers(each, f"{role.capitalize()} {quoted(name)}", role))


def refused_rows(inputs: Mapping[Any, Limits], stamps: np.ndarray, values: Any) -> np.ndarray | None:
    """Why each row is refused; None for no refusal."""
    lacking = np.flatnonzero(~np.logical_and.reduce([np.isfinite(column) for column in values.values()]))
    found = [
        each for name, limits in inputs.items() for each in limits.reasons(values[name], lambda k: stamps[k].item())
    ]
    found.append((lacking, NO_TEMPERATURE))
    if not any(len(rows) for rows, _ in found):
        return None
    why = np.full(len(stamps), "", dtype=object)
    for rows, reason in found:
        why[rows] = reason
    return why


def checked_label(label: Any, column: Any) -> Any:
    """The label of a sample's run, or RecordError."""
    if type(label) is not str:
        if pd.isna(label):
            raise RecordError(f"The sample has no label of its run in {quoted(column)}. Label every sample.")
        if out_of_reach(label):
            raise RecordError(f"The label of the sample's run is {label!s:.60}. {BEYOND}")
    return label


def stretches(labels: pd.Series[Any] | None, n: int) -> list[tuple[int, int, Any]]:
    """Stretches of one run: first row, end, label."""
    if labels is None:
        return [(0, n, None)]
    if labels.isna().any():
        raise RecordError(f"Row {int(labels.isna().argmax())} has no label of its run. Label every row.")
    codes, names = pd.factorize(labels)
    check_dates(codes, names, "The column of the run's label")
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), n]
    return [(low, high, labels.iloc[low]) for low, high in pairwise(edges)]


class LiveErrors:
    """Standard uncertainties of corrected readings: those of `DynamicBiasRegressor.correct` with ``return_std=True``.

    A model that has searched its time constants carries the lags of the whole spectrum besides its own.

    `model` (DynamicBiasRegressor): Fitted.
    """

    def __init__(self, model: DynamicBiasRegressor):
        self.joint = joint = model._joint_errors()
        self._walk = ErrorWalk(model, joint, removed=True)
        own, history = model.features_.effect_list(), model.features_.history_
        more = [i for i, effect in enumerate(joint.effects) if all(effect is not each for each in own)]
        self.effects = [*own, *(joint.effects[i] for i in more)]
        """Effects of the model, and what its errors need besides them."""
        ends = zip(history.end_states, joint.history.end_states, strict=True)
        self.history: History = replace(
            history, end_states=tuple([*states, *(wide[i] for i in more)] for states, wide in ends)
        )
        """The fitted record, with the states of all these effects."""
        edges = np.cumsum([0, *(effect.n_columns() for effect in self.effects)])
        place = {
            id(effect): range(low, high) for effect, (low, high) in zip(self.effects, pairwise(edges), strict=True)
        }
        self._columns = [column for effect in joint.effects for column in place[id(effect)]]
        self._mean_variances: dict[int, float] = {}

    def variances(self, columns: np.ndarray, seconds: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """Variances of the bias and the noise, (2, n).

        `columns` are those of all `effects`, shape (n, p).
        """
        errors = self._walk.errors(columns[:, self._columns], seconds, bias)
        return np.stack((errors.bias, errors.noise))

    def u(self, variances: np.ndarray, count: int = 1) -> np.ndarray:
        """Standard uncertainty of readings, or of their mean, (n,).

        The bias of a mean is taken to be as sure as that of its last reading.
        """
        noise = self.joint.noise.variance if count == 1 else self._mean_variance(count)
        return np.asarray(np.sqrt(np.maximum(variances[0] + noise * variances[1], 0.0)))

    def of_block(
        self, variances: np.ndarray, corrected: np.ndarray, average: MovingAverage | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Standard uncertainties of a block, before it counts."""
        variances[:, np.isnan(corrected)] = np.nan
        of_mean = np.full(len(corrected), np.nan)
        if average is not None:
            counts = np.minimum(np.cumsum(np.isfinite(corrected)) + len(average.values), average.count)
            for count in np.unique(counts).tolist():
                of_mean[counts == count] = self.u(variances[:, counts == count], max(count, 1))
        return self.u(variances), of_mean

    def _mean_variance(self, count: int) -> float:
        """Variance of a mean of consecutive noise."""
        if count not in self._mean_variances:
            noise = replace(self.joint.noise, size_seconds=np.zeros(0), sizes=np.zeros(0))
            self._mean_variances[count] = sum(noise.of_mean(np.arange(count) * self.history.usual_step))
        return self._mean_variances[count]
