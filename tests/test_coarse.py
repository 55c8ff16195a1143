"""Readings with few digits, and readings that are none: neither is a cause, and neither is white noise."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.outliers import spikes


def device(n=6000, seed=0):
    """A temperature of days and weather, and a device that follows within an hour, in units of its own swing."""
    rng, kept = np.random.default_rng(seed), np.exp(-1 / 200)
    weather = lfilter([1 - kept], [1, -kept], rng.standard_normal(n))
    T = 23 + np.sin(2 * np.pi * np.arange(n) / 1440) + 0.5 * weather / weather.std()
    late = lfilter([1 - np.exp(-1 / 60)], [1, -np.exp(-1 / 60)], T - T[0]) + 0.5 * (T - T[0])
    index = pd.date_range("2026-03-02", periods=n, freq="min")
    return pd.DataFrame({"temperature": T}, index=index), pd.Series(late / late.std(), index=index), rng


@pytest.mark.parametrize("swing", [3.0, 15.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2])
def test_the_rounding_of_a_reading_is_no_structure(swing, noise):
    """Five steps and a p-value of 1e-5 were told of it, or structure that nothing explains."""
    X, y, rng = device()
    reading = (swing * y + noise * rng.standard_normal(len(y))).round().rename("reading_mV")
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, reading), X, reading)
    assert found.verdict == "nothing missing" and found.left.rounding == 1.0
    assert "rounding of the reading, in steps of 1" in str(found)


def test_moments_and_widths_of_suspects_are_said_as_on_the_page():
    """A date where the record has dates, and the unit of a width: it said `step: 40500 s` and `width 0.5`."""
    record = make_record(1500, effects={"step": 3.0, "hysteresis": 2.0}, sampling_period=60.0, seed=3)
    X, y = record[["temperature"]], record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y), X, y)
    titles = {suspect.effect.kind: suspect.title for suspect in found.suspects}
    step = next(suspect for suspect in found.suspects if suspect.effect.kind == "step")
    assert titles["step"] == f"step: time {X.index[0] + pd.Timedelta(step.effect.time, unit='s')}"
    assert re.fullmatch(r"hysteresis: width \d\.\d+ K", titles["hysteresis"])
    said = " ".join(str(found).split())
    assert all(title in said for kind, title in titles.items() if kind in {c.effect.kind for c in found.causes})


def test_an_effect_larger_than_the_rounding_is_found():
    X, y, rng = device()
    X["humidity"] = np.cumsum(rng.standard_normal(len(X)))
    humid = X["humidity"] / X["humidity"].std()
    reading = (3.0 * y + humid + 0.1 * rng.standard_normal(len(y))).round()
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, reading), X, reading)
    assert found.best is not None and "humidity" in found.best.inputs()


@pytest.mark.parametrize("height", [20.0, 60.0, 300.0])
@pytest.mark.parametrize(("n", "number"), [(3000, 15), (3000, 50), (30_000, 60), (30_000, 500)])
def test_spikes_are_told_up_to_nearly_a_fiftieth_of_the_readings(n, number, height):
    """From 0.3 % on none was: what is rare enough to be predicted held spikes only."""
    rng = np.random.default_rng(number)
    values, rows = rng.standard_normal(n), rng.choice(np.arange(2, n, 6), number, replace=False)
    values[rows] += height * rng.choice([-1, 1], number)
    told = np.flatnonzero(spikes(values))
    assert np.isin(told, rows).all() and len(told) >= 0.95 * number


def test_nothing_missing_is_not_said_beside_absurd_tails():
    """One reading in thirty is wrong by 60 standard deviations, too many for spikes."""
    X, y, rng = device(3000)
    y = 3.0 * y + rng.standard_normal(3000)
    y.iloc[rng.choice(3000, 100, replace=False)] += 60.0
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.verdict == "unexplained" and found.left.absurd
    assert "A few readings dominate the residual" in str(found) and "white noise" not in str(found)


def test_heavy_tails_are_nothing_that_could_be_explained():
    record, truth = make_record(5000, seed=1, return_truth=True)
    X, noise = record[["temperature"]], np.random.default_rng(1).standard_t(3, 5000)
    y = truth["noise_free"] + 0.2 * noise / np.sqrt(3)
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert (
        found.verdict == "nothing missing"
        and found.explainable < 0.05 < 1 - (found.noise_floor / found.residual_rms) ** 2
    )
