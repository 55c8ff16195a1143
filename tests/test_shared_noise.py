"""Columns that are made from the reading explain everything, and are no cause."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.noise import made_from

RECORD = make_record(1500, seed=1)
X, y = RECORD[["temperature", "humidity"]], RECORD["reading"]


def model():
    return DynamicBiasRegressor("temperature", ["5 min", "1 h"])


def test_the_reading_itself_explains_nothing():
    """A log that holds the reading again, in other units, is no puzzle with an easy answer."""
    X_all = RECORD.assign(again=RECORD["reading"] * 1000 + 3)
    with pytest.warns(RecordWarning, match="'reading', 'again': made from the reading"):
        found = diagnose(model().fit(X_all, y), X_all, y)
    assert all(
        "again" not in cause.effect.inputs() and "reading" not in cause.effect.inputs() for cause in found.causes
    )


@pytest.mark.parametrize("step", [0.02, 0.1])
def test_the_reading_in_counts_explains_nothing(step):
    """Named as a cause, a step of what is measured was taken for the counts' influence, and corrected away."""
    X_all = RECORD.drop(columns="reading").assign(counts=np.round(RECORD["reading"] / step))
    with pytest.warns(RecordWarning, match="'counts': made from the reading"):
        found = diagnose(model().fit(X_all, y), X_all, y)
    assert all("counts" not in cause.effect.inputs() for cause in found.causes)


SECOND_HAND = {
    "mean of 20": lambda y: y.rolling(20, min_periods=1).mean(),
    "mean of 60": lambda y: y.rolling(60, min_periods=1).mean().round(3),
    "low pass": lambda y: y.ewm(alpha=0.1).mean(),
    "earlier": lambda y: y.shift(3).bfill(),
}


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("how", SECOND_HAND)
def test_what_is_made_from_the_reading_explains_nothing(how, seed):
    """A running mean was named, and most of a step of what is measured was then corrected away."""
    noise = np.random.default_rng(seed).standard_normal(len(RECORD))
    noisy = y + 0.5 * (noise - noise.mean())
    second_hand = pd.Series(np.asarray(noisy)).pipe(SECOND_HAND[how]).to_numpy()
    X_all = RECORD.drop(columns="reading").assign(aside=second_hand)
    with pytest.warns(RecordWarning, match="'aside': made from the reading"):
        found = diagnose(model().fit(X_all, noisy), X_all, noisy)
    assert all("aside" not in cause.effect.inputs() for cause in found.causes)


def test_a_second_meter_on_the_source_is_pointed_out():
    other = 0.05 * np.random.default_rng(0).standard_normal(len(RECORD))
    X_all = RECORD.drop(columns="reading").assign(meter2=np.asarray(y) + other * np.std(np.asarray(y)))
    with pytest.warns(RecordWarning, match="'meter2': the numbers of the reading, on its scale"):
        diagnose(model().fit(X_all, y), X_all, y)


QUICK = {
    "wandering": lambda rng: pd.Series(np.cumsum(rng.standard_normal(2500))).ewm(span=20).mean().to_numpy() / 20,
    "wandering and white": lambda rng: QUICK["wandering"](rng) + 0.1 * rng.standard_normal(2500),
    "white": lambda rng: rng.standard_normal(2500),
    "on and off": lambda rng: 3.0 * (np.cumsum(rng.random(2500) < 0.1) % 2),
}


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.parametrize("size", [0.5, 2.0])
def test_causes_are_not_taken_for_something_made_from_the_reading(name, size):
    """Slow sensors of quick causes, and columns at whose rate a reading moves, neither."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        slow = 20 * pd.Series(rng.standard_normal(3500)).ewm(span=200).mean().ewm(span=50).mean().to_numpy()[1000:]
        cause = QUICK[name](rng)
        reading = 8 * slow + size * cause + rng.standard_normal(2500)
        for span in (1, 5, 60):
            assert not made_from(pd.Series(cause).ewm(span=span).mean().to_numpy(), reading)
        assert not made_from(np.cumsum(cause), reading)


def test_means_and_earlier_values_of_short_and_long_records_are_known():
    for seed, rows in enumerate((600, 2500, 100_000)):
        rng = np.random.default_rng(seed)
        slow = (
            40 * pd.Series(rng.standard_normal(rows + 2000)).ewm(span=500).mean().ewm(span=100).mean().to_numpy()[2000:]
        )
        reading = pd.Series(8 * slow + rng.standard_normal(rows))
        for span in (4, 20):
            assert made_from(reading.rolling(span, min_periods=1).mean().to_numpy(), reading.to_numpy())
        assert made_from(reading.shift(2).bfill().to_numpy(), reading.to_numpy())


def test_a_reading_that_is_not_white_tells_nothing():
    """Of a smooth one everything that follows is as smooth."""
    rng = np.random.default_rng(0)
    smooth = pd.Series(np.cumsum(rng.standard_normal(3000))).ewm(span=8).mean()
    assert not made_from(smooth.ewm(span=10).mean().to_numpy(), smooth.to_numpy())


@pytest.mark.parametrize("seed", range(6))
def test_a_cause_that_is_slow_and_white_is_no_mean_of_the_reading(seed):
    """What it follows it follows at once: a mean of the reading has less of what is fast."""
    rng = np.random.default_rng(seed)
    cause = 8 * pd.Series(rng.standard_normal(4500)).ewm(span=200).mean().ewm(span=50).mean().to_numpy()[2000:]
    cause += 0.2 * rng.standard_normal(2500)
    reading = 10 * cause + rng.standard_normal(2500)
    assert not made_from(cause, reading)
    assert made_from(pd.Series(reading).rolling(10, min_periods=1).mean().to_numpy(), reading)
