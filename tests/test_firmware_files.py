"""Export to C: what is refused, what stands in the files, what compilers and checkers say of them, command line."""

import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from firmware_runs import (
    ALL_AT_ONCE,
    BOUNDS,
    KINDS,
    PERIOD,
    WARNINGS,
    compile_c,
    errors,
    fitted,
    later,
    needs_gcc,
    run_c,
    start_of,
    tool,
)
from sklearn.preprocessing import StandardScaler

from thermocorr import DynamicBiasRegressor, RecordError, RecordWarning, save_model
from thermocorr.command import cli
from thermocorr.effects import Covariate, Delay, Drift, Effect, Rate, ThermalLag
from thermocorr.firmware import export_c
from thermocorr.firmware.c99 import number

pytestmark = pytest.mark.newest


@pytest.fixture(scope="module")
def simple():
    """A model with two lags, and its fitted record."""
    return fitted()


@pytest.fixture(scope="module")
def with_columns():
    return fitted([Covariate("humidity"), Rate(), Drift(True)])


class Fan(Effect):
    kind = "fan"

    def names(self):
        return ["fan"]

    def columns(self, block, state):
        return np.sin(block.temperature), state


class OwnLag(ThermalLag):
    """A subclass may compute anything."""

    def columns(self, block, state):
        return super().columns(block, state)


@pytest.mark.parametrize("effect", [Fan(), OwnLag([500.0]), StandardScaler()], ids=["own", "subclass", "transformer"])
def test_effects_without_c_are_refused_by_name(effect, tmp_path):
    model, _ = fitted([effect])
    with pytest.raises(ValueError, match=r"(fan|OwnLag|StandardScaler).*cannot be exported to C"):
        export_c(model, tmp_path / "new" / "bias")
    assert not list(tmp_path.iterdir())


def test_delays_have_bounds(tmp_path):
    model, _ = fitted([Delay("25 min")])
    with pytest.raises(ValueError, match=r"delay of 1500 s.*only at run time"):
        export_c(model, tmp_path, sampling_period="variable")
    with pytest.raises(ValueError, match=r"delay of 1500 s.*15000 values"):
        export_c(model, tmp_path, sampling_period=0.1)
    assert not list(tmp_path.iterdir())


def test_contributions_that_cancel_are_told(tmp_path):
    model, _ = fitted(time_constants=[1e4, 1.0002e4, 1.0004e4])
    with pytest.warns(RecordWarning, match="cancel"):
        export_c(model, tmp_path)


@pytest.mark.parametrize(("level", "told"), [(1e7, True), (100.0, False)])
def test_readings_that_are_coarse_in_single_precision_are_told(tmp_path, level, told):
    """A counter at 10 MHz with a noise of 1 mHz: the code gave exactly 10 MHz for each of its readings."""
    rng = np.random.default_rng(0)
    X = pd.DataFrame({"temperature": 23 + np.cumsum(0.01 * rng.standard_normal(500))})
    y = pd.Series(level + 0.05 * X["temperature"] + 1e-3 * rng.standard_normal(500), name="f [Hz]")
    model = DynamicBiasRegressor("temperature", ["5 min"], sampling_period="1 min", degree=1).fit(X, y)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        export_c(model, tmp_path / "single")
        export_c(model, tmp_path / "double", "double", name="twice")
    said = [str(each.message) for each in caught if "single precision" in str(each.message)]
    assert len(said) == told and all("steps of 1 Hz" in text and "dtype='double'" in text for text in said)


def test_bad_parameters(tmp_path, simple):
    with pytest.raises(ValueError, match="'dtype' parameter must be 'float' or 'double'"):
        export_c(simple[0], tmp_path, "half")
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        export_c(simple[0], tmp_path / "file" / "bias")
    with pytest.raises(ValueError, match="has no place in a C float"):
        number(1e39, "float")
    with pytest.raises(ValueError, match="has no place in a C float"):
        number(1e-42, "float")


def test_numbers_keep_all_their_digits():
    rng = np.random.default_rng(0)
    for value in (*rng.normal(size=200) * 10.0 ** rng.integers(-30, 30, 200), 0.0, 1.0, -3e8):
        assert float(number(value, "double")) == value
        single = number(value, "float")
        assert single.endswith("f") and np.float32(single[:-1]) == np.float32(value)
        assert any(mark in single for mark in ".e")  # a floating-point literal


def build_selftest(export, command, output):
    built = subprocess.run(
        [*command, *WARNINGS, *export.paths[1:], "-o", output, "-lm"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    return output


@needs_gcc
@pytest.mark.parametrize("dtype", ["float", "double"])
@pytest.mark.parametrize("period", ["fitted", "variable"])
def test_the_self_test_passes_and_can_fail(dtype, period, tmp_path, with_columns):
    model, _ = with_columns
    export = export_c(model, tmp_path / "bias", dtype, sampling_period=period)
    program = build_selftest(export, ["gcc", "-O1"], tmp_path / "test")
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "passed, 0 of 160" in done.stdout
    code = export.paths[1].read_text()
    line = next(line for line in code.splitlines() if line.startswith(f"static const {dtype} weight"))
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


def test_command_line(tmp_path, with_columns, monkeypatch, capsys):
    loaded = []

    def load(path):
        loaded.append(path)
        return with_columns[0]

    monkeypatch.setitem(sys.modules, "thermocorr.files.model_file", SimpleNamespace(load=load))
    out = tmp_path / "firmware" / "bridge.c"
    arguments = ["export-c", "--model", "m.json", "--out", str(out), "--double", "--sampling-period", "variable"]
    assert cli.main(arguments) == 0
    assert [str(path) for path in loaded] == ["m.json"]
    assert sorted(path.name for path in out.parent.iterdir()) == ["bridge.c", "bridge.h", "bridge_test.c"]
    said = capsys.readouterr().out
    assert "RAM: state" in said and "bridge: double, steps given to update" in said
    assert cli.main(["export-c", "--model", "m.json", "--out", str(out), "--sampling-period", "no time"]) == 2
    assert "sampling_period" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("steps", "more", "varies"),
    [
        ("uneven", (), True),
        ("uneven", ("--sampling-period", "variable"), False),
        ("uneven", ("--sampling-period", "30s"), False),
        ("rounded", (), False),
        ("missing rows", (), False),
    ],
)
def test_a_fixed_step_is_said_where_those_of_the_log_vary(tmp_path, capsys, steps, more, varies):
    """One row in fifty that is missing, and stamps of half a second, are no steps that vary."""
    rng = np.random.default_rng(1)
    step = rng.uniform(10, 50, 600) if steps == "uneven" else 30 + rng.choice([-0.5, 0, 0.5], 600)
    seconds = step.cumsum()
    if steps == "missing rows":
        seconds = np.delete(30.0 * np.arange(600), np.arange(20, 600, 50))
    X = pd.DataFrame({"time": seconds, "temperature": 20 + np.sin(seconds / 900)})
    model = DynamicBiasRegressor("temperature", [600.0], time="time").fit(X, X["temperature"] + rng.normal(size=len(X)))
    save_model(model, tmp_path / "model.json")
    out = ("--out", str(tmp_path / "firmware"))
    assert cli.main(["export-c", "--model", str(tmp_path / "model.json"), *out, *more]) == 0
    said = capsys.readouterr().out
    assert ("Note: The steps of the fitted log vary" in said) == varies
    if varies:
        assert "one sample every 2" in said or "one sample every 3" in said
        assert "nine of ten are 1" in said and "--sampling-period variable" in said
