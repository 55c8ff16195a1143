"""Signed values: corrected readings with status, means, budgets and declared inputs.

Also: Budgets of uncertainty: the GUM's example, other people's arithmetic, and how values are written. Uncertainty
outside the fitted temperatures: what is curved may lie deep inside, and feel them late.
"""

import numpy as np
import pandas as pd
import pytest
from noisy import TIMES, device

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordWarning, Sensor, diagnose
from thermocorr.datasets import make_record
from thermocorr.datasets._devices import make_device
from thermocorr.model import budget as signed_values
from thermocorr.model.budget import Budget, BudgetLine, concise, coverage_factor


@pytest.fixture(scope="module")
def fitted():
    X, y, truth = device(3000, 11, np.random.default_rng(11).standard_normal(3000))
    return DynamicBiasRegressor("temperature", TIMES, degree=1).fit(X, y), X, y, truth


def test_a_mean_is_as_uncertain_as_the_covariance_matrix_says(fitted):
    model, X, y, _ = fitted
    signed = model.uncertainty(X, y, reference=0.03)
    for rows in (slice(500, 501), slice(500, 560), slice(0, 3000, 50)):
        matrix = signed.covariance(rows)
        assert signed.mean(rows).u == pytest.approx(np.sqrt(matrix.mean()), rel=0.02)
    assert np.diag(signed.covariance(slice(700, 703))) == pytest.approx(signed.u[700:703] ** 2, rel=1e-9)


def test_labels_and_numbers_mean_the_same_rows(fitted):
    model, X, y, _ = fitted
    signed = model.uncertainty(X, y)
    assert signed.budget(X.index[40]).value == signed.budget(40).value == signed.corrected[40]
    assert signed.mean(slice(X.index[40], X.index[49])).u == signed.mean(slice(40, 50)).u


def test_an_incomplete_model_signs_nothing(fitted, tmp_path):
    _, X, y, _ = fitted
    poor = DynamicBiasRegressor("temperature", ["3 h"]).fit(X, y)
    signed = poor.uncertainty(X, y)
    assert set(signed.frame()["status"]) == {"provisional"}
    assert (signed.frame()["u_structure"] > 0).all()
    with pytest.raises(ValueError, match=r"provisional: .* of the residual variance wanders"):
        signed.to_csv(tmp_path / "signed.csv")
    with pytest.raises(ValueError, match="allow_missing=True"):
        signed.certificate()
    allowed = poor.uncertainty(X, y, allow_missing=True)
    assert "provisional" in allowed.certificate(slice(0, 10))
    allowed.to_csv(tmp_path / "signed.csv")
    assert pd.read_csv(tmp_path / "signed.csv")["status"].eq("provisional").all()


def test_a_diagnosis_has_the_last_word(fitted):
    model, X, y, _ = fitted
    diagnosis = diagnose(model, X, y)
    assert diagnosis.verdict == "nothing missing"
    assert model.uncertainty(X, y, diagnosis=diagnosis).frame()["status"].eq("signed").all()
    wrong = DynamicBiasRegressor("temperature", ["3 h"]).fit(X, y)
    found = diagnose(wrong, X, y)
    assert not wrong.uncertainty(X, y, diagnosis=found).frame()["status"].eq("signed").any()
    assert repr(found.verdict) in wrong.uncertainty(X, y, diagnosis=found).why_provisional


def test_outside_the_fitted_temperatures_nothing_is_signed():
    X, y, _ = device(4000, 9, np.random.default_rng(9).standard_normal(4000), nonlinearity=0.005)
    cold = (X["temperature"] < X["temperature"].quantile(0.7)).to_numpy()
    first = int(np.argmax(~cold))
    model = DynamicBiasRegressor("temperature", TIMES, degree=1).fit(X[:first], y[:first])
    frame = model.uncertainty(X, y).frame()
    outside = (X["temperature"] > model.reading_.temperature_range[1] + 0.2).to_numpy()
    assert outside.any() and not frame["status"][outside].eq("signed").any()


def test_another_instrument_of_the_kind_has_no_number_in_its_washout(fitted):
    _, X, y, _ = fitted
    later = X.set_axis(X.index + pd.Timedelta("400 D"))
    strange = DynamicBiasRegressor("temperature", TIMES, max_gap="1 h").fit(X, y)
    frame = strange.uncertainty(later, pd.Series(y.to_numpy(), later.index)).frame()
    washed = frame["status"] == "washout"
    assert washed.sum() == pytest.approx(3 * 5124 / 60, abs=2)
    assert frame["u"][washed].isna().all() and frame["u"][~washed].notna().all()
    assert strange.bias(later, return_std=True)[1][washed.to_numpy()].isna().all()


def test_a_thermometer_that_has_moved_counts_with_the_static_gain(fitted):
    model, X, y, _ = fitted
    signed = model.uncertainty(X, y, sensor=Sensor(drift_since_learning=0.02))
    np.testing.assert_allclose(signed.frame()["u_sensor"], 0.2, rtol=0.01)  # 10 ppm/K
    line = next(line for line in signed.budget(1000).lines if "thermometer" in line.quantity)
    assert (line.type, line.unit, line.uncertainty) == ("B", "K", 0.02)
    assert line.sensitivity == pytest.approx(10, rel=0.01)


def test_a_constant_error_of_the_thermometer_cancels(fitted):
    model, X, y, _ = fitted
    assert model.uncertainty(X, y, sensor=Sensor(calibration=0.3)).frame()["u_sensor"].eq(0).all()
    moved = model.uncertainty(X, y, sensor=Sensor(calibration=0.3, exchanged=True)).frame()["u_sensor"]
    assert moved.iloc[0] == pytest.approx(3.0, rel=0.01)


def test_noise_of_the_thermometer_counts_as_far_as_the_device_follows_it(fitted):
    """Besides readings corrected with noisy temperatures, which the model turns into noise of the bias."""
    model, X, y, _ = fitted
    stated = model.uncertainty(X, y, sensor=Sensor(noise=0.05)).frame()["u_sensor"].iloc[500]
    noisy = X + 0.05 * np.random.default_rng(1).standard_normal(X.shape)
    fresh = DynamicBiasRegressor("temperature", TIMES, degree=1, screen=False).fit(X, y)
    shifted = noisy.set_axis(noisy.index)
    assert stated == pytest.approx((fresh.bias(shifted) - fresh.bias(X))[500:].std(), rel=0.1)


def test_a_slower_thermometer_counts_where_the_temperature_moves(fitted):
    model, X, y, _ = fitted
    u = model.uncertainty(X, y, sensor=Sensor(time_constant=60.0)).frame()["u_sensor"].to_numpy()
    rate = np.abs(np.gradient(X["temperature"].to_numpy(), 60.0))
    np.testing.assert_allclose(u[1:-1], 10 * 60 * rate[1:-1], rtol=0.05, atol=1e-3)


def test_the_reference_adds_to_everything(fitted):
    model, X, y, _ = fitted
    plain, held = model.uncertainty(X, y), model.uncertainty(X, y, reference=0.1, reference_dof=8)
    np.testing.assert_allclose(held.u**2 - plain.u**2, 0.01, rtol=1e-9)
    line = held.budget(3).lines[-1]
    assert (line.uncertainty, line.dof, line.type) == (0.1, 8, "B")
    assert plain.budget(3).lines[-1].type == "B, not declared"


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"coverage": 95}, "share between 0 and 1"),
        ({"coverage": 0}, "share between 0 and 1"),
        ({"reference": -1}, "zero or above"),
        ({"reference": "much"}, "zero or above"),
        ({"reference_dof": 0}, "above zero"),
    ],
)
def test_what_is_no_uncertainty_is_refused(fitted, settings, said):
    model, X, y, _ = fitted
    with pytest.raises(ValueError, match=said):
        model.uncertainty(X, y, **settings)


@pytest.mark.parametrize(
    "settings", [{"noise": -1.0}, {"noise": "loud"}, {"drift_since_learning": np.inf}, {"calibration": True}]
)
def test_a_sensor_refuses_what_is_no_uncertainty(settings):
    with pytest.raises(ValueError, match="standard uncertainty in K"):
        Sensor(**settings)


def test_rows_that_are_none(fitted, monkeypatch):
    model, X, y, _ = fitted
    signed = model.uncertainty(X, y)
    with pytest.raises(ValueError, match="No row is asked for"):
        signed.budget(slice(10, 10))
    for rows in ("1999-01-01", 99_999, [1.0, 2.0], True, np.ones(5, bool)):
        with pytest.raises(ValueError, match=r"There are no such rows: .* places from 0 to 2999, or labels from 2024"):
            signed.budget(rows)
    lost = model.uncertainty(X, y.where(np.arange(len(y)) != 7))
    with pytest.raises(ValueError, match="None of these 1 rows has an uncertainty: no reading"):
        lost.budget(7)
    monkeypatch.setattr(signed_values, "MOST_ROWS", 10)
    with pytest.raises(ValueError, match="choose at most 10"):
        signed.covariance(slice(0, 11))


def test_a_record_too_short_for_its_noise_is_said():
    rng = np.random.default_rng(2)
    X, y, _ = device(3000, 2, np.cumsum(rng.standard_normal(3000)) / 10)
    model = DynamicBiasRegressor("temperature", TIMES).fit(X, y)
    with pytest.warns(RecordWarning, match=r"remembers for about .* Record for at least \d"):
        model.uncertainty(X, y)


@pytest.mark.parametrize("reading", ["constant", "exact", "huge", "tiny"])
def test_readings_of_any_size(reading):
    """Without noise there is hardly an uncertainty; with it, it has the unit of the reading."""
    X, y, truth = device(2000, 3, np.random.default_rng(3).standard_normal(2000))
    scale = {"constant": 0.0, "exact": 1.0, "huge": 1e9, "tiny": 1e-12}[reading]
    y = 5.0 + 0 * y if reading == "constant" else truth if reading == "exact" else y * scale
    u = DynamicBiasRegressor("temperature", TIMES).fit(X, y).correct(X, y, return_std=True)[1]
    assert np.isfinite(u).all()
    if scale in (0.0, 1.0):
        assert u.max() < 0.05
    else:
        assert u.median() == pytest.approx(0.2 * scale, rel=0.05)


@pytest.mark.parametrize("n", [8, 20, 60])
def test_short_records_have_wide_intervals(n):
    X, y, _ = device(n, 3, np.random.default_rng(3).standard_normal(n))
    signed = DynamicBiasRegressor("temperature", ["5 min"], degree=1).fit(X, y).uncertainty(X, y)
    assert np.isfinite(signed.frame()[["u", "k", "U"]]).all(axis=None)
    assert (signed.frame()["k"] > 1.96).all()


def test_rows_count_once(fitted):
    model, X, y, _ = fitted
    signed = model.uncertainty(X, y)
    assert signed.mean([5, 5]).u == signed.mean([5]).u
    assert signed.mean([-1, 2999]).u == signed.mean(2999).u
    assert signed.mean([X.index[3], X.index[9]]).u == signed.mean([9, 3]).u


def test_noise_of_different_runs_is_independent():
    record = make_record(1000, runs=2, seed=5)
    clock = np.tile(np.arange(1000) * 60.0, 2)  # both of the same time
    X = record[["temperature", "run"]].reset_index(drop=True).assign(clock=clock)
    y = record["reading"].reset_index(drop=True)
    signed = DynamicBiasRegressor("temperature", TIMES, run="run", time="clock").fit(X, y).uncertainty(X, y)
    matrix = signed.covariance([500, 1500])
    assert matrix[0, 1] < 0.1 * matrix[0, 0]
    rows = [500, 1500, 700, 1700]
    assert signed.mean(rows).u == pytest.approx(np.sqrt(signed.covariance(rows).mean()), rel=0.02)


def test_rows_outside_are_not_exported(fitted):
    _, X, y, _ = fitted
    first = int(np.argmax(X["temperature"] > X["temperature"].quantile(0.9)))
    signed = DynamicBiasRegressor("temperature", TIMES, degree=1).fit(X[:first], y[:first]).uncertainty(X, y)
    outside = np.flatnonzero(signed.status == "outside fitted range")
    with pytest.raises(ValueError, match="not signed: outside fitted range"):
        signed.certificate(outside)
    assert f"{(signed.status == 'signed').sum()} of them signed" in str(signed)


def test_a_diagnosis_of_another_model_is_refused(fitted):
    model, X, y, _ = fitted
    poor = DynamicBiasRegressor("temperature", ["3 h"]).fit(X, y)
    with pytest.raises(ValueError, match="of another model"):
        poor.uncertainty(X, y, diagnosis=diagnose(model, X, y))
    with pytest.raises(ValueError, match="what diagnose"):
        poor.uncertainty(X, y, diagnosis="nothing missing")


def test_a_thermometer_has_moved_before_the_first_row(fitted):
    """The same rows alone, and as the end of the whole record."""
    _, X, y, _ = fitted
    model = DynamicBiasRegressor("temperature", TIMES, degree=1).fit(X[:1500], y[:1500])
    sensor = Sensor(drift_since_learning=0.02)
    whole, alone = (model.uncertainty(X[k:], y[k:], sensor=sensor).frame()["u_sensor"] for k in (0, 1500))
    np.testing.assert_allclose(alone, whole[1500:], rtol=1e-6)


def test_noise_of_the_thermometer_falls_in_a_mean(fitted):
    model, X, y, _ = fitted
    signed = model.uncertainty(X, y, sensor=Sensor(noise=0.05))
    one, many = (next(line for line in signed.mean(rows).lines if "thermometer" in line.quantity).contribution
                 for rows in (500, slice(500, 600)))  # fmt: skip
    assert many == pytest.approx(one / 10, rel=1e-6)
    matrix = signed.covariance(slice(500, 600))
    assert signed.mean(slice(500, 600)).u == pytest.approx(np.sqrt(matrix.mean()), rel=0.02)


def test_a_budget_in_degf_says_the_same_of_the_thermometer_as_one_in_degc(fitted):
    """0.02 K at 10 ppm/K are 0.2 ppm: number, unit and sensitivity belong together."""
    _, X, y, _ = fitted
    hot = (X * 1.8 + 32).rename(columns={"temperature": "room_degF"})
    lines = []
    for log in (X, hot):
        model = DynamicBiasRegressor(log.columns[0], TIMES, degree=1).fit(log, y)
        budget = model.uncertainty(log, y, sensor=Sensor(drift_since_learning=0.02)).budget(1000)
        lines.append(next(line for line in budget.lines if "thermometer" in line.quantity))
    for line in lines:
        assert (line.uncertainty, line.unit) == (0.02, "K")
        assert line.sensitivity == pytest.approx(10, rel=0.01)
        assert line.contribution == pytest.approx(lines[0].contribution, rel=1e-6)


def test_parts_of_one_estimate_share_their_degrees_of_freedom(fitted):
    _, X, y, _ = fitted
    signed = DynamicBiasRegressor("temperature", ["3 h"]).fit(X, y).uncertainty(X, y)
    assert signed.dof.max() < 2.05 * max(signed.joint.noise.wander_dof, signed.joint.dof)  # of two estimates
    assert signed.budget(1000).dof == pytest.approx(signed.dof[1000], rel=0.05)


@pytest.mark.parametrize("settings", [{"sensor": 0.01}, {"sensor": {"noise": 1}}])
def test_a_sensor_is_a_sensor(fitted, settings):
    model, X, y, _ = fitted
    with pytest.raises(ValueError, match="must be a Sensor"):
        model.uncertainty(X, y, **settings)
    with pytest.raises(ValueError, match="y is None"):
        model.uncertainty(X, None)
    with pytest.raises(ValueError, match="share between 0 and 1"):
        model.uncertainty(X, y, coverage="95 %")


@pytest.mark.parametrize("seed", [21, 22])
def test_noise_that_goes_with_the_temperature_is_not_taken_to_stay_what_it_was_last(seed):
    """The fitted part ends in the cold, where the noise is small: later it may be as large as it was at any time."""
    X, clean, _ = device(6000, seed, np.zeros(6000))
    warm = (X["temperature"] - X["temperature"].min()) / np.ptp(X["temperature"])
    y = clean + 0.2 * 8.0**warm * np.random.default_rng(seed).standard_normal(6000)
    cold = int(np.argmin(warm.rolling(200).mean()[3500:5000])) + 3500
    model = DynamicBiasRegressor("temperature", TIMES, degree=1).fit(X[:cold], y[:cold])
    u = model.predict(X, return_std=True)[1]
    assert u[cold - 100 : cold].mean() < 0.8 * model.residual_std_ and u[cold + 100 :].min() > 0.9 * model.residual_std_


GAUGE = {  # GUM (JCGM 100:2008), example H.1: calibration of an end gauge; nm, contributions of table H.1
    "standard": (25.0, 1.0, 18.0),
    "repeated observations": (5.8, 1.0, 24.0),
    "comparator, random": (3.9, 1.0, 5.0),
    "comparator, systematic": (6.7, 1.0, 8.0),
    "expansion difference": (0.58e-6, 5e7 * 0.1, 50.0),
    "temperature difference": (0.029, 50e6 * 11.5e-6, 2.0),
}


def budget(coverage):
    lines = tuple(
        BudgetLine(quantity=name, estimate=0.0, uncertainty=u, unit="nm", sensitivity=c, dof=dof)
        for name, (u, c, dof) in GAUGE.items()
    )
    return Budget(name="l", value=50_000_838.0, unit="nm", lines=lines, coverage=coverage, status="signed")


def test_the_end_gauge_of_the_guide():
    """H.1.5 and H.1.6: u = 32 nm, 16 degrees of freedom, U99 = 93 nm with k = 2.92 (rounded there at each step)."""
    found = budget(0.99)
    assert found.u == pytest.approx(32, abs=0.5)
    assert np.floor(found.dof) == pytest.approx(16, abs=1)
    assert found.k == pytest.approx(2.92, abs=0.05)
    assert pytest.approx(93, abs=2) == found.U


def test_it_is_what_gtc_makes_of_it():
    """GTC is the GUM tree calculator of the Measurement Standards Laboratory of New Zealand."""
    gtc = pytest.importorskip("GTC", reason="GTC is in the extra 'test'")
    total = gtc.ureal(50_000_838.0, 1e-12)
    for name, (u, sensitivity, dof) in GAUGE.items():
        total = total + sensitivity * gtc.ureal(0.0, u, dof, label=name)
    found = budget(0.95)
    assert found.u == pytest.approx(gtc.uncertainty(total), rel=1e-12)
    assert found.dof == pytest.approx(gtc.dof(total), rel=1e-9)
    assert found.k == pytest.approx(gtc.reporting.k_factor(gtc.dof(total), 95), rel=1e-6)


@pytest.mark.parametrize(
    ("value", "U", "text"),
    [
        (103.95712, 0.00013, "103.957 12(13)"),
        (252.4449, 0.594, "252.44(59)"),
        (10.0, 0.0996, "10.00(10)"),
        (10.0, 0.0999, "10.00(10)"),
        (1234567.0, 4321.0, "1234600(4300)"),
        (-0.5, 12.3, "0(12)"),
        (3.14159, 1.23, "3.1(1.2)"),
        (5.0, 0.0, "5(0)"),
    ],
)
def test_values_are_written_with_two_digits_of_uncertainty(value, U, text):
    assert concise(value, U) == text


def test_shares_add_up_and_tables_are_escaped():
    found = budget(0.95)
    assert found.frame()["share"].sum() == pytest.approx(1)
    strange = Budget(
        name="<x>", value=1.0, unit="%_&", status="provisional", coverage=0.95,
        lines=(BudgetLine(quantity="<script>", estimate=np.nan, uncertainty=1.0, unit="%"),),
    )  # fmt: skip
    assert strange.result().endswith("provisional")
    assert "infinite" in str(strange)


def learned_cold(seed):
    """A device with a curvature inside, learned on a colder part of its record; and the record's hotter rows."""
    record = make_record(
        8000, device="box", setting="outdoor", sampling_period=600.0, nonlinearity=0.002, seed=seed, noise=0.2
    )
    X, y = record[["temperature"]], record["reading"]
    n = 4000
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:n], y[:n])
    hot = (X["temperature"] > model.reading_.temperature_range[1] + 1).to_numpy() & (np.arange(len(X)) >= n)
    return model, X, y, hot


@pytest.mark.parametrize("seed", [9611, 9621, 9625])
def test_hotter_rows_than_any_that_were_learned_are_not_signed(seed):
    """A law without a curvature is wrong there by more than its u says: they are flagged."""
    model, X, y, hot = learned_cold(seed)
    assert model.uncertainty(X, y, allow_missing=True).frame()["status"][hot].eq("outside fitted range").all()


def heated(seed):
    """A curved device, learned in a room, heated by 30 K for two hours: model, rows not learned, first row after."""
    name = ("layered", "box")[seed % 2]
    record, truth = make_record(6000, device=name, seed=seed, return_truth=True)
    air = record["temperature"].to_numpy().copy()
    air[5400:5520] += 30.0
    body = make_device(name, sensitivity=10.0, nonlinearity=0.003, reference_temperature=23.0)
    y = pd.Series(body.respond(60.0 * np.arange(6000), air) + truth["noise"].to_numpy(), record.index)
    X = pd.DataFrame({"temperature": air}, record.index)
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:5000], y[:5000])
    return model, X[5000:], y[5000:], 520


@pytest.mark.parametrize("seed", [9700, 9701, 9702, 9703])
def test_readings_after_an_excursion_are_not_signed_before_the_device_has_cooled(seed):
    """The air is back in the fitted range at once. Where it alone was asked, all of them were signed."""
    model, X, y, back = heated(seed)
    told, u = model.predict(X, return_std=True)
    after = slice(back, back + 180)
    inside = np.abs(y - told)[after] <= coverage_factor(model._joint_errors().dof, 0.95) * u[after]
    assert inside.mean() > 0.85
    frame = model.uncertainty(X, y, allow_missing=True).frame()
    air_inside = X["temperature"].between(*model.reading_.temperature_range).to_numpy()
    assert air_inside[after].mean() > 0.9
    assert frame["status"].iloc[back : back + 60].isin(("outside fitted range", "doubtful input", "jump")).all()
    before = frame.iloc[:300][air_inside[:300]]
    assert not before["status"].eq("outside fitted range").any()
    live = OnlineCorrector(model, uncertainty=True).update_many(X, y)
    np.testing.assert_allclose(live["u"], model.correct(X, y, return_std=True)[1], rtol=1e-6)


def test_no_row_of_the_fitted_record_is_outside_of_it():
    model, X, y, _ = learned_cold(9621)
    assert not model.uncertainty(X[:4000], y[:4000]).frame()["status"].eq("outside fitted range").any()
