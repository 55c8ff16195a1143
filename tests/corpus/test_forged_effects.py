"""What the effects, arrays and states of a model file cannot be: each is refused with its place."""

import json

import numpy as np
import pytest
from effect_records import log

from thermocorr import DynamicBiasRegressor, ModelFileError, load_model, save_model
from thermocorr.effects import CATALOGUE, Delay, Effect, SeveralSteps
from thermocorr.effects.signals import DelayState
from thermocorr.output.codec import pack, unpack
from thermocorr.output.effect_nodes import check_state
from thermocorr.output.model_file import signed


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A model with start-up decays and steps: its file as JSON."""
    X = log(90, seed=9, holes=[40])
    y = X["temperature"] + np.random.default_rng(0).normal(0, 0.1, len(X))
    model = DynamicBiasRegressor(time_constants=[300.0], max_gap="1 h", effects=[SeveralSteps([1200.0])])
    return json.loads(save_model(model.fit(X, y), tmp_path_factory.mktemp("m") / "m.json").read_text())


def rest_of(node):
    return {key: part for key, part in node.items() if key not in ("format", "version", "digest")}


def effect_of(node, kind):
    return next(effect for _, effect in node["model"]["effects"] if effect["kind"] == kind)


def drop(node):
    parts = node["model"]["effects"]
    parts[:] = [part for part in parts if part[1]["kind"] != "static_polynomial"]


def learned(kind, name, value):
    return lambda node: effect_of(node, kind)["learned"].update({name: value})


def history(value, *names):
    def forge(node):
        *above, last = names
        node = node["model"]["history"]
        for name in above:
            node = node[name]
        node[last] = value

    return forge


def more(kind, *given, **changed):
    parameters = {**CATALOGUE[kind](*given).get_params(deep=False), **changed}
    effect = {"kind": kind, "parameters": parameters}
    return lambda node: node["model"]["effects"].append(["more", effect])


FORGED = {
    "decays of no body": (learned("initial_transient", "decays_", [[0, []]]), "belong together|columns"),
    "decays of text": (learned("initial_transient", "decays_", [[0, ["x"]]]), r"decays_\[0\].*where a number"),
    "decays of words": (learned("initial_transient", "decays_", [["0", [300.0]]]), r"decays_\[0\].*integer"),
    "one moment for a list": (learned("several_steps", "seconds_", 1200.0), "seconds_ holds .* where a list belongs"),
    "moments of text": (learned("several_steps", "seconds_", ["1200"]), r"seconds_\[0\]"),
    "words of numbers": (learned("several_steps", "moments_", [1200.0]), r"moments_\[0\]"),
    "times of text": (learned("thermal_lag", "time_constants_", ["x"]), r"constants_\[0\] holds 'x' where a number"),
    "something else learned": (learned("thermal_lag", "more_", 1.0), "learned holds the key 'more_'"),
    "no segment": (history([], "record", "segments"), "segments"),
    "columns of text": (history({"$dict": [["temperature", "x"]]}, "record", "columns"), "belong together"),
    "a clock of its own": (history(999_999_999, "record", "times", "per_second"), "1, 1000, 1000000 or 1000000000"),
    "a clock in words": (history("1000", "record", "times", "per_second"), "an integer"),
    "a time that stands still": (history({"$array": ["int64", [0] * 18]}, "record", "times", "ticks"), "record.times"),
    "a column that is no name": (more("covariate", "humidity", column=1.5), r"parameters\.column"),
    "no column": (more("covariate", "humidity", column=None), r"parameters\.column"),
    "several columns": (more("covariate", "humidity", column=["humidity"]), r"parameters\.column"),
    "a width beyond all numbers": (more("hysteresis", 1.0, width=1e301), r"parameters\.width holds 1e\+301"),
    "a knee beyond all numbers": (more("hinge", 1.0, knee=1e301), r"parameters\.knee holds 1e\+301"),
    "a range in words": (lambda node: node["model"]["reading"].update(temperature_range="20"), "temperature_range"),
    "half a range": (lambda node: node["model"]["reading"].update(temperature_range=[20.0]), "temperature_range"),
    "no static part": (drop, "belong together"),
}  # fmt: skip


@pytest.mark.parametrize("name", FORGED)
def test_what_a_model_cannot_be_is_refused_with_its_place(name, saved, tmp_path):
    node = json.loads(json.dumps(saved))
    forge, words = FORGED[name]
    forge(node)
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match=words):
        load_model(tmp_path / "f.json")


@pytest.mark.parametrize(
    "node",
    [
        {"$array": ["int32", [2**40]]}, {"$array": ["int64", [[1], [1, 2]]]}, {"$array": ["object", [1]]},
        {"$float": "inf", "unit": "s"}, {"$float": "1"}, {"$LagState": [1.0]}, {"$span": 1.5}, {"$span": 2**70},
        *({"$dict": [pair]} for pair in ([1], [1, 2, 3], "ab", [1.5, 2], [[1], 2], [True, 1])),
        *({tag: text} for tag in ("$date", "$day") for text in ("soon", "NaT", "2024-02-30", 5)),
    ],
    ids=repr,
)  # fmt: skip
def test_values_that_none_can_be_are_refused(node):
    with pytest.raises((ModelFileError, ValueError, OverflowError)):
        unpack(node, "x")


@pytest.mark.parametrize(
    ("elapsed", "values"),
    [
        ([0.0, 60.0], [20.0]), ([0.0, 60.0], [20.0, np.inf]), ([0.0, 60.0], [20.0, 1e300]),
        ([60.0, 60.0], [20.0, 21.0]), ([], []),
    ],
)  # fmt: skip
def test_samples_that_a_delay_cannot_look_back_to_are_refused(elapsed, values):
    X = log(90, seed=9)
    delay = DynamicBiasRegressor(effects=[Delay("5 min")]).fit(X, X["humidity"]).features_.effect_list()[-1]
    check_state(delay, DelayState(np.array([0.0, 60.0]), np.array([20.0, 21.0])), "x")
    with pytest.raises(ModelFileError, match="the state of a Delayed"):
        check_state(delay, DelayState(np.array(elapsed), np.array(values)), "x")


@pytest.mark.parametrize(
    "value", [object(), {1, 2}, b"x", 1j, np.array(["a"]), np.datetime64("NaT")], ids=lambda value: type(value).__name__
)
def test_what_has_no_form_in_a_file_is_named(value):
    with pytest.raises(ModelFileError, match=f"x is a {type(value).__name__}, which has no place in a model file"):
        pack(value, "x")


class Pair(Effect):
    """An effect that makes another one and teaches it."""

    kind = "pair"

    def __init__(self, inner=None):
        self.inner = inner

    def learn(self, record):
        self.inner_ = SeveralSteps([60.0])
        self.inner_.learn(record)

    def signals(self, x):
        return [x.maximum(x.T - 23.0, 0.0)]

    def names(self):
        return ["pair"]

    def units(self):
        return ["K"]


def test_an_effect_that_another_one_has_taught_lives_in_a_file(tmp_path):
    X = log(90, seed=9)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Pair(SeveralSteps([5.0]))])
    model.fit(X, X["humidity"])
    save_model(model, tmp_path / "m.json")
    again = load_model(tmp_path / "m.json", allow_imports=[f"{__name__}.Pair"]).features_.effect_list()[-1]
    assert again.inner_.seconds_ == [60.0] and again.inner.times == [5.0] and not hasattr(again.inner, "seconds_")
    node = json.loads((tmp_path / "m.json").read_text())
    for stray in ({"inner": 1}, {"_inner_": 1}, [1]):
        effect_of(node, "pair")["learned"] = stray
        (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
        with pytest.raises(ModelFileError, match=r"names that end with an underscore|an object"):
            load_model(tmp_path / "f.json", allow_imports=[f"{__name__}.Pair"])


def test_an_effect_whose_units_have_changed_since_is_refused(tmp_path, monkeypatch):
    """The class of a user's own effect is of today, the file of the day of the fit."""
    X = log(90, seed=9)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Pair()]).fit(X, X["humidity"])
    save_model(model, tmp_path / "m.json")
    monkeypatch.setattr(Pair, "units", lambda self: ["K", "K"])
    with pytest.raises(ModelFileError, match="columns"):
        load_model(tmp_path / "m.json", allow_imports=[f"{__name__}.Pair"])
