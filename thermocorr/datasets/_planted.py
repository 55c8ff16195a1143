"""Effects planted by independent formulas.

These formulas are written for the tests: on purpose they share nothing with the package's effects but the names of the
kinds and of their parameters, so that each can be checked against the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..records import Layout, read_record
from ._climate import DAY, follow
from ._heat import Array


def of_own_columns(effect: Any, runs: Sequence[Run], rng: np.random.Generator) -> list[Array]:
    """Sum of an effect's columns, equal in size, random in sign.

    `effect` (Effect): It learns the runs as it learns a record. `runs` (sequence of Run). `rng` (Generator): Draws
    the signs.
    """
    frames = [
        pd.DataFrame({**run.columns, "began": run.began + run.time, "number": number})
        for number, run in enumerate(runs)
    ]
    layout = Layout("temperature", "began", run="number")
    record = read_record(pd.concat(frames), layout, needed=list(runs[0].columns), quiet=True)
    effect = deepcopy(effect)
    effect.learn(record)
    parts, state = [], None
    for block in record.blocks():
        columns, state = effect.columns(block, None if block.begins else state)
        parts.append(np.asarray(columns, float).reshape(len(block), -1))
    columns = np.concatenate(parts)
    sizes = np.sqrt(np.mean((columns - columns.mean(axis=0)) ** 2, axis=0))
    signs = rng.choice((-1.0, 1.0), len(sizes)) / np.where(sizes > 0, sizes, np.inf)
    return np.split(columns @ signs, np.cumsum([len(run.time) for run in runs])[:-1])


Parameters = dict[str, Any]
COLUMNS = ("humidity", "pressure", "supply")
"""Recorded columns that a planted effect may use by default."""


class Run(NamedTuple):
    """One run as the device sees it: gaps filled."""

    time: Array
    """Since the run began [s]."""
    began: float
    """From the first sample of the record to that of the run [s]."""
    columns: Mapping[str, Array]
    kept: NDArray[np.intp]
    """Samples that the logger keeps."""


class Scene(NamedTuple):
    """Samples of all runs, that plausible parameters are drawn for."""

    step: float
    """Sampling period [s]."""
    span: float
    """Duration of a run [s]."""
    times: Array
    """Since the record began [s]."""
    columns: Mapping[str, Array]

    def log_uniform(self, rng: np.random.Generator, low: float, high: float) -> float:
        """A number between two, log-uniform, to three digits."""
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(max(high, 2 * low)))):.3g}")


class Plant(NamedTuple):
    """Recipe for planting one kind of effect."""

    draw: Callable[[Scene, np.random.Generator], Parameters]
    """Plausible parameters, named as in the effect's constructor."""
    shape: Callable[[Run, Scene, Parameters, np.random.Generator, np.random.Generator], Array]
    """Contribution at every sample of a run, in any unit. The first generator starts alike for all runs, the second
    belongs to the run."""


def _temperature(run: Run, scene: Scene) -> tuple[Array, Array]:
    """Temperature, and temperature less its mean over the kept samples [K]."""
    air = run.columns["temperature"]
    return air, air - scene.columns["temperature"].mean()


def _late(run: Run, values: Array, parameters: Parameters) -> Array:
    """Lag differences, summed over the time constants."""
    return np.asarray(sum((follow(run.time, values, tau) - values for tau in parameters["time_constants"]), 0 * values))


def _column(run: Run, scene: Scene, parameters: Parameters) -> Array:
    """A recorded column less its mean over the kept samples."""
    name = parameters["column"]
    return np.asarray(run.columns[name] - scene.columns[name].mean())


def _static(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return np.asarray(_temperature(run, scene)[1] ** p["degree"])


def _thermal_lag(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return _late(run, run.columns["temperature"], p)


def _initial_transient(
    run: Run, scene: Scene, p: Parameters, shared: np.random.Generator, own: np.random.Generator
) -> Array:
    amplitude = own.choice((-1.0, 1.0)) * own.uniform(0.7, 1.3)
    return np.asarray(amplitude * sum(np.exp(-run.time / tau) for tau in p["time_constants"]))


def _lag_products(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    air, excess = _temperature(run, scene)
    later = _late(run, air, p)
    return later * (excess if p["temperature_products"] else later)


def _rate(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    air = run.columns["temperature"]
    if p["time_constant"] is not None:
        return np.asarray((air - follow(run.time, air, p["time_constant"])) / p["time_constant"])
    return np.concatenate([[0.0], np.diff(air) / np.diff(run.time)])


def _delay(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    air = run.columns["temperature"]
    return np.asarray(np.interp(run.time - p["delay"], run.time, air) - air)


def _lead(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    air = run.columns["temperature"]
    return np.asarray(np.interp(run.time + p["lead"], run.time, air) - air)


def _covariate(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    power = p["power"]
    return np.asarray(run.columns[p["column"]] ** power - (scene.columns[p["column"]] ** power).mean())


def _lagged_covariate(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    values = _column(run, scene, p)
    return values + _late(run, values, p) / max(len(p["time_constants"]), 1)


def _interaction(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return _temperature(run, scene)[1] * _column(run, scene, p)


def _drift(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return (run.began + run.time) / DAY


def _log_ageing(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return np.asarray(np.log((p["onset"] + run.began + run.time) / p["onset"]))


def _sensitivity_drift(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return (run.began + run.time) / DAY * _temperature(run, scene)[1]


def _step(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    return np.where(run.began + run.time < p["time"], 0.0, 1.0)


def _disturbance(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    now = run.began + run.time
    return np.asarray(((now >= p["start"]) & (now < p["end"])).astype(float))


def _sensitivity_step(
    run: Run, scene: Scene, p: Parameters, shared: np.random.Generator, own: np.random.Generator
) -> Array:
    spread = max(float(scene.columns["temperature"].std()), 1e-300)
    law = shared.uniform(-1.0, 1.0) + shared.uniform(0.5, 1.0) * _temperature(run, scene)[1] / spread
    return np.where(run.began + run.time < p["time"], 0.0, law)


def _lagged_modulation(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    fast, slow = (run.columns[p[name] or "temperature"] for name in ("fast", "slow"))
    means = [scene.columns[p[name] or "temperature"].mean() for name in ("fast", "slow")]
    return np.asarray((fast - means[0]) * (follow(run.time, slow, p["time_constant"]) - means[1]))


def _hysteresis(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    air, half, lag = run.columns["temperature"], p["width"] / 2, 0.0
    result = np.zeros(air.size)
    for k, change in enumerate(np.diff(air), start=1):  # the distance play - T, stopped at either end of the play
        lag = max(-half, min(half, lag - change))
        result[k] = lag
    return result


def _hinge(run: Run, scene: Scene, p: Parameters, *_: Any) -> Array:
    excess = run.columns["temperature"] - p["knee"]
    bent = np.where((excess > 0) == (p["side"] == "above"), excess, 0.0)
    return bent + _late(run, bent, p) / max(len(p["time_constants"]), 1)


def _periodic(run: Run, scene: Scene, p: Parameters, shared: np.random.Generator, own: np.random.Generator) -> Array:
    angle = 2 * np.pi * (run.began + run.time) / p["period"]
    total = np.zeros(run.time.size)
    for order in range(1, p["harmonics"] + 1):
        total += shared.uniform(0.5, 1.0) / order * np.cos(order * angle + shared.uniform(0, 2 * np.pi))
    return total


def _random_telegraph(
    run: Run, scene: Scene, p: Parameters, shared: np.random.Generator, own: np.random.Generator
) -> Array:
    count = int(2 * run.time[-1] / p["dwell"]) + 50  # twice as many switches as there will be on the average
    switches = np.cumsum(own.exponential(p["dwell"], count))
    return np.asarray((np.searchsorted(switches, run.time) + own.integers(2)) % 2, dtype=float)


def _random_walk(run: Run, scene: Scene, p: Parameters, shared: np.random.Generator, own: np.random.Generator) -> Array:
    steps = np.sqrt(np.diff(run.time)) * own.standard_normal(run.time.size - 1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _quantile(scene: Scene, share: float) -> float:
    return float(np.quantile(scene.columns["temperature"], share))


def _draw_lag(low_steps: float, share: float) -> Callable[[Scene, np.random.Generator], Parameters]:
    """One time constant, within what the record can show."""
    return lambda scene, rng: {"time_constants": [scene.log_uniform(rng, low_steps * scene.step, share * scene.span)]}


def _draw_late_column(scene: Scene, rng: np.random.Generator) -> Parameters:
    column = str(rng.choice(COLUMNS))
    return {"column": column, "time_constants": [scene.log_uniform(rng, scene.span / 100, scene.span / 8)]}


def _draw_products(scene: Scene, rng: np.random.Generator) -> Parameters:
    lag = _draw_lag(10, 1 / 50)(scene, rng)
    return {**lag, "temperature_products": bool(rng.integers(2))}


def _draw_step(scene: Scene, rng: np.random.Generator) -> Parameters:
    row = int(rng.uniform(0.15, 0.85) * scene.times.size)
    return {"time": float(np.round(scene.times[row] - 0.4 * scene.step, 3))}


def _draw_disturbance(scene: Scene, rng: np.random.Generator) -> Parameters:
    length = scene.log_uniform(rng, 20 * scene.step, scene.span / 40)
    start = float(np.round(rng.uniform(0.1, 0.85) * scene.span - 0.4 * scene.step, 3))
    return {"start": start, "end": start + length}


def _draw_modulation(scene: Scene, rng: np.random.Generator) -> Parameters:
    column, late = str(rng.choice(COLUMNS)), scene.log_uniform(rng, scene.span / 100, scene.span / 15)
    fast, slow = (None, column) if rng.integers(2) else (column, None)
    return {"fast": fast, "slow": slow, "time_constant": late}


def _draw_hysteresis(scene: Scene, rng: np.random.Generator) -> Parameters:
    swing = _quantile(scene, 0.95) - _quantile(scene, 0.05)
    return {"width": scene.log_uniform(rng, 0.05 * swing, 0.4 * swing)}


def _draw_hinge(scene: Scene, rng: np.random.Generator) -> Parameters:
    knee = round(_quantile(scene, rng.uniform(0.25, 0.75)), 3)
    return {"knee": knee, "side": str(rng.choice(("above", "below"))), "time_constants": []}


def _draw_period(scene: Scene, rng: np.random.Generator) -> Parameters:
    return {"period": DAY if scene.span >= 4 * DAY else float(f"{scene.span / 8:.3g}"), "harmonics": 2}


PLANTS: dict[str, Plant] = {
    "static_polynomial": Plant(lambda scene, rng: {"degree": 3}, _static),
    "thermal_lag": Plant(_draw_lag(3, 1 / 20), _thermal_lag),
    "initial_transient": Plant(
        lambda scene, rng: {"time_constants": [scene.log_uniform(rng, scene.span / 50, scene.span / 8)]},
        _initial_transient,
    ),
    "lag_products": Plant(_draw_products, _lag_products),
    "rate": Plant(lambda scene, rng: {"time_constant": None}, _rate),
    "delay": Plant(lambda scene, rng: {"delay": scene.log_uniform(rng, 2 * scene.step, 60 * scene.step)}, _delay),
    "lead": Plant(lambda scene, rng: {"lead": scene.log_uniform(rng, 2 * scene.step, 60 * scene.step)}, _lead),
    "covariate": Plant(lambda scene, rng: {"column": str(rng.choice(COLUMNS)), "power": 1}, _covariate),
    "lagged_covariate": Plant(_draw_late_column, _lagged_covariate),
    "interaction": Plant(lambda scene, rng: {"column": str(rng.choice(COLUMNS))}, _interaction),
    "drift": Plant(lambda scene, rng: {}, _drift),
    "log_ageing": Plant(
        lambda scene, rng: {"onset": scene.log_uniform(rng, scene.span / 100, scene.span / 5)}, _log_ageing
    ),
    "sensitivity_drift": Plant(lambda scene, rng: {}, _sensitivity_drift),
    "step": Plant(_draw_step, _step),
    "disturbance": Plant(_draw_disturbance, _disturbance),
    "sensitivity_step": Plant(_draw_step, _sensitivity_step),
    "lagged_modulation": Plant(_draw_modulation, _lagged_modulation),
    "hysteresis": Plant(_draw_hysteresis, _hysteresis),
    "hinge": Plant(_draw_hinge, _hinge),
    "periodic": Plant(_draw_period, _periodic),
    # Causes that no kind of effect explains:
    "random_telegraph": Plant(
        lambda scene, rng: {"dwell": scene.log_uniform(rng, scene.span / 200, scene.span / 20)}, _random_telegraph
    ),
    "random_walk": Plant(lambda scene, rng: {}, _random_walk),
}
"""Kind -> how it is planted."""
