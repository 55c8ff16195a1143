"""Several thermometers, and their errors in a fit."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects import Covariate, LaggedCovariate, StaticPolynomial
from ..effects.protocol import Effect
from ..effects.thermal import column_text, seconds_array
from ..equations.statistics import white_part
from ..records import Record, seconds_of
from ..records.units import difference_unit

PREFIX = "thermometer_"
"""How the effects of further thermometers are called."""


@dataclass(frozen=True)
class Thermometer:
    """A column of temperatures, and its thermometer's known errors.

    What is not declared is estimated where a record shows it, see `thermocorr.validation.thermometer_errors`. A
    diagnosis takes it for the cause of what it explains.

    Parameters
    ----------
    column : str or int, optional
        As `temperature` itself; None for the one called "temperature", else the first.
    noise : float, optional
        Standard deviation of the noise of one of its readings, in its unit.
    resolution : float, optional
        Step of its readings, in its unit.
    time_constant : float or time span, default 0.0
        How late it is itself [s]. What the reading does is learned from what the thermometer shows, late or not, and is
        corrected hardly worse (measured up to 20 minutes at a row a minute); but "after a step of the temperature" is
        said of the air then.

    Raises
    ------
    ValueError
        For what is negative or no number.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, Thermometer
    >>> model = DynamicBiasRegressor(Thermometer("case", noise=0.02, resolution=0.0625))
    """

    column: Any = None
    noise: float | None = None
    resolution: float | None = None
    time_constant: Any = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no size."""
        for name in ("noise", "resolution"):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= float(value) < np.inf:
                raise ValueError(
                    f"The {name!r} parameter of Thermometer must be a size in the unit of its column, zero or above. "
                    f"Got {value!r} instead."
                )
        if self.time_constant != 0:
            seconds_of(self.time_constant, "time_constant")

    @property
    def late(self) -> float:
        """Time constant [s]."""
        return 0.0 if self.time_constant == 0 else seconds_of(self.time_constant, "time_constant")

    @classmethod
    def given(cls, plain: Any) -> Any:
        """The parameter `temperature` as a model file has it."""
        if isinstance(plain, list):
            return [cls.given(item) for item in plain]
        return cls(**plain) if isinstance(plain, dict) else plain

    @classmethod
    def plain(cls, temperature: Any) -> Any:
        """The parameter `temperature` in lists, dicts, texts and numbers."""
        if isinstance(temperature, list):
            return [cls.plain(item) for item in temperature]
        return asdict(temperature) if isinstance(temperature, Thermometer) else temperature


class Thermometers(NamedTuple):
    """The parameter `temperature`: one column, or a list of several."""

    ambient: Any
    """The temperature of the model, T; None where it has yet to be found."""
    further: tuple[Any, ...]
    """Columns besides it, each with lags of its own."""
    declared: Mapping[Any, Thermometer]
    """Properties that the user declares, by column."""

    @classmethod
    def of(cls, temperature: Any) -> Thermometers:
        """Thermometers from the parameter; ValueError for doubles."""
        if isinstance(temperature, np.ndarray | pd.Index):
            temperature = temperature.tolist()
        given = temperature if isinstance(temperature, list) else [temperature]
        declared = {item.column: item for item in given if isinstance(item, Thermometer)}
        names = [item.column if isinstance(item, Thermometer) else item for item in given]
        if not isinstance(temperature, list):
            return cls(names[0], (), declared)
        hashable = all(isinstance(name, Hashable) for name in names)
        if not names or not hashable or len(set(names)) < len(names):
            raise ValueError(
                "The 'temperature' parameter must be a column, or a list of different ones, the one nearest to the "
                f"device's surroundings first. Got {temperature!r} instead."
            )
        return cls(names[0], tuple(names[1:]), declared)

    def of_column(self, column: Any) -> Thermometer:
        """Declaration of a column."""
        of_unnamed = self.declared.get(None, Thermometer()) if column not in self.further else Thermometer()
        return self.declared.get(column, of_unnamed)

    def split(self, time_constants: Any) -> tuple[Any, dict[Any, Any]]:
        """Time constants of the first thermometer, and of each further one.

        `time_constants` (sequence, or mapping of column to sequence): A sequence holds for every thermometer; one
        that a mapping leaves out acts at once. Raises ValueError for a column that is no thermometer.
        """
        if not isinstance(time_constants, Mapping):
            return time_constants, dict.fromkeys(self.further, time_constants)
        known = (self.ambient, *self.further)
        for name in time_constants:
            if name not in known:
                raise ValueError(
                    f"The 'time_constants' parameter names {name!r}, which is not among the thermometers "
                    f"temperature={list(known)!r}."
                )
        return time_constants.get(self.ambient, ()), {name: time_constants.get(name, ()) for name in self.further}

    def effects(self, time_constants: Any, hold: str) -> list[tuple[str, Effect]]:
        """The further thermometers as named effects."""
        return [
            (f"{PREFIX}{column_text(name)}", LaggedCovariate(name, taus, hold) if np.size(taus) else Covariate(name))
            for name, taus in self.split(time_constants)[1].items()
        ]

    def times_in(self, effects: Iterable[tuple[str, Effect]]) -> dict[Any, np.ndarray]:
        """Time constants of each further thermometer [s]."""
        found = {effect.inputs()[0]: effect for name, effect in effects if name.startswith(PREFIX) and effect.inputs()}
        return {name: seconds_array(getattr(found.get(name), "time_constants", ())) for name in self.further}

    def all_times(self, time_constants: Any) -> list[float]:
        """Time constants of all thermometers together [s], each once, increasing."""
        first, further = self.split(time_constants)
        some = [seconds_array(taus) for taus in (first, *further.values()) if np.size(taus)]
        return np.unique(np.concatenate(some)).tolist() if some else []


def thermometer_errors(model: Any, X: Any) -> pd.DataFrame:
    """Noise and resolution of each thermometer, and their effect.

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
        Fitted. Errors declared in `Thermometer` count; others are estimated.
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
    """Step of an instrument; 0 where it shows none."""
    still = sum(int(np.count_nonzero(np.diff(part) == 0)) for part in parts)
    # A thermometer's steps are seen as such where half of the rows read what the row before read: where it moves by
    # several steps a row, they are noise like any other.
    if still < 0.5 * sum(max(len(part) - 1, 0) for part in parts):
        return 0.0
    levels = np.unique(np.concatenate(parts))
    if len(levels) < 2:
        return 0.0
    step = float(np.diff(levels).min())
    off = (levels - levels[0]) / step
    # Decimal fractions in single precision lie on a grid of steps to 1e-6.
    on_grid = np.abs(off - np.rint(off)) <= 1e-6 * np.abs(levels).max() / step
    return step if on_grid.all() else 0.0


def _felt(
    model: Any, record: Record, starts: Any, states: Any, name: Any, noise: float, step: float
) -> tuple[float, float, float]:
    """Wandering error of the reading, and relative gain error.

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
    """Simulated error of a thermometer, row by row.

    Steps: the temperature is taken as a straight line between the moments at which its reading changed, when it was
    midway, and is its reading in the middle of a stay before it goes back. Noise: drawn, always the same.
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
