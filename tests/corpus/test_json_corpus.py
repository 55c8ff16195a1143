"""Damaged and forged model files and saved states: refused in a short sentence, at once, in little memory."""

import datetime
import hashlib
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest

from corpus.clean_log import CLEAN, HEADER, Shown, frame_of, save_fitted, text_of
from thermocorr import DynamicBiasRegressor, ModelFileError, OnlineCorrector, load_model, save_model
from thermocorr.output.codec import parse, read
from thermocorr.output.model_file import signed
from thermocorr.records.types import RunLabel


@pytest.fixture(scope="module")
def model_path(tmp_path_factory):
    return save_fitted(tmp_path_factory.mktemp("model") / "m.json")


@pytest.fixture
def correct(model_path, tmp_path, capsys):
    """Function that gives a log to `correct`."""
    return lambda content, *options, model=model_path: Shown(tmp_path, content, options, model, capsys)


def test_thirty_megabytes_of_values_take_no_seconds():
    """A file is not read value by value before somebody counts them, nor quoted as a whole."""
    for count, words in ((15_000_000, "15000000 values"), (8_900_000, r"holds \[1, 1, .* where an object belongs")):
        begin = time.process_time()
        with pytest.raises(ModelFileError, match=words):
            parse(b"[" + b"1," * count + b"1]")
        assert time.process_time() - begin < 4.0


BAD_JSON = {
    "lists in lists": b"[" * 100_000,
    "lists in lists, closed": b"[" * 3000 + b"]" * 3000,
    "objects in objects": b'{"a":' * 3000 + b"1" + b"}" * 3000,
    "NaN": b'{"format": NaN}',
    "infinity": b'{"format": -Infinity}',
    "a float that is too large": b'{"format": 1e999}',
    "an integer of many digits": b'{"format": ' + b"1" * 5000 + b"}",
    "a key twice": b'{"format": 1, "format": 2}',
    "a list": b"[]",
    "nothing": b"",
    "a zero byte": b"\x00",
    "UTF-16": '{"format": 1}'.encode("utf-16"),
    "a pickle": b"\x80\x04cposix\nsystem",
    "a half of a character": b'{"format": "\\ud800"}',
    "a later version": b'{"format": "thermocorr model", "version": 99}',
}


@pytest.mark.parametrize("name", BAD_JSON)
def test_json_that_is_no_file_of_ours_is_refused(name, correct, tmp_path):
    (tmp_path / "x.json").write_bytes(BAD_JSON[name])
    shown = correct(text_of(CLEAN), model=tmp_path / "x.json")
    assert shown.status == 2 and shown.rows == [] and shown.err.count("\n") == 1 and len(shown.err) < 700


IN_A_CHILD = """
import resource, sys
from thermocorr.command.cli import main
bad, log = sys.argv[1:]
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
before = peak()
print(main(["correct", "--model", bad, log]))
print((peak() - before) // 1024)
"""


def test_thirty_megabytes_of_lists_are_refused_in_little_memory(tmp_path):
    """In a process of its own, whose peak is looked at."""
    pytest.importorskip("resource", reason="no account of memory here")
    body = b"[" + b"[]," * 10_000_000 + b"[]]"
    head = f'{{"format": "thermocorr model", "version": 1, "digest": "sha256:{hashlib.sha256(body).hexdigest()}",\n'
    (tmp_path / "x.json").write_bytes(head.encode() + body)
    (tmp_path / "log.csv").write_bytes(text_of(CLEAN))
    command = [sys.executable, "-c", IN_A_CHILD, tmp_path / "x.json", tmp_path / "log.csv"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=120, check=True)
    *statuses, megabytes = map(int, done.stdout.split())
    assert statuses == [2] and done.stderr.count("lists and objects") == done.stderr.count("\n") == 1
    assert megabytes < 500


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_named_pipe_is_no_model(correct, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    signal.alarm(20)  # ends the tests where it hangs
    shown = correct(text_of(CLEAN), model=tmp_path / "pipe")
    assert shown.status == 2 and "no regular file" in shown.err
    signal.alarm(0)


@pytest.mark.parametrize(
    "label",
    [
        pd.Timestamp("2024-03-04"),
        datetime.date(2024, 3, 4),
        pd.Timedelta("1 h"),
        7,
        True,
        datetime.datetime(2024, 3, 4, 5),
        datetime.timedelta(hours=1),
        pd.Timestamp("1885-06-01T12:00", tz="Europe/Paris"),
    ],
)
def test_any_label_of_a_run_lives_in_a_model_file_and_in_a_state(label, tmp_path):
    frame = frame_of(CLEAN).assign(run=pd.Series([label] * 30 + ["other"] * 30, dtype=object))
    model = DynamicBiasRegressor("temperature", [600.0], time="time", run="run")
    X, y = frame[["time", "temperature", "run"]], frame["reading"]
    model = load_model(save_model(model.fit(X[:50], y[:50]), tmp_path / "m.json"))
    whole = OnlineCorrector(model).update_many(X, y)["corrected"]
    for cut in (10, 30, 45):
        live = OnlineCorrector(model)
        first = live.update_many(X[:cut], y[:cut])["corrected"]
        again = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
        both = pd.concat([first, again.update_many(X[cut:], y[cut:])["corrected"]])
        np.testing.assert_allclose(both, whole, rtol=1e-12)


STATES = {
    "no last time": ("state.last", None),
    "a lag that is no number": ("state.states", [None] * 4),
    "a lag beyond all powers": ("state.states.0", 1e300),
    "a time that is text": ("state.last", "2024"),
    "a time beyond an integer": ("state.last", 2**64),
    "a time that is true": ("state.last", True),
    "a list for a flag": ("state.open", []),
    "a number for a flag": ("continues", 1),
    "text for a flag": ("placed", "yes"),
    "a segment that is not there": ("state.key", 10**9),
    "a row before the first": ("next_row", -1),
    "a row that none can follow": ("next_row", 2**63 - 1),
    "an average over no samples": ("average", 0),
    "more values than the average has": ("state.averaged", [1.0] * 10_000),
    "another model's": ("model", "0" * 64),
    "a later format": ("format", "thermocorr stream 99"),
    "one field more": ("state.more", 1),
}


@pytest.mark.parametrize("name", STATES)
def test_a_forged_state_is_refused(name, model_path):
    model = load_model(model_path)
    live = OnlineCorrector(model, average=3)
    frame = frame_of(CLEAN)
    live.update_many(frame[HEADER[:3]][:50], frame["reading"][:50])
    state = json.loads(json.dumps(live.state()))
    path, value = STATES[name]
    *above, last = path.split(".")
    node = state
    for key in above:
        node = node[key]
    node[int(last) if isinstance(node, list) else last] = value
    with pytest.raises(ModelFileError, match="cannot go on"):
        OnlineCorrector.from_state(model, state)


LONG = "[" * 3000
LONG_NAMES = {
    "a key that is none": {f"${LONG}": 1, "x": 2},
    "a tag that is none": {f"${LONG}": 1},
    "a long name above": {LONG: {"$x": 1}},
    "a long label above": {"$dict": [[LONG, {"$x": 1}]]},
}


@pytest.mark.parametrize("name", LONG_NAMES)
def test_a_forged_state_is_not_quoted_at_length(name, model_path):
    """As one came from random bytes: a name of three thousand brackets."""
    model, frame = load_model(model_path), frame_of(CLEAN)
    live = OnlineCorrector(model)
    live.update_many(frame[HEADER[:3]], frame["reading"])
    state = json.loads(json.dumps(live.state()))
    state["state"]["states"][0] = LONG_NAMES[name]
    with pytest.raises(ModelFileError, match="cannot go on") as caught:
        OnlineCorrector.from_state(model, state)
    assert len(str(caught.value)) < 500


def test_a_forged_state_of_an_average_over_no_samples_is_refused(model_path):
    """Before the first sample too, when it has no values."""
    model = load_model(model_path)
    with pytest.raises(ModelFileError, match=r"cannot go on .*\$\.average holds 0"):
        OnlineCorrector.from_state(model, {**OnlineCorrector(model).state(), "average": 0})


CELL = ("history", "record", "columns", "$dict", 0, 1)
FORGED = {
    "a reference that is no text": (("parameters", "reference"), {"$array": [1.0]}),
    "half a character as reference": (("parameters", "reference"), "\ud800"),
    "a long degree": (("effects", 0, 1, "parameters", "degree"), [0.0] * 5000),
    "an infinite coefficient": (("coefficients", 0), {"$float": "inf"}),
    "a coefficient of text": (("coefficients", 0), "1"),
    "a true coefficient": (("coefficients", 0), True),
    "a coefficient less": (("coefficients",), [1.0]),
    "an array of ten to the eighteen": (
        ("history", "record", "columns", "$dict", 0, 1),
        {"$array": [1.0], "shape": [10**9, 10**9]},
    ),
    "an array of objects": (CELL, {"$array": ["object", ["a"]]}),
    "harmonics without end": (("effects", 0, 1, "parameters", "degree"), 10**9),
    "an import": (("effects", 0, 1, "import"), "os.system"),
    "a class of another kind": (("effects", 0, 1, "kind"), "pickle"),
    "steps back in time": (("history", "record", "times", "ticks", "$array", 1, 3), -1),
    "a time beyond three centuries": (("history", "record", "times", "ticks", "$array", 1, 0), 2**62),
    "a temperature beyond all measurements": (
        ("history", "record", "columns", "$dict", 0, 1),
        {"$array": ["float64", [1.7e308] * 9]},
    ),
    "a period beyond all ages": (("history", "record", "times", "period"), 1.7e308),
    "a usual step beyond all ages": (("history", "usual_step"), 1.7e308),
    "a record without columns": (("history", "record", "columns"), []),
    "a gap of less than nothing": (("parameters", "max_gap"), -1.0),
    "a washout of text": (("parameters", "washout"), "soon"),
    "one reading less than none": (("reading", "n_readings"), 0),
    "a negative period": (("history", "record", "times", "period"), -1.0),
    "rows that none can follow": (("history", "n_fitted"), 2**63 - 1),
    "names twice": (("feature_names_in",), ["time", "time", "humidity"]),
    "half a character": (("feature_names_in", 0), "\ud800"),
    "a long text": (("reading", "name"), "x" * 100_000),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_model_with_a_digest_that_fits_is_refused_in_a_short_sentence(name, model_path, tmp_path):
    node = json.loads(model_path.read_text())
    path, value = FORGED[name]
    place = node["model"]
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    rest = {key: part for key, part in node.items() if key not in ("format", "version", "digest")}
    (tmp_path / "f.json").write_bytes(signed(rest))
    with pytest.raises(ModelFileError) as caught:
        load_model(tmp_path / "f.json")
    assert len(str(caught.value)) < 700


@pytest.mark.parametrize("forged", [1e300, 1, "1", None], ids=repr)
def test_seconds_that_are_none_are_refused(forged, tmp_path):
    frame = frame_of(CLEAN).assign(time=60.0 * np.arange(len(CLEAN)))
    model = DynamicBiasRegressor("temperature", [600.0], time="time").fit(frame[HEADER[:2]], frame["reading"])
    node = json.loads(save_model(model, tmp_path / "m.json").read_text())
    node["model"]["history"]["record"]["times"]["ticks"]["$array"][1][-1] = forged
    rest = {key: part for key, part in node.items() if key not in ("format", "version", "digest")}
    (tmp_path / "f.json").write_bytes(signed(rest))
    with pytest.raises(ModelFileError):
        load_model(tmp_path / "f.json")


def test_labels_of_several_parts_are_labels():
    whole = {"$tuple": ["a", {"$tuple": [1, None]}]}
    assert read(RunLabel, whole, "$") == ("a", (1, None))
    for part in ([], {"$float": "nan"}, {"$tuple": ["a", []]}):
        with pytest.raises(ModelFileError, match="a label"):
            read(RunLabel, part, "$")
