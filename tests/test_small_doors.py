"""Names of the user's where they could do harm: C code and comments, terminals, the columns that a model file lists."""

import subprocess

import numpy as np
import pandas as pd
import pytest
from effect_records import log
from firmware_runs import ambient, fitted, needs_gcc

from thermocorr import DynamicBiasRegressor, ModelFileError
from thermocorr.effects import Covariate, Drift, LaggedCovariate, Periodic, Rate
from thermocorr.firmware import export_c
from thermocorr.firmware.printer import comment
from thermocorr.output.codec import parse
from thermocorr.output.effect_nodes import EffectCodec
from thermocorr.output.model_file import _model_of, content_of, signed
from thermocorr.records.errors import printable

OF_THE_CODE = """
    s j k m g in other bias share result reading temperature columns change flags first step started called seconds
    elapsed gain lag lag1 tau1 v1 before previous play delayed judge judged_as motion_of motions advance gate course
    rows state init update worst wrong off expected ROWS INPUTS ACCEPTED H
""".split()  # noqa: SIM905
OF_C = """
    int float double main inline restrict register static void default errno signal isnan isfinite NAN INFINITY exp
    expm1 fabs fabsf sin log1p gamma y0 j1 uint32_t int64_t INT64_C UINT32_MAX FLT_MAX DBL_MAX EOF NULL printf stdin
    time abs div index linux unix asm typeof bool true complex I _Bool __LINE__ __attribute__ defined stdint math stdio
    limits string features atomic sem mtx pthread_mutex class new template
""".split()  # noqa: SIM905
ODD = ["9lives", "_", "*/", "a b", "größe", "温", "x" * 90, "-", ".hidden", "%s%n", '"', "\x1b[31m", "COM1"]
STRICT = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror"]


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000] + done.stdout[:1000]
    return done.stdout


@pytest.fixture(scope="module")
def of_everything():
    """A model with a clock, a recorded column and lags, so that every local variable and flag is in use."""
    return fitted([LaggedCovariate("humidity", ["20 min"]), Rate(), Drift(True), Periodic("3 h")])[0]


@pytest.mark.long
@pytest.mark.newest
@needs_gcc
def test_no_name_of_an_export_breaks_the_code(tmp_path, of_everything):
    """All exports stand in one folder, which is on the include path, and go into one program."""
    names = OF_THE_CODE + OF_C + ODD
    exports = [export_c(of_everything, tmp_path, name=name, force=True) for name in names]
    exports += [export_c(of_everything, tmp_path / "errno.h", force=True)]
    codes, tests = (sorted({export.paths[i] for export in exports}) for i in (1, 2))
    assert len(codes) > 0.9 * len(names)  # few are written alike: "_" and "-" have no letter
    run(*STRICT, "-fsyntax-only", "-I", tmp_path, *codes, *tests)
    run(*STRICT, "-I", tmp_path, *codes, tests[0], "-lm", "-o", tmp_path / "together")
    for export in exports[:2]:
        run(*STRICT, "-I", tmp_path, *export.paths[1:], "-lm", "-o", tmp_path / "alone")
        assert "passed: 200 of 200" in run(tmp_path / "alone")


@needs_gcc
def test_no_name_of_a_column_breaks_the_code(tmp_path):
    ends_comments = [
        "*\\",
        "/\\*",
        "温温温/",
        "???/",
        "**//**",
        "a\n*/\nint",
        "*\x00/",
        "*\u202e/",
        "/" * 9 + "*",
        "\\",
    ]
    names = list(dict.fromkeys(OF_THE_CODE + OF_C + ODD + ends_comments))
    names.remove("temperature")
    rng = np.random.default_rng(0)
    X = pd.DataFrame({name: rng.normal(5, 1, 400) for name in names}).assign(temperature=np.arange(400) % 37.0)
    X.attrs["units"] = {"temperature": "*\\K"}
    y = pd.Series(X.sum(axis=1) + rng.normal(0, 0.1, 400), name="volt*\\")
    y.attrs["units"] = {y.name: "V*\\"}
    effects = [Covariate(name) for name in names]
    model = DynamicBiasRegressor("temperature", [300.0], 1, effects=effects).fit(X, y)
    export = export_c(model, tmp_path, name="S")
    assert export.columns == tuple(names)
    run(*STRICT, "-I", tmp_path, *export.paths[1:], "-lm", "-o", tmp_path / "alone")
    assert "passed: 200 of 200" in run(tmp_path / "alone")
    assert "\x1b" not in str(export) and "\u202e" not in str(export)
    for path in export.paths:
        text = path.read_bytes().decode("ascii")
        assert all(c.isprintable() or c == "\n" for c in text)


@pytest.mark.parametrize("text", ["*\\ x", "/\\*", "???/", "温温温/", "**//**", "/*/", "*\x00/"])
def test_nothing_ends_a_comment(text):
    said = comment(text)
    assert not any(mark in said for mark in ("*/", "/*", "??", "\\"))


ESCAPE, BELL, OVERRIDE = "\x1b[31m", "\x07", "\N{RIGHT-TO-LEFT OVERRIDE}"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("room temperature [°C]", "room temperature [°C]"),
        ("湿度\N{NO-BREAK SPACE}%", "湿度\N{NO-BREAK SPACE}%"),
        ("Te\N{COMBINING ACUTE ACCENT}", "Te\N{COMBINING ACUTE ACCENT}"),
        ("\N{THERMOMETER}", "\N{THERMOMETER}"),
        ("\x1b[2J", r"\x1b[2J"),
        ("a\r\nb\tc", r"a\r\nb\tc"),
        ("\x9b31m\x7f\x00", r"\x9b31m\x7f\x00"),
        ("\u202egnorw\u2066", r"\u202egnorw\u2066"),
        ("a\u2028b\u2029", r"a\u2028b\u2029"),
        ("\ud800\U000e0041", r"\ud800\U000e0041"),
        (7, "7"),
    ],
)
def test_printable(text, shown):
    assert printable(text) == shown
    assert printable(printable(text)) == shown
    shown.encode()


def test_printable_keeps_what_it_is_told_to():
    assert printable("a\n\x1b", kept="\n") == "a\n\\x1b"


def test_names_and_units_cannot_steer_a_terminal():
    temperature, humidity, reading = f"room{ESCAPE}", f"hum{BELL}{OVERRIDE}", f"volt\r{ESCAPE}"
    X = ambient(600).set_axis([temperature, humidity], axis=1)
    y = pd.Series(2 * X[temperature] + 0.1 * X[humidity], name=reading)
    X.attrs["units"] = {humidity: f"%{ESCAPE}"}
    y.attrs["units"] = {reading: f"mV{OVERRIDE}"}
    model = DynamicBiasRegressor(temperature, [300.0], effects=[Covariate(humidity)]).fit(X, y)
    for text in (model.equation(), model.coef_table().to_string(), str(model.notes_)):
        assert not any(mark in text for mark in (ESCAPE, BELL, OVERRIDE, "\r"))
    assert r"room\x1b[31m - " in model.equation() and r"hum\x07\u202e" in model.equation()
    assert humidity in model.features_.get_feature_names_out()  # keys stay what they are
    assert humidity in model.contributions(X).columns[-1]


def test_line_ends_in_names_stay_keys_of_the_table():
    """Spreadsheets have them; pandas shows them as escapes by itself."""
    X = ambient(400).set_axis(["temperature", "humidity\n[%]"], axis=1)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Covariate("humidity\n[%]")]).fit(X, X["temperature"])
    table = model.coef_table()
    assert "humidity\n[%]" in table.index
    assert "humidity\\n[%]" in table.to_string()
    assert len(model.equation().splitlines()) == len(table) + 2  # one for each column, and what the names mean


@pytest.fixture(scope="module")
def saved():
    """A model as its file has it, and data: a run, a time, an effect's column and an idle one."""
    X = log(120, seed=3)
    X = X.assign(idle=1.0, run=np.repeat(["a", "b"], 60), clock=np.arange(120.0)).reset_index(drop=True)
    y = (X["temperature"] + np.random.default_rng(0).normal(0, 0.1, 120)).rename("reading")
    model = DynamicBiasRegressor(time_constants=[300.0], time="clock", run="run", effects=[Covariate("humidity")])
    return written(model.fit(X, y)), X, y


def written(model):
    """What a file holds of a model."""
    return content_of(model)


def loaded(content, change=lambda names: None, place=lambda node: node["model"]["feature_names_in"]):
    """The model of a file with another list of names, whose digest is taken to fit."""
    node = {key: part for key, part in parse(content).items() if key not in ("format", "version", "digest")}
    change(place(node))
    return _model_of(signed(node), EffectCodec())


def test_a_true_list_of_names_is_taken(saved):
    content, X, y = saved
    again = loaded(content)
    assert list(again.feature_names_in_) == list(X.columns)
    assert np.isfinite(again.correct(X, y)).all()


@pytest.mark.parametrize("lost", ["temperature", "humidity", "clock", "run"])
def test_a_list_without_a_needed_name_is_refused(lost, saved):
    def rename(names):
        names[names.index(lost)] = "other"

    with pytest.raises(ModelFileError, match=f"feature_names_in has no .'{lost}'., which the model needs"):
        loaded(saved[0], rename)


def test_a_list_with_a_name_twice_is_refused(saved):
    def double(names):
        names[names.index("idle")] = "humidity"

    with pytest.raises(ModelFileError, match="feature_names_in has a name twice"):
        loaded(saved[0], double)


def test_a_list_of_another_length_is_refused(saved):
    with pytest.raises(ModelFileError, match="feature_names_in"):
        loaded(saved[0], lambda names: names.append("more"))


def test_a_list_that_makes_another_column_the_temperature_is_refused():
    """Nobody named the temperature, and none is called so: the first column is the one."""
    X = log(80, seed=3)[["temperature", "humidity"]].rename(columns={"temperature": "room"})
    y = X["room"].rename("reading") + np.random.default_rng(0).normal(0, 0.1, 80)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Covariate("humidity")]).fit(X, y)
    with pytest.raises(ModelFileError, match="makes 'humidity' the temperature, not 'room'"):
        loaded(written(model), list.reverse)


def test_another_order_of_columns_is_said_in_words_and_changes_no_number(saved):
    """No number in a file depends on the order of named columns: it is that of the fitted X, whatever it was."""
    content, X, y = saved
    swapped = loaded(content, list.reverse)
    with pytest.raises(ValueError, match="same order as they were in fit"):
        swapped.correct(X, y)
    np.testing.assert_array_equal(swapped.correct(X[X.columns[::-1]], y), loaded(content).correct(X, y))


@pytest.mark.parametrize("named", [True, False])
def test_another_temperature_than_that_of_the_fit_is_refused(named):
    X = log(80, seed=3)[["humidity", "temperature"]]
    X, column = (X, "temperature") if named else (X.to_numpy(), 1)
    y = 0.1 * np.arange(80.0)
    content = written(DynamicBiasRegressor(column, [3.0]).fit(X, y))

    def rename(node):
        node["parameters"]["temperature"] = "humidity" if named else 0

    with pytest.raises(ModelFileError, match=r"makes .* the temperature, not|not as thermocorr writes|belong together"):
        loaded(content, rename, lambda node: node["model"])
