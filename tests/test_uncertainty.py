"""Uncertainties of a fitted model: noise, joint errors, rows, signed values."""

import pickle

import numpy as np
import pandas as pd
import pytest
from noisy import TIMES, device, markov
from scipy.linalg import toeplitz
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, diagnose, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.model import averages as binned
from thermocorr.model.budget import coverage_factor
from thermocorr.model.covariance import BandSums
from thermocorr.model.uncertainty import NoiseModel

pytestmark = pytest.mark.newest


@pytest.fixture(scope="module")
def fitted():
    X, y, truth = device(3000, 11, np.random.default_rng(11).standard_normal(3000))
    return DynamicBiasRegressor("temperature", TIMES, degree=1).fit(X, y), X, y, truth


def noise_model(**more):
    given = {
        "white": 0.5, "recent": 0.0, "wander": np.array([1.0, 2.0]), "correlation_times": np.array([30.0, 600.0]),
        "white_dof": 50.0, "wander_dof": 5.0,
    }  # fmt: skip
    return NoiseModel(**{**given, **more})


@pytest.mark.parametrize("recent", [0.0, 20.0])
@pytest.mark.parametrize("even", [False, True])
def test_the_variance_of_a_mean_is_the_mean_of_the_covariance_matrix(recent, even):
    """For one run, and for two whose noise is independent though they are of the same time."""
    noise = noise_model(recent=recent, size_seconds=np.array([0.0, 900.0]), sizes=np.array([1.5, 1.5]))
    seconds = np.arange(40) * 7.0 if even else np.cumsum(np.random.default_rng(1).uniform(1, 60, 40))
    for runs in (np.zeros(40, int), np.arange(40) % 2):
        when = seconds - seconds[1] * (runs if even else 0)
        assert sum(noise.of_mean(when, runs)) == pytest.approx(noise.covariance(when, runs).mean(), rel=1e-9)


def test_what_is_not_predicted_is_white_noise_or_the_innovation_of_a_markov_process():
    """Closed forms: white noise has no past; an Ornstein-Uhlenbeck process keeps exp(-step/tau) of the last value."""
    white = noise_model(wander=np.zeros(2))
    assert white.unpredicted(10.0) == pytest.approx(0.5, rel=1e-9)
    markov_noise = noise_model(white=0.0, wander=np.array([0.0, 2.0]))
    assert markov_noise.unpredicted(60.0) == pytest.approx(2.0 * (1 - np.exp(-0.2)), rel=1e-3)
    assert noise_model(recent=20.0, wander=np.zeros(2)).unpredicted(10.0) == pytest.approx(
        0.5 * (1 - np.exp(-1.0)), rel=1e-3
    )


def test_the_noise_of_a_certificate_is_the_floor_of_a_diagnosis():
    """Of one record: what its past does not predict, by either way to learn the noise."""
    for seed in range(3):
        record = make_record(4000, coloured_noise=(0.4, 1800.0), seed=seed)
        X, y = record.drop(columns="reading"), record["reading"]
        model = DynamicBiasRegressor("temperature").fit(X, y)
        unpredicted = model._joint_errors().noise.unpredicted(model.features_.history_.usual_step)
        assert np.sqrt(unpredicted) == pytest.approx(diagnose(model, X, y).noise_floor, rel=0.05)


def test_restricted_likelihood_finds_the_noise_of_a_record():
    """White noise and one part, over ten records together (each is known to some 20 %).

    What wanders comes out a sixth too large: a record of a hundred correlation times cannot exclude slower parts.
    """
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(4000) + 2 * markov(rng, 4000, 40)
        columns = np.column_stack((np.ones(4000), np.linspace(-1, 1, 4000))) / 60
        said = BandSums(columns, noise, np.zeros(4000, int)).settle().estimate()
        found.append((said.theta[0], said.theta[1:].sum()))
    white, wander = np.mean(found, axis=0)
    assert white == pytest.approx(1.0, rel=0.15)
    assert 3.6 < wander < 5.2


def test_the_covariance_is_that_of_generalised_least_squares():
    """Besides the covariance matrix of the noise that was found: cosines are good for 6 % of a standard error."""
    rng = np.random.default_rng(3)
    n = 600
    A = np.column_stack((np.ones(n), np.sin(np.arange(n) / 15), np.cumsum(rng.standard_normal(n)) / 20)) / np.sqrt(n)
    record = BandSums(A, rng.standard_normal(n) + 2 * markov(rng, n, 20), np.zeros(n, int))
    found = record.estimate()
    lags = np.arange(n)[:, None] / record.times
    sigma = toeplitz(np.exp(-lags) @ found.theta[1:]) + found.theta[0] * np.eye(n)
    exact = np.linalg.inv(A.T @ np.linalg.solve(sigma, A))
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(exact)), rtol=0.06)


@pytest.mark.long
@pytest.mark.parametrize("rows", [0, 5, 60], ids=["white", "5 rows", "60 rows"])
@pytest.mark.parametrize("times", [TIMES, "auto"], ids=["given", "searched"])
def test_intervals_of_the_bias_hold_the_truth(rows, times):
    """95 % intervals of 30 records: the mean share covered, which scatters by 3 %, and a width that is no triumph."""
    shares, widths, errors = [], [], []
    for seed in range(30):
        rng = np.random.default_rng([seed, rows])
        X, y, truth = device(2500, seed, 2 * markov(rng, 2500, rows) if rows else rng.standard_normal(2500))
        settings = {"degree": 1} if times != "auto" else {}
        model = DynamicBiasRegressor("temperature", times, **settings).fit(X, y)
        bias, u = model.bias(X, return_std=True)
        error = (bias - truth)[200:]
        shares.append((error.abs() <= coverage_factor(model._joint_errors().dof, 0.95) * u[200:]).mean())
        widths.append(np.sqrt((u[200:] ** 2).mean()))
        errors.append(np.sqrt((error**2).mean()))
    assert np.mean(shares) >= 0.88
    assert np.median(widths) < 2.5 * np.sqrt(np.mean(np.square(errors)))


def test_a_noise_that_grows_is_said_to_have_grown():
    rng = np.random.default_rng(5)
    X, y, _ = device(4000, 5, rng.standard_normal(4000) * np.linspace(0.2, 2.0, 4000))
    u = DynamicBiasRegressor("temperature", TIMES).fit(X[:3500], y[:3500]).correct(X, y, return_std=True)[1].to_numpy()
    assert u[3000:3500].mean() == pytest.approx(0.2 * 1.66, rel=0.15)
    assert u[100:400].mean() < 0.4 * u[3000:].mean()
    assert u[3600:].mean() == pytest.approx(u[3450:3500].mean(), rel=0.1)


def test_later_readings_lie_in_their_intervals():
    shares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        X, y, _ = device(3000, seed, rng.standard_normal(3000) + markov(rng, 3000, 60))
        model = DynamicBiasRegressor("temperature").fit(X[:2000], y[:2000])
        value, u = model.predict(X[2000:], return_std=True)
        shares.append((np.abs(y[2000:] - value) <= 1.96 * u).mean())
    assert np.mean(shares) > 0.9


def test_values_are_the_same_with_and_without_their_uncertainty(fitted):
    model, X, y, _ = fitted
    np.testing.assert_array_equal(model.predict(X, return_std=True)[0], model.predict(X))
    pd.testing.assert_series_equal(model.bias(X, return_std=True)[0], model.bias(X))
    corrected, u = model.correct(X, y, return_std=True)
    pd.testing.assert_series_equal(corrected, model.correct(X, y))
    assert u.index.equals(X.index)
    pd.testing.assert_series_equal(model.evaluate(X, y, return_std=True)["u"], u)
    array = model.correct(X.assign(seconds=np.arange(len(X)) * 60.0)[["temperature"]], y, return_std=True)[1]
    assert (array > model.bias(X, return_std=True)[1]).all()


def test_missing_temperatures_and_readings_have_no_uncertainty(fitted):
    model, X, y, _ = fitted
    holed, gone = X.copy(), y.copy()
    holed.iloc[100:103], gone.iloc[200] = np.nan, np.nan
    u = model.correct(holed, gone, return_std=True)[1]
    assert list(np.flatnonzero(u.isna())) == [100, 101, 102, 200]
    frame = model.uncertainty(holed, gone).frame()
    assert frame["status"].iloc[100] == "no temperature" and frame["status"].iloc[200] == "no reading"
    assert frame["u"].isna().sum() == 4


def test_pickles_and_clones(fitted):
    model, X, _, _ = fitted
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.bias(X, return_std=True)[1], model.bias(X, return_std=True)[1])
    assert not hasattr(clone(model), "_known_errors")


def test_a_second_fit_forgets_the_first_noise():
    X, y, _ = device(2000, 2, np.random.default_rng(2).standard_normal(2000))
    model = DynamicBiasRegressor("temperature", TIMES).fit(X, y)
    before = model.predict(X, return_std=True)[1].mean()
    after = model.fit(X, y + 0.4 * np.random.default_rng(3).standard_normal(2000)).predict(X, return_std=True)[1].mean()
    assert after > 2 * before


def test_rows_that_follow_have_the_same_uncertainty_alone(fitted):
    X, y, _ = device(3000, 4, np.random.default_rng(4).standard_normal(3000))
    for times in (TIMES, "auto"):
        model = DynamicBiasRegressor("temperature", times).fit(X[:2000], y[:2000])
        whole = model.bias(X, return_std=True)[1]
        np.testing.assert_allclose(model.bias(X[2000:], return_std=True)[1], whole[2000:], rtol=1e-9)


def test_a_long_record_is_averaged_while_it_is_swept(monkeypatch):
    """Compared with the same record whose history keeps every row: bins are wider, and blur the fastest lag alone."""
    X, y, _ = device(20000, 6, np.random.default_rng(6).standard_normal(20000))
    whole = DynamicBiasRegressor("temperature", TIMES).fit(X, y)._joint_errors()
    monkeypatch.setattr(binned, "HISTORY_ROWS", 1000)
    swept = DynamicBiasRegressor("temperature", TIMES).fit(X, y)._joint_errors()
    ratio = np.linalg.norm(swept.half[:4], axis=1) / np.linalg.norm(whole.half[:4], axis=1)
    np.testing.assert_allclose(ratio[:3], 1.0, rtol=0.05)
    assert 1.0 < ratio[3] < 1.5
    assert (np.abs(swept.coef[:4] - whole.coef[:4]) < np.linalg.norm(swept.half[:4], axis=1)).all()
    assert swept.noise.white == pytest.approx(0.04, rel=0.05)


def test_many_segments(monkeypatch):
    record = make_record(2000, runs=12, seed=1)
    X, y = record[["temperature", "run"]], record["reading"]
    model = DynamicBiasRegressor("temperature", TIMES, run="run").fit(X, y)
    u = model.bias(X, return_std=True)[1]
    assert np.isfinite(u).all() and 0.001 < np.median(u) < 0.05


@pytest.mark.parametrize("times", [TIMES, "auto"], ids=["given", "searched"])
def test_a_loaded_model_states_the_same(tmp_path, times):
    X, y, _ = device(3000, 10, np.random.default_rng(10).standard_normal(3000))
    model = DynamicBiasRegressor("temperature", times).fit(X[:2500], y[:2500])
    loaded = load_model(save_model(model, tmp_path / "model.json"))
    for part in (X, X[2500:]):
        np.testing.assert_array_equal(loaded.bias(part, return_std=True)[1], model.bias(part, return_std=True)[1])
    pd.testing.assert_frame_equal(loaded.uncertainty(X, y).frame(), model.uncertainty(X, y).frame())
    assert str(loaded.uncertainty(X, y).budget(40)) == str(model.uncertainty(X, y).budget(40))


def test_a_model_that_knows_no_noise_says_so(fitted):
    model, X, _, _ = fitted
    poor = pickle.loads(pickle.dumps(model))
    poor.__dict__.pop("_known_errors", None)
    del poor._swept
    assert not poor._knows_noise
    with pytest.raises(ValueError, match="does not know the noise"):
        poor.predict(X, return_std=True)


def test_few_readings_among_many_rows():
    """Every third row has a reading: the noise is known all the same."""
    X, y, _ = device(20_000, 12, np.random.default_rng(12).standard_normal(20_000))
    y = y.where(np.arange(20_000) % 3 == 0)
    model = DynamicBiasRegressor("temperature", TIMES).fit(X, y)
    assert model._joint_errors().noise.white == pytest.approx(0.04, rel=0.1)
    assert 0.001 < np.median(model.bias(X, return_std=True)[1]) < 0.02
