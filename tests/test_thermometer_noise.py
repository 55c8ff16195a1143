"""Noisy, coarse and late thermometers: what they do to a reading, and who is named for it."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, OnlineCorrector, Thermometer, diagnose, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.displays import StepResponseDisplay
from thermocorr.equations.statistics import white_part
from thermocorr.records import RecordError
from thermocorr.validation import thermometer_errors

pytestmark = pytest.mark.newest

PERIODS = {"lab": 60.0, "outdoor": 600.0, "chamber": 30.0}


def seen_by(setting, seed, noise=0.0, step=0.0, n=6000):
    """A simulated device, and the temperature as a noisy or coarse thermometer has it."""
    record = make_record(n, seed=seed, sampling_period=PERIODS[setting], setting=setting)
    T = record["temperature"].to_numpy()
    T = np.round(T / step) * step if step else T + noise * np.random.default_rng([9, seed]).standard_normal(n)
    return record.drop(columns="reading").assign(temperature=T), record["reading"], record[["temperature"]]


@pytest.mark.parametrize("setting", PERIODS)
@pytest.mark.parametrize("noise", [0.05, 0.2])
def test_noise_is_estimated_and_put_through_the_model(setting, noise):
    X, y, exact = seen_by(setting, 31, noise)
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = thermometer_errors(model, X).iloc[0]
    assert found["noise"] == pytest.approx(noise, rel=0.15)
    assert (found["noise_from"], found["resolution"]) == ("estimated", 0.0)
    made = (model.predict(X) - model.predict(X.assign(temperature=exact["temperature"]))).std()
    assert found["in_reading"] == pytest.approx(made, rel=0.15)


@pytest.mark.parametrize("setting", PERIODS)
def test_steps_are_seen_and_put_through_the_model(setting):
    X, y, exact = seen_by(setting, 32, step=0.25)
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y)
    found = thermometer_errors(model, X).iloc[0]
    assert found["resolution"] == pytest.approx({"lab": 0.25, "outdoor": 0.0, "chamber": 0.25}[setting])
    assert bool(found["noise"]) == (setting == "outdoor")  # where it moves by several steps a row, they are noise
    made = (model.predict(X) - model.predict(X.assign(temperature=exact["temperature"]))).std()
    assert made / 2 < found["in_reading"] < 2 * made


def test_an_exact_thermometer_makes_nothing():
    for setting in PERIODS:
        X, y, _ = seen_by(setting, 33)
        found = thermometer_errors(DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y), X).iloc[0]
        assert found["resolution"] == 0 and found["noise"] < 0.01


def test_what_is_declared_counts_and_goes_with_the_model(tmp_path):
    X, y, _ = seen_by("lab", 34)
    said = Thermometer("temperature", noise=0.03, resolution=0.1)
    model = DynamicBiasRegressor([said, "humidity"], {"temperature": ["5 min", "90 min"]})
    found = thermometer_errors(clone(model).fit(X, y), X)
    assert found["thermometer"].tolist() == ["temperature", "humidity"]
    assert found.loc[0, ["noise", "resolution"]].tolist() == [0.03, 0.1]
    assert found["noise_from"].tolist() == ["declared", "estimated"]
    fitted = model.fit(X, y)
    save_model(fitted, tmp_path / "m.json")
    again = load_model(tmp_path / "m.json")
    assert again.temperature == [said, "humidity"]
    pd.testing.assert_frame_equal(thermometer_errors(again, X), found)
    np.testing.assert_allclose(again.predict(X), fitted.predict(X), rtol=1e-12)
    plain = DynamicBiasRegressor(["temperature", "humidity"], {"temperature": ["5 min", "90 min"]}).fit(X, y)
    np.testing.assert_array_equal(plain.coef_, fitted.coef_)


def test_a_thermometer_without_a_column_is_the_usual_one():
    X, y, _ = seen_by("lab", 35, n=2000)
    model = DynamicBiasRegressor(Thermometer(noise=0.5), ["5 min"]).fit(X, y)
    assert thermometer_errors(model, X)[["thermometer", "noise"]].iloc[0].tolist() == ["temperature", 0.5]
    live = OnlineCorrector(model).update_many(X, y)
    np.testing.assert_allclose(live["corrected"], model.correct(X, y), rtol=1e-9)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"noise": -0.1}, "'noise' .* unit of its column, zero or above. Got -0.1"),
        ({"resolution": "fine"}, "'resolution' .* Got 'fine'"),
        ({"noise": float("nan")}, "Got nan"),
        ({"time_constant": "soon"}, "time_constant"),
    ],
)
def test_what_is_no_size_is_refused(wrong, words):
    with pytest.raises((ValueError, RecordError), match=words):
        Thermometer("case", **wrong)


@pytest.mark.parametrize("late", [0.0, -1.2])
def test_attenuation_is_what_a_fit_without_the_noise_shows(late):
    """Mean of twelve records; one time constant that is known, or none, so that nothing is chosen."""
    shown, said = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        T = pd.Series(23 + np.sin(np.arange(4000) / 100) + 0.3 * rng.standard_normal(4000).cumsum() / 60)
        body = T.ewm(alpha=1 - np.exp(-1 / 40), adjust=False).mean()
        y = 5 + 2.0 * T + late * body + 0.01 * rng.standard_normal(4000)
        noisy = pd.DataFrame({"temperature": T + 0.2 * rng.standard_normal(4000)})
        taus = [40.0] if late else []
        model = DynamicBiasRegressor("temperature", taus, degree=1, sampling_period=1.0).fit(noisy, y)
        exact = clone(model).fit(T.to_frame("temperature"), y)
        shown.append(model.coef_[0] / exact.coef_[0] - 1)
        said.append(thermometer_errors(model, noisy)["gain_error"].iloc[0])
    assert (np.mean(shown) < -0.06) if not late else (0.005 < np.mean(shown) < 0.012)
    assert np.mean(said) == pytest.approx(np.mean(shown), abs=max(0.02 * abs(np.mean(shown)), 0.003))


@pytest.mark.long
@pytest.mark.parametrize(("step", "within"), [(0.5, (25, 30)), (1.0, (25, 30)), (2.0, (15, 25))])
def test_of_coarse_steps_it_is_a_size_and_twice_that_a_bound(step, within):
    """Of thirty records; the very coarse steps are 2.8 standard deviations of the temperature. 95 % of 30 are 28.5."""
    ratios = []
    for seed in range(30):
        record = make_record(6000, seed=seed)
        model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
        exact = clone(model).fit(record[["temperature"]], record["reading"])
        coarse = step * (record[["temperature"]] / step).round()
        model.fit(coarse, record["reading"])
        ratios.append(
            abs(model.coef_[0] / exact.coef_[0] - 1) / thermometer_errors(model, coarse)["gain_error"].iloc[0]
        )
    assert within[0] <= np.count_nonzero(np.array(ratios) <= 1) <= within[1]
    assert np.count_nonzero(np.array(ratios) <= 2) >= 29


def test_a_declared_noise_explains_what_cannot_be_seen():
    """20 mK at a row a minute besides a thermostat of ten minutes."""
    X, y, _ = seen_by("lab", 201, 0.02)
    said = [
        diagnose(DynamicBiasRegressor(temperature).fit(X, y), X, y)
        for temperature in ("temperature", Thermometer("temperature", noise=0.02))
    ]
    assert said[1].verdict == "nothing missing"
    words = " ".join(str(said[1]).split())
    assert "comes from the noise of 0.02 K (declared) of the thermometer 'temperature'" in words


def test_a_step_of_the_air_reaches_a_late_thermometer_late():
    X, y, _ = seen_by("lab", 36, n=3000)
    plain = DynamicBiasRegressor("temperature", ["30 min"], degree=1).fit(X, y)
    late = DynamicBiasRegressor(Thermometer("temperature", time_constant="10 min"), ["30 min"], degree=1).fit(X, y)
    np.testing.assert_array_equal(plain.coef_, late.coef_)
    at_once, air = (StepResponseDisplay.from_estimator(model).frame() for model in (plain, late))
    t, (gain, lag) = air["time"].to_numpy(), plain.coef_[:2]
    # T shows 1 - exp(-t/600), and a lag of 1800 s of that is 1 - (1800 exp(-t/1800) - 600 exp(-t/600))/1200
    shown, body = -np.expm1(-t / 600), 1 - (1800 * np.exp(-t / 1800) - 600 * np.exp(-t / 600)) / 1200
    np.testing.assert_allclose(air["response"], gain * shown + lag * (body - shown), atol=2e-3 * abs(gain))
    assert (air["response"].iloc[:20] / at_once["response"].iloc[:20]).abs().max() < 0.5


@pytest.mark.parametrize("minutes", [1, 5, 20])
def test_a_late_thermometer_costs_nothing(minutes):
    """Of the error on later data, rows a minute apart; what docs/guide/thermometers.md says."""
    for seed in (300, 301):
        record = make_record(8000, seed=seed)
        y, exact = record["reading"], record[["temperature"]]
        late = exact.ewm(alpha=1 - np.exp(-1 / minutes), adjust=False).mean()
        missed = []
        for X in (exact, late):
            model = DynamicBiasRegressor("temperature").fit(X[:5000], y[:5000])
            missed.append(float(np.sqrt((model.residuals(X[5000:], y[5000:]) ** 2).mean())))
        assert missed[1] == pytest.approx(missed[0], rel=0.01)


def test_white_part_of_many_segments_and_of_too_short_ones():
    rng = np.random.default_rng(0)
    assert white_part([rng.standard_normal(50) for _ in range(400)]) == pytest.approx(1.0, rel=0.05)
    assert white_part([np.zeros(5), np.ones(3)]) == 0.0
    assert white_part([]) == 0.0
