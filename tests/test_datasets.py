"""Data sets: simulated records against their truth, measured ones as found.

Also: Heat conduction of the simulated devices against closed forms and an independent integration.
"""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import erfc, erfcx

from thermocorr import RecordWarning
from thermocorr.datasets import (
    HeatStack,
    Layer,
    list_real_records,
    load_real_record,
    load_voltage_reference,
    make_record,
)
from thermocorr.datasets import _heat as heat
from thermocorr.datasets._climate import smooth_noise


def lag_differences(temperature, time_constants, steps):
    """Lag minus temperature, sample after sample, from equilibrium: written out once more for these tests."""
    state, rows = np.zeros(len(time_constants)), []
    rows.append(state)
    for change, step in zip(np.diff(temperature), steps, strict=True):
        decay = np.exp(-step / time_constants)
        state = decay * state - (1 - decay) * time_constants / step * change
        rows.append(state)
    return np.array(rows)


def smoothed_std(residual):
    return np.convolve(residual, np.ones(25) / 25, "valid").std()


def residual(columns, reading, blocks):
    """Least-squares residual, in sample, or (blocks > 1) each contiguous block predicted from the others."""
    scaled = columns / np.abs(columns).max(axis=0)
    left = np.empty_like(reading)
    for rows in np.array_split(np.arange(reading.size), blocks):
        train = np.delete(np.arange(reading.size), rows) if blocks > 1 else rows
        left[rows] = reading[rows] - scaled[rows] @ np.linalg.lstsq(scaled[train], reading[train], rcond=None)[0]
    return left


@pytest.fixture(scope="module")
def reference():
    return load_voltage_reference(return_truth=True)


@pytest.fixture(scope="module")
def variants(reference):
    record, _ = reference
    excess = (record["temperature"] - record["temperature"].mean()).to_numpy()
    lags = lag_differences(excess, np.geomspace(60.0, 14_400.0, 6), np.full(excess.size - 1, 15.0))
    static = np.stack([np.ones_like(excess), excess], axis=1)
    square = excess[:, None] ** 2
    return {
        "static linear": static,
        "static nonlinear": np.hstack([static, square]),
        "dynamic linear": np.hstack([static, lags]),
        "dynamic nonlinear": np.hstack([static, square, lags]),
    }


def test_voltage_reference_has_the_promised_form(reference):
    record, truth = reference
    assert list(record) == ["temperature", "humidity", "pressure", "supply", "voltage"]
    assert len(record) == 84_000 and record.index.name == "time" and record.index.tz is None
    assert (np.diff(record.index) == np.timedelta64(15, "s")).all()
    assert record["voltage"].mean() == pytest.approx(0.1040, rel=0.01)
    assert record["voltage"].std() == pytest.approx(1.114e-3, rel=0.02)
    assert set(record.attrs["units"]) == set(record)
    np.testing.assert_array_equal(truth["noise_free"] + truth["noise"], record["voltage"])
    # A white sequence of n has its standard deviation within 4 sigma / sqrt(2 n).
    assert truth["noise"].std() == pytest.approx(record.attrs["noise"], rel=4 / np.sqrt(2 * 84_000))


def test_voltage_reference_is_the_same_on_every_call(reference):
    again = load_voltage_reference()
    pd.testing.assert_frame_equal(again, reference[0])
    again["voltage"] = 0.0  # what a user does to a record must not reach the next call
    pd.testing.assert_frame_equal(load_voltage_reference(), reference[0])


@pytest.mark.parametrize(("variant", "paper"), [("static linear", -27.3), ("static nonlinear", -27.9)])
def test_static_corrections_leave_what_they_left_in_the_paper(reference, variants, variant, paper):
    voltage = reference[0]["voltage"].to_numpy()
    left = residual(variants[variant], voltage, 1)
    assert 20 * np.log10(smoothed_std(left) / voltage.std()) == pytest.approx(paper, abs=0.3)
    # Not smoothed: 9.985e-5 and 9.780e-5 mV in the paper.
    assert left.std() == pytest.approx({-27.3: 9.985e-5, -27.9: 9.780e-5}[paper], rel=0.03)


def test_recorded_columns_are_no_copies_of_temperature(reference):
    record = reference[0]
    for frame in (record, record.diff().iloc[1:]):
        assert frame[["humidity", "pressure", "supply"]].corrwith(frame["temperature"]).abs().max() < 0.5


def test_moisture_is_the_lag_of_humidity_and_nothing_else_changes(reference):
    record, truth = load_voltage_reference(hidden="moisture", return_truth=True)
    plain = reference[0]
    pd.testing.assert_frame_equal(record.drop(columns="voltage"), plain.drop(columns="voltage"))
    np.testing.assert_allclose(record["voltage"] - plain["voltage"], truth["moisture"], atol=1e-15)
    humidity = (record["humidity"] - record["humidity"].mean()).to_numpy()
    lag = humidity + lag_differences(humidity, np.array([1.5 * 86_400]), np.full(83_999, 15.0))[:, 0]
    assert np.corrcoef(lag, truth["moisture"])[0, 1] == pytest.approx(1.0, abs=1e-9)
    excess = (record["temperature"] - record["temperature"].mean()).to_numpy()
    left = residual(np.stack([np.ones_like(excess), excess, excess**2], axis=1), truth["moisture"].to_numpy(), 1)
    assert left.std() == pytest.approx(1e-4, rel=1e-6)


def test_unknown_hidden_effect():
    with pytest.raises(ValueError, match=r"'hidden' parameter of load_voltage_reference .* Got 'dust' instead"):
        load_voltage_reference(hidden="dust")


@pytest.mark.parametrize("setting", ["lab", "outdoor", "chamber"])
@pytest.mark.parametrize("device", ["slab", "plate", "layered", "box"])
def test_device_is_its_lag_coefficients(setting, device):
    record, truth = make_record(1000, setting=setting, device=device, irregular=0.5, seed=4, return_truth=True)
    about = truth.attrs["device"]
    steps = np.diff(record.index) / np.timedelta64(1, "s")
    air = record["temperature"].to_numpy()
    lags = lag_differences(air, np.array(about["time_constants"]), steps)
    bias = about["sensitivity"] * (air - about["reference_temperature"]) + lags @ about["lag_coefficients"]  # (22)
    # Modes below 1e-6 of the whole are not listed; the readings reach a few hundred ppm.
    np.testing.assert_allclose(truth["device"], bias, atol=2e-3)
    np.testing.assert_allclose(truth["noise_free"], truth.attrs["base"] + truth["device"], atol=1e-9)
    np.testing.assert_array_equal(truth["noise_free"] + truth["noise"], record["reading"])


def test_device_goes_on_in_a_gap():
    whole = make_record(900, gaps=3, noise=0.0, seed=5)
    steps = np.diff(whole.index) / np.timedelta64(1, "s")
    assert len(whole) == 900 and (steps > 60).sum() == 3 and steps.min() == 60
    assert make_record(900, gaps=899, seed=5).shape == (900, 6)


def test_runs_have_their_own_history():
    record, truth = make_record(300, runs=3, seed=6, return_truth=True)
    assert record["run"].tolist() == [1] * 300 + [2] * 300 + [3] * 300
    assert record.index.is_monotonic_increasing and len(truth) == 900
    parts = [part["temperature"].to_numpy() for _, part in record.groupby("run")]
    assert not np.allclose(parts[0], parts[1])
    # Each run starts at equilibrium: the bias is the static law of its first sample.
    first = record.groupby("run").head(1)
    np.testing.assert_allclose(truth.loc[first.index, "device"], 10 * (first["temperature"] - 22.5), atol=1e-9)


def test_parts_have_their_own_streams():
    plain = make_record(200, seed=7)
    louder, truth = make_record(200, seed=7, noise=3.0, coloured_noise=(1.0, 600.0), return_truth=True)
    pd.testing.assert_frame_equal(plain.drop(columns="reading"), louder.drop(columns="reading"))
    assert list(truth) == ["noise_free", "device", "coloured_noise", "noise"]
    pd.testing.assert_frame_equal(plain, make_record(200, seed=7))
    assert not np.allclose(plain["temperature"], make_record(200, seed=8)["temperature"])


def test_offset_and_nonlinearity():
    record, truth = make_record(400, device="slab", initial_offset=2.0, nonlinearity=0.01, seed=9, return_truth=True)
    start = record["temperature"].iloc[0] + 2.0 - 22.5
    assert truth["device"].iloc[0] == pytest.approx(10 * start + 10 * 0.01 * start**2)


def test_coloured_noise_has_the_promised_correlation():
    _, truth = make_record(40_000, coloured_noise=(2.0, 300.0), irregular=0.0, seed=10, return_truth=True)
    noise = truth["coloured_noise"].to_numpy()
    # 40 000 samples hold about 4000 independent ones: 1 % for the deviation, 0.01 for the correlation.
    assert noise.std() == pytest.approx(2.0, rel=0.05)
    assert np.corrcoef(noise[:-5], noise[5:])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)


def test_smooth_noise_has_unit_variance_at_every_step():
    for step in (1.0, 20.0, 300.0):
        noise = smooth_noise(np.random.default_rng(11), step * np.arange(200_000), 100.0)
        # At 1 s: 200 000 s hold about 500 independent values, so 3 % for the deviation.
        assert noise.std() == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"n": 1}, r"The 'n' parameter of make_record must be an int in the range \[2, inf\). Got 1 instead."),
        ({"n": 10.0}, "Got 10.0 instead"),
        ({"sampling_period": 0.0}, r"a float in the range \(0.0, inf\)"),
        ({"setting": "cellar"}, "must be one of 'lab', 'outdoor', 'chamber'. Got 'cellar' instead"),
        ({"device": "brick"}, "must be one of 'slab'"),
        ({"noise": -1.0}, "'noise' parameter"),
        ({"noise": np.nan}, "Got nan instead"),
        ({"irregular": 1.0}, r"\[0.0, 1.0\)"),
        ({"runs": 0}, "'runs' parameter"),
        ({"n": 5, "gaps": 5}, "at most n - 1 = 4"),
        ({"seed": -1}, "'seed' parameter"),
        ({"coloured_noise": 1.0}, "correlation time"),
        ({"coloured_noise": (1.0, 0.0)}, "coloured_noise"),
    ],
)
def test_parameter_errors(options, words):
    with pytest.raises(ValueError, match=words):
        make_record(**options)


@pytest.mark.parametrize(
    ("name", "rows", "runs"),
    [
        ("vhd200_resistor", 11_524, ["run9", "run10", "run15", "run17"]),
        ("hp34420a_nanovoltmeter", 22_697, ["1V", "100mV", "10mV"]),
        ("oldtown_soil", 30_973, []),
        ("dmm_box_heater", 4_561, ["log10.2", "log11.2"]),
        ("gr1433_resistor", 6_520, []),
    ],
)
def test_measured_record(measured, name, rows, runs):
    if not (measured / name / f"{name}.csv").is_file():
        pytest.skip(f"{measured} holds no {name}")
    record = load_real_record(name, measured)
    assert len(record) == rows
    about = record.attrs
    assert {about["reading"], about["temperature"], *about["hidden_columns"]} <= set(record)
    assert about["license"] and about["hidden"]
    if runs:
        assert list(record[about["run_column"]].unique()) == runs
        parts = [load_real_record(name, measured, run=run) for run in runs]
        pd.testing.assert_frame_equal(pd.concat(parts, ignore_index=name == "dmm_box_heater"), record)
    if name == "dmm_box_heater":
        assert isinstance(record.index, pd.RangeIndex) and record["time_s"].iloc[0] == 5.0
    else:
        assert isinstance(record.index, pd.DatetimeIndex) and record.index.name == "time"
        assert (record.index.tz is not None) == (name != "hp34420a_nanovoltmeter")


def test_folder_comes_from_the_environment(tmp_path, monkeypatch):
    (tmp_path / "gr1433_resistor").mkdir()
    text = "time,room_temp_degC,room_rh_pct,resistance_ohm\n2018-01-23T06:07:10Z,21.7,56.1,99997.9\n"
    (tmp_path / "gr1433_resistor" / "gr1433_resistor.csv").write_text(text)
    monkeypatch.setenv("THERMOCORR_RECORDS", str(tmp_path))
    with pytest.warns(RecordWarning, match="SHA-256"):
        record = load_real_record("gr1433_resistor")
    assert record.index[0] == pd.Timestamp("2018-01-23 06:07:10", tz="UTC")
    with pytest.raises(FileNotFoundError, match=r"holds no oldtown_soil.* found there: gr1433_resistor"):
        load_real_record("oldtown_soil")
    with pytest.warns(RecordWarning), pytest.raises(ValueError, match="has no runs"):
        load_real_record("gr1433_resistor", run="run9")


def test_measured_record_errors(tmp_path, monkeypatch):
    monkeypatch.delenv("THERMOCORR_RECORDS", raising=False)
    with pytest.raises(ValueError, match=r"Pass folder=\.\.\., .* THERMOCORR_RECORDS"):
        load_real_record("oldtown_soil")
    with pytest.raises(ValueError, match="The records are: vhd200_resistor"):
        load_real_record("newtown", tmp_path)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_real_record("oldtown_soil", tmp_path / "nowhere")
    (tmp_path / "dmm_box_heater.csv").write_text("run,time_s,room_temp_degC\nlog10.2,5.0,23.4\n")
    with pytest.warns(RecordWarning), pytest.raises(ValueError, match=r"no run 'log1'. Its runs are: log10.2"):
        load_real_record("dmm_box_heater", tmp_path, run="log1")


def test_list_of_measured_records():
    records = list_real_records()
    assert list(records.index) == [
        "vhd200_resistor", "hp34420a_nanovoltmeter", "oldtown_soil", "dmm_box_heater", "gr1433_resistor",
        "groundwater_river", "groundwater_well",
    ]  # fmt: skip
    assert records[["physics", "reading", "temperature", "hidden", "license", "source"]].notna().all(axis=None)


@pytest.mark.parametrize("moment", ["12:30", "1,5 h", "soon"])
def test_a_planted_moment_without_a_day_is_refused(moment):
    with pytest.raises(ValueError, match=r"A moment in make_record .*'2 days'"):
        make_record(300, effects=[("step", 2.0, {"time": moment})])


def test_a_record_may_begin_at_a_date_in_any_iso_form():
    for start in ("20240304", "2024-03-04", pd.Timestamp("2024-03-04")):
        assert make_record(10, start=start).index[0] == pd.Timestamp("2024-03-04")


def biot_series(depth, time, biot):
    """Slab cooled from 1 to 0 at depth 1, insulated at depth 0: the textbook series in Fourier numbers."""
    total = 0.0
    for k in range(200):
        zeta = brentq(lambda z: z * np.sin(z) - biot * np.cos(z), k * np.pi + 1e-12, (k + 0.5) * np.pi)
        factor = 4 * np.sin(zeta) / (2 * zeta + np.sin(2 * zeta))
        total = total + factor * np.exp(-(zeta**2) * time) * np.cos(zeta * depth)
    return total


def cooled_slab(cells, biot, fourier):
    """The same slab by finite volumes: 20 mm, 0.5 W/(m K), 1e6 J/(m3 K); diffusion time 800 s."""
    stack = HeatStack([Layer("slab", 0.02, 0.5, 1e6, cells)], biot * 0.5 / 0.02)
    time = np.concatenate([[0.0], 800.0 * np.asarray(fourier)])
    field = stack.field(time, np.zeros(time.size), initial_offset=1.0)[1:]
    return 1 - stack.positions / 0.02, field


@pytest.mark.parametrize("biot", [0.1, 1.0, 20.0])
def test_slab_follows_the_biot_series_to_second_order(biot):
    fourier = np.array([0.05, 0.2, 1.0])
    errors = []
    for cells in (10, 20, 40):
        depth, field = cooled_slab(cells, biot, fourier)
        errors.append(np.abs(field - [biot_series(depth, time, biot) for time in fourier]).max())
    # Second order: each halving of the cells divides the error by 4; 3.5 leaves room for the next order.
    assert errors[0] / errors[1] > 3.5 and errors[1] / errors[2] > 3.5
    assert errors[2] < 1e-3


def test_thick_slab_follows_the_semi_infinite_body():
    conductivity, capacity, convection = 0.3, 2e6, 10.0
    stack = HeatStack([Layer("ground", 0.5, conductivity, capacity, 1000)], convection)
    time = np.array([0.0, 3600.0, 7200.0])
    field = stack.field(time, np.zeros(3), initial_offset=1.0)
    for k in (1, 2):
        spread = np.sqrt(conductivity / capacity * time[k])
        x = stack.positions[:200] / (2 * spread)
        y = x + convection * spread / conductivity
        # exp(...) erfc(y) of the textbook, written with erfcx so that it does not overflow
        exact = 1 - (erfc(x) - np.exp(-(x**2)) * erfcx(y))
        # 0.5 mm cells against a spread of 23 mm: (0.5/23)^2 = 5e-4 times a factor below 1
        np.testing.assert_allclose(field[k, :200], exact, atol=2e-4)


def test_mean_delay_of_two_bodies_with_a_contact_layer_between():
    plates = [
        Layer("outer", 1e-3, 1e4, 2e6, 2),
        Layer("contact", 1e-4, 2e-3, 1.0, 1),
        Layer("inner", 1e-3, 1e4, 3e6, 2),
    ]
    joined = [plates[0], Layer("inner", 1e-3, 1e4, 3e6, 2, contact_resistance=0.05)]
    # Elmore's delay: every heat capacity times the resistance that it shares with the path from the air.
    outer, inner = 2e3, 3e3  # [J/(m2 K)]
    expected = (outer + inner) / 10.0 + inner * 0.05
    for layers in (plates, joined):
        stack = HeatStack(layers, 10.0)
        delay = stack.layer_mean("inner") @ stack.modes @ stack.time_constants
        assert delay == pytest.approx(expected, rel=1e-5)  # the plates themselves add 1e-7 m2 K/W


def by_solve_ivp(layers, outer, inner, time, air):
    """Independent integration of the same heat balance, written with heat flows, one step after the other."""
    width = np.concatenate([np.full(la.cells, la.thickness / la.cells) for la in layers])
    conductivity = np.concatenate([np.full(la.cells, la.conductivity) for la in layers])
    capacity = width * np.concatenate([np.full(la.cells, la.heat_capacity) for la in layers])

    def flow(now, theta):
        ambient = np.interp(now, time, air)
        heat_in = (ambient - theta[0]) / (1 / outer + width[0] / 2 / conductivity[0])
        back = (theta[-1] - ambient) / (1 / inner + width[-1] / 2 / conductivity[-1])
        between = -np.diff(theta) / (width[:-1] / 2 / conductivity[:-1] + width[1:] / 2 / conductivity[1:])
        flows = np.concatenate([[heat_in], between, [back]])
        return -np.diff(flows) / capacity

    theta, rows = np.full(width.size, air[0]), [np.full(width.size, air[0])]
    for k in range(time.size - 1):
        step = solve_ivp(flow, (time[k], time[k + 1]), theta, method="LSODA", rtol=1e-9, atol=1e-10)
        theta = step.y[:, -1]
        rows.append(theta)
    return np.array(rows)


def test_layers_against_solve_ivp_at_irregular_times():
    layers = [Layer("a", 0.002, 20.0, 2.4e6, 3), Layer("b", 0.004, 0.04, 5e4, 4), Layer("c", 0.003, 1.0, 2e6, 4)]
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(5.0, 120.0, 40))
    air = 20 + np.cumsum(rng.normal(size=40))
    field = HeatStack(layers, 12.0, 3.0).field(time, air)
    # Tolerance: that of the integrator (1e-9 of 20 degC per internal step).
    np.testing.assert_allclose(field, by_solve_ivp(layers, 12.0, 3.0, time, air), atol=2e-6)


def test_blocks_of_rows_agree_with_one_block(monkeypatch):
    stack = HeatStack([Layer("slab", 0.01, 0.3, 2e6, 10)], 15.0)
    rng = np.random.default_rng(2)
    for time in (np.arange(300.0), np.cumsum(rng.uniform(0.5, 2.0, 300))):
        air = np.cumsum(rng.normal(size=300))
        whole = stack.field(time, air, initial_offset=-1.0)
        monkeypatch.setattr(heat, "_CHUNK", 7)
        np.testing.assert_allclose(stack.field(time, air, initial_offset=-1.0), whole, atol=1e-12)
        monkeypatch.undo()


def test_output_is_first_and_second_degree_in_the_field():
    stack = HeatStack([Layer("skin", 0.001, 1.0, 2e6, 3), Layer("core", 0.01, 0.3, 2e6, 10)], 15.0)
    time, air = np.arange(200) * 30.0, 20 + np.sin(np.arange(200) / 9.0)
    linear, quadratic = 2 * stack.layer_mean("skin"), 0.1 * stack.layer_mean("core")
    excess = stack.field(time, air) - 20.5
    output = stack.respond(time, air, linear, quadratic, reference_temperature=20.5)
    np.testing.assert_allclose(output, excess @ linear + excess**2 @ quadratic, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Layer("a", -1.0, 1.0, 1.0), r"'thickness' parameter of Layer .* Got -1.0 instead"),
        (lambda: HeatStack([], 1.0), "at least one Layer"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 0.0), "'outer_convection' parameter"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 1.0).layer_mean("b"), "The layers are: a"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 1.0).field([0, 1, 1], [0, 0, 0]), "Row 2 does not come"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 1.0).field([0, 1], [0, np.nan]), "finite"),
    ],
)
def test_heat_errors(call, words):
    with pytest.raises(ValueError, match=words):
        call()
