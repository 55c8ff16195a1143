"""Gaps in later rows: what they may move the bias by is in the uncertainty, in flags, streams and files."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import LaggedCovariate

LEARNED = 3500


def with_holes(record, seed, first=LEARNED):
    """Later rows with six holes of 10 to 120 rows, and the same without."""
    rng, kept = np.random.default_rng(seed), np.ones(len(record), bool)
    for at in rng.integers(first + 100, len(record) - 150, 6):
        kept[at : at + rng.integers(10, 120)] = False
    later = np.arange(len(record)) >= first
    return record[kept & later], record[later]


def fitted(record):
    learn = record.iloc[:LEARNED]
    return DynamicBiasRegressor("temperature").fit(learn.drop(columns="reading"), learn["reading"])


@pytest.fixture(scope="module")
def record():
    return make_record(6000, seed=730)


@pytest.fixture(scope="module")
def model(record):
    return fitted(record)


@pytest.mark.parametrize("setting", ["lab", "outdoor"])
def test_the_error_behind_gaps_is_what_is_said(setting):
    squares, said = [], []
    for seed in range(731, 737):
        record = make_record(6000, setting=setting, seed=seed)
        model = fitted(record)
        some, whole = with_holes(record, seed)
        error = model.bias(some.drop(columns="reading")) - model.bias(whole.drop(columns="reading")).loc[some.index]
        variance = model._resumed_with_gaps(some.drop(columns="reading"))[0].gap_variance
        squares.append(error[variance > 0] ** 2)
        said.append(variance[variance > 0])
        unknown = model.bias(some.drop(columns="reading"), return_std=True)[1]
        assert (unknown >= np.sqrt(variance)).all()
    ratio = np.sqrt(np.concatenate(squares).mean() / np.concatenate(said).mean())
    assert 0.7 < ratio < 1.4


def test_rows_that_gaps_spoil_are_flagged_and_not_signed(model, record):
    some, _ = with_holes(record, 1)
    X, y = some.drop(columns="reading"), some["reading"]
    variance = model._resumed_with_gaps(X)[0].gap_variance
    far = variance > model.residual_std_**2
    assert far.any()
    for flags in (model.flags(X), model.evaluate(X, y)["flag"], model.uncertainty(X, y).frame()["status"]):
        assert set(flags[far]) == {"behind gap"}
        assert not (flags[~far] == "behind gap").any()
    sensor = model.uncertainty(X, y).frame()["u_sensor"]
    np.testing.assert_allclose(sensor, np.sqrt(variance))


def test_without_gaps_nothing_is_felt(model, record):
    _, whole = with_holes(record, 1)
    assert model._resumed_with_gaps(whole.drop(columns="reading"))[0].gap_variance is None


def test_rows_long_after_the_fitted_record_follow_on_it_behind_a_gap(model, record):
    late = record.iloc[LEARNED + 60 :]
    variance = model._resumed_with_gaps(late.drop(columns="reading"))[0].gap_variance
    assert variance[0] > model.residual_std_**2
    live = OnlineCorrector(model, uncertainty=True)
    first = live.update(late.index[0], late["temperature"].iloc[0], late["reading"].iloc[0])
    assert first.flags[0] == "behind gap"
    assert first.u == pytest.approx(
        model.correct(late.drop(columns="reading"), late["reading"], return_std=True)[1].iloc[0]
    )


@pytest.mark.parametrize("sizes", [(1,), (7, 1, 300), (6000,)])
def test_a_stream_says_what_the_whole_record_says(model, record, sizes):
    some, _ = with_holes(record, 2)
    some = some.iloc[: 1000 if sizes == (1,) else None]
    X, y = some.drop(columns="reading"), some["reading"]
    u, flags = model.correct(X, y, return_std=True)[1], model.flags(X, y)
    live, at, parts, turn = OnlineCorrector(model, uncertainty=True), 0, [], 0
    while at < len(X):
        stop = at + sizes[turn % len(sizes)]
        parts.append(live.update_many(X.iloc[at:stop], y.iloc[at:stop]))
        at, turn = stop, turn + 1
        if turn % 5 == 0:
            live = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
    found = pd.concat(parts)
    np.testing.assert_allclose(found["u"], u, rtol=1e-12)
    assert (found["flag"].replace("gap", "") == flags).all()


@pytest.mark.parametrize("damage", [[[1.0]], [None, None], [["a"] * 4], "x", [[float("nan")] * 100]])
def test_a_damaged_state_is_refused(model, record, damage):
    some, _ = with_holes(record, 2)
    live = OnlineCorrector(model)
    live.update_many(some.drop(columns="reading"), some["reading"])
    state = live.state()
    state["state"]["behind_gap"] = damage
    with pytest.raises(ValueError, match="behind_gap"):
        OnlineCorrector.from_state(model, state)


@pytest.mark.parametrize("rows", [100, None])
def test_a_model_file_knows_it(model, record, rows, tmp_path):
    some, _ = with_holes(record, 3)
    X = some.drop(columns="reading")
    save_model(model, tmp_path / "model.json", history_rows=rows)
    known, again = model._resumed_with_gaps(X)[0], load_model(tmp_path / "model.json")._resumed_with_gaps(X)[0]
    np.testing.assert_array_equal(again.gap_variance, known.gap_variance)
    assert model._slim()._resumed_with_gaps(X)[0].gap_variance == pytest.approx(known.gap_variance)


def test_other_columns_that_are_felt_late_wander_in_gaps_too(record):
    rng = np.random.default_rng(5)
    humid = 40 + np.cumsum(rng.standard_normal(len(record))) / 5
    lagged, kept = np.empty(len(record)), np.exp(-60.0 / 3600.0)
    lagged[0] = humid[0]
    for k in range(1, len(record)):
        lagged[k] = kept * lagged[k - 1] + (1 - kept) * humid[k]
    both = record.assign(humidity=humid, reading=record["reading"] + 0.5 * lagged)
    learn = both.iloc[:LEARNED]
    model = DynamicBiasRegressor("temperature", effects=[LaggedCovariate("humidity", [3600.0])])
    model.fit(learn.drop(columns="reading"), learn["reading"])
    some, whole = with_holes(both, 6)
    X = some.drop(columns="reading")
    error = model.bias(X) - model.bias(whole.drop(columns="reading")).loc[X.index]
    variance = model._resumed_with_gaps(X)[0].gap_variance
    alone = model._gap_error()
    assert [law.column for law in alone.laws] == ["temperature", "humidity"]
    assert 0.5 < np.sqrt((error[variance > 0] ** 2).mean() / variance[variance > 0].mean()) < 2


def test_rows_far_sparser_than_the_fitted_ones_are_all_behind_gaps(model, record):
    """Nobody knows what the temperature did between them, whole or in a stream."""
    sparse = record.iloc[LEARNED:].iloc[::8]
    X, y = sparse.drop(columns="reading"), sparse["reading"]
    u = model.correct(X, y, return_std=True)[1]
    dense = model.correct(
        record.iloc[LEARNED:].drop(columns="reading"), record["reading"].iloc[LEARNED:], return_std=True
    )
    assert (u > dense[1].loc[u.index]).iloc[1:].all()
    np.testing.assert_allclose(OnlineCorrector(model, uncertainty=True).update_many(X, y)["u"], u, rtol=1e-12)
