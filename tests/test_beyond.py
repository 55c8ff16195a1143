"""Uncertainty outside the fitted temperatures: what is curved may lie deep inside, and feel them late."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.estimators.uncertainty.budget import coverage_factor
from thermocorr.files import model_file


def learned_cold(seed):
    """A device with a curvature inside, learned on a colder part of its record; and the record's hotter rows."""
    record = make_record(
        8000, device="box", setting="outdoor", sampling_period=600.0, nonlinearity=0.002, seed=seed, noise=0.2
    )
    X, y = record[["temperature"]], record["reading"]
    n = 4000
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:n], y[:n])
    hot = (X["temperature"] > model.temperature_range_[1] + 1).to_numpy() & (np.arange(len(X)) >= n)
    return model, X, y, hot


@pytest.mark.parametrize("seed", [9611, 9621, 9625])
def test_a_curvature_deep_inside_is_in_the_uncertainty(seed):
    """By the temperature as it is, 23 to 42 % of these rows were covered."""
    model, X, y, hot = learned_cold(seed)
    told, u = model.predict(X, return_std=True)
    error = np.abs(y.to_numpy() - told)[hot]
    assert np.mean(error <= coverage_factor(model.joint_errors().dof, 0.95) * u[hot]) > 0.9
    assert np.sqrt(np.mean(u[hot] ** 2)) < 2 * np.sqrt(np.mean(error**2))


@pytest.mark.parametrize("seed", [9600, 9602])
def test_without_a_sensitivity_the_measured_temperature_is_taken(seed):
    """The static slope is taken away: what is left of the law has no temperature inside that it goes by."""
    record = make_record(
        8000, device="box", setting="outdoor", sampling_period=600.0, nonlinearity=0.002, seed=seed, noise=0.2
    )
    T, y = record["temperature"].to_numpy(), record["reading"]
    level = y - np.polyfit(T[:4000], y[:4000], 1)[0] * T
    model = DynamicBiasRegressor("temperature", degree=1).fit(record[["temperature"]][:4000], level[:4000])
    weights = model.joint_errors().beyond.weights
    assert weights[0] == 1.0 and not weights[1:].any()


def test_a_file_of_version_10_takes_it_to_feel_the_temperature_at_once(tmp_path):
    model, X, _, hot = learned_cold(9611)
    weights = model.joint_errors().beyond.weights
    assert weights[0] == 1.0 and np.count_nonzero(weights) > 1
    save_model(model, tmp_path / "m.json")
    u = model.predict(X, return_std=True)[1]
    np.testing.assert_array_equal(load_model(tmp_path / "m.json").predict(X, return_std=True)[1], u)
    node = json.loads((tmp_path / "m.json").read_text())
    del node["model"]["errors"]["beyond"]["weights"]
    body = (model_file.render({k: node[k] for k in ("provenance", "model")}) + "\n").removeprefix("{\n").encode("ascii")
    head = f'{{"format": "thermocorr model", "version": 10, "digest": "sha256:{hashlib.sha256(body).hexdigest()}",\n'
    (tmp_path / "old.json").write_bytes(head.encode() + body)
    older = load_model(tmp_path / "old.json")
    assert older.joint_errors().beyond.weights.tolist() == [1.0] + [0.0] * (len(weights) - 1)
    assert (older.predict(X, return_std=True)[1][hot] > 0).all()
