"""Several thermometers, each with time constants of its own; one that is lost; columns with missing cells."""

import io

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import (
    DiffusiveFeatures,
    DynamicBiasRegressor,
    OnlineCorrector,
    RecordError,
    TimeConstantSearch,
    diagnose,
    load_model,
    refine,
    save_model,
)
from thermocorr.command.cli import main
from thermocorr.effects import Covariate

STEP, LEARNED = 60.0, 7000
BODIES = {"case": (600.0, 5400.0), "room": (1200.0, 20_000.0)}
"""Time constants of the device behind each of its two surfaces [s]."""


def wander(rng, n, memory, deviation):
    decay = np.exp(-STEP / memory)
    white = rng.standard_normal(n) * deviation * np.sqrt(1 - decay**2)
    return lfilter([1], [1, -decay], white)


def followed(T, tau):
    """A body of one time constant, stepped in twenty parts of each step: no formula of the package."""
    fine = np.interp(np.arange(20 * len(T)) / 20, np.arange(len(T)), T)
    decay = np.exp(-STEP / 20 / tau)
    return lfilter([1 - decay], [1, -decay], fine, zi=[decay * fine[0]])[0][::20]


def two_surfaces(seed, n=10_000, noise=0.01):
    """Case and room, the reading, and the reading without noise. The case follows the room and a fan of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * STEP
    room = (
        23
        + np.sin(2 * np.pi * t / 86_400 + rng.uniform(0, 6))
        + wander(rng, n, 20_000, 0.4)
        + wander(rng, n, 3000, 0.15)
    )
    case = 25 + 0.8 * (followed(room, 1500.0) - 23) + wander(rng, n, 7200, 0.15) + wander(rng, n, 1000, 0.05)
    U = 100 + 0.4 * (case - 25) + 0.2 * (room - 23)
    for T, shares in ((case, (0.5, 0.3)), (room, (-0.3, 0.4))):
        for tau, share in zip(BODIES["case" if T is case else "room"], shares, strict=True):
            U = U + share * (followed(T, tau) - T)
    X = pd.DataFrame({"case": case, "room": room}, index=pd.to_timedelta(t, unit="s"))
    return X, pd.Series(U + noise * rng.standard_normal(n), index=X.index, name="reading"), U, noise


@pytest.fixture(scope="module")
def device():
    X, y, U, noise = two_surfaces(1)
    return X, y, U, noise, DynamicBiasRegressor(["case", "room"]).fit(X[:LEARNED], y[:LEARNED])


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_both_sets_of_time_constants_are_found_and_later_rows_are_predicted_to_the_noise(seed):
    X, y, U, noise = two_surfaces(seed)
    model = DynamicBiasRegressor(["case", "room"]).fit(X[:LEARNED], y[:LEARNED])
    for name, true in BODIES.items():
        found = np.log(model.thermometers_[name])
        assert all(abs(found - np.log(tau)).min() < np.log(1.5) for tau in true), (name, model.thermometers_)
    error = model.predict(X[LEARNED:]) - U[LEARNED:]
    given = DynamicBiasRegressor(["case", "room"], BODIES).fit(X[:LEARNED], y[:LEARNED])
    oracle = given.predict(X[LEARNED:]) - U[LEARNED:]
    assert np.sqrt(np.mean(oracle**2)) < 0.2 * noise  # the device is what the test says
    assert np.sqrt(np.mean(error**2)) < 0.3 * noise
    one = DynamicBiasRegressor("case").fit(X[:LEARNED], y[:LEARNED])
    assert np.sqrt(np.mean((one.predict(X[LEARNED:]) - U[LEARNED:]) ** 2)) > 3 * noise


def test_nothing_is_missing_beside_both_thermometers_and_refine_adds_nothing(device):
    X, y, _, _, model = device
    assert diagnose(model, X[:LEARNED], y[:LEARNED]).verdict == "nothing missing"
    refined = refine(DynamicBiasRegressor(["case", "room"]), X[:LEARNED], y[:LEARNED])
    assert [step for step in refined.steps["effect"] if step] == []


def test_a_missing_lag_joins_those_of_its_thermometer(device):
    X, y, _, _, _ = device
    lacking = DynamicBiasRegressor(["case", "room"], {"case": [600.0, 5400.0], "room": [1200.0]})
    refined = refine(lacking, X[:LEARNED], y[:LEARNED])
    assert not refined.model_.effects  # it is no effect of its own
    assert len(refined.model_.thermometers_["room"]) > 1
    assert refined.model_.residual_std_ < 1.05 * 0.01


def test_what_each_thermometer_carries_stands_beside_each_other(device):
    X, _, _, _, model = device
    parts = model.contributions(X)
    assert list(parts) == ["static polynomial", "thermal lag", "initial transient", "lagged covariate: room"]
    assert np.allclose(parts.sum(axis=1) + model.intercept_, model.predict(X), atol=1e-12)


def test_a_stream_a_file_and_a_copy_say_the_same(device, tmp_path):
    X, y, _, _, model = device
    whole = model.correct(X, y)
    save_model(model, tmp_path / "model.json")
    for each in (model, load_model(tmp_path / "model.json")):
        live = OnlineCorrector(each)
        later = zip(X.index[LEARNED:][:300], X[LEARNED:].to_numpy(), y[LEARNED:], strict=False)
        rows = [live.update(t, case, u, room=room).corrected for t, (case, room), u in later]
        assert np.abs(whole[LEARNED : LEARNED + 300] - rows).max() < 1e-12
    again = DynamicBiasRegressor(["case", "room"], model._fixed_time_constants(), alpha=model.alpha_)
    assert np.allclose(again.fit(X[:LEARNED], y[:LEARNED]).coef_, model.coef_, rtol=1e-9)


def test_columns_of_an_array_and_of_the_transformer(device):
    X, y, _, _, _ = device
    named = DynamicBiasRegressor(["case", "room"], [600.0]).fit(X, y)
    numbered = DynamicBiasRegressor([0, 1], [600.0], sampling_period=STEP).fit(X.to_numpy(), y.to_numpy())
    assert np.allclose(named.coef_, numbered.coef_, rtol=1e-9)
    features = DiffusiveFeatures({"case": [600.0]}, temperature=["case", "room"], initial_state="equilibrium")
    features.set_output(transform="pandas")
    assert list(features.fit_transform(X)) == ["case", "lag[600 s]", "room"]


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"temperature": []}, "must be a column, or a list of different ones"),
        ({"temperature": ["case", "case"]}, "must be a column, or a list of different ones"),
        ({"time_constants": {"rom": [60]}}, "names 'rom', which is not among the thermometers"),
    ],
)
def test_what_makes_no_sense_is_refused(device, parameters, said):
    X, y, _, _, _ = device
    with pytest.raises(ValueError, match=said):
        DynamicBiasRegressor(**{"temperature": ["case", "room"], "time_constants": [600.0], **parameters}).fit(X, y)


def test_the_search_for_one_thermometer_says_what_it_is_not_for(device):
    X, y, _, _, model = device
    with pytest.raises(ValueError, match="searches the time constants of one thermometer"):
        TimeConstantSearch(model).fit(X, y)


def with_hole(X, column, start, rows=60):
    lost = X.copy()
    lost.iloc[start : start + rows, lost.columns.get_loc(column)] = np.nan
    return lost, slice(start, start + rows)


@pytest.mark.parametrize("column", ["case", "room"])
def test_a_lost_thermometer_is_no_temperature(column, device):
    X, y, _, _, model = device
    lost, hole = with_hole(X, column, 8000)
    assert set(model.flags(lost, y)[hole]) == {"no temperature"}
    assert np.isnan(model.correct(lost, y)[hole]).all()


def test_the_command_takes_several_thermometers(device, tmp_path, capsys):
    X, y, _, _, _ = device
    log = X[:3000].assign(U=y[:3000])
    log.insert(0, "time", np.arange(3000) * STEP)
    log.to_csv(tmp_path / "log.csv", index=False)
    options = ["--temperature", "case", "--temperature", "room", "--reading", "U"]
    assert main(["analyze", str(tmp_path / "log.csv"), *options, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "temperatures 'case', 'room'" in said
    assert (
        main(["correct", "--model", str(tmp_path / "out" / "model.json"), str(tmp_path / "log.csv"), "--reading", "U"])
        == 0
    )


def test_an_effect_is_taken_out_by_its_name():
    model = DynamicBiasRegressor("case", effects=[Covariate("room"), ("dew", Covariate("humidity"))])
    left = model.without_effect("dew")
    assert [name for name, _ in left.effects] == ["covariate_room"] and len(model.effects) == 2
    with pytest.raises(ValueError, match=r"no effect called 'rain'. There are \['covariate_room', 'dew'\]"):
        model.without_effect("rain")


def test_a_further_thermometer_in_another_unit_is_refused():
    X, y, _, _ = two_surfaces(5, 2000)
    model = DynamicBiasRegressor(["case", "room"], {"case": ["10 min"], "room": ["90 min"]}).fit(X, y)
    with pytest.raises(RecordError, match=r"looks like kelvin where degC was fitted\. Convert 'room' first"):
        model.correct(X.assign(room=X["room"] + 273.15), y)


def test_the_command_takes_each_thermometer_by_its_name(tmp_path, capsys):
    """Columns under other names, in the model's order; as many as it has, or the first."""
    X, y, _, _ = two_surfaces(5, 2000)
    model = DynamicBiasRegressor(["case", "room"], {"case": ["10 min"], "room": ["90 min"]}).fit(X, y)
    save_model(model, tmp_path / "model.json")
    log = X.assign(reading=y).rename(columns={"case": "inner", "room": "outer"})
    log.insert(0, "time", X.index.total_seconds())
    log.to_csv(tmp_path / "log.csv", index=False)
    command = ["correct", str(tmp_path / "log.csv"), "--model", str(tmp_path / "model.json"), "--reading", "reading"]
    assert main([*command, "--temperature", "inner", "--temperature", "outer"]) == 0
    shown = pd.read_csv(io.StringIO(capsys.readouterr().out))
    np.testing.assert_allclose(shown["corrected"], model.correct(X, y), rtol=0, atol=1e-9)
    assert main([*command, "--temperature", "inner"]) == 2
    assert "no column 'room'" in capsys.readouterr().err
    assert main([*command, *(3 * ["--temperature", "inner"])]) == 2
    assert "the model has 2 thermometers: 'case', 'room'" in capsys.readouterr().err
