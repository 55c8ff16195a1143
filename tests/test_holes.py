"""Rows that lack a temperature, or a column that the model uses: as if they had not been recorded."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from effect_records import log

from thermocorr import DynamicBiasRegressor, OnlineCorrector, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import Delay, Hysteresis, LaggedCovariate, Periodic

N = 900
LAYOUTS = {"plain": {}, "max_gap": {"max_gap": "5 min"}, "runs": {"run": "run"}, "screen": {"screen": False}}


def readings(X):
    """Of a device that follows temperature and humidity late."""
    late = X["temperature"].ewm(alpha=0.1).mean() + 0.02 * X["humidity"].ewm(alpha=0.05).mean()
    return (late + np.random.default_rng(0).normal(0, 0.02, len(X))).rename("reading")


def spoiled(kind, seed):
    """A log with holes: single rows, stretches, at both ends, in either column; and which rows lack something."""
    X, rng = log(N, seed), np.random.default_rng(seed)
    y = readings(X)
    if kind == "runs":  # interleaved
        X["run"] = np.arange(N) % 2
    lost = {"temperature": rng.choice(N, 20, replace=False), "humidity": rng.choice(N, 10, replace=False)}
    low, high = int(rng.integers(100, 300)), int(rng.integers(500, 700))
    lost["temperature"] = np.r_[lost["temperature"], 0, 1, N - 1, low : low + 30, high : high + 3]
    for name, rows in lost.items():
        X.iloc[rows, X.columns.get_loc(name)] = np.nan
    return X, y, X.isna().any(axis=1).to_numpy()


def model_of(kind):
    effects = [LaggedCovariate("humidity", [900.0]), Hysteresis(0.3), Delay("2 min"), Periodic("6 h")]
    return DynamicBiasRegressor("temperature", ["5 min", "50 min"], effects=effects, **LAYOUTS[kind])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_fit_and_all_that_follows_is_that_of_the_other_rows(kind, seed):
    X, y, lost = spoiled(kind, seed)
    model, other = (model_of(kind).fit(X[rows], y[rows]) for rows in (slice(None), ~lost))
    np.testing.assert_allclose(model.coef_, other.coef_, rtol=1e-9)
    assert list(model.coef_table().index) == list(other.coef_table().index)
    for rows in (slice(0, N), slice(2, 500), slice(450, N)):  # repeated, from any row on
        there = lost[rows]
        predicted, flags = model.predict(X[rows]), model.flags(X[rows], y[rows])
        assert (np.isnan(predicted) == there).all() and ((flags == "no temperature") == there).all()
        np.testing.assert_allclose(predicted[~there], other.predict(X[rows][~there]), rtol=0, atol=1e-9)
        assert (flags[~there] == other.flags(X[rows][~there], y[rows][~there])).all()


@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_model_file_keeps_the_holes(kind, tmp_path):
    X, y, lost = spoiled(kind, 7)
    model = model_of(kind).fit(X[:600], y[:600])
    save_model(model, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    for rows in (slice(0, 600), slice(300, 500), slice(600, N), slice(0, N)):
        np.testing.assert_array_equal(model.predict(X[rows]), again.predict(X[rows]))
    filled = X.copy()  # numbers where the fitted record had none are rows that the fit left out
    filled[["temperature", "humidity"]] = filled[["temperature", "humidity"]].ffill()
    first = int(np.flatnonzero(lost[10:600])[0]) + 10
    later = filled[first : first + 1]
    expected = model.predict(pd.concat([X[:first][~lost[:first]], later]))[-1:]
    np.testing.assert_allclose(again.predict(later), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in LAYOUTS if kind != "runs"])
def test_a_stream_passes_over_them_too(kind):
    X, y, lost = spoiled(kind, 11)
    model = model_of(kind).fit(X[:450], y[:450])
    whole = model.correct(X, y)
    single, block = OnlineCorrector(model, average=3), OnlineCorrector(model, average=3)
    rows = zip(X.index, X["temperature"], y, X["humidity"], strict=True)
    got = [single.update(time, T, U, humidity=RH) for time, T, U, RH in rows]
    many = pd.concat([block.update_many(X[low : low + 47], y[low : low + 47]) for low in range(0, N, 47)])
    np.testing.assert_allclose([one.corrected for one in got], whole, rtol=0, atol=1e-9)
    np.testing.assert_allclose(many["corrected"], whole, rtol=0, atol=1e-9)
    assert [one.flag for one in got] == many["flag"].tolist()
    assert ((many["flag"] == "no temperature") == lost).all()


def test_rows_without_times_keep_their_places():
    """As an array: a row that lacks its temperature takes its time all the same."""
    record = make_record(1200, seed=4)
    T, y = record[["temperature"]].to_numpy().copy(), record["reading"].to_numpy()
    T[[100, 101, 500]] = np.nan
    dated = record[["temperature"]].assign(temperature=T[:, 0])
    one = DynamicBiasRegressor(time_constants=["5 min", "2 h"], sampling_period="1 min").fit(T[:900], y[:900])
    other = DynamicBiasRegressor(time_constants=["5 min", "2 h"]).fit(dated[:900], y[:900])
    np.testing.assert_allclose(one.coef_, other.coef_, rtol=1e-9)
    for rows in (slice(0, 900), slice(900, 1200), slice(101, 600), slice(400, 502)):
        np.testing.assert_allclose(one.predict(T[rows]), other.predict(dated[rows]), rtol=0, atol=1e-9)


def test_the_note_says_how_long_the_longest_hole_is():
    record = make_record(600, seed=1)
    X, y = record[["temperature"]].copy(), record["reading"]
    X.iloc[100:130] = np.nan
    model = DynamicBiasRegressor("temperature", ["5 min"])
    with pytest.warns(UserWarning, match=r"30 rows of 600 .*row 100.*for 31 min at most.*Pass max_gap=180 to"):
        model.fit(X, y)
    X.iloc[400] = np.nan
    with pytest.warns(UserWarning, match=r"31 rows of 600 .*for 2 min at most\. To use"):
        model.set_params(max_gap="10 min").fit(X, y)
