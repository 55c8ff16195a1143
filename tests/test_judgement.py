"""The parts of judgement against closed forms and plain computations: noise, likelihood, steps, later data."""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import toeplitz

import thermocorr
from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.noise import Bands, fitted_parts
from thermocorr.estimators.evenness import evenness
from thermocorr.judgement.anywhere import best_period, filtered, step_gains
from thermocorr.judgement.blocks import averaged, spans
from thermocorr.judgement.candidates import record_of, suspect_record
from thermocorr.judgement.levels import RIDGE
from thermocorr.judgement.likelihood import Comparison
from thermocorr.judgement.worth import BLOCKS, LATER, HeldOut


def markov(rng, n, rows):
    """Unit variance, remembered for some rows."""
    kept, noise = np.exp(-1 / rows), rng.standard_normal(n)
    for k in range(1, n):
        noise[k] = kept * noise[k - 1] + np.sqrt(1 - kept**2) * noise[k]
    return noise


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


def test_taking_an_explanation_in_and_out_leaves_the_likelihood_as_it_was():
    rng = np.random.default_rng(3)
    n = 600
    reading, column = rng.standard_normal(n), rng.standard_normal(n)
    reading += column
    judged = Comparison(reading, np.ones((n, 1)), np.zeros(n))
    judged.add([column[:, None], rng.standard_normal((n, 2))])
    before, gain = judged.base.level, judged.refit([0])[0].level - judged.base.level
    assert gain > 100
    judged.adopt(0)
    assert judged.base.level == pytest.approx(before + gain, abs=0.05)
    assert judged.base.level - judged.level_with([]) == pytest.approx(gain, abs=0.5)
    assert judged.screen(judged.base.theta)[0] == pytest.approx(0.0, abs=1e-6)  # it is in the base already
    assert judged.smallest(column, 12.0) == np.inf


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


@pytest.mark.parametrize(("exponent", "low", "first"), [(1, 0.95, 0), (2, 0.85, 8)])
@pytest.mark.parametrize("n", [2500, 25_000])
def test_sums_of_parts_hold_flicker_noise_and_random_walks(n, exponent, low, first):
    bands = Bands(np.zeros(n))
    sizes, wanted = bands.sizes[1:].astype(float), 1 / (2 * np.sin(bands.middle[1:] / 2)) ** exponent
    theta = np.full((bands.parts.shape[1], 1), wanted.mean())
    for _ in range(60):
        theta = fitted_parts(bands.parts[1:], sizes, (wanted * sizes)[:, None], theta)
    ratio = (bands.parts[1:] @ theta)[:, 0] / wanted
    assert low < ratio[first:].min() and ratio.max() < 1.06 and ratio.min() > 0.28


def test_a_wave_under_wandering_noise_is_found_across_a_pause_where_it_gains_most():
    n, rng = 4000, np.random.default_rng(15)
    place = np.arange(n) + 777 * (np.arange(n) >= 1500)
    base = np.column_stack((np.ones(n), np.sin(np.arange(n) / 300)))
    reading = rng.standard_normal(n) + 3 * markov(rng, n, 200.0) + 3 * np.cos(2 * np.pi * place / 310.0)
    judged = Comparison(reading, base, np.repeat([0, 1], [1500, n - 1500]))
    theta = judged.base.theta
    found = best_period(judged, theta, place, n / 3, filtered(judged, theta))
    assert found == pytest.approx(310.0, rel=0.03)
    periods = [found, *np.geomspace(3, n / 3, 300)]
    waves = [np.column_stack([f(2 * np.pi * place / period) for f in (np.cos, np.sin)]) for period in periods]
    judged.add(waves)
    gains = judged.screen(theta)
    assert gains[0] > 0.9 * gains.max() > 10


def test_forecasts_from_cross_products_are_those_of_ridges():
    rng = np.random.default_rng(6)
    n = 1003
    base = np.column_stack((np.ones(n), rng.standard_normal((n, 3)) + 5))
    column = rng.standard_normal((n, 2))
    reading = base @ [1, 2, 3, 4.0] + column @ [0.3, 0.1] + rng.standard_normal(n)
    edges = np.linspace(0, n, 21).astype(int)

    def error(columns, folds):
        total = 0.0
        for learn, test in folds:
            seen, unseen = (np.concatenate([np.arange(edges[i], edges[i + 1]) for i in part]) for part in (learn, test))
            mean, size = columns[seen].mean(axis=0), columns[seen].std(axis=0)
            X = (columns[seen] - mean) / size
            coef = np.linalg.solve(X.T @ X / len(X) + RIDGE * np.eye(X.shape[1]), X.T @ reading[seen] / len(X))
            total += np.sum((reading[unseen] - reading[seen].mean() - (columns[unseen] - mean) / size @ coef) ** 2)
        return total

    found = HeldOut(reading[:, None], base).worth([column[:, :1], column, column[:, 1:]])[1]
    for folds, value in ((LATER, found.later), (BLOCKS, found.blocks)):
        before, after = error(base[:, 1:], folds), error(np.column_stack((base[:, 1:], column)), folds)
        assert value == pytest.approx(10 * np.log10(before / after), abs=1e-6)


@pytest.mark.parametrize("size", [1e-4, 1e-5, 3e-6, 1e-6, 1e-8])
def test_a_column_that_hardly_varies_where_it_is_learned_is_none_there(size):
    """Its variance is a difference of large sums: at 3e-6 the rounding outweighed the ridge, the matrix was none."""
    rng, row = np.random.default_rng(9), np.arange(1000)
    for _ in range(20):
        late = np.where(row < 450, 1.0, -0.7)[:, None] + size * rng.standard_normal((1000, 2))
        base = np.column_stack((np.ones(1000), rng.standard_normal(1000), late, late @ [0.6, 0.7]))
        for worth in HeldOut(rng.standard_normal((1000, 1)), base).worth([late[:, :1] ** 2, late]):
            assert np.isfinite([worth.later, worth.blocks]).all()


def test_a_quantised_reading_with_a_slow_drift_is_weighted_evenly():
    """The median increment of such a reading is nought or the step; weights from it have blown up."""
    n = 5000
    reading = np.round(np.linspace(0, 30, n) + 0.2 * np.random.default_rng(7).standard_normal(n))
    weights = evenness(reading - np.linspace(0, 30, n), np.zeros(n))
    assert weights.std() < 0.5
    noise = np.random.default_rng(8).standard_normal(n) * np.where(np.arange(n) < n // 2, 1.0, 5.0)
    low, high = evenness(noise, np.zeros(n))[[n - 500, 500]]
    assert high / low == pytest.approx(5.0, rel=0.3)


@pytest.mark.parametrize(("louder", "rows", "seed"), [(8, 30, 12), (20, 30, 12), (8, 100, 11), (20, 300, 14)])
def test_a_burst_of_loud_noise_is_no_disturbance(louder, rows, seed):
    quiet, noisy = (make_record(5000, seed=seed, noise=noise)["reading"].to_numpy() for noise in (0.0, 0.2))
    X = make_record(5000, seed=seed).drop(columns="reading")
    loud = np.where((np.arange(5000) >= 2100) & (np.arange(5000) < 2100 + rows), louder, 1)
    y = quiet + loud * (noisy - quiet)
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert not {"disturbance", "several_steps", "step"} & {cause.effect.kind for cause in found.causes}
    assert found.left.loud, "a burst is said, though it is no effect"
    step = (X.index[1] - X.index[0]).total_seconds()
    ends = np.array(found.left.loud[0][:2]) / step
    assert ends == pytest.approx([2100, 2100 + rows], abs=65)  # half of the rows over which the noise is measured
    assert "times as large as usual" in str(found)
    assert found.explainable < 0.2


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


def test_steps_to_and_fro_are_one_cause():
    record = make_record(6000, seed=83)
    X, y = record.drop(columns="reading"), record["reading"].copy()
    for row, height in ((900, 1.0), (2100, -1.0), (3300, 0.7), (4700, -0.9)):
        y.iloc[row:] += height
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert [cause.effect.kind for cause in found.causes] == ["several_steps"]
    step = record.index.to_series().diff().median().total_seconds()
    assert np.array(found.best.times) / step == pytest.approx([900, 2100, 3300, 4700], abs=2)
    better = DynamicBiasRegressor("temperature").fit(X, y).with_effect(found.best).fit(X, y)
    assert better.residual_std_ == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("name", ["levels", "left_levels", "refinement_levels"])
def test_every_threshold_is_explained(name):
    """Each constant has a docstring that says more than its name."""
    path = Path(thermocorr.__file__).parent / "judgement" / f"{name}.py"
    body = ast.parse(path.read_text(encoding="utf-8")).body
    for node, after in pairwise(body):
        if isinstance(node, ast.Assign):
            assert isinstance(after, ast.Expr), ast.unparse(node)
            assert len(str(after.value.value)) > 40, ast.unparse(node)


def test_a_page_tells_what_is_left():
    record = make_record(5000, effects={"random_walk": 2.0}, seed=84)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.verdict == "unexplained" and found.left.structured
    for text in (str(found), found.to_html()):
        assert "remembers for about" in text and "log what changes as slowly" in text
    assert pd.notna(found.left.smallest_step) and found.left.smallest_step > 0


@pytest.mark.parametrize("absurd", [9.9e37, 1e3, -999.0])
def test_spikes_and_sentinels_hide_nothing(absurd):
    record = make_record(6000, effects={"hysteresis": 2.0}, seed=63)
    X, y = record.drop(columns="reading"), record["reading"].copy()
    model = DynamicBiasRegressor("temperature").fit(X, y)
    y.iloc[[700, 2500, 2501, 5000]] = absurd
    found = diagnose(model, X, y)
    assert found.best.kind == "hysteresis"
    assert len(found.left.spikes) == 4 and "left out of the" in " ".join(str(found).split())
    assert found.left.floor == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize(("offset", "slope"), [(5.0, 0.0), (0.0, 2.0), (1e7, 1e-9)])
def test_an_exact_reading_misses_nothing(offset, slope):
    X = make_record(2000, seed=3).drop(columns="reading")
    y = offset + slope * X["temperature"]
    found = diagnose(DynamicBiasRegressor("temperature", [600.0]).fit(X, y), X, y)
    assert found.verdict == "nothing missing" and not found.left.structured
    assert "nan" not in str(found) and "inf" not in str(found)


def test_segments_of_two_rows_are_judged():
    record = make_record(3000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    kept = np.arange(3000) % 4 < 2
    model = DynamicBiasRegressor("temperature", [], max_gap="1.5 min").fit(X[kept], y[kept])
    assert diagnose(model, X[kept], y[kept]).causes


def test_noise_goes_on_over_short_pauses_but_not_from_run_to_run():
    record = make_record(3000, seed=3, runs=2, gaps=2)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", [600.0], run="run", max_gap="5 min").fit(X, y)
    read = suspect_record(model, record_of(model, X, y), X, y, None, [])
    data = averaged(read, [])
    assert len(set(data.segment)) == 6
    np.testing.assert_array_equal(spans(data, read), data.segment // 3)


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


def test_kinds_that_are_left_out_are_looked_for_nowhere():
    record = make_record(3000, effects={"step": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y, exclude=["step", "periodic"])
    assert not {"step", "periodic"} & {suspect.effect.kind for suspect in found.suspects}


def test_an_explanation_that_one_stretch_decides_scatters():
    rng = np.random.default_rng(21)
    n = 6000
    column, noise = rng.standard_normal(n), rng.standard_normal(n)
    wrong = np.where(np.arange(n) // 300 == 7, 3.0 * column, 0.0)  # it acts in one stretch alone
    for reading, low, high in ((noise + 0.3 * column, 0.3, 2.3), (noise + wrong, 4.0, 400.0)):
        judged = Comparison(reading, np.ones((n, 1)), np.zeros(n))
        judged.add([column[:, None]])
        fit = judged.refit([0])[0]
        assert fit.level - judged.base.level > 40
        assert low < judged.scatter(0, fit.theta) < high


@pytest.mark.parametrize("seed", [12, 13])
def test_a_column_that_matters_in_one_stretch_alone_is_not_proven_but_said(seed, monkeypatch):
    record = make_record(6000, seed=seed)
    X, y = record.drop(columns="reading"), record["reading"]
    X["fan"] = np.random.default_rng(seed).standard_normal(6000)
    y = y + np.where(np.arange(6000) // 600 == 5, 0.2 * X["fan"], 0.0)
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y)
    assert found.verdict == "unexplained" and not found.causes
    assert "covariate: fan" in found.left.uneven and "A few stretches of the record follow" in str(found)
    assert "white noise" not in str(found)
    monkeypatch.setattr("thermocorr.judgement.family.SCATTER", 1e9)
    assert diagnose(model, X, y).causes[0].label == "covariate: fan"  # without the rule it is


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
