"""Export to C: what the compiled code answers, against the model; what is refused; what compilers say."""

import subprocess

import numpy as np
import pandas as pd
import pytest
from firmware_runs import (
    ALL_AT_ONCE,
    BOUND,
    KINDS,
    ROWS,
    WARNINGS,
    ambient,
    compile_c,
    errors,
    fitted,
    later,
    needs_gcc,
    run_c,
    seconds_to,
    tool,
)
from sklearn.preprocessing import StandardScaler

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, save_model
from thermocorr.command import cli
from thermocorr.effects import CATALOGUE, Covariate, Delay, Drift, Effect, LaggedCovariate, Rate, ThermalLag
from thermocorr.firmware import export_c
from thermocorr.firmware.printer import number

pytestmark = pytest.mark.newest

NO_INPUT, NO_READING, WASHOUT, OUTSIDE, NOT_STARTED, BAD_STEP, JUMP, DOUBTFUL = (1 << k for k in range(8))


@pytest.fixture(scope="module")
def simple():
    """A model with two lags, and its fitted record."""
    return fitted()


@pytest.fixture(scope="module")
def with_columns():
    return fitted([Covariate("humidity"), Rate(), Drift(True)])


@pytest.fixture(scope="module")
def everything():
    effects = [*ALL_AT_ONCE, *(KINDS[kind]["effects"][0] for kind in ("delay", "periodic", "log_ageing", "step"))]
    return fitted(effects)


def selftest(export, command=("gcc", "-O1")):
    """Build the self-test with all warnings, and run it."""
    program = export.paths[1].with_name("selftest")
    built = subprocess.run(
        [*command, *WARNINGS, *export.paths[1:], "-o", program, "-lm"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    return subprocess.run([program], capture_output=True, text=True, check=False)


@needs_gcc
@pytest.mark.parametrize("kind", KINDS)
def test_c_gives_the_bias_of_python(kind, tmp_path):
    """With steps of its own; the self-test passes, too."""
    settings = KINDS[kind]
    model, X = fitted(**settings)
    error, export, *_ = errors(model, X, tmp_path, ROWS, True, settings.get("kelvin", False), ("gcc", "-O1"))
    assert error < BOUND
    assert selftest(export).returncode == 0


class Twisted(Effect):
    """A user's own effect: every word, words upon words, and operations that are no polynomials."""

    kind = "twisted"

    def __init__(self, delay=None):
        self.delay = delay

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["slow", "late", "rate", "damped", "clock", "case", "gap", "one side", "other side"]

    def signals(self, x):
        h, gap = x["humidity"], x["humidity"] - 2 * x.T
        slow = x.lag(x.play(x.T, 0.3) + 1.0, [100.0, 900.0], "zero_order")
        late = h - x.lag(h * x.T, [700.0])[0] if self.delay is None else x.delayed(gap, self.delay) - gap
        twice = x.lag(x.lag(x.T, [300.0])[0], [50.0, 6000.0])
        damped = x.exp(-abs(h - 45.0) / 3) + x.sin(x.T / 7) * x.cos(h / 9) / (1 + (h / 40) ** 2)
        clock = x.log1p(x.maximum(x.minimum(x.seconds, 2e6), 0.0) / 3600)
        case = x.where(x.change_rate(x.T) > 0.001, x.maximum(h, 45 - x.T), 2 - x.T)
        case = case * x.where(h < 45, 1, 3) + x.where(self.delay is None, (x.T >= 23) * h, x.where(h - 45, x.T, 1))
        return [
            slow[1] - twice[1],
            late,
            x.change_rate(gap**2),
            damped,
            clock,
            case,
            gap**2,
            *((x.T > 23.5) * v for v in (h, x.T)),
        ]


@needs_gcc
@pytest.mark.parametrize("effect", [Twisted(), Twisted(100.0)], ids=["words", "delayed"])
def test_any_formula_becomes_c(effect, tmp_path):
    model, X = fitted([effect])
    for irregular in (False, True):
        error, *_ = errors(model, X, tmp_path, ROWS, irregular, command=("gcc", "-O1"))
        assert error < BOUND


class Conditions(Effect):
    """Lags of two conditions: inputs that have no name of their own."""

    kind = "conditions"

    def inputs(self):
        return ["T"]

    def names(self):
        return ["warm", "dry"]

    def signals(self, x):
        return [x.lag(x.where(warm, 1, 0), [300.0])[0] for warm in (x.T > 23.0, x["T"] < 45.0)]


@needs_gcc
@pytest.mark.parametrize("effect", [Conditions(), LaggedCovariate("T", [200.0])], ids=["conditions", "column"])
def test_lags_of_different_inputs_are_not_one(effect, tmp_path):
    """Neither where comments call the inputs alike, such as a column with the name "T"."""
    X = ambient(6000).rename(columns={"humidity": "T"})
    model = DynamicBiasRegressor("temperature", [200.0], effects=[effect], max_gap="1 h")
    model.fit(X, X["temperature"].ewm(20).mean() + X["T"].ewm(30).mean() + (X["T"] < 45.0).ewm(30).mean())
    export = export_c(model, tmp_path / "bias")
    new = X.set_axis(X.index + pd.Timedelta(10, "D"))
    run = run_c(compile_c(export), new, np.ones(len(X)), export.columns)
    expected = model.bias(new).to_numpy()
    assert np.abs(run.bias - expected).max() < BOUND * np.ptp(expected)


def test_every_kind_of_the_catalogue_is_among_them():
    assert {kind.split(",")[0] for kind in KINDS} - {"several"} == {
        kind for kind, effect in CATALOGUE.items() if not effect.foresees
    }


@needs_gcc
def test_flags_and_correction_are_those_of_python(tmp_path):
    model, X = fitted()
    _, _, run, new = errors(model, X, tmp_path, 3000)
    python, T = model.flags(new), new["temperature"].to_numpy()
    low, high = model.reading_.temperature_range
    np.testing.assert_array_equal((run.flags & WASHOUT) > 0, python == "washout")
    assert ((run.flags & OUTSIDE) > 0)[(low > T) | (high < T)].all()
    settled = (run.flags & WASHOUT) == 0
    np.testing.assert_array_equal(((run.flags & OUTSIDE) > 0)[settled], (python == "outside fitted range")[settled])
    assert 0 < (python == "washout").sum() < 3000 and 0 < ((run.flags & OUTSIDE) > 0).sum() < 3000
    np.testing.assert_array_equal(run.corrected, 1.0 - run.bias)


@needs_gcc
def test_a_column_beyond_its_range_and_cooling_never_shown_are_flagged(tmp_path):
    X = ambient(3000)
    X["temperature"] = np.linspace(20.0, 30.0, 3000) + 0.3 * np.sin(np.arange(3000) / 50)
    rng = np.random.default_rng(0)
    lagged = X["temperature"].ewm(200).mean()
    y = 0.5 * X["humidity"] + 3 * lagged + 1e-3 * rng.standard_normal(3000)
    model = DynamicBiasRegressor("temperature", [600.0], effects=[Covariate("humidity")], degree=1).fit(X, y)
    new = X.copy()
    new.index += pd.Timedelta(10, "D")
    new["temperature"] = X["temperature"].to_numpy()[::-1]
    new.iloc[2000:, 1] += np.linspace(0, 60, 1000)
    export = export_c(model, tmp_path)
    run = run_c(compile_c(export), new, np.ones(3000), export.columns, seconds_to(X, new))
    python = model.flags(new).to_numpy()
    settled = (run.flags & WASHOUT) == 0
    np.testing.assert_array_equal(((run.flags & OUTSIDE) > 0)[settled], (python == "outside fitted range")[settled])
    assert ((run.flags & OUTSIDE) > 0)[2500:].all()


@needs_gcc
@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_inputs_are_doubted_as_by_the_stream(seed, irregular, tmp_path):
    """Jumps of one row and more, stretches that stand still, pauses longer than `max_gap`."""
    model, X = fitted([Covariate("humidity"), LaggedCovariate("humidity", [600.0])], seed=seed)
    rng, new = np.random.default_rng(seed), later(X, 4000, seed + 10, irregular)
    for _ in range(30):
        row, column, length = rng.integers(4000), rng.integers(2), rng.choice([1, 2, 5, 29, 31, 60])
        if rng.random() < 0.3:
            new.iloc[row : row + length, column] = new.iloc[row, column]
        else:
            new.iloc[row : row + length, column] += rng.normal() * rng.choice([3, 30, 80])
    pause = np.zeros(4000)
    pause[[1500, 2500]] = 1800.0, 5000.0
    new.index += pd.to_timedelta(np.cumsum(pause), unit="s")
    stream = OnlineCorrector(model)
    said = stream.update_many(new, np.ones(4000))
    export = export_c(model, tmp_path)
    run = run_c(compile_c(export), new, np.ones(4000), export.columns, seconds_to(X, new))
    bias, flags = said["bias"].to_numpy(), said["flag"].to_numpy()
    assert np.abs(run.bias - bias).max() < BOUND * np.abs(bias).max()
    for flag, word in ((JUMP, "jump"), (DOUBTFUL, "doubtful")):
        raised = (run.flags & flag) > 0
        assert raised[flags == word].all() and raised.any(), word
    assert (flags[(run.flags & (JUMP | DOUBTFUL)) > 0] != "").all()
    assert np.isin(flags[run.flags == 0], ["", "behind gap"]).all()  # a long step is a straight line to the device


@needs_gcc
def test_fused_multiply_adds_do_no_harm(tmp_path):
    model, X = fitted(**KINDS["thermal_lag, paper's size"])
    error, *_ = errors(model, X, tmp_path, ROWS, command=("gcc", "-O3", "-march=native", "-ffp-contract=fast"))
    assert error < BOUND


@needs_gcc
def test_missing_inputs_are_flagged_and_forgotten(tmp_path, with_columns):
    model, X = with_columns
    new = later(X, 2000)
    broken = new.copy()
    broken.iloc[[0, 1], 0] = np.nan
    broken.iloc[500:510, 0] = np.inf
    broken.iloc[700, 0] = -1e4  # finite, and no temperature of a room
    broken.iloc[505:520, 1] = np.nan
    reading = np.ones(2000)
    reading[900] = np.nan
    export = export_c(model, tmp_path / "bias")
    run = run_c(compile_c(export), broken, reading, export.columns, seconds_to(X, new))
    taken = broken.where(np.abs(broken) < 1e3).ffill()[2:]  # the last good value stands in
    expected = model.bias(taken).to_numpy()
    assert np.abs(run.bias[2:] - expected).max() < BOUND * np.ptp(expected)
    rows = {bit: set(np.flatnonzero(run.flags & bit)) for bit in (NO_INPUT, NO_READING, NOT_STARTED, JUMP)}
    missing = {0, 1, *range(500, 520)}
    assert rows == {NO_INPUT: missing, NO_READING: {900}, NOT_STARTED: {0, 1}, JUMP: {700}}
    np.testing.assert_array_equal(run.bias[:2], 0.0)
    assert np.isnan(run.corrected[900]) and np.isfinite(np.delete(run.corrected, 900)).all()


@needs_gcc
def test_a_step_of_no_length_is_left_out(tmp_path, with_columns):
    model, X = with_columns
    new = later(X, 1000, irregular=True)
    export = export_c(model, tmp_path / "bias")
    repeated = new.iloc[[*range(300), 299, *range(300, 1000)]].copy()
    repeated.iloc[300] = [90.0, np.nan]
    run = run_c(compile_c(export), repeated, np.ones(1001), export.columns, seconds_to(X, new))
    expected = model.bias(new).to_numpy()
    assert np.flatnonzero(run.flags & BAD_STEP).tolist() == [300]
    assert np.abs(np.delete(run.bias, 300) - expected).max() < BOUND * np.ptp(expected)


@needs_gcc
@pytest.mark.parametrize("gap", [3000.0, 4000.0])
@pytest.mark.parametrize("kind", ["several", "lag_products, of the model", "initial_transient"])
def test_a_gap_is_one_long_step_and_beyond_max_gap_a_new_start(kind, gap, tmp_path):
    """`max_gap` is 1 h here: Python takes what comes after a longer one as a device of unknown state."""
    model, X = fitted(**KINDS[kind])
    new = later(X, 2000, irregular=True)
    new.index = new.index + pd.to_timedelta(np.where(np.arange(2000) > 1000, gap, 0.0), unit="s")
    export = export_c(model, tmp_path / "bias")
    run = run_c(compile_c(export), new, np.ones(2000), export.columns, seconds_to(X, new))
    expected = model.bias(new).to_numpy()
    assert np.abs(run.bias - expected).max() < BOUND * np.ptp(expected)
    if gap > 3600:
        assert ((run.flags & WASHOUT)[model.flags(new) == "washout"] > 0).all()
        assert (run.flags[1001:] & WASHOUT).any()


def test_what_correct_keeps_is_kept(tmp_path):
    model, _ = fitted([Drift()])
    export = export_c(model, tmp_path)
    assert export.kept == ("drift",) and "drift" in str(export)


@needs_gcc
def test_samples_too_fast_for_a_delay_are_flagged(tmp_path):
    model, X = fitted([Delay("25 min")])
    new = later(X, 3000)
    new.index = new.index[0] + (new.index - new.index[0]) / 10
    run = run_c(compile_c(export_c(model, tmp_path)), new, np.ones(3000))
    assert (run.flags[1200:] & BAD_STEP).all() and not (run.flags[:150] & BAD_STEP).any()


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
    model, _ = fitted([Delay(40_000.0)])
    with pytest.raises(ValueError, match=r"delay of 40000 s keeps 5338 samples"):
        export_c(model, tmp_path)
    assert not list(tmp_path.iterdir())


def test_bad_parameters(tmp_path, simple):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        export_c(simple[0], tmp_path / "file" / "bias")
    with pytest.raises(ValueError, match="has no place in C"):
        number(np.inf)


def test_numbers_keep_all_their_digits():
    rng = np.random.default_rng(0)
    for value in (*rng.normal(size=200) * 10.0 ** rng.integers(-30, 30, 200), 0.0, 1.0, -3e8):
        assert float(number(value)) == value and any(mark in number(value) for mark in ".e")


@needs_gcc
def test_the_self_test_passes_and_can_fail(tmp_path, with_columns):
    export = export_c(with_columns[0], tmp_path / "bias")
    done = selftest(export)
    assert done.returncode == 0 and "passed: 200 of 200" in done.stdout
    code = export.paths[1].read_text()
    weight = repr(float(with_columns[0].coef_[1]))
    assert weight in code
    export.paths[1].write_text(code.replace(weight, repr(float(weight) * 1.001)))
    done = selftest(export)
    assert done.returncode == 1 and "FAILED" in done.stdout


@pytest.mark.skipif(tool("clang") is None, reason="clang is not installed")
def test_clang_has_nothing_to_say(tmp_path, everything):
    assert selftest(export_c(everything[0], tmp_path), ["clang", "-Wsign-conversion"]).returncode == 0


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
    export = export_c(model, tmp_path / "bias")
    new = later(X, 3000)
    new.iloc[::97] = np.nan
    run = run_c(compile_c(export, command), new, np.ones(3000), export.columns, seconds_to(X, new))
    assert np.isfinite(run.bias).all()


@pytest.mark.skipif(
    tool("arm-linux-gnueabihf-gcc") is None or tool("qemu-arm") is None,
    reason="needs arm-linux-gnueabihf-gcc and qemu-arm",
)
def test_an_emulated_arm_gives_the_same(tmp_path, everything):
    model, X = everything
    command = ("arm-linux-gnueabihf-gcc", "-O2", "-static", "-mfpu=vfpv4", "-ffp-contract=fast")  # as firmware is built
    error, *_ = errors(model, X, tmp_path, 2000, command=command, before=("qemu-arm",))
    assert error < BOUND


def test_command_line(tmp_path, with_columns, capsys):
    save_model(with_columns[0], tmp_path / "model.json")
    out = tmp_path / "firmware" / "bridge.c"
    arguments = ["export-c", str(tmp_path / "model.json"), "--out", str(out)]
    assert cli.main(arguments) == 0
    assert sorted(path.name for path in out.parent.iterdir()) == ["bridge.c", "bridge.h", "bridge_test.c"]
    assert "columns: humidity" in capsys.readouterr().out
    assert cli.main(["export-c", str(tmp_path / "nothing.json")]) == 2
    assert "nothing.json" in capsys.readouterr().err
