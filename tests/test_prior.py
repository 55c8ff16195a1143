"""A fleet of like devices, and one more with an hour of its own.

Also: Fleets without a cluster: processes, executors, and models that are small enough to send.
"""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning, load_model, save_model
from thermocorr.cluster.fleet import fit_fleet
from thermocorr.datasets import make_record
from thermocorr.effects import InitialTransient, LaggedCovariate
from thermocorr.estimators.prior import LawPrior

STEP, HOUR, TWO_WEEKS = 60.0, 60, 14 * 1440
BODIES = (400.0, 5000.0)
LAW = np.array([0.3, 0.01, 0.5, 0.4])
"""Slope, curvature about 23 degC, and the two lags."""
NOISE = 0.05


def followed(T, tau):
    decay = np.exp(-STEP / tau)
    gain = (1 - decay) * tau / STEP  # a straight line between samples
    change = np.diff(T, prepend=T[0])
    return T + lfilter([-gain], [1, -decay], change)


def unit(seed, days=14, spread=0.1):
    """A device of the make, in a room of its own; the reading without noise beside it."""
    rng = np.random.default_rng([77, seed])
    n = int(days * 86_400 / STEP)
    t = np.arange(n) * STEP
    walk = lfilter([1], [1, -np.exp(-STEP / 15_000)], rng.standard_normal(n) * 0.5 * np.sqrt(2 * STEP / 15_000))
    T = 23 + np.sin(2 * np.pi * t / 86_400 + rng.uniform(0, 6)) + walk
    law = LAW * (1 + spread * rng.standard_normal(4))
    U = 10 + 5 * rng.standard_normal() + law[0] * (T - 23) + law[1] * (T - 23) ** 2
    U = U + sum(c * (followed(T, tau) - T) for c, tau in zip(law[2:], BODIES, strict=True))
    index = pd.to_timedelta(t, unit="s")
    return pd.DataFrame({"temperature": T, "reading": U + NOISE * rng.standard_normal(n)}, index=index), U, law


@pytest.fixture(scope="module")
def fleet():
    model = DynamicBiasRegressor("temperature", list(BODIES), reference_temperature=23.0)
    return fit_fleet(1, {k: unit(k)[0] for k in range(20)}, "reading", model)


@pytest.fixture(scope="module")
def prior(fleet):
    return LawPrior.of(list(fleet.values()))


def test_mean_and_covariance_are_those_that_the_devices_were_drawn_from(prior):
    laws = np.array([unit(k)[2] for k in range(20)])
    assert np.allclose(prior.mean, laws.mean(axis=0), rtol=0.02)
    assert np.allclose(np.sqrt(np.diag(prior.covariance)), laws.std(axis=0), rtol=0.15)
    assert prior.noise == pytest.approx(NOISE, rel=0.1)


def test_records_that_say_little_do_not_make_the_fleet_look_unlike():
    """Hours instead of weeks: the scatter of the estimates is many times that of the devices."""
    model = DynamicBiasRegressor("temperature", list(BODIES), reference_temperature=23.0)
    short = fit_fleet(1, {k: unit(k, days=0.15)[0] for k in range(20)}, "reading", model)
    found = LawPrior.of(list(short.values()))
    scatter = np.std([each.coef_[:4] for each in short.values()], axis=0)
    spread, unlike = np.sqrt(np.diag(found.covariance)), 3 * 0.1 * np.abs(LAW) < scatter
    assert unlike.any()
    assert (spread < 0.5 * scatter)[unlike].all()
    assert np.abs(found.mean / LAW - 1)[[0, 2, 3]].max() < 0.25


def errors_of_new_units(prior, spread, units=range(100, 112)):
    """Rms error of a corrected reading in the two weeks after, and less each unit's mean.

    Of two weeks of its own, of the last hour alone, and of that with the temperature known before.
    """
    found = []
    for seed in units:
        log, U, _ = unit(seed, days=28, spread=spread)
        X, y = log[["temperature"]], log["reading"]
        past, hour = slice(0, TWO_WEEKS), slice(TWO_WEEKS - HOUR, TWO_WEEKS)
        late = y[past].mask(np.arange(TWO_WEEKS) < TWO_WEEKS - HOUR)
        new = DynamicBiasRegressor("temperature", prior=prior)
        errors = []
        for model, rows, known in (
            (DynamicBiasRegressor("temperature", list(BODIES)), past, y[past]),
            (new, hour, y[hour]),
            (new, past, late),
        ):
            left = model.fit(X[rows], known).predict(X[TWO_WEEKS:]) - U[TWO_WEEKS:]
            errors.append([np.mean(left**2) + NOISE**2, np.var(left) + NOISE**2])
        found.append(errors)
    return np.sqrt(np.mean(found, axis=0))


def test_an_hour_of_a_new_unit_is_worth_two_weeks(prior):
    own, hour, known = errors_of_new_units(prior, 0.1)
    assert known[0] < 1.3 * own[0] and known[1] < 1.3 * own[1]
    assert hour[1] < 1.3 * own[1]
    assert hour[0] < 2 * own[0]  # its level: slow bodies may be anywhere when the hour begins


def test_without_the_fleet_an_hour_is_worth_nothing():
    log, U, _ = unit(100, days=28)
    rows = slice(TWO_WEEKS - HOUR, TWO_WEEKS)
    alone = DynamicBiasRegressor("temperature", list(BODIES)).fit(log[["temperature"]][rows], log["reading"][rows])
    assert np.std(alone.predict(log[["temperature"]][TWO_WEEKS:]) - U[TWO_WEEKS:]) > 5 * NOISE


def test_a_long_record_outweighs_the_fleet(prior):
    log, _, law = unit(200, spread=0.5)
    model = DynamicBiasRegressor("temperature", prior=prior).fit(log[["temperature"]], log["reading"])
    alone = DynamicBiasRegressor("temperature", list(BODIES), reference_temperature=prior.reference_temperature)
    alone.fit(log[["temperature"]], log["reading"])
    assert np.abs(model.coef_[:4] - law).max() < 0.01
    assert np.allclose(model.coef_[:4], alone.coef_[:4], atol=5e-3)


def test_a_temperature_that_stands_still_for_the_hour_leaves_the_law_of_the_fleet(prior):
    hours = pd.timedelta_range(0, periods=60, freq="1min")
    flat = pd.DataFrame({"temperature": np.full(60, 22.5)}, index=hours)
    model = DynamicBiasRegressor("temperature", prior=prior).fit(flat, np.full(60, 7.0))
    assert np.allclose(model.coef_[:4], prior.mean, rtol=1e-6)
    assert model.predict(flat)[-1] == pytest.approx(7.0, abs=1e-3)


def test_the_fleet_itself_its_prior_and_what_is_written_down_are_one(fleet, prior, tmp_path):
    log, _, _ = unit(300)
    X, y = log[["temperature"]][-HOUR:], log["reading"][-HOUR:]
    models = [DynamicBiasRegressor("temperature", prior=p).fit(X, y) for p in (prior, fleet, prior.as_dict())]
    save_model(models[1], tmp_path / "unit.json")
    loaded = load_model(tmp_path / "unit.json")
    models += [pickle.loads(pickle.dumps(models[0])), clone(models[1]).fit(X, y), loaded, clone(loaded).fit(X, y)]
    for model in models:
        assert np.allclose(model.predict(X), models[0].predict(X), atol=1e-12)


@pytest.mark.newest
def test_a_slim_fleet_knows_as_much(prior):
    model = DynamicBiasRegressor("temperature", list(BODIES), reference_temperature=23.0)
    slim = fit_fleet(2, {k: unit(k)[0] for k in range(20)}, "reading", model, history_rows=10)
    found = LawPrior.of(list(slim.values()))
    assert np.array_equal(found.mean, prior.mean) and np.array_equal(found.covariance, prior.covariance)


def test_laws_about_other_temperatures_are_brought_together():
    """The mean of each room as T0: the slope is another one, and so is the coefficient of the curvature's neighbour."""
    logs = {k: unit(k)[0] for k in range(6)}
    given, own = (
        fit_fleet(1, logs, "reading", DynamicBiasRegressor("temperature", list(BODIES), reference_temperature=T0))
        for T0 in (23.0, "mean")
    )
    one, other = LawPrior.of(list(given.values())), LawPrior.of(list(own.values()))
    shift = other.reference_temperature - 23.0
    assert other.mean[0] == pytest.approx(one.mean[0] + 2 * shift * one.mean[1], rel=1e-3)
    assert np.allclose(other.mean[1:], one.mean[1:], rtol=1e-3)


def test_shrinkage_helps_devices_with_short_records():
    logs = {k: unit(k, days=1)[0] for k in range(20)}
    model = DynamicBiasRegressor("temperature", list(BODIES), reference_temperature=23.0)
    fleets = [fit_fleet(1, logs, "reading", model, shrinkage=shrinkage) for shrinkage in (False, True)]
    errors = [np.mean([(each.coef_[:4] / unit(k)[2] - 1) ** 2 for k, each in fleet.items()]) for fleet in fleets]
    assert errors[1] < errors[0] / 2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"degree": 1}, "have 'temperature\\^2' in their law, and this model has only"),
        ({"reference_temperature": 20.0}, "laws are about 23, and this model has reference_temperature=20.0"),
        ({"time_constants": [400.0]}, "have 'lag\\[5000 s\\]' in their law"),
    ],
)
def test_a_unit_of_another_make_is_refused(prior, change, said):
    log, _, _ = unit(0)
    model = DynamicBiasRegressor("temperature", prior=prior).set_params(**change)
    with pytest.raises(ValueError, match=said):
        model.fit(log[["temperature"]], log["reading"])


def test_a_fleet_that_is_none(fleet):
    with pytest.raises(ValueError, match="A fleet of 2 tells too little"):
        LawPrior.of(list(fleet.values())[:2])
    log, _, _ = unit(0)
    odd = DynamicBiasRegressor("temperature", [400.0]).fit(log[["temperature"]], log["reading"])
    with pytest.raises(ValueError, match="Devices 0 and 2 of the fleet have other columns"):
        LawPrior.of([*list(fleet.values())[:2], odd])


def test_uncertainties_beside_a_fleet_are_refused(prior):
    log, _, _ = unit(0)
    model = DynamicBiasRegressor("temperature", prior=prior).fit(log[["temperature"]][:HOUR], log["reading"][:HOUR])
    with pytest.raises(ValueError, match="with a fleet as its prior"):
        model.correct(log[["temperature"]], log["reading"], return_std=True)


def test_decays_of_the_device_are_not_measured_by_lags_of_another_column():
    model = DynamicBiasRegressor("temperature", [400.0], effects=[LaggedCovariate("humidity", [600.0])])
    records = [unit(seed, days=1)[0] for seed in range(3)]
    for seed, log in enumerate(records):
        log.insert(0, "humidity", np.random.default_rng(seed).normal(50, 5, len(log)).cumsum())
    fleet = [clone(model).fit(log[["temperature", "humidity"]], log["reading"]) for log in records]
    new = DynamicBiasRegressor(
        "temperature", prior=LawPrior.of(fleet), effects=[*model.effects, InitialTransient([600.0])]
    )
    with pytest.raises(ValueError, match=r"have no 'lag\[600 s\]' in their law"):
        new.fit(records[0][["temperature", "humidity"]], records[0]["reading"])


def test_what_the_fleet_has_seen_is_not_outside(prior, fleet):
    log, _, _ = unit(400)
    model = DynamicBiasRegressor("temperature", prior=prior).fit(log[["temperature"]][:HOUR], log["reading"][:HOUR])
    T = log["temperature"]
    low, high = (f(each.reading_.temperature_range[k] for each in fleet.values()) for k, f in ((0, min), (1, max)))
    flags = model.flags(log[["temperature"]])[T.between(low, high)]
    assert set(flags) <= {"", "jump", "doubtful input"}  # an hour does not tell how fast the room may move
    assert (flags == "").mean() > 0.99


@pytest.mark.parametrize("given", [3, "fleet", [1, 2, 3], {"covariance": 1}, {"a": None}])
def test_what_is_no_prior(given):
    log, _, _ = unit(0)
    with pytest.raises(ValueError, match="'prior' parameter"):
        DynamicBiasRegressor("temperature", prior=given).fit(log[["temperature"]], log["reading"])


def test_a_dict_of_models_does_not_survive_a_clone_and_a_fleet_does(fleet):
    log, _, _ = unit(0)
    clone(DynamicBiasRegressor("temperature", prior=fleet)).fit(log[["temperature"]][:HOUR], log["reading"][:HOUR])
    with pytest.raises(ValueError, match="The models of the 'prior' are not fitted"):
        clone(DynamicBiasRegressor("temperature", prior=dict(fleet))).fit(log[["temperature"]], log["reading"])


def test_another_unit_than_the_fleets_is_said(prior):
    log, _, _ = unit(0)
    X, y = log[["temperature"]], log["reading"]
    with pytest.raises(RecordError, match="that looks like another unit"):
        DynamicBiasRegressor("temperature", prior=prior).fit(X[:HOUR] + 273.15, y[:HOUR])
    with pytest.warns(RecordWarning, match="times those of the fleet"):
        DynamicBiasRegressor("temperature", prior=prior).fit(X[:HOUR], 1000 * y[:HOUR])


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
