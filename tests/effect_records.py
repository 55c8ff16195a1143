"""Examples of every kind of effect, and small records to try them on."""

import numpy as np
import pandas as pd
from sklearn.base import clone

from thermocorr.effects import (
    Covariate,
    Delay,
    Disturbance,
    Drift,
    Events,
    Hinge,
    Hysteresis,
    InitialTransient,
    Interaction,
    LaggedCovariate,
    LaggedModulation,
    LagProducts,
    Lead,
    LogAgeing,
    Periodic,
    QuadraticCovariate,
    Rate,
    SaturatingCovariate,
    SensitivityDrift,
    SensitivityStep,
    SeveralSteps,
    StaticPolynomial,
    Step,
    ThermalLag,
)
from thermocorr.effects.stream import own_starts, walk
from thermocorr.records import Layout, read_record

EXAMPLES = [
    StaticPolynomial(3, lowest_power=2),
    ThermalLag([90.0, 4000.0]),
    InitialTransient(["10 min"]),
    LagProducts([90.0, 4000.0], temperature_products=True),
    LagProducts([90.0, 4000.0], temperature_products=True, order=3),
    Rate(),
    Rate("5 min"),
    Delay(7.0),
    Delay("25 min"),
    Lead(7.0),
    Lead("25 min", ["20 min", "2 h"]),
    Covariate("humidity"),
    Covariate("humidity", power=2),
    LaggedCovariate("humidity", ["20 min"], power=2),
    Interaction("humidity"),
    SaturatingCovariate("humidity", 30.0),
    QuadraticCovariate("humidity"),
    LaggedModulation(None, "humidity", "20 min"),
    LaggedModulation("humidity", time_constant=4000.0),
    Drift(),
    LogAgeing("2 h"),
    SensitivityDrift(),
    Step(5000.0),
    SeveralSteps([4000.0, "3 h"]),
    Events(["2 h", 20_000.0]),
    Disturbance(5000.0, "2 h"),
    SensitivityStep("2 h"),
    Hysteresis(0.6),
    Hinge(22.8, "below", ["10 min", "2 h"]),
    Hinge(23, "above"),
    Periodic("3 h", harmonics=3),
]
NAMES = [f"{type(effect).__name__}-{number}" for number, effect in enumerate(EXAMPLES)]
LIVE = [effect for effect in EXAMPLES if not effect.foresees]
LIVE_NAMES = [name for name, effect in zip(NAMES, EXAMPLES, strict=True) if not effect.foresees]
"""Those that need no later samples."""


def log(n=400, seed=0, irregular=0.5, holes=()):
    """A record in dates; `holes` are rows after which half a day is missing."""
    rng = np.random.default_rng(seed)
    steps = 60.0 * (1 + irregular * rng.uniform(-0.9, 0.9, n))
    steps[list(holes)] += 43_200.0
    seconds = np.round(np.cumsum(steps) - steps[0], 6)
    temperature = 23 + np.sin(seconds / 3000) + np.cumsum(rng.normal(0, 0.05, n))
    humidity = 45 + np.cumsum(rng.normal(0, 0.3, n))
    index = pd.Timestamp("2024-03-04 01:23:45") + pd.to_timedelta(seconds, unit="s")
    return pd.DataFrame({"temperature": temperature, "humidity": humidity}, index=index)


def read(X, **layout):
    needed = ["humidity"] if "humidity" in X else []
    return read_record(X, Layout(time="time" if "time" in X else None, **layout), needed=needed, quiet=True)


def whole(effect, record):
    """Columns of a learned effect, one block for each segment, as an array of shape (n, width)."""
    return np.vstack([step.columns for step in walk([effect], record, starts=own_starts(record), size=10**9)])


def learned(effect, X, **layout):
    record = read(X, **layout)
    effect = clone(effect)
    effect.learn(record)
    return effect, record


def columns_of(effect, X, **layout):
    return whole(*learned(effect, X, **layout))


def ramp(n=200, step=60.0, slope=0.001):
    """Temperature that rises by `slope` [K/s]; seconds since the start besides it."""
    seconds = step * np.arange(n)
    return timed(20 + slope * seconds, seconds), seconds


def timed(temperature, seconds):
    return pd.DataFrame({"temperature": temperature}, index=pd.to_timedelta(seconds, unit="s"))


def temperatures(n=60, seed=0):
    """A random walk that begins near 20."""
    return 20.0 + np.cumsum(np.random.default_rng(seed).normal(0.0, 0.05, n))
