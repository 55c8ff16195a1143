"""Fleets without a cluster: processes, executors, and models that are small enough to send."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError
from thermocorr.cluster.fleet import fit_fleet
from thermocorr.datasets import make_record

MODEL = DynamicBiasRegressor("temperature", ["5 min", "90 min"])


@pytest.fixture(scope="module")
def devices():
    return {f"box {i}": make_record(3000, seed=i, device="box")[["temperature", "reading"]] for i in range(3)}


@pytest.mark.parametrize("workers", [1, 2, None, "executor"])
@pytest.mark.parametrize("shared", [False, True])
def test_whoever_does_it_the_models_are_the_same(workers, shared, devices):
    model = DynamicBiasRegressor("temperature", 2) if shared else MODEL
    expected = fit_fleet(1, devices, "reading", model, shared_time_constants=shared)
    with ThreadPoolExecutor(2) as executor:
        chosen = executor if workers == "executor" else workers
        fleet = fit_fleet(chosen, devices, "reading", model, shared_time_constants=shared)
    assert list(fleet) == list(devices)
    for name, fitted in fleet.items():
        np.testing.assert_array_equal(fitted.coef_, expected[name].coef_)


def test_a_device_that_cannot_be_fitted_is_named(devices):
    bad = devices | {"box 9": devices["box 0"].assign(temperature=20.0)}
    with pytest.raises(RecordError, match="Device 'box 9': The temperature never changes"):
        fit_fleet(2, bad, "reading", MODEL)
    with pytest.raises(RecordError, match="no devices"):
        fit_fleet(2, {}, "reading", MODEL)


@pytest.mark.parametrize("effects", [None, {"drift": 1.0}])
def test_a_slim_model_does_for_later_rows_what_the_whole_one_does(effects):
    record = make_record(24_000, seed=1, effects=effects)[["temperature", "reading"]]
    first, later = record[:20_000], record[20_000:]
    whole = DynamicBiasRegressor("temperature").fit(first[["temperature"]], first["reading"])
    corrected, u = whole.correct(later[["temperature"]], later["reading"], return_std=True)
    errors = whole._standard_errors()
    slim = pickle.loads(pickle.dumps(whole))._slim()
    assert len(pickle.dumps(slim)) < 32 * 1024 < 400 * 1024 < len(pickle.dumps(whole))
    again, u_again = slim.correct(later[["temperature"]], later["reading"], return_std=True)
    np.testing.assert_array_equal(again, corrected)
    np.testing.assert_array_equal(u_again, u)
    np.testing.assert_array_equal(slim._standard_errors(), errors)
    live = OnlineCorrector(slim).update_many(later[["temperature"]], later["reading"])["corrected"]
    np.testing.assert_allclose(live, corrected, atol=1e-9)
    with pytest.raises(ValueError, match="Fit it again"):
        slim._standard_errors(np.ones((1, len(slim.coef_))))


@pytest.mark.long
def test_a_fleet_of_slim_models(devices):
    fleet = fit_fleet(2, devices, "reading", MODEL, history_rows=100)
    for name, fitted in fleet.items():
        assert len(pickle.dumps(fitted)) < 20 * 1024
        assert fitted.correct(devices[name], devices[name]["reading"]).notna().all()


def test_a_model_is_slimmed_once_and_again_and_never_to_nothing(devices):
    model = DynamicBiasRegressor("temperature", ["5 min"]).fit(devices["box 0"], devices["box 0"]["reading"])
    for wrong in (lambda: model._slim(0), lambda: fit_fleet(1, devices, "reading", MODEL, history_rows=0)):
        with pytest.raises(ValueError, match="history_rows"):
            wrong()
    assert model._slim()._slim().predict(devices["box 0"]).shape == (3000,)
