"""Doubtful inputs: what is held back, what is doubted and for how long, alike in records, streams and exported code."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, load_model, save_model
from thermocorr.effects import Delay, LaggedCovariate
from thermocorr.records.gate import Gate, Motion

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
faults = pytest.importorskip("faults", reason="needs benchmarks/, which a checkout has")

MOTION = Motion(low=20.0, high=26.0, spread=1.0, farthest=0.1, rest=60.0, step=60.0)


def judged(values, times=None, max_gap=np.inf, motion=MOTION):
    """What a gate says of rows, a minute apart by default: values, twins, held, accepted."""
    times = 60.0 * np.arange(len(values)) if times is None else times
    single = Gate(motion, max_gap)
    said = [single.one(float(value), float(time)) for value, time in zip(values, times, strict=True)]
    many = Gate(motion, max_gap).many(np.asarray(values, float), times)
    for k, each in enumerate(said):  # one by one and at once
        expected = (values[k], np.nan, False, False) if each is None else tuple(each)
        found = expected if many is None else tuple(column[k] for column in many)
        np.testing.assert_array_equal(np.array(found, float), np.array(expected, float))
    return many


def quiet(n=60):
    return 23.0 + 0.05 * np.sin(np.arange(n) / 5.0)


def test_what_moves_as_it_did_is_believed():
    assert judged(quiet()) is None


def test_a_value_that_returns_is_held_back_alone():
    values = quiet()
    values[20] = 85.0
    said = judged(values)
    assert np.flatnonzero(said.held).tolist() == [20]
    assert said.value[20] == values[19]
    assert np.flatnonzero(np.isfinite(said.twin)).tolist() == [20]


def test_a_value_that_stays_is_doubted_until_it_returns():
    values = quiet()
    values[20:30] += 2.0
    said = judged(values)
    assert np.flatnonzero(said.held).tolist() == [20]
    assert np.flatnonzero(np.isfinite(said.twin)).tolist() == list(range(20, 30))
    assert (said.twin[21:30] == values[19]).all() and not said.accepted.any()


@pytest.mark.parametrize("moved", [2.0, 9.0])
def test_a_room_that_has_moved_is_believed_after_a_while_in_the_fitted_range(moved):
    values = quiet(200)
    values[20:] += moved
    said = judged(values)
    end = int(np.append(np.flatnonzero(said.accepted), 200)[0])
    assert np.flatnonzero(np.isfinite(said.twin)).tolist() == list(range(20, end))
    assert 20 < end < 140 if moved < 5 else end == 200


@pytest.mark.parametrize("missing", [0, 1, 20, 31])
@pytest.mark.parametrize("bad", [2, 25, 31, 45])
def test_a_fault_is_not_believed_by_the_clock(bad, missing):
    """Whatever pause follows on it, the input is back with its first sound value, and sound values are not doubted."""
    values, minutes = quiet(200), np.arange(200.0)
    values[20 : 20 + bad] += 9.0
    kept = np.r_[0 : 20 + bad, 20 + bad + missing : 200]
    said = judged(values[kept], 60.0 * minutes[kept])
    assert not said.accepted.any()
    assert np.flatnonzero(np.isfinite(said.twin)).tolist() == list(range(20, 20 + bad))


def test_an_input_that_stands_still_is_doubted_but_for_the_ends_of_its_range():
    values = quiet(80)
    values[20:50] = values[20]
    said = judged(values)
    doubted = np.flatnonzero(np.isfinite(said.twin)).tolist()
    assert doubted == list(range(doubted[0], 50)) and 21 < doubted[0] < 35
    values = np.concatenate((np.linspace(20.5, 20.0, 20), np.full(60, 20.0)))
    assert judged(values) is None


@pytest.mark.parametrize("first", [85.0, -40.0])
def test_a_first_value_far_outside_is_held_back(first):
    said = judged(np.concatenate(([first], quiet(20))))
    assert said.held[0] and said.value[0] == np.clip(first, 20.0, 26.0)


@pytest.fixture(scope="module")
def device():
    effect = LaggedCovariate("humidity", ["20 min"])
    made = faults.Device(effect, 7)
    return made, made.fit()


@pytest.mark.parametrize("effect", [None, *faults.EXAMPLES][::4], ids=lambda e: "none" if e is None else e.label())
def test_no_fault_moves_readings_in_silence(effect, tmp_path):
    made = faults.Device(effect, 11)
    found = pd.DataFrame(faults.in_use("", made, np.random.default_rng(0), str(tmp_path)))
    known = ~found["fault"].isin((*faults.UNSEEN, "missing, 8 rows", "missing, 30 rows"))
    assert found[known]["silent"].sum() <= 1 < 100 < found[known]["wrong"].sum()


@pytest.mark.parametrize("fault", ["85, ten rows", "jump of 12 rows", "stuck", "missing, 8 rows", "999, one row"])
@pytest.mark.parametrize("column", ["temperature", "humidity"])
def test_streams_and_files_say_what_the_whole_record_says(device, fault, column, tmp_path):
    made, model = device
    clean, y = made.X[faults.FITTED :], made.reading[faults.FITTED :]
    every = dict(faults.faults(clean[column].to_numpy(), faults.AT, faults.SCALES[column], np.random.default_rng(1)))
    X = clean.assign(**{column: every[fault]})
    whole = model.evaluate(X, y, return_std=True)
    save_model(model, tmp_path / "m.json")
    again = load_model(tmp_path / "m.json").evaluate(X, y, return_std=True)
    pd.testing.assert_frame_equal(again, whole)
    stream, parts = OnlineCorrector(model, uncertainty=True), []
    for start in range(0, len(X), 37):
        parts.append(stream.update_many(X[start : start + 37], y[start : start + 37]))
        stream = OnlineCorrector.from_state(model, stream.state())
    found = pd.concat(parts)
    assert [flag for flag in found["flag"] if flag != "gap"] == [
        flag for flag, own in zip(whole["flag"], found["flag"], strict=True) if own != "gap"
    ]
    np.testing.assert_allclose(found["corrected"], whole["corrected"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found["u"], whole["u"], rtol=1e-4)


def test_a_doubted_row_has_a_wider_uncertainty(device):
    made, model = device
    clean, y = made.X[faults.FITTED :], made.reading[faults.FITTED :]
    far = clean.copy()
    far.iloc[200:205, 0] += 3.0
    u, usual = (model.correct(X, y, return_std=True)[1] for X in (far, clean))
    wrong = np.abs(model.correct(far, y) - model.correct(clean, y))
    rows = slice(201, 206)
    assert (u[rows] > 0.3 * wrong[rows]).all() and (u[rows] > 3 * usual[rows]).all()
    assert u.iloc[-1] == pytest.approx(usual.iloc[-1], rel=0.05)


@pytest.mark.parametrize("value", [999.0, 1000.0, -127.0, 1e30])
def test_one_bad_cell_of_a_fitted_column_is_left_out_with_a_note(device, value):
    made, model = device
    X = made.X[: faults.FITTED].copy()
    X.iloc[1500, 1] = value
    fitted = made.fit(X)
    assert fitted.residual_std_ == pytest.approx(model.residual_std_, rel=0.05)
    assert any("'humidity' left out" in note for note in fitted.notes_)


def test_without_the_screen_everything_is_believed(device):
    made, _ = device
    plain = made.fit().set_params(screen=False).fit(made.X[: faults.FITTED], made.reading[: faults.FITTED])
    X = made.X[faults.FITTED :].copy()
    X.iloc[100, 0] = 40.0
    assert set(plain.flags(X)) == {"", "outside fitted range"}


def test_rows_that_do_not_belong_together_are_refused():
    n, rng = 400, np.random.default_rng(0)
    T = 23.0 + np.sin(np.arange(n) / 40.0)
    X, y = pd.DataFrame({"temperature": T}), pd.Series(2 * T + 0.1 * rng.normal(size=n), name="reading")
    model = DynamicBiasRegressor("temperature", [600.0], sampling_period=60.0)
    order, plain = rng.permutation(n), DynamicBiasRegressor(0, [600.0], sampling_period=60.0)
    with pytest.raises(RecordError, match="as if they had been shuffled"):
        plain.fit(X.to_numpy()[order], y.to_numpy()[order])
    with pytest.raises(RecordError, match="numbered from 10 to 399, those of y from 0 to 389"):
        model.fit(X[10:], y[:-10])
    with pytest.raises(RecordError, match="holds times"):
        model.fit(X.assign(temperature=pd.period_range("2024-01-01", periods=n, freq="min")), y)


def test_masked_cells_are_missing_ones():
    n = 400
    T = 23.0 + np.sin(np.arange(n) / 40.0)
    y = 2 * T + 0.1 * np.random.default_rng(0).normal(size=n)
    hidden = np.ma.masked_array(np.where(np.arange(n) == 50, 1e3, y), mask=np.arange(n) == 50)
    model = DynamicBiasRegressor(0, [600.0], sampling_period=60.0)
    found = model.fit(T[:, None], hidden).residual_std_
    assert found == pytest.approx(model.fit(T[:, None], y).residual_std_, rel=0.05)
    covered = np.ma.masked_array(T[:, None] + 0.0, mask=np.arange(n)[:, None] == 70)
    covered.data[70] = 500.0
    assert np.isnan(model.predict(covered)[70])


def test_a_slice_with_runs_and_no_times_is_corrected():
    n = 300
    T = 23.0 + np.sin(np.arange(n) / 40.0)
    X = pd.DataFrame({"temperature": T, "run": np.repeat(["a", "b"], n // 2)})
    model = DynamicBiasRegressor("temperature", [600.0], sampling_period=60.0, run="run").fit(X, 2 * T)
    found = OnlineCorrector(model).update_many(X[200:], 2 * T[200:])
    assert found["corrected"].notna().all()


@pytest.mark.parametrize("size", [0.6, 2.0, 4.0])
@pytest.mark.parametrize("rows", [13, 28])
def test_a_fault_of_less_than_thirty_rows_is_not_back_before_it_is(size, rows):
    values = quiet(120)
    values[20 : 20 + rows] += size
    said = judged(values)
    assert np.flatnonzero(np.isfinite(said.twin)).tolist()[:rows] == list(range(20, 20 + rows))
    assert not said.accepted.any()


def same_as_whole(model, X, y, sizes):
    """A stream in pieces of these sizes says what the whole record says."""
    whole = model.evaluate(X, y, return_std=True)
    for size in sizes:
        stream, parts = OnlineCorrector(model, uncertainty=True), []
        for start in range(0, len(X), size):
            parts.append(stream.update_many(X[start : start + size], y[start : start + size]))
        found = pd.concat(parts)
        np.testing.assert_allclose(found["u"], whole["u"], rtol=1e-4)
        assert [(a, b) for a, b in zip(found["flag"], whole["flag"], strict=True) if a not in (b, "gap")] == []


def test_what_a_delay_still_holds_is_not_forgotten():
    made = faults.Device(Delay("50 min"), 3)
    X, y = made.X[faults.FITTED :].copy(), made.reading[faults.FITTED :]
    X.iloc[200:210, 0] += 3.0
    model = made.fit()
    assert (model.flags(X)[255:258] == "doubtful input").all()  # fifty minutes later
    same_as_whole(model, X, y, [1, 20])


def test_the_doubt_of_one_run_does_not_reach_the_next(device):
    made, _ = device
    X, y = made.X.assign(run=np.repeat(["a", "b"], len(made.X) // 2)), made.reading
    fit = np.r_[0:1500, 1800:3300]
    model = DynamicBiasRegressor("temperature", [600.0], degree=1, run="run").fit(X.iloc[fit], y[fit])
    later = X.iloc[np.r_[1500:1800, 3300:3600]].copy()
    later.iloc[295:300, 0] += 3.0
    same_as_whole(model, later, y[np.r_[1500:1800, 3300:3600]], [1, 600, 290])


def test_an_excursion_in_the_fit_is_left_out_of_one_thermometer_or_two():
    X, y = faults.room(5, 2000), np.random.default_rng(5).normal(size=2000)
    X = X.assign(b=X["temperature"].rolling(30, min_periods=1).mean() + 0.2 * X["humidity"] / 8)
    y = y + 30 * X["temperature"] + 10 * X["b"]
    for given in ("temperature", ["temperature", "b"]):
        model = DynamicBiasRegressor(given, [600.0], degree=1)
        usual = model.fit(X, y).residual_std_
        far = X.copy()
        far.iloc[700:712, 0] += 3.0
        model.fit(far, y)
        assert model.residual_std_ == pytest.approx(usual, rel=0.05)
        assert any("12 temperatures left out as jumps" in note for note in model.notes_)
        assert np.nanstd(model.residuals(far, y)) == pytest.approx(usual, rel=0.1)


def test_a_belief_ends_the_doubt_of_its_own_input_alone():
    made = faults.Device(LaggedCovariate("humidity", ["4 h"]), 3)
    X, y = made.X[faults.FITTED :].copy(), made.reading[faults.FITTED :]
    X.iloc[200:220, 1] += 30.0  # false, and remembered for hours
    X.iloc[225:, 0] += 3.0  # the room has moved
    model = made.fit()
    flags = model.flags(X)
    assert (flags[226:255] == "doubtful input").all()  # nobody knows yet
    wrong = np.abs(model.predict(X) - model.predict(X.assign(humidity=made.X["humidity"])))
    assert (flags[256:400][wrong[256:400] > 2 * model.residual_std_] == "doubtful input").all()
    assert (wrong[256:300] > 2 * model.residual_std_).any()
    same_as_whole(model, X, y, [1, 20])
