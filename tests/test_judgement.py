"""The parts of judgement against closed forms and plain computations: noise, likelihood, steps, later data."""

import numpy as np
import pandas as pd
import pytest
from noisy import markov
from scipy.linalg import toeplitz

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.noise import Bands, fitted_parts
from thermocorr.judgement.scan import best_period, filtered, step_gains
from thermocorr.judgement.score import Comparison
from thermocorr.model.heteroscedasticity import evenness


def test_the_noise_of_segments_is_told_apart_into_white_and_wandering():
    """Variances 4 (white) and 1 (9 rows): within a fifth from 20 000 rows, whatever the neighbouring parts take."""
    rng = np.random.default_rng(1)
    segment = np.repeat([0, 1, 5], [9000, 4000, 7000])
    noise = 2 * rng.standard_normal(20_000) + markov(rng, 20_000, 9.0)
    bands = Bands(segment)
    rows = bands.forward(noise[:, None])
    np.testing.assert_allclose(bands.back(rows)[:, 0], noise, atol=1e-12)  # orthonormal: there and back
    power = bands.sums(rows**2)
    theta = np.full((bands.parts.shape[1], 1), 0.3)
    for _ in range(6):
        theta = fitted_parts(bands.parts, bands.sizes.astype(float), power, theta)
    assert theta[0, 0] == pytest.approx(4.0, rel=0.1)
    assert theta[1:].sum() == pytest.approx(1.0, rel=0.2)
    assert theta[2:4].sum() > 0.6 * theta[1:].sum()  # correlation times of 3 and 9 rows


def test_likelihood_gains_are_those_of_generalised_least_squares():
    """Against the covariance matrix itself; the cosine transform makes it diagonal to a few per cent of the gain."""
    rng = np.random.default_rng(2)
    n = 2000
    base = np.column_stack((np.ones(n), np.sin(np.arange(n) / 40)))
    column = markov(rng, n, 15.0)
    reading = base @ [3.0, 1.0] + 0.3 * column + rng.standard_normal(n) + markov(rng, n, 27.0)
    judged = Comparison(reading, base, np.zeros(n))
    judged.add([column[:, None]])
    theta = np.zeros(judged.bands.parts.shape[1])
    theta[0], theta[4] = 1 / judged.unit**2, 1 / judged.unit**2
    found = judged.screen(theta)[0]
    half = np.linalg.cholesky(np.eye(n) + toeplitz(np.exp(-np.arange(n) / 27.0)))
    white = np.linalg.solve(half, np.column_stack((reading, base, column)))

    def left(columns):
        return np.sum((white[:, 0] - columns @ np.linalg.lstsq(columns, white[:, 0], rcond=None)[0]) ** 2)

    assert found == pytest.approx(0.5 * (left(white[:, 1:3]) - left(white[:, 1:])), rel=0.05)
    size = judged.smallest(column, 12.0)
    judged.base = judged.refit([0])[0]
    assert 0.01 < size < 1.0


@pytest.mark.parametrize("segment", [np.zeros(300), np.repeat([0, 1, 2], [120, 80, 100])])
def test_a_step_at_every_row_is_as_good_as_its_column(segment):
    rng = np.random.default_rng(4)
    n = len(segment)
    base = np.column_stack((np.ones(n), np.sin(np.arange(n) / 9)))
    reading = rng.standard_normal(n) + 2.0 * (np.arange(n) >= 130) + markov(rng, n, 9.0)
    judged = Comparison(reading, base, segment)
    theta = judged.base.theta
    gains = step_gains(judged, theta, np.ones(n), filtered(judged, theta))
    rows = list(range(1, n, 7))
    judged.add([(np.arange(n) >= row).astype(float)[:, None] for row in rows])
    np.testing.assert_allclose(gains[rows], judged.screen(theta), rtol=1e-6, atol=1e-9)
    assert abs(int(gains.argmax()) - 130) <= 2


def test_the_strongest_wave_has_its_period():
    n = 4000
    rng = np.random.default_rng(5)
    reading = rng.standard_normal(n) + 0.5 * np.sin(2 * np.pi * np.arange(n) / 87.0)
    judged = Comparison(reading, np.ones((n, 1)), np.zeros(n))
    theta, place = judged.only_white(), np.arange(n)
    rows = filtered(judged, theta)
    assert best_period(judged, theta, place, n / 3, rows) == pytest.approx(87.0, rel=0.02)
    assert best_period(judged, theta, place, 50.0, rows) < 50.0


def test_a_quantised_reading_with_a_slow_drift_is_weighted_evenly():
    """The median increment of such a reading is nought or the step; weights from it have blown up."""
    n = 5000
    reading = np.round(np.linspace(0, 30, n) + 0.2 * np.random.default_rng(7).standard_normal(n))
    weights = evenness(reading - np.linspace(0, 30, n), np.zeros(n))
    assert weights.std() < 0.5
    noise = np.random.default_rng(8).standard_normal(n) * np.where(np.arange(n) < n // 2, 1.0, 5.0)
    low, high = evenness(noise, np.zeros(n))[[n - 500, 500]]
    assert high / low == pytest.approx(5.0, rel=0.3)


def test_units_names_and_order_change_no_verdict():
    record = make_record(6000, effects={"lagged_covariate": 1.0}, seed=81)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    shuffled = X[X.columns[::-1]].rename(columns={"humidity": "h", "supply": "s"})
    shuffled["pressure"] = shuffled["pressure"] * 100 + 7
    shuffled["temperature"] += 273.15
    again = diagnose(DynamicBiasRegressor("temperature").fit(shuffled, y + 1e3), shuffled, y + 1e3)
    assert found.verdict == again.verdict and len(found.causes) == len(again.causes)
    names = {"h": "humidity", "s": "supply"}
    for one, other in zip(found.causes, again.causes, strict=True):
        assert one.effect.kind == other.effect.kind
        assert one.effect.inputs() == [names.get(name, name) for name in other.effect.inputs()]
        assert one.gain_db == pytest.approx(other.gain_db, abs=0.05)


def test_a_clock_is_no_suspect():
    record = make_record(4000, effects={"drift": 2.0}, seed=82)
    X, y = record.drop(columns="reading"), record["reading"]
    X["row"] = np.arange(len(X)) * 0.5
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert "row" not in set(found.ranking["column"].dropna())


@pytest.mark.parametrize(("offset", "slope"), [(5.0, 0.0), (0.0, 2.0), (1e7, 1e-9)])
def test_an_exact_reading_misses_nothing(offset, slope):
    X = make_record(2000, seed=3).drop(columns="reading")
    y = offset + slope * X["temperature"]
    found = diagnose(DynamicBiasRegressor("temperature", [600.0]).fit(X, y), X, y)
    assert found.verdict == "nothing missing" and not found.left.structured
    assert "nan" not in str(found) and "inf" not in str(found)


@pytest.mark.long
def test_segments_of_two_rows_are_judged():
    record = make_record(3000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    kept = np.arange(3000) % 4 < 2
    model = DynamicBiasRegressor("temperature", [], max_gap="1.5 min").fit(X[kept], y[kept])
    assert diagnose(model, X[kept], y[kept]).causes


@pytest.mark.parametrize("offset", [1e4, 1e8])
def test_a_large_offset_changes_nothing(offset):
    record = make_record(4000, effects={"covariate": 0.5}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    moved = X.assign(**{name: X[name] + offset for name in ("humidity", "pressure", "supply")})
    model = DynamicBiasRegressor("temperature", [600.0])
    plain, high = (diagnose(model.fit(A, b), A, b).ranking.iloc[0] for A, b in ((X, y), (moved, y + offset)))
    assert high["label"] == plain["label"]
    for name in ("later_db", "gain_db", "share"):
        assert high[name] == pytest.approx(plain[name], rel=1e-2)


def test_the_spectrum_of_what_is_left_is_that_of_the_noise():
    """White noise of 0.3 every 30 s: 0.3 sqrt(2 x 30 s); a random walk of 0.02 a row falls into it as 1 / frequency."""
    rng, n = np.random.default_rng(8), 8000
    T = 23 + np.sin(np.arange(n) / 900) + 0.1 * np.sin(np.arange(n) / 90)
    times = pd.to_datetime("2026-01-01") + pd.to_timedelta(30 * np.arange(n), unit="s")
    X = pd.DataFrame({"temperature": T}, index=times)
    y = 2 * T + 0.3 * rng.standard_normal(n) + 0.02 * np.cumsum(rng.standard_normal(n))
    spectrum = diagnose(DynamicBiasRegressor("temperature", ["10 min"]).fit(X, y), X, y).left.spectrum
    f = spectrum["frequency"].to_numpy()
    expected = np.sqrt(2 * 30 * (0.3**2 + 0.02**2 / (2 * np.sin(np.pi * f * 30)) ** 2))
    middle = f > 10 / (n * 30)
    np.testing.assert_allclose(spectrum["noise"][middle], expected[middle], rtol=0.2)
    np.testing.assert_allclose(spectrum["residual"][f > 1e-3], expected[f > 1e-3], rtol=0.15)
    assert f[-1] < 0.5 / 30 and spectrum["white"].iloc[-1] == pytest.approx(0.3 * np.sqrt(60), rel=0.1)


def test_a_column_that_only_counts_is_no_suspect():
    """What goes with time is a drift, whatever counter was logged with it."""
    record = make_record(3000, effects={"drift": 2.0}, seed=5)
    X, y = record[["temperature"]].assign(counter=7.0 + 0.5 * np.arange(3000)), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X[["temperature"]], y), X, y)
    assert all("counter" not in suspect.effect.inputs() for suspect in found.suspects)
