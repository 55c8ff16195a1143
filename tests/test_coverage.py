"""Temperatures that a record covers: powers that they do not determine, and rows between them."""

import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest
from firmware_runs import WARNINGS, compile_c, run_c

from thermocorr import DynamicBiasRegressor, OnlineCorrector, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.firmware import export_c
from thermocorr.model.reading import Coverage
from thermocorr.records import read_record
from thermocorr.records.read import Layout


def plateaus(levels, curve=0.0, seed=0, hold=200):
    """Levels held for some minutes each, three times; the device follows with 20 min, and its law may be curved."""
    rng = np.random.default_rng(seed)
    room = np.repeat([*levels, *levels[::-1], *levels], hold) + 0.02 * rng.standard_normal(3 * len(levels) * hold)
    inner = np.empty_like(room)
    inner[0] = room[0]
    for k in range(1, len(room)):
        inner[k] = inner[k - 1] + (room[k] - inner[k - 1]) * (1 - np.exp(-1 / 20))
    reading = law(inner, curve) + 0.02 * rng.standard_normal(len(room))
    times = pd.date_range("2024-01-01", periods=len(room), freq="min")
    return pd.DataFrame({"temperature": room}, index=times), pd.Series(reading, index=times, name="reading")


def law(T, curve):
    return 0.05 * (T - 30) + curve * (T - 30) ** 2


def settled(low, high):
    """Nine levels, each held for days, soon after; rows are the last of each."""
    levels, times = np.linspace(low, high, 9), pd.date_range("2024-01-02 06:00", periods=90_000, freq="min")
    room = np.interp(np.arange(90_000), np.arange(18) * 5000, np.repeat(levels, 2))
    return pd.DataFrame({"temperature": room + 0.02 * np.random.default_rng(9).standard_normal(90_000)}, times), levels


ROWS = np.arange(9) * 10_000 + 4900


@pytest.mark.parametrize("curve", [0.0, 0.0006])
@pytest.mark.parametrize("seed", range(3))
def test_between_two_plateaus_the_law_is_right_or_its_rows_are_flagged(curve, seed):
    """The default quadratic was wrong by 0.9 between them, of an effect of 1.7, and no row was flagged."""
    model = DynamicBiasRegressor("temperature").fit(*plateaus([13, 47.5], curve, seed))
    assert model.degree_ == 1 and any("too few levels to determine (T - T0)^2" in note for note in model.notes_)
    X, levels = settled(13, 47.5)
    error = np.abs(np.asarray(model.predict(X))[ROWS] - law(levels, curve))
    wrong = error > 0.05
    flags, (_, u) = np.asarray(model.flags(X))[ROWS], model.predict(X, return_std=True)
    assert wrong.any() == bool(curve)
    assert (flags[wrong] == "outside fitted range").all() and flags[0] != "outside fitted range"
    assert (np.asarray(u)[ROWS][wrong] > error[wrong] / 2).all()


def test_three_plateaus_determine_a_parabola():
    model = DynamicBiasRegressor("temperature").fit(*plateaus([13, 30, 47.5], 0.0006))
    X, levels = settled(13, 47.5)
    assert model.degree_ == 2
    assert np.abs(np.asarray(model.predict(X))[ROWS] - law(levels, 0.0006)).max() < 0.05


def covered(T, degree=2):
    frame = pd.DataFrame({"temperature": T}, index=pd.date_range("2024-01-01", periods=len(T), freq="min"))
    return Coverage.of(read_record(frame, Layout("temperature")), degree)


def test_what_a_ramp_passes_is_covered_and_four_levels_check_a_parabola():
    rng = np.random.default_rng(1)
    wander = 20 + np.cumsum(rng.standard_normal(2000)) / 10
    assert covered(wander) == Coverage(2, ())
    assert covered(np.repeat([10.0, 20.0, 30.0, 40.0], 100)) == Coverage(2, ())
    assert covered(np.linspace(10, 40, 300)) == Coverage(2, ())
    assert covered(np.repeat([10.0, 40.0], 100)).degree == 1
    assert len(covered(np.repeat([10.0, 25.0, 40.0], 100)).gaps) == 2  # a cubic would not be seen there


def test_an_ordinary_record_has_no_gaps():
    for seed in range(20):
        record = make_record(1000, seed=seed)
        assert covered(record["temperature"].to_numpy()).degree == 2


def test_live_and_loaded_models_flag_the_same_rows(tmp_path):
    model = DynamicBiasRegressor("temperature", time_constants=["20 min"]).fit(*plateaus([13, 47.5]))
    save_model(model, tmp_path / "model.json")
    loaded = load_model(tmp_path / "model.json")
    assert loaded.reading_.temperature_gaps == model.reading_.temperature_gaps != ()
    X, _ = settled(13, 47.5)
    X = X[:20_000]
    live = OnlineCorrector(loaded)
    flags = [live.update(time, T, 0.0).flag for time, T in zip(X.index, X["temperature"], strict=True)]
    assert list(model.flags(X)) == flags
    assert flags.count("outside fitted range") > 5000


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_the_exported_c_flags_what_lies_between_two_plateaus(tmp_path):
    model = DynamicBiasRegressor("temperature", time_constants=["20 min"]).fit(*plateaus([13, 47.5]))
    export = export_c(model, tmp_path)
    sources = [str(path) for path in export.paths if path.suffix == ".c"]
    subprocess.run(["gcc", *WARNINGS, *sources, "-lm", "-o", str(tmp_path / "test")], check=True)
    done = subprocess.run([str(tmp_path / "test")], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "passed: " in done.stdout, done.stdout
    (low, high), *_ = model.reading_.temperature_gaps
    new = pd.DataFrame(
        {"temperature": np.linspace(low - 1, high + 1, 3000)}, pd.date_range("2030", periods=3000, freq="min")
    )
    run = run_c(compile_c(export), new, np.ones(3000))
    inside = (new["temperature"] > low) & (new["temperature"] < high)
    assert ((run.flags & 8) > 0)[inside].all() and not ((run.flags & 8) > 0).all()
