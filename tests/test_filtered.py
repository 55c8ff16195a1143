"""Instruments that filter or average what they read: their noise remembers, and no effect is missing."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose

pytestmark = pytest.mark.newest

N = 3000


def low_pass(kept):
    return lambda rng: np.sqrt(1 - kept**2) * lfilter([1.0], [1.0, -kept], rng.standard_normal(N + 500))[500:]


def mean_of(rows):
    return lambda rng: np.convolve(rng.standard_normal(N + rows - 1), np.ones(rows) / np.sqrt(rows), "valid")


FILTERS = {
    "low pass 0.3": low_pass(0.3),
    "low pass 0.8": low_pass(0.8),
    "mean of 4": mean_of(4),
    "mean of 10": mean_of(10),
}


def record(seed, noise, more=0.0):
    """A device of one lag in a wandering room with noise of standard deviation 1."""
    rng = np.random.default_rng(seed)
    room = 22 + 20 * pd.Series(rng.standard_normal(N + 500)).ewm(span=200).mean().ewm(span=30).mean().to_numpy()
    felt = pd.Series(room).ewm(alpha=1 / 40, adjust=False).mean().to_numpy()
    stamps = pd.date_range("2024-10-07", periods=N, freq="s")
    reading = 100 + (8 * room - 5 * felt)[500:] + noise(rng) + more
    return pd.DataFrame({"temperature": room[500:]}, index=stamps), pd.Series(reading, stamps, name="reading")


def told(X, y):
    model = DynamicBiasRegressor("temperature", ["5 s", "40 s"]).fit(X, y)
    return model, diagnose(model, X, y)


@pytest.mark.long
@pytest.mark.parametrize("name", FILTERS)
def test_the_noise_of_a_filter_is_no_missing_effect(name):
    calm = 0
    for seed in range(8):
        _, found = told(*record(seed, FILTERS[name]))
        calm += found.verdict == "nothing missing"
        assert not found.causes
        if found.verdict == "nothing missing":
            assert 0 < found.left.filtered < 20
            assert found.noise_floor == pytest.approx(found.residual_rms, rel=0.1)
            assert "An instrument that filters or averages" in " ".join(str(found).split())
    assert calm >= 7  # what the temperature took of slow noise, or what chance left of it, may look like more


def test_later_readings_of_such_an_instrument_are_signed_and_covered():
    calm = 0
    for seed, name in enumerate(FILTERS):
        X, y = record(20 + seed, FILTERS[name])
        model, found = told(X[:2000], y[:2000])
        calm += found.verdict == "nothing missing"
        if found.verdict == "nothing missing":
            frame = model.uncertainty(X[2000:], y[2000:], diagnosis=found).frame()
            signed = frame["status"] == "signed"
            inside = np.abs(y[2000:] - model.predict(X[2000:])) < frame["U"]
            assert signed.mean() > 0.5
            assert inside[signed].mean() > 0.88  # of some hundred readings that are independent
    assert calm >= 3


def switched(rng, often):
    return np.cumsum(rng.random(N) < often) % 2


OTHERS = {
    "slow": lambda rng: low_pass(0.97)(rng),
    "slow besides the instrument's": lambda rng: 0.7 * low_pass(0.9)(rng) + 0.7 * rng.standard_normal(N),
    "switched, far above the noise": lambda rng: 2 * switched(rng, 0.15) + 0.1 * rng.standard_normal(N),
    "switched often": lambda rng: switched(rng, 0.3) + 0.1 * rng.standard_normal(N),
    "a filter and slow": lambda rng: low_pass(0.6)(rng) + 0.7 * low_pass(0.99)(rng),
}


@pytest.mark.long
@pytest.mark.parametrize("name", OTHERS)
def test_what_wanders_otherwise_stays_unexplained(name):
    for seed in range(6):
        _, found = told(*record(seed, OTHERS[name]))
        assert found.verdict != "nothing missing"
        assert found.left.filtered == 0.0


def test_a_step_beside_a_filter_is_not_calmed():
    for seed in range(4):
        _, found = told(*record(seed, FILTERS["low pass 0.8"], more=4.0 * (np.arange(N) > 1700)))
        assert found.verdict != "nothing missing"


@pytest.mark.long
@pytest.mark.parametrize("period", [2.31, 3.17, 7.3, 41.0])
def test_a_wave_is_named_once_and_by_its_period(period):
    """Besides a wave whose period was a tenth of a cycle off over the record, the rest of it was a second one."""
    for seed in range(4):
        wave = np.sin(2 * np.pi * np.arange(N) / period)
        _, found = told(*record(seed, lambda rng: rng.standard_normal(N), more=0.8 * wave))
        assert [cause.effect.kind for cause in found.causes] == ["periodic"]
        assert found.causes[0].effect.period == pytest.approx(period, rel=0.1 * period / N)  # of a cycle; noise: 0.018
