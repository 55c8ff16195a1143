"""Damaged, foreign and forged model files: refused in a sentence, or harmless."""

import copy
import json
import os
import random

import numpy as np
import pytest
from effect_records import log

from thermocorr import DynamicBiasRegressor, ModelFileError, RecordError, load_model, save_model
from thermocorr.effects import Delay, Hysteresis, LaggedCovariate, ThermalLag
from thermocorr.output import codec, model_file
from thermocorr.output.codec import parse
from thermocorr.output.model_file import signed as sign


def readings(X):
    return (X["temperature"] + np.random.default_rng(0).normal(0, 0.1, len(X))).rename("reading")


def signed(node):
    """The file with a digest that fits whatever is in it."""
    return sign({key: value for key, value in node.items() if key not in ("format", "version", "digest")}).decode()


@pytest.fixture(scope="module")
def victim(tmp_path_factory):
    """A model of many kinds: its file, itself, and data."""
    X = log(90, seed=9, holes=[40])
    y = readings(X)
    effects = [LaggedCovariate("humidity", ["20 min"]), Delay("10 min"), Hysteresis(0.5), ThermalLag([90.0])]
    model = DynamicBiasRegressor(time_constants=[300.0], products=True, max_gap="1 h", effects=effects).fit(
        X[:60], y[:60]
    )
    path = tmp_path_factory.mktemp("victim") / "m.json"
    save_model(model, path)
    return path, model, X, y


def scramble(text, rng):
    """One way of damaging text."""
    at = rng.randrange(len(text))
    return rng.choice(
        [
            lambda: text[:at],
            lambda: text[at:],
            lambda: text[:at] + text[at + rng.randrange(1, 40) :],
            lambda: text[:at] + rng.choice('0123456789-+.eE"\\{}[],: ntf\x00é') + text[at + 1 :],
            lambda: (
                text[:at]
                + rng.choice(["NaN", "1e999", "-Infinity", "9" * 5000, "[" * 100_000, '"\\ud800"', "{}"])
                + text[at:]
            ),
            lambda: text[:at] + text[at : at + 200] + text[at:],
            lambda: text.replace(": ", f": {rng.choice(['NaN', '1e400', '[]', 'null', '-'])}, ", 1),
        ]
    )()


def test_600_damaged_files_are_refused_or_mean_the_same(victim, tmp_path):
    path, model, X, _ = victim
    text, rng, harmless = path.read_text(), random.Random(1), 0
    content, sentences = parse(text.encode()), []
    for _ in range(600):
        damaged = scramble(text, rng)
        (tmp_path / "d.json").write_bytes(damaged.encode("utf-8", "surrogatepass"))
        try:
            again = load_model(tmp_path / "d.json")
        except ModelFileError as error:
            sentences.append(str(error))
        else:
            assert parse(damaged.encode()) == content
            harmless += 1
            np.testing.assert_array_equal(again.predict(X), model.predict(X))
    assert harmless < 60  # a blank more or less
    assert all(text.startswith(str(tmp_path / "d.json")) and len(text) < 700 for text in sentences)


HOSTILE = [
    None,
    True,
    -1,
    0,
    1,
    10**12,
    -(2**63),
    0.0,
    -1.5,
    1e308,
    -1e308,
    1e-320,
    "",
    "x",
    "__import__('os').system('true')",
    "\x00\x1b[2J",
    "9" * 9999,
    [],
    [1],
    [[[[]]]],
    {},
    {"$float": "nan"},
    {"$float": "x"},
    {"$tuple": [1]},
    {"$array": []},
    {"$array": ["float64", [1.0, {"$float": "inf"}]]},
    {"$array": ["object", ["a"]]},
    {"$LagState": [{"$array": ["float64", [0.0]]}, 1.0]},
    {"$date": "soon"},
    {"$date": "9999-01-01"},
    {"$span": 10**18},
    {"$effect": {"kind": "drift", "parameters": {"removed_by_correct": True}}},
    {"$dict": [[1, 2], [1, 3]]},
    {"import": "os"},
    {"$effect": {"kind": "periodic", "parameters": {"period": 1.0, "harmonics": 10**9, "removed_by_correct": True}}},
]


def places(node, path=()):
    """Every place in a JSON value."""
    yield path
    if isinstance(node, dict | list):
        for key in node if isinstance(node, dict) else range(len(node)):
            yield from places(node[key], (*path, key))


def mutate(node, path, rng):
    """The content with something else at one place."""
    node = copy.deepcopy(node)
    *above, last = path
    parent = node
    for key in above:
        parent = parent[key]
    value, kind = parent[last], rng.randrange(6)
    if kind == 0 and isinstance(parent, dict):
        del parent[last]
    elif kind == 1 and isinstance(parent, list):
        parent.insert(last, copy.deepcopy(value))
    elif kind == 2 and isinstance(value, int | float) and not isinstance(value, bool):
        parent[last] = value * rng.choice([-1, 0, 1.5, 1e200, 10**15])
    elif kind == 3 and isinstance(value, dict):
        value["$" + rng.choice("abc")] = 1
    elif kind == 4 and isinstance(value, list):
        rng.shuffle(value)
    else:
        parent[last] = copy.deepcopy(rng.choice(HOSTILE))
    return node


@pytest.mark.long
@pytest.mark.newest
def test_800_forged_files_with_a_fitting_digest_are_refused_or_still_compute(victim, tmp_path, monkeypatch):
    """Whoever recomputes the digest can write another model, but not one that breaks, hangs or runs anything."""
    path, _, X, y = victim
    content = json.loads(path.read_text())
    forbidden = lambda *args, **kwargs: pytest.fail("a model file made something run")  # noqa: E731
    monkeypatch.setattr(os, "system", forbidden)
    monkeypatch.setattr("builtins.eval", forbidden)
    monkeypatch.setattr("thermocorr.output.effect_nodes.importlib.import_module", forbidden)
    everywhere = [place for place in places(content) if place and place[0] in ("model", "errors")]
    plain = [place for place in everywhere if not any(part in ("ticks", "columns", "half", "last") for part in place)]
    rng, refused, strange = random.Random(2), [], []
    for number in range(800):
        forged = mutate(content, rng.choice(plain if number % 4 else everywhere), rng)
        (tmp_path / "f.json").write_text(signed(forged))
        try:
            again = load_model(tmp_path / "f.json", allow_imports=["os.system"])
        except ModelFileError as error:
            refused.append(str(error))
            continue
        try:
            with np.errstate(all="ignore"):
                again.predict(X)
                again.evaluate(X, y, return_std=again._knows_noise)
                again._knows_noise and again.uncertainty(X, y).frame()
                again.coef_table(), again.equation()
        except RecordError:
            pass  # it needs other columns, say
        except ValueError as error:
            strange.append(str(error))
    assert len(refused) > 400 and all(text.startswith(str(tmp_path / "f.json")) for text in refused)
    assert all("feature" in text for text in strange), strange  # scikit-learn's words for other columns


def test_a_model_is_saved_as_long_as_its_file_can_be_read(victim, tmp_path, monkeypatch):
    path, model, *_ = victim
    size = path.stat().st_size
    for room in (model_file, codec):
        monkeypatch.setattr(room, "LARGEST_FILE", size)
    load_model(save_model(model, tmp_path / "m.json"))
    for room in (model_file, codec):
        monkeypatch.setattr(room, "LARGEST_FILE", size - 1)
    with pytest.raises(ModelFileError, match=f"would have {size} bytes.*at most {size - 1}"):
        save_model(model, tmp_path / "larger.json")
    assert not (tmp_path / "larger.json").exists()
    with pytest.raises(ModelFileError, match=f"has {size} bytes, and at most {size - 1} are read"):
        load_model(path)


def test_missing_files_are_refused(tmp_path):
    with pytest.raises(ModelFileError, match="cannot be read"):
        load_model(tmp_path / "none.json")
    with pytest.raises(ModelFileError, match="no regular file"):
        load_model(tmp_path)
