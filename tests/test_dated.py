"""What begins at a date, wherever it does: closed forms, names, and how well dates are known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import toeplitz
from sklearn.base import clone
from test_judgement import markov

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import Disturbance, InitialTransient, ThermalLag
from thermocorr.equations.noise import decaying_sums, inverse_kernel
from thermocorr.judgement.anywhere import filtered
from thermocorr.judgement.cuts import change_gains, products_from
from thermocorr.judgement.likelihood import Comparison
from thermocorr.judgement.stretches import best_stretch, damped, lengths_of, squares_of

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


@pytest.mark.parametrize("memory", [0.0, 9.0, 300.0])
def test_the_best_stretch_is_the_planted_one(memory):
    rng, n = np.random.default_rng(7), 3000
    noise = rng.standard_normal(n) + (2 * markov(rng, n, memory) if memory else 0.0)
    reading = noise + 6.0 * ((np.arange(n) >= 1500) & (np.arange(n) < 1540))
    judged = Comparison(reading, np.ones((n, 1)), np.zeros(n))
    theta = judged.only_white() if not memory else judged.base.theta
    found = best_stretch(judged, theta, np.ones(n))
    assert abs(found.start - 1500) <= 3 and abs(found.stop - 1540) <= 3
    judged.add([((np.arange(n) >= found.start) & (np.arange(n) < found.stop)).astype(float)[:, None]])
    assert found.gain == pytest.approx(judged.screen(theta)[0], rel=0.1)  # damping, and what the base holds
    quiet = Comparison(noise, np.ones((n, 1)), np.zeros(n))
    assert best_stretch(quiet, quiet.base.theta, np.ones(n)) is None


def test_single_readings_that_stand_out_make_no_stretch():
    rng, n = np.random.default_rng(9), 4000
    reading = rng.standard_normal(n)
    reading[rng.choice(n, 60, replace=False)] += 9.0
    judged = Comparison(reading, np.ones((n, 1)), np.zeros(n))
    assert best_stretch(judged, judged.only_white(), np.ones(n)) is None
    assert np.abs(damped(reading)).max() < 6.0
    assert not len(lengths_of(100)) and lengths_of(25_000)[-1] <= 1250


def test_a_few_large_readings_in_a_row_are_no_stretch():
    """Three readings do not move the median around them, as they would move one of five."""
    rng, n = np.random.default_rng(9), 4000
    reading = rng.standard_normal(n)
    reading[2000:2003] += 5.0
    judged = Comparison(reading, np.ones((n, 1)), np.zeros(n))
    assert best_stretch(judged, judged.only_white(), np.ones(n)) is None
    assert np.abs(damped(reading)[2000:2003]).max() < 4.0


def hidden(kind, seed, strength, noise=None, n=6000):
    """A record with an effect in it, its parameters, and the diagnosis of a model without it."""
    record, truth = make_record(
        n, effects={kind: strength}, coloured_noise=noise, device=("layered", "plate")[seed % 2], seed=seed,
        return_truth=True,
    )  # fmt: skip
    X, y = record.drop(columns="reading"), record["reading"]
    parameters = truth.attrs["effects"][kind]["parameters"]
    return X, y, parameters, diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)


@pytest.mark.parametrize("noise", [None, (0.2, 1800.0)], ids=["white", "wandering"])
@pytest.mark.parametrize("seed", [301, 302, 303])
@pytest.mark.parametrize("kind", ["sensitivity_step", "disturbance", "lagged_modulation"])
def test_the_hidden_cause_is_named_first(kind, seed, noise):
    X, y, parameters, found = hidden(kind, seed, 2.0, noise)
    best = found.best
    assert best.kind == kind and found.causes[0].standing == "proven"
    if kind == "lagged_modulation":
        assert (best.fast, best.slow) == (parameters["fast"], parameters["slow"])
        assert best.time_constant == pytest.approx(parameters["time_constant"], rel=0.5)
    else:
        true = [parameters[name] for name in ("time", "start", "end") if name in parameters]
        for (low, high), moment in zip(found.causes[0].when, true, strict=True):
            moment = X.index[0] + pd.Timedelta(moment, unit="s")
            margin = 0.2 * (high - low) + pd.Timedelta("1 min")  # nine records: one miss of 95 % must not fail them
            assert low - margin <= moment <= high + margin and high - low < pd.Timedelta("1 day")
        assert "(95 %)" in " ".join(str(found).split())
    better = DynamicBiasRegressor("temperature").fit(X, y).with_effect(best).fit(X, y)
    assert better.residual_std_ < (0.23 if noise is None else 0.33)


@pytest.mark.parametrize(("kind", "strength"), [("step", 0.7), ("sensitivity_drift", 2.0), ("interaction", 2.0)])
def test_simpler_causes_keep_their_names(kind, strength):
    for seed in (311, 312):
        found = hidden(kind, seed, strength)[-1]
        assert [cause.effect.kind for cause in found.causes] == [kind]


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


def test_many_disturbances_and_steps_are_several_steps():
    record = make_record(6000, seed=83)
    X, y = record.drop(columns="reading"), record["reading"].copy()
    for start, stop, height in ((900, 960, 1.0), (2100, 2180, -1.0), (4700, 6000, 0.8)):
        y.iloc[start:stop] += height
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert [cause.effect.kind for cause in found.causes] == ["several_steps"]
    assert np.array(found.best.times) / 60 == pytest.approx([900, 960, 2100, 2180, 4700], abs=2)
    assert len(found.causes[0].when) == 5


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


@pytest.mark.parametrize("share", [0.01, 0.002])
def test_glitches_are_no_steps(share):
    """One reading in a hundred wrong by 25 standard deviations, or pairs of them: too many, or too long, for spikes."""
    record = make_record(7000, seed=760)
    rng = np.random.default_rng(760)
    wrong = rng.random(7000) < share
    size = 5.0 * rng.standard_normal(7000) if share == 0.01 else np.full(7000, 4.0)
    record["reading"] += np.convolve(wrong * size, [1.0] if share == 0.01 else [1.0, 1.2])[:7000]
    X, y = record.drop(columns="reading"), record["reading"]
    assert diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y).verdict == "nothing missing"


@pytest.mark.parametrize("rows", [0, 1, 2, 50])
def test_sums_that_decay_are_those_of_a_filter(rows):
    columns = np.random.default_rng(rows).standard_normal((rows, 3))
    kept = columns.copy()
    sums = np.zeros(3)
    for row, found in zip(kept, decaying_sums(columns, 0.9), strict=True):
        sums = 0.9 * sums + row
        np.testing.assert_allclose(found, sums, rtol=1e-12)
    np.testing.assert_array_equal(columns, kept)


@pytest.mark.parametrize(("seed", "size"), [(19, 1.0), (21, 1.1), (22, 0.8)])
@pytest.mark.parametrize("end", [0, -1])
def test_a_large_reading_at_an_end_is_neither_a_start_nor_a_step(seed, size, end):
    """Five standard deviations are rare in normal noise and not in other: a decay within one step is the first row."""
    record = make_record(4000, noise=0.2, setting=("lab", "outdoor", "chamber")[seed % 3], seed=seed)
    X, y = record.drop(columns="reading"), record["reading"].copy()
    y.iloc[end] += size
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert not found.causes and found.verdict == "nothing missing"


def test_given_lags_and_starts_may_be_texts():
    """As everywhere, time constants are seconds or time spans."""
    record = make_record(2000, seed=1)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    for suspect in (InitialTransient(["2 h"]), InitialTransient(["1 min"]), InitialTransient(), ThermalLag(["5 h"])):
        assert diagnose(model, X, y, suspects=[suspect]).verdict == "nothing missing"
