"""Rows that lack a temperature, or a column that the model uses: as if they had not been recorded.

Also: Filled cells where it is hard: what goes on behind a hole, codes, gaps, runs, losses of everything.
"""

import json

import numpy as np
import pandas as pd
import pytest
from effect_records import log
from test_thermometers import BODIES, LEARNED, STEP, two_surfaces, with_hole

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, diagnose, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Delay, Events, Hysteresis, LaggedCovariate, Periodic
from thermocorr.estimators.input_errors import FillingError
from thermocorr.interactive.browser.widget import bench_of

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


MODEL = {"temperature": ["case", "room"], "time_constants": BODIES}


@pytest.fixture(scope="module")
def device():
    X, y, U, noise = two_surfaces(11)
    return X, y, U, noise, DynamicBiasRegressor(**MODEL).fit(X[:LEARNED], y[:LEARNED])


def in_blocks(model, X, y, size):
    live, parts = OnlineCorrector(model, uncertainty=True), []
    for start in range(0, len(X), size):
        parts.append(live.update_many(X[start : start + size], y[start : start + size]))
        live = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
    return pd.concat(parts)


def assert_live_is_whole(model, X, y, sizes=(1, 7, 300)):
    whole = model.evaluate(X, y, return_std=True)
    for size in sizes:
        found = in_blocks(model, X, y, size)
        assert np.nanmax(np.abs(found["corrected"] - whole["corrected"])) < 1e-9
        assert [flag for flag in found["flag"] if flag != "gap"] == [
            flag for flag, live in zip(whole["flag"], found["flag"], strict=True) if live != "gap"
        ]
        assert np.nanmax(np.abs(found["u"] - whole["u"])) < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("column", ["case", "room"])
def test_what_a_hole_leaves_behind_is_said(column):
    inside, behind = [], []
    for seed in (12, 13, 14):
        X, y, U, _ = two_surfaces(seed)
        model = DynamicBiasRegressor(["case", "room"]).fit(X[:LEARNED], y[:LEARNED])
        for start in range(LEARNED + 100, len(X) - 200, 200):
            lost, hole = with_hole(X, column, start)
            bias, u = model.bias(lost, return_std=True)
            ratio = ((bias - (U - model.intercept_)) / u).to_numpy()
            inside.append(ratio[hole])
            behind.append(ratio[hole.stop : hole.stop + 60])
            assert u.iloc[hole.stop + 5] > 2 * u.iloc[hole.start - 1]  # it is not forgotten at once
    assert 0.4 < np.sqrt(np.mean(np.square(inside))) < 1.6
    assert 0.4 < np.sqrt(np.mean(np.square(behind))) < 1.6


def test_the_variance_is_that_of_a_simulation():
    """A wandering error of the room's thermometer for an hour, then none: 4000 of them through the model's own law."""
    X, y, _, _ = two_surfaces(15, n=2000)
    model = DynamicBiasRegressor(**MODEL, degree=1).fit(X, y)
    n, hole = 400, slice(50, 110)
    error = np.full(n, np.nan)
    error[hole] = 0.1 * np.sqrt(np.arange(1, 61))
    law: FillingError = model._filling_error()
    steady = {"case": np.full(n, 25.0), "room": np.full(n, 23.0)}
    nothing = {"case": np.full(n, np.nan), "room": error}
    said, _ = law.of_rows(steady, nothing, np.full(n, STEP))
    rng = np.random.default_rng(0)
    wandered = np.zeros((n, 4000))
    wandered[hole] = 0.1 * np.cumsum(rng.standard_normal((60, 4000)), axis=0)
    names = list(model.features_.get_feature_names_out())
    weights = model.coef_[[names.index(name) for name in ("room", "room lag[1200 s]", "room lag[20000 s]")]]
    felt = (weights[0] - weights[1:].sum()) * wandered
    for tau, weight in zip(BODIES["room"], weights[1:], strict=True):
        late = np.zeros((n, 4000))
        for k in range(1, n):
            late[k] = np.exp(-STEP / tau) * late[k - 1] + (1 - np.exp(-STEP / tau)) * wandered[k - 1]
        felt = felt + weight * late
    true = felt.std(axis=1)
    rows = said > 0
    assert rows[50:200].all()
    assert np.allclose(said[rows][3:], true[rows][3:], rtol=0.08)


def test_a_hole_in_the_fitted_record_raises_no_alarm():
    verdicts = []
    for seed in (20, 21, 22, 23):
        X, y, _, _ = two_surfaces(seed, n=5000)
        lost, _ = with_hole(X, "case", 2000)
        model = DynamicBiasRegressor(["case", "room"]).fit(lost, y)
        verdicts.append(diagnose(model, lost, y).verdict)
    assert verdicts.count("nothing missing") >= 3


def test_codes_and_spikes_of_every_thermometer(device):
    X, y, _, noise, model = device
    clean = model.correct(X, y)
    for column in (0, 1):
        for code in (9.9e37, -999.0):
            bad = X[LEARNED:].copy()
            bad.iloc[100:103, column] = code
            found = model.evaluate(bad, y[LEARNED:])
            assert set(found["flag"].iloc[100:103]) <= {"filled", "doubtful input"}
            assert np.abs(found["corrected"] - clean[LEARNED:]).max() < 5 * noise
            assert_live_is_whole(model, bad[:200], y[LEARNED:][:200], (1, 200))
    learned = X[:LEARNED].copy()
    learned.iloc[500:530, 1] = -999.0
    learned.iloc[900, 1] += 8.0
    with pytest.warns(UserWarning, match="31 cells of 'room' filled"):
        again = DynamicBiasRegressor(**MODEL).fit(learned, y[:LEARNED])
    assert again.residual_std_ < 1.05 * model.residual_std_


FAR = {"outside fitted range", "jump", "doubtful input"}


def test_another_thermometer_outside_its_range(device):
    X, y, _, _, model = device
    far = X[LEARNED:][:100].assign(room=X["room"][LEARNED:][:100] + 40)
    assert set(model.flags(far)) <= FAR
    assert set(OnlineCorrector(model).update_many(far, y[LEARNED:][:100])["flag"]) <= {
        "outside fitted range",
        "jump",
        "doubtful input",
    }


@pytest.mark.long
def test_live_is_whole_where_all_are_lost_at_once(device):
    X, y, _, _, model = device
    lost = X[LEARNED:][:400].copy()
    lost.iloc[50:170, 1] = np.nan
    lost.iloc[80:110, 0] = np.nan
    lost.iloc[380:, :] = np.nan
    assert_live_is_whole(model, lost, y[LEARNED:][:400])


@pytest.mark.long
@pytest.mark.newest
def test_live_is_whole_over_gaps_and_runs():
    X, y, _, _ = two_surfaces(16, n=4000)
    run = np.repeat(["a", "b", "c", "d"], 1000)
    cut = np.r_[0:1500, 1700:4000]
    X, y = X.assign(run=run).iloc[cut], y.iloc[cut]
    X.iloc[1495:1520, 1] = np.nan  # over a gap of 200 minutes
    X.iloc[2790:2830, 0] = np.nan  # over a change of run
    fill = {"room": ("estimate", "30 min")}
    model = DynamicBiasRegressor(**MODEL, run="run", max_gap="20 min", fill=fill)
    model.fit(X[:2400], y[:2400])
    assert_live_is_whole(model, X[2400:], y[2400:])


def test_a_damaged_date_does_not_end_the_filling(device):
    X, y, _, _, model = device
    lost = X[LEARNED:][:200].copy()
    lost.iloc[50:110, 1] = np.nan
    whole = model.evaluate(lost, y[LEARNED:][:200])
    live, flags = OnlineCorrector(model), []
    for k, (time, (case, room)) in enumerate(zip(lost.index, lost.to_numpy(), strict=True)):
        when = time + pd.Timedelta("30 D") if k == 80 else time
        flags.append(live.update(when, case, float(y.iloc[LEARNED + k]), room=room).flag)
    assert flags[:80] + flags[81:110] == whole["flag"].tolist()[:80] + whole["flag"].tolist()[81:110]


def test_an_event_in_a_row_that_lacks_its_temperature_is_an_event():
    X, y, _, _ = two_surfaces(18, n=3000)
    marks = np.zeros(3000)
    marks[1000] = 1
    log = X[["case"]].assign(stepped=marks)
    log.iloc[1000, 0] = np.nan
    model = DynamicBiasRegressor("case", [600.0], effects=[Events(column="stepped")]).fit(log, y)
    assert "events: 1" in model.contributions(log)
    both = pd.concat([log, log]).assign(run=np.repeat(["a", "b"], 3000)).sort_index(kind="stable")
    with pytest.raises(RecordError, match="stands in runs that overlap in time"):
        DynamicBiasRegressor("case", [600.0], run="run", effects=[Events(column="stepped")]).fit(
            both, np.repeat(y.to_numpy(), 2)
        )


def test_uncertainty_with_weights_is_refused(device):
    X, y, _, _, _ = device
    weight = np.where(np.arange(len(X)) % 2, 1.0, 25.0)
    model = DynamicBiasRegressor(**MODEL).fit(X, y, sample_weight=weight)
    with pytest.raises(ValueError, match="readings with weights"):
        model.correct(X, y, return_std=True)


def test_the_workbench_takes_a_model_of_several_thermometers(device):
    X, y, _, _, _ = device
    bench = bench_of(DynamicBiasRegressor(["case", "room"]), X[:3000], y[:3000])
    assert bench.problem is None or not bench.problem
    assert bench.fit().model.residual_std_ < 0.012


def late_humidity(seed, n=9000):
    """A device that feels a wandering humidity late; the reading without its noise."""
    rng = np.random.default_rng(seed)
    wander = pd.Series(rng.standard_normal(n)).ewm(span=400).mean() * 20
    X = two_surfaces(seed, n=n)[0]
    late = wander.ewm(alpha=1 - np.exp(-STEP / 3000.0), adjust=False).mean()
    X = X[["case"]].assign(humidity=40 + wander.to_numpy())
    truth = 0.05 * (X["case"] - 25) + 0.01 * late.to_numpy()
    return X, truth + 0.002 * rng.standard_normal(n), truth


@pytest.mark.long
@pytest.mark.parametrize("rule", ["end", ("end", "30 min")])
def test_a_hole_ends_the_segment(rule, tmp_path):
    """Missing humidity for 10 and 60 minutes: what begins behind it is a start that the fit does not know."""
    X, y, _ = late_humidity(36)
    X.iloc[2000:2060, 1] = np.nan
    model = DynamicBiasRegressor("case", [600.0], effects=[Covariate("humidity")], fill={"humidity": rule})
    model.fit(X[:5000], y[:5000])
    assert len(model.features_.history_.record.segments) == 2
    later, readings = X[5000:5600].copy(), y[5000:5600]
    later.iloc[100:110, 1] = np.nan
    later.iloc[300:360, 1] = np.nan
    later.iloc[360:365, 0] = np.nan  # the first rows behind it lack another cell
    later.iloc[590:, 1] = np.nan
    flags = model.flags(later)
    anew = [row for row in range(600) if flags.iloc[row] == "washout" and flags.iloc[row - 1] != "washout"]
    assert anew == ([110, 365] if rule == "end" else [365])
    assert_live_is_whole(model, later, readings, (1, 7, 105, 362, 600))
    save_model(model, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    pd.testing.assert_series_equal(again.correct(later, readings), model.correct(later, readings))
    assert_live_is_whole(again, later, readings, (50,))


@pytest.mark.parametrize("size", [1, 50, 600])
def test_a_damaged_date_behind_a_hole_that_ended_a_segment_begins_none(size):
    X, y, _ = late_humidity(37)
    model = DynamicBiasRegressor("case", [600.0], effects=[Covariate("humidity")], fill={"humidity": "end"}).fit(
        X[:5000], y[:5000]
    )
    later, readings = X[5000:5600].copy(), y[5000:5600]
    later.iloc[100:110, 1] = np.nan
    good = np.delete(np.arange(600), 300)
    whole = model.evaluate(later.iloc[good], readings.iloc[good])
    times = later.index.to_series().to_numpy().copy()
    times[300] += np.timedelta64(30, "D")
    damaged, live = later.set_index(pd.TimedeltaIndex(times)), OnlineCorrector(model)
    readings = readings.to_numpy()
    parts = [live.update_many(damaged[at : at + size], readings[at : at + size]) for at in range(0, 600, size)]
    shown = pd.concat(parts).iloc[good]
    assert (shown["flag"] == "washout").sum() == (whole["flag"] == "washout").sum() == 30  # three time constants
    assert np.nanmax(np.abs(shown["corrected"].to_numpy() - whole["corrected"].to_numpy())) < 1e-9
