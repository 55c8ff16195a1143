"""What noise and steps of a thermometer do to a reading, and to the static gain that a model learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ..effects import StaticPolynomial
from ..effects.protocol import Effect
from ..equations.statistics import white_part
from ..records import Record
from ..records.units import difference_unit

STANDING = 0.5
"""Share of rows that read what the row before read, from which the steps of a thermometer are seen as such: where it
moves by several steps a row, they are noise like any other."""
MANY_DIGITS = 1e-6
"""Relative distance within which values lie on a grid of steps: those of decimal fractions in single precision."""


def thermometer_errors(model: Any, X: Any) -> pd.DataFrame:
    """What the errors of each thermometer do: noise, steps, and what a fit makes of them.

    A thermometer's white noise is what is left of its changes from row to row when the time between rows goes to zero,
    see `thermocorr.equations.statistics.white_part`: true where rows are close enough to resolve the temperature; a
    draught that comes and goes within a row counts as noise, unless the reading follows it: what an estimated noise
    makes in the reading must be found in the residuals. Its step is the smallest distance of its readings. What it
    reads beyond the temperature is then put through the model.

    Errors of a recorded quantity make coefficients wrong, that of a single column too small (attenuation): by
    ``(Q'Q - E'E)^-1 E'E beta``, E the errors of the columns Q (Fuller, Measurement Error Models, 1987, sec. 2.2).
    Corrected readings are not the worse for it, as long as the same thermometer serves: these coefficients are the best
    ones for such a thermometer. A gain that is to be quoted, or used with a better thermometer, is.

    This holds for errors that do not depend on the temperature, as noise. The rounding to steps does: where they are
    seen, nobody knows the sign, and the larger of two is given as the size of the gain's error: what the formula says,
    and by how much a fit is moved that has such a rounding added. That is no limit: of 90 simulated records, read in
    steps of 0.7, 1.4 and 2.8 standard deviations of the temperature, the gain was within it in 78 (28, 29 and 21 of
    30), and within twice that in 89: a bound of 95 % for such records.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted. What it was told by `Thermometer` counts; what it was not is estimated.
    X : DataFrame or array of shape (n_rows, n_columns)
        The record; rows that are not evenly spaced are taken as if they were.

    Returns
    -------
    DataFrame
        One row for each thermometer: ``thermometer``, its ``unit``, ``noise`` and ``resolution`` in that (0.0: none is
        seen), ``noise_from`` and ``resolution_from`` ("declared" or "estimated"), ``reading_unit``, ``in_reading``, the
        standard deviation that its errors give the modelled reading, ``wandering``, the part of that which is not
        white, and ``gain_error``, the relative error of its static gain (-0.01: one per cent too small); with steps the
        size of that error, without sign: no limit.

    Raises
    ------
    RecordError
        For a record that cannot be used; the message says what was found, where, and what to do.
    """
    thermometers = model.features_.thermometers()
    features = model.features_
    record, starts, states = features.resume(X)
    rows = []
    for name in (record.temperature_name, *thermometers.further):
        declared = thermometers.of_column(name)
        noise, resolution = _noise_of(record, name), resolution_of(_values(record, name))
        found = declared.noise if declared.noise is not None else noise
        step = declared.resolution if declared.resolution is not None else resolution
        in_reading, wandering, gain_error = _felt(model, record, starts, states, name, found, step)
        if declared.noise is None and found and in_reading > model.residual_std_:  # the reading follows: it is no noise
            found = 0.0
            in_reading, wandering, gain_error = _felt(model, record, starts, states, name, found, step)
        rows.append(
            {
                "thermometer": name,
                "unit": difference_unit(model.reading_.temperature_unit),
                "noise": found,
                "noise_from": "estimated" if declared.noise is None else "declared",
                "resolution": step,
                "resolution_from": "estimated" if declared.resolution is None else "declared",
                "reading_unit": model.reading_.unit,
                "in_reading": in_reading,
                "wandering": wandering,
                "gain_error": gain_error,
            }
        )
    return pd.DataFrame(rows)


def _values(record: Record, name: Any) -> list[np.ndarray]:
    """A column's values, segment by segment."""
    return [np.asarray(record.columns[name][record.kept(s.start, s.stop)], float) for s in record.segments]


def _noise_of(record: Record, name: Any) -> float:
    return float(np.sqrt(white_part(_values(record, name))))


def resolution_of(parts: Sequence[np.ndarray]) -> float:
    """Step of an instrument, from consecutive values; 0 where few in a row are the same, or they lie on no grid."""
    still = sum(int(np.count_nonzero(np.diff(part) == 0)) for part in parts)
    if still < STANDING * sum(max(len(part) - 1, 0) for part in parts):
        return 0.0
    levels = np.unique(np.concatenate(parts))
    if len(levels) < 2:
        return 0.0
    step = float(np.diff(levels).min())
    off = (levels - levels[0]) / step
    on_grid = np.abs(off - np.rint(off)) <= MANY_DIGITS * np.abs(levels).max() / step
    return step if on_grid.all() else 0.0


def _felt(
    model: Any, record: Record, starts: Any, states: Any, name: Any, noise: float, step: float
) -> tuple[float, float, float]:
    """Standard deviation in the reading, the part that wanders, and relative error of the static gain.

    With steps that is a size without sign, see `thermometer_errors`.
    """
    error = _error(record, name, noise, step)
    if not error.any():
        return 0.0, 0.0, 0.0
    features, coef = model.features_, model.coef_
    column = np.asarray(record.columns[name][:], float)
    moved = replace(record, columns={**record.columns, name: column - error}, known_moments={})
    n = len(coef)
    gram, errors, added, key = np.zeros((n + 1, n + 1)), np.zeros((n, n)), np.zeros(n + 1), -1
    changes: list[list[np.ndarray]] = []
    pairs = zip(
        features.walk_resumed(record, starts, states), features.walk_resumed(moved, starts, states), strict=True
    )
    for seen, without in pairs:
        Q = np.column_stack((np.ones(len(seen.block)), seen.columns))
        E = seen.columns - without.columns
        gram += Q.T @ Q
        errors += E.T @ E
        added += Q.T @ (E @ coef)
        if seen.block.segment != key:
            key = seen.block.segment
            changes.append([])
        changes[-1].append(E @ coef)
    reading = [np.concatenate(part) for part in changes]
    variance = float(np.concatenate(reading).var())
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    place = _place_of_gain(features.effect_list(), name, record.temperature_name)

    def lost(matrix: np.ndarray, right: np.ndarray) -> float:
        """By how much the gain is wrong, over the true one."""
        solved = np.linalg.lstsq(matrix / scale / scale[:, None], right / scale, rcond=1e-12)[0] / scale
        wrong = float(solved[place + 1])
        true = float(coef[place]) - wrong
        return wrong / true if true else 0.0

    exact = gram.copy()
    exact[1:, 1:] -= errors
    gain_error = lost(exact, np.concatenate(([0.0], -errors @ coef)))
    return (
        float(np.sqrt(variance)),
        float(np.sqrt(max(variance - white_part(reading), 0.0))),
        max(abs(gain_error), abs(lost(gram, -added))) if step else gain_error,
    )


def _place_of_gain(effects: Sequence[Effect], name: Any, temperature: Any) -> int:
    """Number of the column whose coefficient is a thermometer's static gain."""
    edges = np.cumsum([0, *(effect.n_columns() for effect in effects)])
    own = [isinstance(e, StaticPolynomial) if name == temperature else name in e.inputs() for e in effects]
    return int(edges[own.index(True)])


def _error(record: Record, name: Any, noise: float, step: float) -> np.ndarray:
    """What a thermometer read beyond the temperature, by rows as they came: like it in size, not row by row.

    Steps: the temperature is taken as a straight line between the moments at which its reading changed, when it was
    midway, and is its reading in the middle of a stay from which it goes back. Noise: drawn, always the same.
    """
    error = np.zeros(record.n_rows)
    if noise:
        error += noise * np.random.default_rng(0).standard_normal(record.n_rows)
    for segment in record.segments if step else ():
        rows = record.kept(segment.start, segment.stop)
        T = np.asarray(record.columns[name][rows], float)
        k = np.flatnonzero(np.diff(T))
        if len(k) > 1:
            midway = (T[k] + T[k + 1]) / 2
            turns = np.flatnonzero(midway[1:] == midway[:-1])
            places = np.concatenate((k + 0.5, (k[turns] + k[turns + 1] + 1) / 2))
            known, order = np.concatenate((midway, T[k[turns] + 1])), np.argsort(places, kind="stable")
            line = np.interp(np.arange(len(T)), places[order], known[order])
            error[rows] += np.clip(T - line, -step / 2, step / 2)
    return error
