"""Which correction, if any: what `analyze` begins with, and what `compare_variants(...).best_` is."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, compare_variants, diagnose, load_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import Step
from thermocorr.model.advice import NEEDLESS, REFINED, advise_refined

N = 600


def wandering(rng, rows, n=N):
    kept = np.exp(-1 / rows)
    return lfilter([np.sqrt(1 - kept**2)], [1, -kept], rng.standard_normal(n + 2000))[2000:]


def hourly(temperature, reading):
    times = pd.date_range("2024-01-01", periods=len(reading), freq="h", name="time")
    return pd.DataFrame({"temperature": temperature}, index=times), pd.Series(reading, times, name="reading")


def advised(X, y, **options):
    return compare_variants(X, y, temperature="temperature", **options)


NOISES = {
    "white": lambda rng: rng.standard_normal(N),
    "wander": lambda rng: wandering(rng, 10) + 0.3 * rng.standard_normal(N),
    "slow wander": lambda rng: wandering(rng, 100) + 0.3 * rng.standard_normal(N),
    "walk": lambda rng: 0.2 * np.cumsum(rng.standard_normal(N)) + 0.3 * rng.standard_normal(N),
    "jumps": lambda rng: np.repeat(3 * rng.standard_normal(4), N // 4) + 0.3 * rng.standard_normal(N),
    "drift": lambda rng: np.linspace(0, 3, N) + 0.3 * rng.standard_normal(N),
}
ROOMS = {"white": lambda rng: rng.standard_normal(N), "weather": lambda rng: 3 * wandering(rng, 60) + wandering(rng, 8)}


@pytest.mark.long
@pytest.mark.newest
def test_a_thermometer_that_has_nothing_to_do_with_the_reading_is_not_corrected_by():
    """Those of other devices on measured records: `benchmarks/placebo.py`."""
    chosen = []
    for room, temperature in ROOMS.items():
        for noise, reading in NOISES.items():
            for seed in range(2):
                rng = np.random.default_rng([seed, 11])
                found = advised(*hourly(20 + temperature(rng), reading(rng)))
                chosen += [(room, noise, seed)] if found.advice.choice != "none" else []
    assert len(chosen) <= 1


def test_a_static_device_is_corrected_by_a_static_law():
    rng = np.random.default_rng(3)
    X, _ = hourly(20 + ROOMS["weather"](rng), np.zeros(N))
    y = 0.35 * X["temperature"] + 0.0098 * rng.standard_normal(N)
    found = advised(X, y)
    assert found.advice.variant == "static linear" and found.best_ is found.models["static linear"]
    assert found.advice.after == pytest.approx(0.0098, rel=0.15)
    assert found.advice.before > 50 * found.advice.after
    assert found.advice.sentence().startswith("Use the static linear correction: it leaves 0.0")


def test_a_dynamic_device_is_corrected_by_a_dynamic_law():
    record = make_record(4000, seed=7)
    found = advised(record[["temperature"]], record["reading"], time_constants=["5 min", "90 min"])
    assert (found.advice.choice, found.advice.variant) == ("dynamic", "dynamic linear")
    assert list(found.advice.table.index) == ["level", "latest level", "level and drift", *found.models]
    assert "dynamic linear *" in str(found.advice) and "static linear *" not in str(found.advice)


def test_each_stretch_is_predicted_from_what_came_before():
    record = make_record(2400, seed=7)
    X, y = record[["temperature"]], record["reading"]
    table = advised(X, y, time_constants=["5 min", "90 min"]).advice.table
    for number in range(6):
        low, high = 960 + 240 * number, 1200 + 240 * number
        T, known = np.vander(X["temperature"] - 20, 2), slice(0, low)
        missed = (y - T @ np.linalg.lstsq(T[known], y[known], rcond=None)[0])[low:high]
        assert table.loc["static linear", number + 1] == pytest.approx(np.sqrt(np.mean(missed**2)), rel=1e-3)
        plain = y[low:high] - y[:low].mean()
        assert table.loc["level", number + 1] == pytest.approx(np.sqrt(np.mean(plain**2)), rel=1e-6)
        known = slice(0, 1680)  # the last 30 % from the first 70 %
    missed = (y - T @ np.linalg.lstsq(T[known], y[known], rcond=None)[0])[1680:]
    assert table.loc["static linear", "from 70 %"] == pytest.approx(np.sqrt(np.mean(missed**2)), rel=1e-3)
    assert table["all"].to_numpy() == pytest.approx(np.exp(np.log(table[range(1, 7)]).mean(axis=1)))


@pytest.mark.parametrize("levels", [(13.0, 47.5), (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)])
def test_plateaus_are_corrected_by_a_static_law(levels):
    rng = np.random.default_rng(5)
    T = np.repeat(levels, N // len(levels)) + 0.02 * rng.standard_normal(N)
    found = advised(*hourly(T, 0.5 * T + 0.01 * rng.standard_normal(N)))
    assert found.advice.choice == "static"


def test_a_course_that_repeats_itself_is_said_to_be_no_proof():
    rng = np.random.default_rng(6)
    T = 20 + 5 * np.sin(2 * np.pi * np.arange(N) / 24)
    found = advised(*hourly(T, T + 0.1 * rng.standard_normal(N)))
    assert found.advice.choice == "static" and np.isnan(found.advice.copies_db)
    assert "a coincidence cannot be excluded" in found.advice.unproven


def test_too_short_a_record_says_so():
    record = make_record(80, seed=1)
    found = advised(record[["temperature"]], record["reading"], time_constants=["5 min"])
    assert found.advice.choice == "" and found.best_ is None
    assert "too short" in found.advice.sentence() and "too short" in str(found.advice)


def test_the_command_writes_what_is_advised(tmp_path, capsys):
    rng = np.random.default_rng(8)
    room = ROOMS["weather"](rng)
    logs = {"none": rng.standard_normal(N), "static": 0.5 * room + 0.01 * rng.standard_normal(N)}
    for name, reading in logs.items():
        X, y = hourly(20 + room, reading)
        X.assign(reading=y).to_csv(tmp_path / f"{name}.csv")
    command = ["analyze", "--temperature", "temperature", "--reading", "reading", "--time", "time"]
    assert main([*command, str(tmp_path / "static.csv"), "--out", str(tmp_path / "static")]) == 0
    assert capsys.readouterr().out.startswith("Use the static linear correction")
    assert len(load_model(tmp_path / "static" / "model.json").time_constants_) == 0
    assert main([*command, str(tmp_path / "none.csv"), "--out", str(tmp_path / "none")]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Use no temperature correction") and "No correction is written" in said
    assert not (tmp_path / "none" / "model.json").exists()
    more = ["--variant", "dynamic-linear", "--out", str(tmp_path / "none")]
    assert main([*command, str(tmp_path / "none.csv"), *more]) == 0
    assert isinstance(load_model(tmp_path / "none" / "model.json"), DynamicBiasRegressor)


def test_longer_forecasts_from_before_a_late_step_are_unknown():
    rng = np.random.default_rng(4)
    X, y = hourly(20 + ROOMS["weather"](rng), 0.1 * rng.standard_normal(N))
    y += 0.35 * X["temperature"] + (np.arange(N) > 0.85 * N)
    found = advised(X, y)
    refined = DynamicBiasRegressor("temperature", [], effects=[Step(X.index[int(0.85 * N)])]).fit(X, y)
    table = advise_refined(found.advice, found.models, refined, 0.85, X, y).table
    longer = [column for column in table if str(column).startswith("from")]
    assert table.loc[[REFINED, *NEEDLESS], longer].isna().all(axis=None)
    assert table.loc[[REFINED, *NEEDLESS], "all"].notna().all()


@pytest.mark.parametrize(("device", "seed"), [("layered", 6), ("slab", 5)])
def test_errors_on_later_data_are_those_of_single_readings_by_hand(device, seed):
    """A static law leaves what moves within the averages that errors are computed of: it counts as well.

    Six stretches, each predicted from all before; the averages and the ridge make a few per cent.
    """
    record = make_record(12_000, device=device, seed=seed)
    X, y = record[["temperature"]], record["reading"]
    comparison = compare_variants(X, y, temperature="temperature", n_blocks=2)
    edges = np.linspace(0, len(y), 81).astype(int)
    for name in ("static linear", "dynamic linear"):
        model, squares = clone(comparison.models[name]), []
        model.set_params(time_constants=comparison.models[name].time_constants_.tolist())
        for stop in range(32, 80, 8):
            before, behind = slice(edges[stop]), slice(edges[stop], edges[stop + 8])
            squares.append(np.mean((y[behind] - model.fit(X[before], y[before]).predict(X[behind])) ** 2))
        by_hand = np.sqrt(np.exp(np.mean(np.log(squares))))
        assert comparison.advice.table["all"][name] == pytest.approx(by_hand, rel=0.04)
        fitted = comparison.models[name]
        assert diagnose(fitted, X, y).later_rms == pytest.approx(by_hand, rel=0.04)
