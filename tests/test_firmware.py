"""Export to C: what the compiled code answers, against the model; what is refused; what stands in the files."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from firmware_runs import (
    ALL_AT_ONCE,
    KINDS,
    PERIOD,
    WARNINGS,
    ambient,
    compile_c,
    errors,
    fitted,
    later,
    run_c,
    start_of,
    tool,
)
from sklearn.preprocessing import StandardScaler

from thermocorr import DynamicBiasRegressor, RecordError, RecordWarning
from thermocorr.effects import CATALOGUE, Covariate, Delay, Drift, Effect, LagProducts, Rate, Step, ThermalLag
from thermocorr.outside import cli
from thermocorr.outside.firmware import export_c
from thermocorr.outside.firmware.language import Operations, comment, count_operations, identifier, number

needs_gcc = pytest.mark.skipif(tool("gcc") is None, reason="no C compiler: install gcc to run the exported code")
ROWS = 20_000
BOUNDS = {"double": 1e-12, "float": 1e-5}
"""Promised share of the range of the bias. Measured: 1e-14 and 1e-6, see benchmarks/firmware.py for a million rows."""


@pytest.fixture(scope="module")
def simple():
    """A model with two lags, and its fitted record."""
    return fitted()


@pytest.fixture(scope="module")
def with_columns():
    return fitted([Covariate("humidity"), Rate(), Drift(True)])


# ------------------------------------------------------------------------- the same numbers as the model gives


@needs_gcc
@pytest.mark.parametrize("kind", KINDS)
def test_c_gives_the_bias_of_python(kind, tmp_path):
    """A device that starts anew, at a fixed period; one that goes on where the fit ended, with steps of its own."""
    settings = KINDS[kind]
    model, X = fitted(**settings)
    kelvin = settings.get("kelvin", False)
    runs = [("double", False, False), ("float", False, False), ("float", True, True)]
    if kind.startswith("delay"):
        runs[-1] = ("float", False, True)
    for dtype, variable, follows in runs:
        error, *_ = errors(model, X, tmp_path, dtype, ROWS, variable, follows, kelvin, command=("gcc", "-O1"))
        assert error < BOUNDS[dtype], (dtype, variable, follows)


def test_every_kind_of_the_catalogue_is_among_them():
    assert {kind.split(",")[0] for kind in KINDS} - {"several"} == set(CATALOGUE)


@needs_gcc
@pytest.mark.parametrize("dtype", ["float", "double"])
def test_flags_and_correction_are_those_of_python(dtype, tmp_path):
    model, X = fitted()
    _error, _export, run, _expected, new = errors(model, X, tmp_path, dtype, 3000)
    held = new.to_numpy()[:, 0]
    low, high = model.reading_.temperature_range
    python = model.flags(new)
    outside = (held < np.float32(low)) | (held > np.float32(high)) if dtype == "float" else (held < low) | (held > high)
    np.testing.assert_array_equal((run.flags & 8) > 0, python == "washout")
    np.testing.assert_array_equal((run.flags & 16) > 0, outside)
    assert 0 < (python == "washout").sum() < 3000 and 0 < outside.sum() < 3000
    T = np.float32 if dtype == "float" else np.float64
    np.testing.assert_array_equal(run.corrected, T(1.0) - run.bias.astype(T))


@needs_gcc
def test_a_slow_lag_does_not_stick_in_single_precision(tmp_path):
    """tau/dt = 7e5: an increment is below half a unit of the state's last digit most of the time."""
    model, X = fitted(**KINDS["thermal_lag, 1e7 s"])
    error, _export, _run, _expected, new = errors(model, X, tmp_path, "float", ROWS)
    assert error < 2e-6
    column = [name.startswith("lag[") for name in model.features_.get_feature_names_out()].index(True)
    exact = model.features_.transform(new)[:, column]
    T, decay, d, plain = new["temperature"].to_numpy(np.float32), np.float32(np.exp(-PERIOD / 1e7)), np.float32(0), []
    for step in np.diff(T, prepend=T[0]):
        d = decay * d - step  # the gain is 1 to all digits of single precision
        plain.append(float(d))
    assert np.abs(np.array(plain) - exact).max() > 10 * error * np.ptp(exact)  # what the plain recursion would do


# ------------------------------------------------------------------------------------------ costs


def test_a_model_of_the_papers_size_is_small(tmp_path):
    model, _ = fitted(**KINDS["thermal_lag, paper's size"])
    export = export_c(model, tmp_path)
    assert export.state_bytes <= 64
    assert export.operations.total <= 40  # fewer still are multiply-adds
    # By hand: 6 lags of 2 multiply-adds and 1 for the bias, 2 for the square; 3 additions for each compensated lag
    # (tau > 16 dt: five), T - T0, T - T before, reading - bias.
    assert export.operations == Operations(multiply_adds=20, adds=5 * 3 + 3)
    # By hand: 6 lags, 5 rests, temperature, washout and started, 4 bytes each.
    assert export.state_bytes == 4 * (6 + 5 + 3)
    frame = export.frame()
    assert frame.loc["RAM: state", "value"] == 56 and "56 bytes" in str(export)


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("bias += mu[j + 1] * s->lag[j];", Operations(1)),
        ("const float a = -(x - 1.0e-5f);", Operations(0, 1)),
        ("y = (a_2 * u + a_1) * u; /* a * comment */", Operations(2)),
        ("const double r = step / tau[j] + expm1(-x) * 2.5e+3;", Operations(1, 0, 1, 1)),
        ("const float seconds = (float)s->sample * period;", Operations(1)),
        ("s->rest[j] = (next - s->lag[j]) + increment;", Operations(0, 2)),
        ("return value >= -limit;", Operations()),
    ],
)
def test_operations_are_counted_from_the_text(statement, expected):
    assert count_operations(statement) == expected


def test_equal_lags_are_computed_once(tmp_path, simple):
    plain = export_c(simple[0], tmp_path)
    model, _ = fitted([LagProducts([200.0, 2000.0]), Rate(200.0)])
    more = export_c(model, tmp_path)
    assert more.state_bytes == plain.state_bytes


# -------------------------------------------------------------------------------- missing inputs, starts, steps


@needs_gcc
def test_missing_inputs_are_flagged_and_forgotten(tmp_path, with_columns):
    model, X = with_columns
    new = later(model, X, 2000)
    broken = new.copy()
    broken.iloc[[0, 1], 0] = np.nan
    broken.iloc[500:510, 0] = np.inf
    broken.iloc[700, 0] = -1e4  # finite, and no temperature of a room
    broken.iloc[505:520, 1] = np.nan
    reading = np.ones(2000)
    reading[900] = np.nan
    export = export_c(model, tmp_path / "bias", sampling_period=PERIOD)
    run = run_c(compile_c(export, start=start_of(export, X, new)), broken, reading, export.columns)
    taken = broken.where(np.abs(broken) < 1e3).ffill()[2:]  # the last good value stands in
    expected = model.bias(taken).to_numpy()
    assert np.abs(run.bias[2:] - expected).max() < 1e-5 * np.ptp(expected)
    rows = {bit: set(np.flatnonzero(run.flags & bit)) for bit in (1, 2, 4, 32)}
    assert rows == {1: {0, 1, *range(500, 510), 700}, 2: set(range(505, 520)), 4: {900}, 32: {0, 1}}
    np.testing.assert_array_equal(run.bias[:2], 0.0)
    assert np.isnan(run.corrected[900]) and np.isfinite(np.delete(run.corrected, 900)).all()


@needs_gcc
def test_a_step_of_no_length_is_left_out(tmp_path, with_columns):
    model, X = with_columns
    new = later(model, X, 1000, irregular=True)
    export = export_c(model, tmp_path / "bias", sampling_period="variable")
    program = compile_c(export, start=start_of(export, X, new))
    repeated = new.iloc[[*range(300), 299, *range(300, 1000)]].copy()
    repeated.iloc[300] = [90.0, np.nan]
    run = run_c(program, repeated, np.ones(1001), export.columns)
    expected = model.bias(new).to_numpy()
    assert np.flatnonzero(run.flags & 64).tolist() == [300]
    assert np.abs(np.delete(run.bias, 300) - expected).max() < 1e-5 * np.ptp(expected)


@needs_gcc
def test_a_gap_is_one_long_step(tmp_path, simple):
    """A straight line across the gap, as Python takes it within a segment; every form of exp is used."""
    model, X = simple
    new = later(model, X, 3000, irregular=True)
    new.index = new.index + pd.to_timedelta(np.where(np.arange(3000) > 1000, 3000.0, 0.0), unit="s")
    for dtype in ("float", "double"):
        export = export_c(model, tmp_path / "bias", dtype, sampling_period="variable")
        run = run_c(compile_c(export), new, np.ones(3000))
        expected = model.bias(new).to_numpy()
        assert np.abs(run.bias - expected).max() < BOUNDS[dtype] * np.ptp(expected)


@needs_gcc
@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("kind", ["several", "lag_products, from T0", "initial_transient"])
def test_a_gap_beyond_max_gap_starts_anew(kind, follows, tmp_path):
    """Python takes what comes after a gap longer than max_gap (1 h here) as a device of unknown state."""
    model, X = fitted(**KINDS[kind])
    new = later(model, X, 2000, irregular=True, follows=follows)
    new.index = new.index + pd.to_timedelta(np.where(np.arange(2000) > 1000, 4000.0, 0.0), unit="s")
    for dtype in ("float", "double"):
        export = export_c(model, tmp_path / "bias", dtype, sampling_period="variable", continue_from_fit=follows)
        first = round(PERIOD * 1e6) if follows else 0
        program = compile_c(export, start=0 if follows else start_of(export, X, new))
        run = run_c(program, new, np.ones(2000), export.columns, first_step=first)
        expected = model.bias(new).to_numpy()
        assert np.abs(run.bias - expected).max() < BOUNDS[dtype] * np.ptp(expected)
        np.testing.assert_array_equal((run.flags & 8) > 0, model.flags(new) == "washout")
        assert (run.flags[:1001] & 8).any() != follows and (run.flags[1001:] & 8).any()


def test_what_correct_keeps_is_kept(tmp_path):
    model, _ = fitted([Drift()])
    export = export_c(model, tmp_path)
    assert export.kept == ("drift",) and "drift" in str(export)
    assert "seconds" not in export.paths[1].read_text()


# --------------------------------------------------------------------------------------------- refusals, warnings


class Fan(Effect):
    kind = "fan"

    def names(self):
        return ["fan"]

    def columns(self, block, state):
        return np.sin(block.temperature), state


class OwnLag(ThermalLag):
    """A subclass may compute anything."""


@pytest.mark.parametrize("effect", [Fan(), OwnLag([500.0]), StandardScaler()], ids=["own", "subclass", "transformer"])
def test_effects_without_c_are_refused_by_name(effect, tmp_path):
    model, _ = fitted([effect])
    with pytest.raises(ValueError, match=r"(fan|OwnLag|StandardScaler).*cannot be exported to C"):
        export_c(model, tmp_path / "new" / "bias")
    assert not list(tmp_path.iterdir())


def test_delays_have_bounds(tmp_path):
    model, _ = fitted([Delay("25 min")])
    with pytest.raises(ValueError, match=r"delay: 1500 s.*only at run time"):
        export_c(model, tmp_path, sampling_period="variable")
    with pytest.raises(ValueError, match=r"delay: 1500 s.*15000 temperatures"):
        export_c(model, tmp_path, sampling_period=0.1)
    assert not list(tmp_path.iterdir())


def test_contributions_that_cancel_are_told(tmp_path):
    model, _ = fitted(time_constants=[1e4, 1.02e4, 1.04e4])
    with pytest.warns(RecordWarning, match="cancel"):
        export_c(model, tmp_path)


def test_bad_parameters(tmp_path, simple):
    with pytest.raises(ValueError, match="'dtype' parameter of export_c must be 'float' or 'double'"):
        export_c(simple[0], tmp_path, "half")
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        export_c(simple[0], tmp_path / "file" / "bias")
    with pytest.raises(ValueError, match="has no place in a C float"):
        number(1e39, "float")
    with pytest.raises(ValueError, match="has no place in a C float"):
        number(1e-42, "float")


# ------------------------------------------------------------------------------------------ names and digits


def test_numbers_keep_all_their_digits():
    rng = np.random.default_rng(0)
    for value in (*rng.normal(size=200) * 10.0 ** rng.integers(-30, 30, 200), 0.0, 1.0, -3e8):
        assert float(number(value, "double")) == value
        single = number(value, "float")
        assert single.endswith("f") and np.float32(single[:-1]) == np.float32(value)
        assert Fraction(float(single[:-1])) is not None and any(mark in single for mark in ".e")


def test_names_of_the_user_stay_inside_their_comments():
    nasty = 'a */ int x; /* "\\\n??/ \N{DEGREE SIGN}C'
    said = comment(nasty)
    assert "*/" not in said and "/*" not in said and "\n" not in said and "??" not in said and "\\" not in said
    assert said.isascii() and said.isprintable()
    taken = set()
    names = [
        identifier(text, taken) for text in ("Température (°C)", "temperature c", "TEMPERATURE_C", "int", "9 V", "")
    ]
    assert len({name.lower() for name in names}) == 6
    assert all(name.isidentifier() and name.isascii() for name in names)


@needs_gcc
def test_nasty_column_names_compile(tmp_path):
    names = ['*/ #error "out"\n', "int", "relative humidity [%]", "relative_humidity____", "\N{GREEK SMALL LETTER RHO}"]
    X = ambient(400)
    rng = np.random.default_rng(0)
    for name in names:
        X[name] = rng.normal(5, 1, 400)
    X = X.drop(columns="humidity")
    y = pd.Series(X.sum(axis=1), name="volt*/age\\")
    effects = [Covariate(name) for name in names]
    model = DynamicBiasRegressor("temperature", [300.0], 1, effects=effects).fit(X, y)
    export = export_c(model, tmp_path / "9 int.c")
    assert export.columns == tuple(names) and export.name == "thermal_bias_9_int"
    run = run_c(compile_c(export), X.astype(np.float32).astype(float), y, export.columns)
    assert np.ptp(run.corrected) < 0.01 * np.ptp(y)


# --------------------------------------------------------------------------------------- self-test, other tools


def build_selftest(export, command, output):
    built = subprocess.run(
        [*command, *WARNINGS, *export.paths[1:], "-o", output, "-lm"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    return output


@needs_gcc
@pytest.mark.parametrize("dtype", ["float", "double"])
@pytest.mark.parametrize("period", ["fitted", "variable"])
@pytest.mark.parametrize("follows", [False, True])
def test_the_self_test_passes_and_can_fail(dtype, period, follows, tmp_path, with_columns):
    model, _ = with_columns
    export = export_c(model, tmp_path / "bias", dtype, sampling_period=period, continue_from_fit=follows)
    program = build_selftest(export, ["gcc", "-O1"], tmp_path / "test")
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "passed, 0 of 160" in done.stdout
    code = export.paths[1].read_text()
    line = next(line for line in code.splitlines() if line.startswith(f"static const {dtype} covariate"))
    value = line.split(" = ")[1].split(";")[0]
    wrong = number(float(value.rstrip("f")) * 1.001, dtype)
    export.paths[1].write_text(code.replace(line, line.replace(value, wrong)))
    program = build_selftest(export, ["gcc", "-O1"], tmp_path / "test")
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "FAILED" in done.stdout


@pytest.fixture(scope="module")
def everything():
    effects = [*ALL_AT_ONCE, *(KINDS[kind]["effects"][0] for kind in ("delay", "periodic", "log_ageing", "step"))]
    return fitted(effects)


@pytest.mark.skipif(tool("clang") is None, reason="clang is not installed")
def test_clang_has_nothing_to_say(tmp_path, everything):
    for dtype in ("float", "double"):
        build_selftest(export_c(everything[0], tmp_path, dtype), ["clang", "-Wsign-conversion"], tmp_path / "test")


@needs_gcc
def test_sanitizers_have_nothing_to_say(tmp_path, everything):
    model, X = everything
    probe = subprocess.run(
        ["gcc", "-fsanitize=address,undefined", "-x", "c", "-", "-o", tmp_path / "probe"],
        input="int main(void){return 0;}",
        text=True,
        capture_output=True,
        check=False,
    )
    if probe.returncode:
        pytest.skip("gcc has no sanitizers here")
    command = ("gcc", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    export = export_c(model, tmp_path / "bias", sampling_period=PERIOD)
    new = later(model, X, 3000)
    new.iloc[::97] = np.nan
    run = run_c(compile_c(export, command, start_of(export, X, new)), new, np.ones(3000), export.columns)
    assert np.isfinite(run.bias).all()


@pytest.mark.skipif(tool("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not installed")
def test_it_builds_for_a_cortex_m4_and_fits(tmp_path, simple, everything):
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-Os"]
    for model in (simple[0], everything[0]):
        export = export_c(model, tmp_path / "bias")
        size_check = f"typedef char fits[sizeof({export.name}_state) == {export.state_bytes} ? 1 : -1];"
        source = tmp_path / "check.c"
        source.write_text(f'#include "{export.paths[1]}"\n{size_check}\nfits *unused(void);\n')
        built = subprocess.run(
            ["arm-none-eabi-gcc", *core, *WARNINGS, "-c", source, "-o", tmp_path / "check.o"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert built.returncode == 0, built.stderr


@pytest.mark.skipif(
    tool("arm-linux-gnueabihf-gcc") is None or tool("qemu-arm") is None,
    reason="needs arm-linux-gnueabihf-gcc and qemu-arm",
)
@pytest.mark.parametrize("dtype", ["float", "double"])
def test_an_emulated_arm_gives_the_same(dtype, tmp_path, everything):
    model, X = everything
    command = ("arm-linux-gnueabihf-gcc", "-O2", "-static", "-mfpu=vfpv4", "-ffp-contract=fast")  # as firmware is built
    error, export, *_ = errors(model, X, tmp_path, dtype, 2000, command=command, before=("qemu-arm",))
    assert error < BOUNDS[dtype]
    program = build_selftest(export, command, tmp_path / "test")
    subprocess.run(["qemu-arm", program], check=True, capture_output=True)


@needs_gcc
@pytest.mark.parametrize("variable", [False, True])
def test_fused_multiply_adds_do_no_harm(variable, tmp_path):
    """Compilers fuse a * b + c into one rounding unless told otherwise: the carried roundings must survive it."""
    model, X = fitted(**KINDS["thermal_lag, paper's size"])
    for dtype in ("float", "double"):
        command = ("gcc", "-O3", "-march=native", "-ffp-contract=fast")
        error, *_ = errors(model, X, tmp_path, dtype, ROWS, variable, command=command)
        assert error < BOUNDS[dtype]


# ------------------------------------------------------------------------ models from a file, command line


def stripped(model, history=False):
    """What a model needs to have for an export: no more."""
    features = SimpleNamespace(effect_list=model.features_.effect_list)
    if history:
        features.history_ = model.features_.history_
    names = ("coef_", "intercept_", "washout_", "time_constants_", "reference_temperature_")
    given = {name: getattr(model, name) for name in names}
    return SimpleNamespace(features_=features, temperature_range_=model.reading_.temperature_range, **given)


def test_a_loaded_model_needs_little(tmp_path, with_columns):
    whole = export_c(with_columns[0], tmp_path / "bias", sampling_period=PERIOD)
    code = whole.paths[1].read_text()
    bare = stripped(with_columns[0])
    again = export_c(bare, tmp_path / "bias", sampling_period=PERIOD)
    numbers = [[line.split("/*")[0] for line in text.splitlines()] for text in (code, again.paths[1].read_text())]
    assert numbers[0] == numbers[1]
    with pytest.raises(ValueError, match="pass sampling_period"):
        export_c(bare, tmp_path)
    with pytest.raises(ValueError, match="does not know the record"):
        export_c(bare, tmp_path, sampling_period=PERIOD, continue_from_fit=True)


def test_command_line(tmp_path, with_columns, monkeypatch, capsys):
    loaded = []

    def load(path):
        loaded.append(path)
        return with_columns[0]

    monkeypatch.setitem(sys.modules, "thermocorr.outside.model_file", SimpleNamespace(load=load))
    out = tmp_path / "firmware" / "bridge.c"
    arguments = ["export-c", "--model", "m.json", "--out", str(out), "--double", "--sampling-period", "variable"]
    assert cli.main(arguments) == 0
    assert [str(path) for path in loaded] == ["m.json"]
    assert sorted(path.name for path in out.parent.iterdir()) == ["bridge.c", "bridge.h", "bridge_test.c"]
    said = capsys.readouterr().out
    assert "RAM: state" in said and "bridge: double, steps given to update" in said
    assert cli.main(["export-c", "--model", "m.json", "--out", str(out), "--sampling-period", "no time"]) == 2
    assert "sampling_period" in capsys.readouterr().err


def test_steps_of_the_clock_are_exact(tmp_path):
    """A step between two samples is felt by the later one; one on a sample by itself."""
    model, _ = fitted([Step(60.0 + PERIOD / 2, True)])
    text = export_c(model, tmp_path / "bias", sampling_period=PERIOD).paths[1].read_text()
    assert "INT32_C(5)" in text
    model, _ = fitted([Step(60.0, True)])
    text = export_c(model, tmp_path / "bias", sampling_period=PERIOD).paths[1].read_text()
    assert "INT32_C(4)" in text
