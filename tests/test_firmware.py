"""Export to C: what the compiled code answers, against the model, and what it costs."""

import numpy as np
import pandas as pd
import pytest
from firmware_runs import (
    BOUNDS,
    KINDS,
    PERIOD,
    ROWS,
    ambient,
    compile_c,
    errors,
    fitted,
    later,
    needs_gcc,
    run_c,
    start_of,
)

from thermocorr import DynamicBiasRegressor
from thermocorr.effects import CATALOGUE, Covariate, Drift, Effect, LaggedCovariate, LagProducts, Rate, Step
from thermocorr.firmware import export_c
from thermocorr.firmware.statements import Operations

pytestmark = pytest.mark.newest


@pytest.fixture(scope="module")
def simple():
    """A model with two lags, and its fitted record."""
    return fitted()


@pytest.fixture(scope="module")
def with_columns():
    return fitted([Covariate("humidity"), Rate(), Drift(True)])


@pytest.mark.newest
@needs_gcc
@pytest.mark.parametrize("kind", KINDS)
def test_c_gives_the_bias_of_python(kind, tmp_path):
    """At a fixed period, and with steps of its own."""
    settings = KINDS[kind]
    model, X = fitted(**settings)
    kelvin = settings.get("kelvin", False)
    for dtype, variable in (("double", False), ("float", not kind.startswith("delay"))):
        error, *_ = errors(model, X, tmp_path, dtype, ROWS, variable, kelvin, command=("gcc", "-O1"))
        assert error < BOUNDS[dtype], (dtype, variable)


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
    for dtype in ("double", "float"):
        for variable in (False, True):
            if variable and effect.delay:
                continue  # refused by name
            error, *_ = errors(model, X, tmp_path, dtype, ROWS, variable, command=("gcc", "-O1"))
            assert error < BOUNDS[dtype], (dtype, variable, error)


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
    export = export_c(model, tmp_path / "bias", "double")
    new = X.set_axis(X.index + pd.Timedelta(10, "D"))
    run = run_c(compile_c(export), new, np.ones(len(X)), export.columns)
    expected = model.bias(new).to_numpy()
    assert np.abs(run.bias - expected).max() < BOUNDS["double"] * np.ptp(expected)


def test_every_kind_of_the_catalogue_is_among_them():
    assert {kind.split(",")[0] for kind in KINDS} - {"several"} == {
        kind for kind, effect in CATALOGUE.items() if not effect.foresees
    }


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


@needs_gcc
def test_roundings_do_not_pile_up_while_the_temperature_rests(tmp_path):
    """Steps and long rests: every sample of a rest rounds the same way, which noise would have hidden."""
    model, X = fitted(**KINDS["thermal_lag, paper's size"])
    new = later(model, X, ROWS)
    new["temperature"] = np.float32([21.3, 24.1, 22.2, 25.7])[np.arange(ROWS) // 5000].astype(float)
    export = export_c(model, tmp_path / "bias")
    run = run_c(compile_c(export), new, np.ones(ROWS))
    expected = model.bias(new).to_numpy()
    assert np.abs(run.bias - expected).max() < 2e-6 * np.ptp(expected)


@needs_gcc
@pytest.mark.parametrize("variable", [False, True])
def test_fused_multiply_adds_do_no_harm(variable, tmp_path):
    """Compilers fuse a * b + c into one rounding unless told otherwise: the carried roundings must survive it."""
    model, X = fitted(**KINDS["thermal_lag, paper's size"])
    for dtype in ("float", "double"):
        command = ("gcc", "-O3", "-march=native", "-ffp-contract=fast")
        error, *_ = errors(model, X, tmp_path, dtype, ROWS, variable, command=command)
        assert error < BOUNDS[dtype]


def test_a_model_of_the_papers_size_is_small(tmp_path):
    model, _ = fitted(**KINDS["thermal_lag, paper's size"])
    export = export_c(model, tmp_path)
    assert export.operations.multiply_adds + export.operations.adds <= 42  # fewer still are multiply-adds
    # By hand: 6 lags of 2 multiply-adds and 1 for the bias, 2 for the square; 3 additions for each compensated lag
    # (tau > 16 dt: five), T - T0, T - T before, reading - bias.
    assert export.operations == Operations(multiply_adds=20 + 1, adds=5 * 3 + 3 + 2)  # and the gate
    # By hand: two courses of 6 lags, 5 rests, temperature, washout and started; 9 numbers of the gate, 3 counters.
    assert export.state_bytes == 4 * (2 * (6 + 5 + 3) + 9 + 3)
    frame = export.frame()
    assert frame.loc["RAM: state", "value"] == 160 and "160 bytes" in str(export)


def test_equal_lags_are_computed_once(tmp_path, simple):
    plain = export_c(simple[0], tmp_path)
    model, _ = fitted([LagProducts([200.0, 2000.0]), Rate(200.0)])
    more = export_c(model, tmp_path)
    assert more.state_bytes == plain.state_bytes


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
    rows = {bit: set(np.flatnonzero(run.flags & bit)) for bit in (1, 2, 4, 32, 128)}
    assert rows == {1: {0, 1, *range(500, 510)}, 2: set(range(505, 520)), 4: {900}, 32: {0, 1}, 128: {700}}
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
@pytest.mark.parametrize("kind", ["several", "lag_products, of the model", "initial_transient"])
def test_a_gap_beyond_max_gap_starts_anew(kind, tmp_path):
    """Python takes what comes after a gap longer than max_gap (1 h here) as a device of unknown state."""
    model, X = fitted(**KINDS[kind])
    new = later(model, X, 2000, irregular=True)
    new.index = new.index + pd.to_timedelta(np.where(np.arange(2000) > 1000, 4000.0, 0.0), unit="s")
    for dtype in ("float", "double"):
        export = export_c(model, tmp_path / "bias", dtype, sampling_period="variable")
        run = run_c(compile_c(export, start=start_of(export, X, new)), new, np.ones(2000), export.columns)
        expected = model.bias(new).to_numpy()
        assert np.abs(run.bias - expected).max() < BOUNDS[dtype] * np.ptp(expected)
        np.testing.assert_array_equal((run.flags & 8) > 0, model.flags(new) == "washout")
        assert (run.flags[:1001] & 8).any() and (run.flags[1001:] & 8).any()


def test_what_correct_keeps_is_kept(tmp_path):
    model, _ = fitted([Drift()])
    export = export_c(model, tmp_path)
    assert export.kept == ("drift",) and "drift" in str(export)
    assert "seconds" not in export.paths[1].read_text()


def test_steps_of_the_clock_are_exact(tmp_path):
    """A step between two samples is felt by the later one; one on a sample by itself."""
    model, _ = fitted([Step(60.0 + PERIOD / 2, True)])
    text = export_c(model, tmp_path / "bias", sampling_period=PERIOD).paths[1].read_text()
    assert "INT32_C(5)" in text
    model, _ = fitted([Step(60.0, True)])
    text = export_c(model, tmp_path / "bias", sampling_period=PERIOD).paths[1].read_text()
    assert "INT32_C(4)" in text
