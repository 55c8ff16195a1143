"""Columns that are made from the reading explain everything, and are no cause."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.shared_noise import made_from

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


def test_causes_are_not_taken_for_something_made_from_the_reading():
    """Slow sensors of quick causes, too: of 25 records, with and without white noise in the cause."""
    for seed in range(25):
        rng = np.random.default_rng(seed)
        cause = pd.Series(np.cumsum(rng.standard_normal(2500))).ewm(span=20).mean().to_numpy() / 20
        cause += (seed % 2) * 0.1 * rng.standard_normal(2500)
        reading = 5 * cause + rng.standard_normal(2500)
        for span in (1, 10, 60):
            sensor = pd.Series(cause).ewm(span=span).mean().to_numpy() + 0.01 * rng.standard_normal(2500)
            assert not made_from(sensor, reading)
