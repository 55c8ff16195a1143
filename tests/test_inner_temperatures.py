"""Temperatures inside of the device: those that a simulated device had."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.effects import InitialTransient, ThermalLag

TAUS = (600.0, 7200.0)
WITH_START = [ThermalLag(TAUS), InitialTransient(TAUS)]  # the slow part was not at rest
START = (3.0, -5.0)
"""Inner less ambient temperature when the record begins [K]."""


def simulated(n=6000, step=30.0, seed=0):
    """A device of two parts, each a first-order lag of a temperature that is straight between samples."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) * step
    ambient = 20 + 2 * np.sin(2 * np.pi * time / 20_000) + np.cumsum(rng.normal(0, 0.02, n))
    inner = np.empty((n, 2))
    inner[0] = ambient[0] + np.array(START)
    for j, tau in enumerate(TAUS):  # exact solution of tau d(psi)/dt = T - psi for a straight line of T
        decay = np.exp(-step / tau)
        for k in range(1, n):
            slope = (ambient[k] - ambient[k - 1]) / step
            rest = inner[k - 1, j] - ambient[k - 1] + slope * tau
            inner[k, j] = ambient[k] - slope * tau + rest * decay
    reading = 10 + 0.5 * ambient + (inner - ambient[:, None]) @ np.array([0.3, -0.2])
    index = pd.Timestamp("2024-01-01") + pd.to_timedelta(time, unit="s")
    return pd.DataFrame({"temperature": ambient}, index=index), reading, inner


@pytest.fixture(scope="module")
def device():
    X, y, inner = simulated()
    return X, y, inner, DynamicBiasRegressor("temperature", [], 1, effects=WITH_START).fit(X, y)


def test_they_are_those_of_the_device(device):
    X, _, inner, model = device
    found = model.inner_temperatures(X)
    np.testing.assert_allclose(found["temperature"], inner, rtol=0, atol=1e-4)
    np.testing.assert_allclose(found["start"].iloc[0], START, atol=1e-4)
    np.testing.assert_allclose(found["start"].iloc[-1], 0.0, atol=1e-6)
    difference = found["difference"]
    np.testing.assert_allclose(difference, found["temperature"].sub(X["temperature"], axis=0), atol=1e-12)
    assert found["temperature"].columns.tolist() == list(TAUS) and found.index.equals(X.index)


def test_the_reading_is_made_of_them(device):
    X, _, _, model = device
    found = model.inner_temperatures(X)["difference"].to_numpy()
    mu = model.coef_table().set_index("effect").loc["thermal lag", "coefficient"].to_numpy()
    lags = model.contributions(X)[["thermal lag", "initial transient"]].sum(axis=1)
    np.testing.assert_allclose(found @ mu, lags, rtol=0, atol=1e-9)


def test_later_rows_go_on_where_the_fitted_ones_ended(device):
    X, y, inner, _ = device
    model = DynamicBiasRegressor("temperature", [], 1, effects=WITH_START).fit(X[:4000], y[:4000])
    np.testing.assert_allclose(model.inner_temperatures(X[4000:])["temperature"], inner[4000:], rtol=0, atol=1e-3)


def test_rows_that_are_passed_over_have_none(device):
    X, y, _, _ = device
    gappy = X.copy()
    gappy.iloc[100:103] = np.nan
    model = DynamicBiasRegressor("temperature", [], 1, effects=WITH_START).fit(gappy, y)
    assert model.inner_temperatures(gappy).isna().any(axis=1).sum() == 3


def test_each_run_has_a_start_of_its_own(device):
    X, y, inner, _ = device
    both = pd.concat([X, X.set_axis(X.index + pd.Timedelta("30 days"))])
    both["run"] = ["a"] * len(X) + ["b"] * len(X)
    model = DynamicBiasRegressor("temperature", [], 1, effects=WITH_START, run="run").fit(both, np.concatenate((y, y)))
    np.testing.assert_allclose(model.inner_temperatures(both)["temperature"], np.vstack((inner, inner)), atol=1e-3)


def test_a_static_model_knows_of_none(device):
    X, y, _, _ = device
    with pytest.raises(ValueError, match="no lags"):
        DynamicBiasRegressor("temperature", []).fit(X, y).inner_temperatures(X)
