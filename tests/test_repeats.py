"""Readings that stand in several rows: one of them is a reading."""

import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.outliers import is_repeated
from thermocorr.records.errors import RecordWarning

N = 3000


def record(seed):
    """A device of one lag in a wandering room, noise of standard deviation 1: frame and readings."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.standard_normal(N + 500))
    room = 22 + 2 * pd.Series(x).ewm(span=60).mean().to_numpy() / 20
    bias = 8 * (room - pd.Series(room).ewm(alpha=1 / 40, adjust=False).mean().to_numpy())
    stamps = pd.date_range("2024-10-07", periods=N, freq="min")
    reading = 100 + (bias + 3 * room)[500:] + rng.standard_normal(N)
    return pd.DataFrame({"temperature": room[500:].round(3)}, index=stamps), pd.Series(reading, stamps, name="reading")


def told(X, y):
    """Model, diagnosis and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        model = DynamicBiasRegressor("temperature").fit(X, y)
    return model, diagnose(model, X, y), " ".join(str(w.message) for w in caught)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rows", [2, 5, 3.4])
def test_readings_that_stand_in_several_rows_are_no_effect(seed, rows):
    X, y = record(seed)
    first = np.minimum(np.ceil(np.floor(np.arange(N) / rows) * rows).astype(int), N - 1)
    repeated = pd.Series(y.to_numpy()[first], y.index, name="reading")
    model, found, said = told(X, repeated)
    assert found.verdict == "nothing missing"
    again = N - len(np.unique(first))
    assert f"{again} readings repeat the row before" in said
    once, other = repeated.mask(repeated == repeated.shift()), DynamicBiasRegressor("temperature")
    assert model.residual_std_ == pytest.approx(other.fit(X, once).residual_std_, rel=1e-12)
    assert model.flags(X, repeated).eq("").all()  # later rows are corrected: what is measured is still shown


@pytest.mark.parametrize("seed", range(3))
def test_spikes_are_found_among_repeated_readings(seed):
    X, y = record(seed)
    y.iloc[[500, 1500]] += 60.0
    _, found, said = told(X, y.iloc[np.arange(N) // 5 * 5].set_axis(y.index))
    assert "2 readings left out as spikes: rows 500, 1500." in said
    assert found.verdict == "nothing missing"


def test_a_temperature_that_is_measured_seldom_is_said_and_kept():
    X, y = record(0)
    seldom = X.iloc[np.arange(N) // 10 * 10].set_axis(X.index)
    rng = np.random.default_rng(0)
    seldom["temperature"] = np.round(seldom["temperature"] + 0.02 * rng.standard_normal(N // 10).repeat(10), 3)
    model, _, said = told(seldom, y)
    assert "measured less often than the readings" in said
    assert model.flags(seldom, y).eq("").all()


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("digit", [1e-6, 0.1, 0.3, 1.0, 3.0, 10.0])
def test_coarse_readings_and_devices_at_rest_are_not_repeated(seed, digit):
    X, y = record(seed)
    at_rest = y.where(np.arange(N) > N // 4, y.iloc[0])
    loud = y + np.where(np.arange(N) // 50 % 2, 20, 0.1) * np.random.default_rng(seed).standard_normal(N)
    for values in (y, at_rest, loud, X["temperature"] * 50):
        rounded = np.round(values.to_numpy() / digit) * digit
        assert not is_repeated(rounded)


COARSE = {
    "one finer value": lambda c, w: np.where(np.arange(N) == 777, c + 0.0003, c),
    "four digits across a decade": lambda c, w: np.array([float(f"{value:.3g}") for value in w]),
    "two tares": lambda c, w: np.where(np.arange(N) < N // 2, c - 1.3, c - 1.3003),
    "two ways of scaling": lambda c, w: np.where(np.arange(N) < N // 2, np.round(c * 10) * 0.1, np.round(c * 10) / 10),
    "two factors": lambda c, w: np.where(np.arange(N) < N // 2, c, c * 1.00037),
    "a difference": lambda c, w: c - np.round(0.5 * w + 0.03, 1),
    "a ratio": lambda c, w: c / np.round(0.5 * w + 0.03, 1),
}


@pytest.mark.parametrize("how", COARSE)
@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1, 0.2])
def test_coarse_readings_of_more_than_one_digit_are_not_repeated(how, noise):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        w = 10 + 0.02 * np.cumsum(rng.standard_normal(N)) + noise * rng.standard_normal(N)
        assert not is_repeated(COARSE[how](np.round(w, 1), w))


@pytest.mark.parametrize("digits", [10, 30])
def test_repeated_readings_are_told_down_to_few_digits_of_noise(digits):
    _, y = record(1)
    assert is_repeated(np.repeat(np.round(y.to_numpy() * digits), 3))


def test_a_switch_is_not_repeated():
    switch = np.repeat(np.random.default_rng(0).integers(0, 2, 300), 7).astype(float)
    assert not is_repeated(switch)


def test_the_builtin_record_has_none():
    frame = make_record(seed=1)
    for name in ("temperature", "reading"):
        assert not is_repeated(frame[name].to_numpy())
