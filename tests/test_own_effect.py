"""A user's effect of ten lines, from outside the package: whatever a kind of the catalogue has, it has."""

import json
import pickle

import numpy as np
import pytest
from firmware_runs import BOUND, PERIOD, ROWS, ambient, errors, fitted, needs_gcc

from thermocorr import DynamicBiasRegressor, ModelFileError, OnlineCorrector, diagnose, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import CATALOGUE, Effect
from thermocorr.effects.expressions import TraceError, traced
from thermocorr.effects.protocol import EffectInfo
from thermocorr.effects.stream import own_starts, stepper_of, walk
from thermocorr.records import Layout, read_record


class Damp(Effect):
    kind = "damp"

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["damp", "late damp"]

    def signals(self, x):
        wet = x.maximum(x["humidity"] - 42.0, 0.0) ** 2 / 10
        return [wet, x.lag(wet, [1800.0])[0]]


class Draught(Effect):
    """Elementary functions of a column."""

    kind = "draught"

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["root", "log", "saturation"]

    def signals(self, x):
        wet = x.maximum(x["humidity"], 1.0)
        return [x.sqrt(wet), x.log(wet), x.exp(-wet / 50) + x.log1p(wet) + x.sin(wet / 9) * x.cos(wet / 7)]


class Unsaid(Effect):
    kind = "unsaid"

    def names(self):
        return ["wet"]

    def signals(self, x):
        return [x["humidity"] ** 0.5]


@pytest.fixture(scope="module")
def model():
    return fitted([Damp()])


def test_its_columns_are_what_it_says(model):
    _, X = model
    record = read_record(X, Layout(), needed=["humidity"], quiet=True)
    for size in (10**9, 137):  # whole, and in blocks that hand on their state
        walked = walk([Damp()], record, starts=own_starts(record), size=size)
        columns = np.vstack([step.columns for step in walked])
        wet = np.maximum(X["humidity"].to_numpy() - 42.0, 0.0) ** 2 / 10
        np.testing.assert_array_equal(columns[:, 0], wet)
        lagged, decay = wet[0], np.exp(-PERIOD / 1800.0)
        gain = (1 - decay) * 1800.0 / PERIOD
        for k in range(1, 500):  # eq. (25) with a straight line between samples
            lagged = decay * lagged + (gain - decay) * wet[k - 1] + (1 - gain) * wet[k]
        assert columns[499, 1] == pytest.approx(lagged - wet[499], abs=1e-12)


def test_it_lives_by_code_of_its_own(model, tmp_path):
    fit, X = model
    stepper = stepper_of(Damp(), fit.features_.history_.record.times, 0.0, "temperature")
    assert stepper.step.__code__.co_filename == "<signals>"  # written from the formula, not blocks of one row
    live = OnlineCorrector(fit)
    new = ambient(400, seed=5, begin=X.index[-1] + (X.index[1] - X.index[0]))
    got = []
    for time, T, h in zip(new.index, new["temperature"], new["humidity"], strict=True):
        got.append(live.update(time, T, 1.0, humidity=h).bias)
        if len(got) == 150:
            live = OnlineCorrector.from_state(fit, json.loads(json.dumps(live.state())))
    expected = fit.bias(new).to_numpy()
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13 * np.ptp(expected))


@needs_gcc
@pytest.mark.parametrize("irregular", [False, True])
def test_it_becomes_c(irregular, model, tmp_path):
    error, *_ = errors(*model, tmp_path, ROWS, irregular)
    assert error < BOUND


@needs_gcc
def test_every_function_of_a_formula_becomes_c(tmp_path):
    error, *_ = errors(*fitted([Draught()]), tmp_path, ROWS, False)
    assert error < BOUND


def test_a_formula_that_cannot_be_used_says_why():
    record = make_record(600, seed=2)
    X, y = record[["temperature", "humidity"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min"])
    with pytest.raises(ValueError, match="uses the column 'humidity', which its effect's `inputs` do not name"):
        model.with_effect(Unsaid()).fit(X, y)
    with pytest.raises(ValueError, match=r"Damp has no `candidates`: pass Damp\(...\), or write them"):
        diagnose(model.fit(X, y), X, y, suspects=[Damp])
    with pytest.raises(TraceError, match=r"whole numbers from 0 to 99, got 0.5: use x.sqrt"):
        traced(Unsaid())


def test_it_has_a_model_file_that_refuses_a_damaged_state(model, tmp_path):
    fit, X = model
    path = tmp_path / "model.json"
    save_model(fit, path)
    with pytest.raises(ModelFileError, match="allow_imports"):
        load_model(path)
    again = load_model(path, allow_imports=[f"{Damp.__module__}.Damp"])
    new = ambient(300, seed=6, begin=X.index[-1] + (X.index[1] - X.index[0]))
    np.testing.assert_array_equal(again.predict(new), fit.predict(new))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fit)).predict(new), fit.predict(new))
    live = OnlineCorrector(fit)
    live.update(new.index[0], 23.0, 1.0, humidity=45.0)
    state = json.loads(json.dumps(live.state()))
    state["state"]["states"][-1] = 0.0
    with pytest.raises(ModelFileError, match="the state of a Lag"):
        OnlineCorrector.from_state(fit, state)


class Dry(Damp):
    """A new kind of the catalogue that does not say what it learns."""

    kind = "dry"
    info = EffectInfo("", "", "")

    def learn(self, record):
        self.wettest_ = record.moments("humidity").high

    def signals(self, x):
        return [column / self.wettest_ for column in super().signals(x)]


def test_a_kind_that_does_not_say_what_it_learns_is_loaded_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setitem(CATALOGUE, "dry", Dry)
    fit, X = fitted([Dry()])
    save_model(fit, tmp_path / "model.json")
    assert '"import"' not in (tmp_path / "model.json").read_text()
    np.testing.assert_array_equal(load_model(tmp_path / "model.json").predict(X), fit.predict(X))


def test_a_diagnosis_names_it():
    record = make_record(6000, seed=6)
    X = record.drop(columns="reading")
    y = record["reading"] + 0.05 * np.maximum(X["humidity"] - 42.0, 0.0) ** 2
    found = diagnose(DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y), X, y, suspects=[Damp()])
    assert found.verdict == "missing" and found.best.kind == "damp"
