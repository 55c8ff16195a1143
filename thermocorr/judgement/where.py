"""Conditions under which a residual exceeds the noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from ..effects import Covariate, Rate, ThermalLag
from ..effects.protocol import Effect
from ..equations import allan_deviation
from ..model.averages import Averages, averaged
from ..model.regressor import DynamicBiasRegressor, largest_lag
from ..records import Record
from ..records.units import difference_unit
from .data import record_of, residuals_of, suspect_record
from .levels import PLACES, PLACES_BEYOND

ALLAN_COLUMNS = ["averaging_time", "deviation", "low", "high", "white", "excess"]
COLUMNS = ["aspect", "column", "time_constant", "low", "high", "unit", "n", "rms", "share", "lift"]


def where_it_fails(
    model: DynamicBiasRegressor, record: Record, residual: np.ndarray, rms: float, floor: float
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Where and at which averaging times a model fails.

    `model` (DynamicBiasRegressor): Fitted. `record` (Record): With the recorded columns that are conditions.
    `residual` (array of shape (n_rows,)): Measured less modelled reading; NaN where unknown. `rms` (float): Rms
    residual of single readings; where the rows of the record are averages, theirs is less. `floor` (float): Standard
    deviation of the noise of one sample.
    """
    lag, recorded = largest_lag(model), [name for name in record.columns if name != record.temperature_name]
    effects: list[Effect] = [Rate(), *([] if lag is None else [ThermalLag([lag])])]
    effects += (Covariate(name) for name in (*recorded, record.temperature_name))
    degree = difference_unit(model.reading_.temperature_unit)
    aspects: list[dict[str, Any]] = [{"aspect": "rate", "unit": f"{degree}/h"}]
    aspects += [] if lag is None else [{"aspect": "lag difference", "time_constant": lag, "unit": degree}]
    aspects += [{"aspect": "column", "column": name} for name in recorded]
    aspects.append({"aspect": "temperature", "column": record.temperature_name})
    for effect in effects:
        effect.learn(record)
    data = averaged(replace(record, reading=residual), [*effects, _Square()])
    *values, squares = (columns[:, 0] for columns in data.columns)
    squares = squares + max(rms**2 - float(np.average(squares, weights=data.counts)), 0.0)  # what averaged rows hide
    values[0] = values[0] * 3600.0
    for i, effect in enumerate(effects):
        if isinstance(effect, Covariate):
            values[i] = values[i] + effect.mean_
    return _places(record, data, squares, floor, aspects, values), _against_white(data, floor)


def first_look(model: DynamicBiasRegressor, X: Any, y: Any) -> pd.DataFrame:
    """Where a model fails, before it is diagnosed."""
    read = record_of(model, X, y)
    record = suspect_record(model, read, X, y, None)
    residual, rms = residuals_of(model, read, record)
    steps = np.diff(residual[np.isfinite(residual)])
    noise = float(np.sqrt(np.mean(steps**2) / 2)) if len(steps) else rms
    return where_it_fails(model, record, residual, rms, min(noise, rms))[0]


def _places(
    record: Record,
    data: Averages,
    squares: np.ndarray,
    floor: float,
    aspects: list[dict[str, Any]],
    values: list[np.ndarray],
) -> pd.DataFrame:
    """Rank stretches of time and ranges of conditions.

    One place a row, worst first: by how much more than its part of the record it has, in standard deviations. Empty
    where the error is not clearly beyond the noise. Columns: aspect ("time", "temperature", "rate", "lag difference",
    "hour" or "column"), column (its name, where the temperature or a recorded column is the aspect),
    time_constant [s] (of the lag difference), low, high (the same for a state of a switch) and unit ("date": seconds
    since 1970; "h" or "h (UTC)" of the hour), n (samples), rms (of single
    readings), share (of the error beyond the noise, 0 where there is
    none beyond it: those of an aspect may be more than 1 together), lift (share over the share of samples).
    """
    excess = data.reading**2 - floor**2 / data.counts
    total = float(np.sum(excess * data.counts))
    if total <= PLACES_BEYOND * floor**2 * np.sqrt(2 * len(excess)):
        return pd.DataFrame(columns=COLUMNS)
    rows = [
        {**place, **_figures(data, squares, excess, total, inside)}
        for place, inside in _bins(record, data, aspects, values)
        if inside.sum() >= 3
    ]
    frame = pd.DataFrame(rows, columns=[*COLUMNS, "concentration"])
    frame["unit"] = frame["unit"].fillna("")
    return frame.sort_values("concentration", ascending=False, ignore_index=True)[COLUMNS]


def _against_white(data: Averages, floor: float) -> pd.DataFrame:
    """Allan deviation of the residual against white noise.

    Columns averaging_time [s], deviation, low, high (95 %), white (the line of the noise floor) and excess (deviation
    over white); from averages over short stretches of time, so the shortest averaging time is one of these.
    """
    pieces = [data.reading[data.segment == segment] for segment in np.unique(data.segment)]
    if len(data.reading) < 3 or not len(data.steps):
        return pd.DataFrame(columns=ALLAN_COLUMNS)
    found = allan_deviation(pieces, float(np.median(data.steps)))
    white = floor / np.sqrt(np.median(data.counts) * found.averaging_times / found.averaging_times[0])
    excess = found.deviation / np.maximum(white, 1e-300)
    figures = (found.averaging_times, found.deviation, found.low, found.high, white, excess)
    return pd.DataFrame(dict(zip(ALLAN_COLUMNS, figures, strict=True)))


class _Square(Effect):
    """The square of a residual, to be averaged."""

    def names(self) -> list[str]:
        return ["square"]

    def columns(self, block: Any, state: Any) -> tuple[np.ndarray, Any]:
        return np.nan_to_num(np.asarray(block.record.reading[block.rows], float)) ** 2, state


def _bins(
    record: Record, data: Averages, aspects: list[dict[str, Any]], values: list[np.ndarray]
) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """Each place (aspect and interval), and which averages lie in it."""
    n = len(data.reading)
    place = np.arange(n) * PLACES // n
    since = record.since_1970()
    zero, unit = (0.0, "s") if since is None else (since, "date")
    for i in range(PLACES):
        inside = place == i
        if inside.any():
            first, last = zero + data.seconds[inside][[0, -1]]
            yield {"aspect": "time", "low": first, "high": last, "unit": unit}, inside
    for aspect, column in zip(aspects, values, strict=True):
        states = _states(record, aspect.get("column"))
        if states is not None:  # an average over both is of the nearer one
            nearest = np.searchsorted((states[1:] + states[:-1]) / 2, column)
            for number, state in enumerate(states.tolist()):
                yield {**aspect, "low": state, "high": state}, nearest == number
            continue
        edges = np.unique(np.quantile(column, np.linspace(0, 1, PLACES + 1)))
        for low, high in pairwise(edges):
            inside = (column >= low) & ((column < high) | (high == edges[-1]))
            yield {**aspect, "low": low, "high": high}, inside
    if since is not None and np.ptp(data.seconds) >= 4 * 86_400:
        hour = ((zero + data.seconds) % 86_400) / 3600
        clock = "h" if record.times.kind == "datetime" else "h (UTC)"
        for i in range(PLACES):
            low, high = 24.0 * i / PLACES, 24.0 * (i + 1) / PLACES
            yield {"aspect": "hour", "low": low, "high": high, "unit": clock}, (hour >= low) & (hour < high)


def _states(record: Record, column: Any) -> np.ndarray | None:
    """The values of a column with few; None for others."""
    if column is None:
        return None
    ends = (
        record.columns[column][: (1 << 15)],
        record.columns[column][max(record.n_rows - (1 << 15), 0) : record.n_rows],
    )
    values = np.concatenate([np.asarray(end, float) for end in ends])
    found = np.unique(values[np.isfinite(values)])
    # Up to four values of a column, a switch or a mode, are conditions of their own.
    return found if 2 <= len(found) <= 4 else None


def _figures(
    data: Averages, squares: np.ndarray, excess: np.ndarray, total: float, inside: np.ndarray
) -> dict[str, Any]:
    weight = float(data.counts[inside].sum() / data.counts.sum())
    share = float(np.sum((excess * data.counts)[inside]) / total)
    return {
        "n": int(data.counts[inside].sum()),
        "rms": float(np.sqrt(np.average(squares[inside], weights=data.counts[inside]))),
        "share": max(share, 0.0),
        "lift": max(share, 0.0) / weight,
        "concentration": (share - weight) / np.sqrt(weight * (1 - weight)) if weight < 1 else 0.0,
    }
