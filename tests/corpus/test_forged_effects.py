"""What the effects, arrays and states of a model file cannot be: each is refused with its place."""

import json

import numpy as np
import pytest
from effect_records import log

from thermocorr import DynamicBiasRegressor, ModelFileError, load_model, save_model
from thermocorr.effects import CATALOGUE, Delay, Effect, SeveralSteps
from thermocorr.effects.signals import DelayState
from thermocorr.files.codec import pack, unpack
from thermocorr.files.effect_nodes import check_state
from thermocorr.files.model_file import signed


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
    return next(effect for effect in node["model"]["effects"] if effect["kind"] == kind)


FORGED = {
    "decays of a longer body": ("initial_transient", "decays_", {"$dict": [[0, {"$array": [7e7]}]]}, "some of those"),
    "decays of no body": ("initial_transient", "decays_", {"$dict": [[0, {"$array": []}]]}, "some of those"),
    "decays before all": (
        "initial_transient",
        "decays_",
        {"$dict": [[-1, {"$array": [300.0]}]]},
        "numbers of segments",
    ),
    "a label for no segment": ("initial_transient", "labels_", {"$dict": [[7, "x"]]}, "one for each segment"),
    "one moment for a list": ("several_steps", "seconds_", 1200.0, "where a list belongs"),
    "moments of text": ("several_steps", "seconds_", ["1200"], r"seconds_\[0\]"),
    "words of numbers": ("several_steps", "moments_", [1200.0], r"moments_\[0\]"),
    "times of text": ("thermal_lag", "time_constants_", {"$array": ["x"]}, "a float belongs"),
}


@pytest.mark.parametrize("name", FORGED)
def test_what_an_effect_cannot_have_learned_is_refused_with_its_place(name, saved, tmp_path):
    node = json.loads(json.dumps(saved))
    kind, learned, value, words = FORGED[name]
    effect_of(node, kind)["learned"][learned] = value
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match=rf"\$\.model\.effects.*\.{learned}") as caught:
        load_model(tmp_path / "f.json")
    assert caught.match(words)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("segments", [], "at least one segment"),
        (
            "columns",
            2 * [{"name": "temperature", "values": {"$array": [20.0] * 90}}],
            "'temperature' where another name",
        ),
        ("ticks_per_second", 999_999_999, "1, 1000, 1000000 or 1000000000"),
        ("ticks_per_second", "1000", "an integer"),
    ],
)
def test_a_history_that_none_can_be_is_refused(place, value, words, saved, tmp_path):
    node = json.loads(json.dumps(saved))
    node["model"]["history"][place] = value
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match=rf"history\.{place}.*{words}"):
        load_model(tmp_path / "f.json")


def test_a_history_whose_time_stands_still_is_refused(saved, tmp_path):
    node = json.loads(json.dumps(saved))
    node["model"]["history"]["ticks"][5] = 0
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match=r"history\.ticks\[5\].*does not increase"):
        load_model(tmp_path / "f.json")


@pytest.mark.parametrize(
    ("kind", "column"),
    [("covariate", 1.5), ("covariate", None), ("covariate", ["humidity"]), ("lagged_covariate", {"$tuple": [1, 2]})],
)
def test_a_column_is_a_name_or_a_number(kind, column, saved, tmp_path):
    node = json.loads(json.dumps(saved))
    parameters = {"column": column, "power": 1, "removed_by_correct": True, "time_constants": [60.0]}
    effect = CATALOGUE[kind]("humidity", *([[60.0]] if kind == "lagged_covariate" else []))
    given = {**effect.get_params(deep=False), **{k: v for k, v in parameters.items() if k in effect.get_params()}}
    node["model"]["effects"].append({"kind": kind, "parameters": given, "learned": {}})
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match=r"effects\[\d\]\.parameters\.column"):
        load_model(tmp_path / "f.json")


@pytest.mark.parametrize(("kind", "parameter"), [("hysteresis", "width"), ("hinge", "knee")])
def test_a_place_beyond_all_numbers_is_refused(kind, parameter, saved, tmp_path):
    node = json.loads(json.dumps(saved))
    given = {**CATALOGUE[kind](1.0).get_params(deep=False), parameter: 1e301}
    node["model"]["effects"].append({"kind": kind, "parameters": given, "learned": {}})
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match=rf"effects\[\d\]\.parameters\.{parameter} holds 1e\+301"):
        load_model(tmp_path / "f.json")


@pytest.mark.parametrize("ends", [[30.0, 20.0], [20.0], "20"])
def test_a_range_goes_from_the_lower_end_to_the_higher(ends, saved, tmp_path):
    node = json.loads(json.dumps(saved))
    node["model"]["reading"]["temperature_range"] = ends
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match="temperature_range"):
        load_model(tmp_path / "f.json")


def test_a_model_without_a_static_part_is_refused(saved, tmp_path):
    node = json.loads(json.dumps(saved))
    node["model"]["effects"] = [part for part in node["model"]["effects"] if part["kind"] != "static_polynomial"]
    (tmp_path / "f.json").write_bytes(signed(rest_of(node)))
    with pytest.raises(ModelFileError, match="no static polynomial"):
        load_model(tmp_path / "f.json")


@pytest.mark.parametrize(
    ("node", "words"),
    [
        ({"$array": [2**40], "dtype": "int32", "shape": [1]}, "numbers within the range of int32"),
        ({"$state": "LagState", "values": [{"$array": [0.0]}, 23]}, r"x\.temperature holds 23 where a float"),
        ({"$state": "LagState", "values": [{"$array": [0.0], "shape": [1, 1]}, 23.0]}, "lag_difference.* a ndarray"),
        ({"$state": "LagState", "values": [0.0, 23.0]}, "lag_difference.* a ndarray"),
        ({"$array": [1.0], "shape": [-1, -1]}, r"x\.shape holds .* the shape of 1 numbers"),
        ({"$float": "inf", "unit": "s"}, "x holds the keys .*unit"),
        ({"$dict": [[1, 2], [1, 3]]}, r"x\[1\] holds .* a key that stands once"),
        *(
            ({"$dict": [pair]}, r"x\[0\] holds .* a key")
            for pair in ([1], [1, 2, 3], "ab", [1.5, 2], [[1], 2], [True, 1])
        ),
        ({"$state": "LagState", "values": [{"$array": [0.0]}]}, "the values of a LagState"),
        *(
            ({tag: text}, f"x holds '{text}' where a date")
            for tag in ("$date", "$day")
            for text in ("soon", "NaT", "2024-02-30")
        ),
    ],
)
def test_arrays_and_states_that_none_can_be_are_refused(node, words):
    with pytest.raises(ModelFileError, match=words):
        unpack(node, "x")


@pytest.mark.parametrize(
    ("elapsed", "values", "words"),
    [
        ([0.0, 60.0], [20.0], r"temperature holds .* 2 finite numbers"),
        ([0.0, 60.0], [20.0, np.inf], r"temperature holds .* 2 finite numbers"),
        ([0.0, 60.0], [20.0, 1e300], r"temperature holds .* 2 finite numbers"),
        ([60.0, 60.0], [20.0, 21.0], "elapsed holds times where increasing times"),
        ([], [], "holds .* where the samples that a delay looks back to"),
    ],
)
def test_samples_that_a_delay_cannot_look_back_to_are_refused(elapsed, values, words):
    X = log(90, seed=9)
    delay = DynamicBiasRegressor(effects=[Delay("5 min")]).fit(X, X["humidity"]).features_.effect_list()[-1]
    check_state(delay, DelayState(np.array([0.0, 60.0]), np.array([20.0, 21.0])), "x")
    with pytest.raises(ModelFileError, match=words):
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
        with pytest.raises(ModelFileError, match="names that end with an underscore"):
            load_model(tmp_path / "f.json", allow_imports=[f"{__name__}.Pair"])


def test_an_effect_whose_units_have_changed_since_is_refused(tmp_path, monkeypatch):
    """The class of a user's own effect is of today, the file of the day of the fit."""
    X = log(90, seed=9)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Pair()]).fit(X, X["humidity"])
    save_model(model, tmp_path / "m.json")
    monkeypatch.setattr(Pair, "units", lambda self: ["K", "K"])
    with pytest.raises(ModelFileError, match=r"Pair has another number of units than of names"):
        load_model(tmp_path / "m.json", allow_imports=[f"{__name__}.Pair"])
