"""What the temperature does between its rows: how much of it a model feels, and what a diagnosis puts down to it."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicHermiteSpline

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.estimators.between_rows import felt_between_rows
from thermocorr.records import read_record

pytestmark = pytest.mark.newest


spec = importlib.util.spec_from_file_location("bench", Path(__file__).parents[1] / "benchmarks" / "slow_logs.py")
bench = importlib.util.module_from_spec(spec)
spec.loader.exec_module(bench)


def judged(room, seed, minutes, hidden="nothing"):
    X, y = bench.simulated(room, seed, 60.0 * minutes, 2500, hidden)
    return diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)


def fitted(X, y, **options):
    model = DynamicBiasRegressor("temperature", **options).fit(X, y)
    return model, read_record(X, model.features_.layout(), y=y, quiet=True)


@pytest.mark.parametrize("irregular", [0.0, 0.4])
def test_it_is_what_a_finer_record_of_the_curve_would_move(irregular):
    """A room that swings within four rows; the curve in a record of sixteen rows for each."""
    rng = np.random.default_rng(3)
    seconds = np.cumsum(300 * (1 + irregular * rng.uniform(-1, 1, 3000)))
    T = 21 + 0.3 * np.sin(seconds / 250) + 0.2 * np.sin(seconds / 40_000)
    X = pd.DataFrame({"temperature": T, "t": seconds})
    y = 2 * T + 0.01 * rng.standard_normal(3000)
    model, record = fitted(X, y, time_constants=["20 min", "1 h"], degree=1, time="t", initial_state="equilibrium")
    model.coef_[1:3] = 0.5, 0.7  # bodies that the readings do not have
    rows, fine = np.arange(3000.0), np.arange(0, 2999.001, 1 / 16)
    slopes = np.gradient(T, seconds)
    times = np.interp(fine, rows, seconds)
    walk = {
        "curve": CubicHermiteSpline(seconds, T, slopes)(times),
        "line": np.interp(times, seconds, T),
    }
    lags = {
        name: model.features_.transform(pd.DataFrame({"temperature": values, "t": times}))[::16, 1:3]
        for name, values in walk.items()
    }
    moved = (lags["curve"] - lags["line"]) @ [0.5, 0.7]
    assert felt_between_rows(model, record).curve == pytest.approx(moved.std(), rel=0.1)


def test_it_is_no_more_than_the_gain_allows():
    """Lags that stand for a delay have weights that no body has."""
    record = make_record(3000, effects={"delay": 2.0}, seed=2)
    model, read = fitted(record[["temperature"]], record["reading"])
    T = record["temperature"].to_numpy()
    rise = np.diff(T, 2).std() / 8
    assert 0 < felt_between_rows(model, read).curve <= 1.01 * record["reading"].std() / T.std() * rise


def test_what_happens_in_gaps_is_another_matter():
    record = make_record(4000, seed=5)
    whole, gappy = record, record[(np.arange(4000) < 1500) | (np.arange(4000) >= 1700)]
    felt = [
        felt_between_rows(*fitted(r[["temperature"]], r["reading"], time_constants=["1 h"])) for r in (whole, gappy)
    ]
    assert felt[1].curve == pytest.approx(felt[0].curve, rel=0.3)
    assert felt[1].turning == pytest.approx(felt[0].turning, rel=0.1)


@pytest.mark.parametrize(("step", "turning"), [(60.0, 2 * np.sin(0.1)), (600.0, 2 * np.sin(1.0))])
def test_a_wave_turns_more_sharply_in_a_slow_log(step, turning):
    """Of a wave the slope from row to row is a wave, too; its changes are 2 sin(half a step's phase) of it."""
    times = step * np.arange(3000)
    X = pd.DataFrame({"temperature": 21 + np.sin(times / 300.0), "t": times})
    y = X["temperature"] + 0.01 * np.random.default_rng(1).standard_normal(3000)
    found = felt_between_rows(*fitted(X, y, time_constants=["1 h"], time="t"))
    assert found.turning == pytest.approx(turning, rel=1e-3)


def test_a_staircase_and_a_model_without_lags_have_nothing_between_rows():
    record = make_record(2000, seed=1)
    X, y = record[["temperature"]], record["reading"]
    assert felt_between_rows(*fitted(X, y, time_constants=[])) == (0.0, 0.0)
    assert felt_between_rows(*fitted(X, y, time_constants=["10 min"], hold="zero_order")) == (0.0, 0.0)
    assert felt_between_rows(*fitted(X, y, time_constants=["10 min"])).curve > 0.0


@pytest.mark.parametrize("seed", [31, 32])
def test_what_the_log_does_not_show_is_no_cause(seed):
    """Leads and knees are proven of a device that lacks nothing, at a row every five minutes."""
    found = judged("brisk", seed, minutes=5)
    assert found.verdict == "nothing missing" and not found.causes
    assert "hinge" in found.left.between_rows
    assert 0.003 < found.left.swings < 0.02
    assert "no more than the temperature may have made between its rows" in " ".join(str(found).split())


def test_nothing_is_put_down_to_a_log_that_shows_the_room():
    found = judged("brisk", 31, minutes=1)
    assert not found.causes
    assert found.left.between_rows == () and found.left.swings == 0.0
    assert "between its rows" not in str(found)


@pytest.mark.parametrize("seed", [32, 33])
def test_a_heating_within_one_row_is_no_cause_either(seed):
    """The curve through the rows makes a sixth of the knees that are proven."""
    found = judged("calm", seed, minutes=2.5)
    assert not found.causes and "hinge" in found.left.between_rows


@pytest.mark.parametrize("seed", [33, 34])
def test_a_late_clock_beside_such_a_heating_is_named(seed):
    found = judged("calm", seed, minutes=2.5, hidden="clock")
    assert found.causes[0].effect.kind == "lead"


@pytest.mark.parametrize("kind", ["hinge", "hysteresis", "lead"])
def test_a_true_cause_in_a_slow_log_is_named(kind):
    record = make_record(3000, sampling_period=600.0, setting="outdoor", effects={kind: 1.0}, seed=12)
    X, y = record[["temperature"]], record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.causes[0].effect.kind == kind


def test_what_helps_where_rows_resolve_the_room_is_a_cause():
    """A hysteresis of half the noise outdoors, a row every ten minutes: as large as the curve, and worth 0.9 dB."""
    record = make_record(
        17_280, sampling_period=600.0, setting="outdoor", device="layered", effects={"hysteresis": 0.5}, seed=8414
    )
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert [cause.effect.kind for cause in found.causes] == ["hysteresis"]
