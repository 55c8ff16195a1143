"""What the temperature did in gaps: how wrong the bias is behind them, what is learned from, and who is blamed.

Also: Gaps in later rows: what they may move the bias by is in the uncertainty, in flags, streams and files.
"""

import json
import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, compare_variants, load_model, refine, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import LaggedCovariate
from thermocorr.equations import lag_differences
from thermocorr.equations.lags import bridge_error
from thermocorr.model.input_errors import GapError, InputLaw, error_behind_gaps
from thermocorr.records import Layout, read_record
from thermocorr.records.history import Gaps

TAUS = np.array([120.0, 900.0, 7200.0])


def felt_late(weights):
    return InputLaw("temperature", TAUS, weights, 0.0)


def wandering(rng, n, remembers):
    """An Ornstein-Uhlenbeck process of unit variance, a row a step."""
    kept = np.exp(-1 / remembers)
    noise = np.sqrt(1 - kept**2) * rng.standard_normal(n)
    noise[0] = rng.standard_normal()
    for k in range(1, n):
        noise[k] += kept * noise[k - 1]
    return noise


def test_the_error_of_a_bridge_is_that_of_drawn_ones():
    """Brownian motion: bridges drawn at random, and the lags' integrals over them."""
    rng, h, steps = np.random.default_rng(0), 3600.0, 400
    t = np.linspace(0, h, steps + 1)
    walk = np.cumsum(np.sqrt(h / steps) * rng.standard_normal((4000, steps)), axis=1)
    bridge = np.column_stack((np.zeros(4000), walk)) - t / h * walk[:, -1:]
    kernel = np.exp(-(h - t) / TAUS[:, None]) / TAUS[:, None]
    drawn = np.cov((bridge @ kernel.T) * h / steps, rowvar=False)
    found = bridge_error(lambda lag: np.asarray(lag, float), h, TAUS)
    np.testing.assert_allclose(found, drawn, rtol=0.12)


def by_matrices(law, gaps, steps):
    """The definition, row by row: matrices J x J; forgotten where all lags together err by no more than `least`."""
    felt, said = None, []
    for step in steps.tolist():
        decay = np.diag(np.exp(-step / law.time_constants))
        felt = None if felt is None else decay @ felt @ decay
        if step > gaps.least:
            bridge = bridge_error(gaps.structure(law.column), float(f"{step:.2g}"), law.time_constants)
            felt = bridge if felt is None else felt + bridge
        if felt is not None and np.abs(law.weights) @ np.sqrt(np.diag(felt)) <= law.least:
            felt = None
        said.append(0.0 if felt is None else law.weights @ felt @ law.weights)
    return np.array(said)


def laws_and_steps(seed):
    """Two columns with lags, one of which forgets sooner; dense and sparse gaps, the first row behind one or not."""
    rng, lags = np.random.default_rng(seed), np.concatenate(([0.0], np.geomspace(10, 1e5, 20)))
    laws = [
        InputLaw(column, np.sort(10 ** rng.uniform(1, 4, n_lags)), rng.uniform(0.2, 1, n_lags), least)
        for column, n_lags, least in (("T", 4, 0.15), ("H", 2, 0.15))
    ]
    squares = {"T": np.minimum(1e-3 * lags**1.2, 4.0), "H": np.minimum(1e-2 * lags**0.6, 2.0)}
    steps = rng.choice([10.0, 12.0, 15.3], 400)
    behind = rng.random(400) < (0.3, 0.05, 0.02)[seed % 3]
    behind[0] = seed % 2
    steps[behind] += 10 ** rng.uniform(1.5, 4, behind.sum())
    return laws, Gaps(least=30.0, lags=lags, squares=squares), steps


@pytest.mark.parametrize("seed", range(6))
def test_what_is_felt_of_gaps_fades_as_matrices_do(seed):
    """Whole, and in pieces; the weights are of one sign, so sums lose no digits to 1e-12."""
    laws, gaps, steps = laws_and_steps(seed)
    error, rng, felt, parts, at = GapError(laws, gaps), np.random.default_rng(seed), (), [], 0
    expected = sum(by_matrices(law, gaps, steps) for law in laws)
    assert expected.any()
    np.testing.assert_allclose(error.of_rows(steps)[0], expected, rtol=1e-12)
    while at < len(steps):
        stop = at + int(rng.integers(1, 50))
        said, felt = error.of_rows(steps[at:stop], felt)
        parts.extend(said)
        at = stop
    np.testing.assert_allclose(parts, expected, rtol=1e-12)


@pytest.mark.parametrize("remembers", [30.0, 300.0])
def test_the_error_behind_a_gap_is_that_of_many_records(remembers):
    rng, n = np.random.default_rng(1), 3000
    weights, gap = np.array([3.0, -1.0, 2.0]), slice(1500, 1560)
    seconds = 60.0 * np.arange(n)
    kept = np.ones(n, bool)
    kept[gap] = False
    missed, said = [], []
    for _ in range(60):
        T = 23 + wandering(rng, n, remembers)
        whole = lag_differences(T, np.diff(seconds, prepend=-60.0), TAUS)[0][kept]
        X = pd.DataFrame({"temperature": T, "seconds": seconds})[kept]
        bridged = lag_differences(T[kept], np.diff(seconds[kept], prepend=-60.0), TAUS)[0]
        missed.append((whole - bridged) @ weights)
        record = read_record(X, Layout("temperature", "seconds"), quiet=True)
        rows, error = error_behind_gaps(record, [felt_late(weights)])
        said.append(np.zeros(len(X)))
        said[-1][rows] = error
    rms, said = np.sqrt(np.mean(np.square(missed), axis=0)), np.sqrt(np.mean(np.square(said), axis=0))
    assert (said[:1500] == 0).all() and (rms[:1500] < 1e-12).all()
    for behind in (0, 5, 30, 120):
        assert said[1500 + behind] == pytest.approx(rms[1500 + behind], rel=0.3)  # of sixty records
    np.testing.assert_allclose(said[1500:1700].mean(), rms[1500:1700].mean(), rtol=0.2)


def test_without_gaps_there_is_no_error():
    X = make_record(1000, irregular=0.5, seed=1)[["temperature"]]
    record = read_record(X, Layout("temperature"), quiet=True)
    assert len(error_behind_gaps(record, [felt_late(np.ones(3))])[0]) == 0
    assert len(error_behind_gaps(record, [])[0]) == 0
    apart = read_record(X.drop(X.index[300:400]), Layout("temperature", max_gap="10 min"), quiet=True)
    assert len(error_behind_gaps(apart, [felt_late(np.ones(3))])[0]) == 0  # a start has decays of its own


def test_how_the_temperature_wanders_is_read_off_it():
    T = np.cumsum(np.random.default_rng(2).standard_normal(50_000))
    X = pd.DataFrame({"temperature": T, "seconds": 10.0 * np.arange(50_000)})
    record = read_record(X, Layout("temperature", "seconds"), quiet=True)
    structure = Gaps.of(record, ["temperature"], 10.0, 1000.0).structure("temperature")
    np.testing.assert_allclose(structure(np.array([0.0, 5.0, 100.0, 1000.0])), [0.0, 0.5, 10.0, 100.0], rtol=0.1)


def test_it_is_said_how_many_readings_are_left_out():
    record = make_record(3000, gaps=3, seed=714)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = DynamicBiasRegressor("temperature").fit(record[["temperature"]], record["reading"])
    said = [str(one.message) for one in caught if "behind gaps" in str(one.message)]
    assert len(said) == 1 and "are not learned from" in said[0] and "max_gap" in said[0]
    assert said[0] in model.notes_ and "% of all" not in said[0]


def test_a_gap_in_one_run_is_not_felt_in_the_next():
    record = make_record(1500, runs=3, gaps=2, seed=716)
    layout = Layout("temperature", run="run")
    record_read = read_record(record[["run", "temperature"]], layout, quiet=True)
    rows, error = error_behind_gaps(record_read, [felt_late(np.ones(3))])
    runs, steps = record["run"].to_numpy(), record.index.to_series().diff().dt.total_seconds().to_numpy()
    first = {
        run: int(np.flatnonzero((runs == run) & (steps > 150) & (np.roll(runs, 1) == run))[0]) for run in set(runs)
    }
    assert (error > 0).all() and all(rows[runs[rows] == run].min() == start for run, start in first.items())


@pytest.mark.parametrize("work", ["variants", "refine"])
def test_what_many_fits_say_is_said_once(work):
    record = make_record(3000, gaps=3, seed=717)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if work == "variants":
            compare_variants(X, y, model=model)
        else:
            refine(model, X, y)
    said = [" ".join(str(one.message).split()[:2]) for one in caught]
    assert sorted(said) == ["Sampling has", "The device"]


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


def test_a_model_file_knows_it(model, record, tmp_path):
    some, _ = with_holes(record, 3)
    X = some.drop(columns="reading")
    save_model(model, tmp_path / "model.json")
    known, again = model._resumed_with_gaps(X)[0], load_model(tmp_path / "model.json")._resumed_with_gaps(X)[0]
    np.testing.assert_array_equal(again.gap_variance, known.gap_variance)


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
