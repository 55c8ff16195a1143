"""What begins at a date, wherever it does: closed forms, names, and how well dates are known."""

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import toeplitz
from sklearn.base import clone
from test_judgement import markov

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import Disturbance, InitialTransient, ThermalLag
from thermocorr.equations.noise import inverse_kernel
from thermocorr.judgement.scan import change_gains, filtered, products_from, squares_of
from thermocorr.judgement.score import Comparison

pytestmark = pytest.mark.newest

TIMES = np.array([1.0, 3.0, 9.0, 27.0])


def covariance(theta, n):
    """White noise and the parts that remember for `TIMES`, from the definition."""
    kept = np.exp(-1 / TIMES)
    return theta[0] * np.eye(n) + sum(v * toeplitz(k ** np.arange(n)) for v, k in zip(theta[1:], kept, strict=True))


@pytest.mark.parametrize("theta", [[2.0, 0, 0, 0, 0], [1.0, 0.3, 0, 2.0, 0.5], [0.1, 0, 1.0, 0, 3.0]])
def test_the_inverse_of_the_noise_is_white_less_exponentials(theta):
    """Against the inverse of the covariance matrix, in its middle, where the ends are forgotten."""
    n = 1500
    white, sizes, ratios = noise = inverse_kernel(np.array(theta), TIMES)
    k = np.arange(n)[:, None]
    kernel = white * ((k[:, 0] == 0) - (ratios**k) @ sizes)
    inverse = np.linalg.inv(covariance(theta, n))
    np.testing.assert_allclose(kernel[:100], inverse[n // 2, n // 2 : n // 2 + 100], atol=1e-6 * white)
    # Products of what is cut at a row, in the middle of a longer span: sums over that matrix.
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((60, 2))
    found = products_from(columns, noise, mirrored=False)
    part = inverse[720:780, 720:780]
    for row in (0, 17, 59):
        np.testing.assert_allclose(found[row], columns[row:].T @ part[row:, row:] @ columns[row:], rtol=1e-5, atol=1e-6)
    squares = squares_of(60, noise)
    np.testing.assert_allclose(squares[[1, 7, 60]], [part[:m, :m].sum() for m in (1, 7, 60)], rtol=1e-4)


@pytest.mark.parametrize("segment", [np.zeros(900), np.repeat([0, 1], [500, 400])])
def test_another_law_at_every_row_is_as_good_as_its_columns(segment):
    """To 2 % of the largest gain: what the base holds is computed at some rows, powers are those of bands."""
    rng, n = np.random.default_rng(4), len(segment)
    T = np.sin(np.arange(n) / 31) + markov(rng, n, 40.0)
    T -= T.mean()
    base = np.column_stack((np.ones(n), T, np.sin(np.arange(n) / 9)))
    law = 3 * (np.arange(n) >= 430) * (0.6 + T)
    judged = Comparison(rng.standard_normal(n) + markov(rng, n, 9.0) + law, base, segment)
    theta = judged.base.theta
    gains = change_gains(judged, theta, np.ones(n), T, filtered(judged, theta))
    rows = list(range(60, n - 60, 7))
    judged.add([(np.arange(n) >= row)[:, None] * np.column_stack((np.ones(n), T)) for row in rows])
    expected = judged.screen(theta)
    assert expected.max() > 30
    np.testing.assert_allclose(gains[rows], expected, atol=0.02 * expected.max())
    assert abs(int(gains.argmax()) - 430) <= 15


@pytest.mark.long
def test_the_interval_of_a_faint_step_is_wide_and_mostly_holds_it():
    """Twelve steps of 1.2 noises, known to some rows: 95 % would miss 0.6 of them, four or more once in 400."""
    rng, widths, hits = np.random.default_rng(5), [], []
    X = make_record(2500, seed=5)[["temperature"]]
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
    for _ in range(12):
        row = int(rng.integers(500, 2000))
        y = X["temperature"] + 0.2 * rng.standard_normal(2500) + 0.24 * (np.arange(2500) >= row)
        found = diagnose(model.fit(X, y), X, y)
        steps = [cause for cause in found.causes if cause.effect.kind == "step"]
        if not steps:  # the base has taken this one upon itself
            continue
        ((low, high),) = steps[0].when
        hits.append(low <= X.index[row] - pd.Timedelta("30 s") <= high)
        widths.append((high - low) / pd.Timedelta("1 min"))
    assert len(hits) >= 8 and sum(hits) >= len(hits) - 3
    assert 2 <= np.median(widths) < 60


def test_a_disturbance_bends_no_coefficient_once_it_is_in_the_model():
    record = make_record(4000, seed=84)
    X, y = record.drop(columns="reading"), record["reading"].copy()
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
    clean = clone(model).fit(X, y)
    y.iloc[1000:1100] += 3.0
    bent = clone(model).fit(X, y)
    put_right = bent.with_effect(Disturbance(60_000.0, 66_000.0)).fit(X, y)
    elsewhere = np.r_[:1000, 1100:4000]
    wrong, right = (np.abs(m.predict(X) - clean.predict(X))[elsewhere].max() for m in (bent, put_right))
    assert right < 0.1 * wrong
    corrected = np.asarray(put_right.correct(X, y))
    assert corrected[1000:1100].mean() == pytest.approx(corrected[1100:].mean(), abs=0.05)


@pytest.mark.parametrize("place", [0.1, 0.45, 0.8])
def test_a_disturbance_where_runs_overlap_begins_before_it_ends(place):
    """The second run began while the first one was still recorded: rows in order are no times in order."""
    record = make_record(3000, seed=8).reset_index(drop=True)
    seconds = 60.0 * np.arange(3000) - np.where(np.arange(3000) < 1500, 0, 60.0 * 700)
    record = record.assign(s=seconds, run=np.repeat([1, 2], 1500))
    start, end = int(3000 * place), int(3000 * place) + 120
    inside = (seconds >= seconds[start]) & (seconds < seconds[end - 1])
    X, y = record.drop(columns="reading"), record["reading"] + 3.0 * inside
    found = diagnose(DynamicBiasRegressor("temperature", time="s", run="run").fit(X, y), X, y)
    named = [cause.effect for cause in found.causes if isinstance(cause.effect, Disturbance)]
    assert all(effect.start < effect.end for effect in named)
    if place != 0.45:  # elsewhere one run alone was recorded
        assert named and abs(named[0].start - seconds[start]) < 600


def test_a_stretch_up_to_the_end_of_a_run_ends_with_it():
    """Behind its last row comes the first one of a run that began earlier."""
    record = make_record(3000, seed=9).reset_index(drop=True)
    seconds = 60.0 * np.arange(3000) - np.where(np.arange(3000) < 1500, 0, 60.0 * 1499.5)
    record = record.assign(s=seconds, run=np.repeat([1, 2], 1500))
    shifted = (np.arange(3000) >= 1400) & (np.arange(3000) < 1500)
    X, y = record.drop(columns="reading"), record["reading"] + 3.0 * shifted
    model = DynamicBiasRegressor("temperature", ["10 min"], time="s", run="run").fit(X, y)
    found = diagnose(model, X, y)
    assert all(np.isfinite(model.with_effect(cause.effect).fit(X, y).coef_).all() for cause in found.causes)


def test_given_lags_and_starts_may_be_texts():
    """As everywhere, time constants are seconds or time spans."""
    record = make_record(2000, seed=1)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    for suspect in (InitialTransient(["2 h"]), InitialTransient(["1 min"]), InitialTransient(), ThermalLag(["5 h"])):
        assert diagnose(model, X, y, suspects=[suspect]).verdict == "nothing missing"
