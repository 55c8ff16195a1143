"""Uncertainty outside the fitted temperatures: what is curved may lie deep inside, and feel them late."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.datasets._devices import make_device
from thermocorr.estimators.uncertainty.signed import coverage_factor


def learned_cold(seed):
    """A device with a curvature inside, learned on a colder part of its record; and the record's hotter rows."""
    record = make_record(
        8000, device="box", setting="outdoor", sampling_period=600.0, nonlinearity=0.002, seed=seed, noise=0.2
    )
    X, y = record[["temperature"]], record["reading"]
    n = 4000
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:n], y[:n])
    hot = (X["temperature"] > model.reading_.temperature_range[1] + 1).to_numpy() & (np.arange(len(X)) >= n)
    return model, X, y, hot


@pytest.mark.parametrize("seed", [9611, 9621, 9625])
def test_a_curvature_deep_inside_is_in_the_uncertainty(seed):
    """By the temperature as it is, 23 to 42 % of these rows were covered."""
    model, X, y, hot = learned_cold(seed)
    told, u = model.predict(X, return_std=True)
    error = np.abs(y.to_numpy() - told)[hot]
    assert np.mean(error <= coverage_factor(model._joint_errors().dof, 0.95) * u[hot]) > 0.9
    assert np.sqrt(np.mean(u[hot] ** 2)) < 2 * np.sqrt(np.mean(error**2))


def test_a_file_holds_all_temperatures_that_are_asked(tmp_path):
    model, X, _, _ = learned_cold(9611)
    weights = model._joint_errors().beyond.weights
    assert len(weights) == 1 + len(model.time_constants_) and np.count_nonzero(weights[0]) > 1
    save_model(model, tmp_path / "m.json")
    told = load_model(tmp_path / "m.json").predict(X, return_std=True)[1]
    np.testing.assert_array_equal(told, model.predict(X, return_std=True)[1])


# ------------------------------------------------------------------------------------------------ after an excursion


def heated(seed):
    """A curved device, learned in a room, heated by 30 K for two hours: model, rows not learned, first row after."""
    name = ("layered", "box")[seed % 2]
    record, truth = make_record(6000, device=name, seed=seed, return_truth=True)
    air = record["temperature"].to_numpy().copy()
    air[5400:5520] += 30.0
    body = make_device(name, sensitivity=10.0, nonlinearity=0.003, reference_temperature=23.0)
    y = pd.Series(body.respond(60.0 * np.arange(6000), air) + truth["noise"].to_numpy(), record.index)
    X = pd.DataFrame({"temperature": air}, record.index)
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:5000], y[:5000])
    return model, X[5000:], y[5000:], 520


@pytest.mark.parametrize("seed", [9700, 9701, 9702, 9703])
def test_readings_after_an_excursion_are_not_signed_before_the_device_has_cooled(seed):
    """The air is back in the fitted range at once. Where it alone was asked, all of them were signed."""
    model, X, y, back = heated(seed)
    told, u = model.predict(X, return_std=True)
    after = slice(back, back + 180)
    inside = np.abs(y - told)[after] <= coverage_factor(model._joint_errors().dof, 0.95) * u[after]
    assert inside.mean() > 0.85
    frame = model.uncertainty(X, y, allow_missing=True).frame()
    air_inside = X["temperature"].between(*model.reading_.temperature_range).to_numpy()
    assert air_inside[after].mean() > 0.9
    assert frame["status"].iloc[back : back + 60].isin(("outside fitted range", "doubtful input", "jump")).all()
    before = frame.iloc[:300][air_inside[:300]]
    assert not before["status"].eq("outside fitted range").any()
    live = OnlineCorrector(model, uncertainty=True).update_many(X, y)
    np.testing.assert_allclose(live["u"], model.correct(X, y, return_std=True)[1], rtol=1e-6)


def test_no_row_of_the_fitted_record_is_outside_of_it():
    model, X, y, _ = learned_cold(9621)
    assert (model.uncertainty(X[:4000], y[:4000]).frame()["u_extrapolation"] == 0).all()
