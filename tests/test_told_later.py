"""What a record does not tell apart, and data that were not learned from do."""

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, refine
from thermocorr.datasets import load_real_record, make_record
from thermocorr.effects import Covariate, Drift, LaggedCovariate
from thermocorr.estimators.holdout import rms
from thermocorr.judgement.tuning import effects_of

pytestmark = pytest.mark.newest

N, LEARNED = 5000, 3500


def smooth(walk, width):
    """A walk without what is faster than `width` rows, mean 0 and standard deviation 1."""
    for _ in range(2):
        walk = np.convolve(np.pad(walk, width, "edge"), np.ones(width) / width, "same")[width:-width]
    return (walk - walk.mean()) / walk.std()


def refined(seed, room):
    """Refinement of a record whose reading follows a recorded room, and its error on the rest over the noise."""
    record = make_record(N, seed=seed)
    noise = record.attrs["noise"]
    X, y = record.drop(columns="reading").assign(room=room), record["reading"] + noise * (room - 20)
    found = refine(DynamicBiasRegressor("temperature"), X[:LEARNED], y[:LEARNED], max_steps=2)
    return found, rms(np.asarray(found.model_.residuals(X[LEARNED:], y[LEARNED:]), float)) / noise


def warming(seed, wiggle):
    """A room that warms by 3.5 K, and wanders a little, then cools by 10 K."""
    walk = np.convolve(np.cumsum(np.random.default_rng(seed).normal(size=N)), np.ones(200) / 200, "same")
    room = 20 + 5 * np.arange(N) / N + wiggle * (walk - walk.mean()) / walk.std()
    room[LEARNED:] -= np.linspace(0, 10, N - LEARNED)
    return room


def test_a_column_stands_for_the_drift_that_the_record_does_not_tell_from_it_where_later_data_do():
    """With the drift alone the rest, on which the room cools, has 5.8 times the noise."""
    found, error = refined(2, warming(2, 0.12))
    drift = found.diagnoses[0].causes[0]
    assert isinstance(drift.effect, Drift) and "room" in {e.column for e in drift.confusable_with if e.inputs()}
    assert effects_of(found.model_)[0].inputs() == ["room"] and error < 1.1


@pytest.mark.parametrize(
    ("seed", "room"),
    [(1, warming(1, 0.2)), (2, 20 + 2 * smooth(np.cumsum(np.random.default_rng(1002).normal(size=N)), 800))],
    ids=["slow lags had absorbed it", "few blocks show it"],
)
def test_a_proven_column_is_kept_that_raises_no_error(seed, room):
    """Without it the rest has 5.9 and 1.1 times the noise."""
    found, error = refined(seed, room)
    assert [effect.inputs() for effect in effects_of(found.model_)] == [["room"]]
    assert found.diagnoses[0].causes[0].standing == "proven" and error < 1.05


def test_two_time_constants_are_not_moved_one_on_top_of_the_other():
    record = make_record(500, seed=1)
    model = DynamicBiasRegressor("temperature", effects=[Covariate("humidity")])
    model.fit(record.drop(columns="reading"), record["reading"])
    near = LaggedCovariate("humidity", [1000.0, 1250.0]).nearby(model.features_.history_.record, 0.25)
    assert len(near) == 2 and all(len(set(effect.time_constants)) == 2 for effect in near)


@pytest.mark.parametrize("share", [0.6, 0.7])
def test_the_room_beside_two_runs_of_a_resistor(measured, share):
    """The room cools at the end of the second run. Slow lags do not foretell it: 3.6 and 3.0 ppm."""
    runs = load_real_record("vhd200_resistor", measured)
    runs = runs[runs["run"].isin(["run9", "run10"])]
    X, y = runs.drop(columns="resistance_ohm"), (runs["resistance_ohm"] / 1000 - 1) * 1e6
    n = len(X) - int((1 - share) * (X["run"] == "run10").sum())
    found = refine(DynamicBiasRegressor("oven_temp_degC", run="run"), X[:n], y[:n])
    assert found.steps["effect"].iloc[1] == "lagged covariate: ambient_temp_degC"
    assert rms(np.asarray(found.model_.residuals(X[n:], y[n:]), float)) < 0.25
