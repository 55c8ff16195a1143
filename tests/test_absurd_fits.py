"""Fits that mean nothing are refused or said to be so: rounding taken for a change, columns that cancel."""

import warnings
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, RecordError, RecordWarning, TimeConstantSearch, compare_variants
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Interaction, LaggedCovariate, Periodic
from thermocorr.effects.stream import equal_edges
from thermocorr.model.fitting import sweep_effects
from thermocorr.records import Layout, read_record

N = 1200
RNG = np.random.default_rng(4)
NOISE = RNG.normal(size=N)
SECONDS = pd.timedelta_range(0, periods=N, freq="15s")
WAVE = np.sin(np.arange(N) / 90.0) + 0.3 * np.sin(np.arange(N) / 17.0)


def room(temperature, **columns):
    return pd.DataFrame({"temperature": temperature, **columns}, index=SECONDS)


@contextmanager
def silence():
    """Any warning about a record fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RecordWarning)
        yield


ROUNDING = {
    "of a constant": 23 + 1e-13 * NOISE,
    "in kelvin": 296.15 + 1e-12 * NOISE,
    "of a constant less its mean": 1e-14 * NOISE,
    "last digit": np.where(NOISE > 0, 20.1, np.nextafter(20.1, 21)),
    "in volts": 0.6 + 1e-16 * np.round(NOISE),
}
SMALL = {
    "a microkelvin at 300 K": 300 + 1e-6 * WAVE,
    "in amperes": 296e-6 + 1e-9 * WAVE,
    "in volts of a thermocouple": 4e-5 * WAVE,
    "single precision": (23 + 1e-5 * WAVE).astype(np.float32),
}


@pytest.mark.parametrize("name", ROUNDING)
@pytest.mark.parametrize("time_constants", [(), [600.0], "auto"], ids=str)
def test_rounding_is_no_change_of_temperature(name, time_constants):
    X, y = room(ROUNDING[name]), 10 + 1e-3 * NOISE
    words = r"temperature never changes( beyond its rounding: its span is|: it is).*1200 rows.*right column"
    with pytest.raises(RecordError, match=words):
        DynamicBiasRegressor(time_constants=time_constants).fit(X, y)


@pytest.mark.parametrize("name", SMALL)
def test_small_changes_are_learned_from(name):
    """The planted coefficient comes back: 1e3 readings of noise 1e-3 of the signal know it to 1e-4."""
    T = SMALL[name].astype(float)
    y = 5.0 + 2.0 * (T - T.mean()) / T.std() + 1e-3 * NOISE
    model = DynamicBiasRegressor(time_constants=(), degree=1).fit(room(SMALL[name]), y)
    assert model.coef_[0] * T.std() == pytest.approx(2.0, rel=1e-3)


OF_A_COLUMN = [
    Covariate("humidity"),
    Covariate("humidity", 2),
    LaggedCovariate("humidity", ["20 min"]),
    LaggedCovariate("humidity", ["20 min"], power=3),
    Interaction("humidity"),
]
FLAT = {"rounding": 45 + 1e-13 * NOISE, "constant": np.full(N, 45.0), "zero": np.zeros(N)}


@pytest.mark.parametrize("effect", OF_A_COLUMN, ids=repr)
@pytest.mark.parametrize("column", FLAT)
@pytest.mark.parametrize("time_constants", [[600.0], 2], ids=str)
def test_a_flat_column_gets_no_coefficient_and_a_note(effect, column, time_constants):
    X, y = room(23 + WAVE, humidity=FLAT[column]), 10 + WAVE + 1e-3 * NOISE
    with pytest.warns(RecordWarning, match="The column 'humidity' never changes") as caught:
        model = DynamicBiasRegressor(time_constants=time_constants, effects=[effect]).fit(X, y)
    assert len([1 for warning in caught if "humidity" in str(warning.message)]) == 1
    assert any("'humidity' never changes" in note and "Leave it out" in note for note in model.notes_)
    without = DynamicBiasRegressor(time_constants=model.time_constants_, alpha=model.alpha_).fit(X, y)
    n = len(effect.inputs()) + isinstance(effect, LaggedCovariate)
    np.testing.assert_array_equal(model.coef_[-n:], 0.0)
    np.testing.assert_allclose(model.coef_[:-n], without.coef_, rtol=1e-6)
    later = X.set_index(X.index + pd.Timedelta("30 days"))
    moved = later.assign(humidity=60.0)  # what nothing was learned about does nothing
    np.testing.assert_allclose(model.predict(moved), without.predict(later), rtol=1e-9)


def test_a_column_that_moves_a_little_keeps_its_coefficient():
    """Pressure in Pa that moves by 1 Pa: a part in 1e5; its planted effect comes back within four standard errors."""
    pressure = 101_325.0 + np.cos(np.arange(N) / 50.0)
    X = room(23 + WAVE, pressure=pressure)
    with silence():
        model = DynamicBiasRegressor(time_constants=[600.0], effects=[Covariate("pressure")]).fit(
            X, 10 + WAVE + 0.5 * pressure + 1e-3 * NOISE
        )
    assert model.coef_[-1] == pytest.approx(0.5, abs=4 * model._standard_errors()[-1])


def test_effects_of_ones_own_are_left_alone():
    """A subclass may make anything of a flat column."""

    class Supply(Covariate):
        kind = "supply"

        def columns(self, block, state):
            return block.temperature**3 * block[self.column], state

    X = room(WAVE, supply=5 + 1e-13 * NOISE)
    effect = Supply("supply")
    record = read_record(X, Layout(), y=NOISE, needed=["supply"])
    effect.learn(record)
    swept = sweep_effects(record, [effect], equal_edges(record))
    assert swept.total().r[:, 1].any()


def short(n=19):
    """18 s of a room, and readings of 10 V with a noise of 1 mV."""
    X = pd.DataFrame(
        {"temperature": 23 + np.sin(np.arange(n) / 3)}, index=pd.date_range("2024-01-01", periods=n, freq="1s")
    )
    return X, pd.Series(10 + 1e-3 * RNG.normal(size=n), X.index, name="volt")


@pytest.mark.parametrize("effect", [Periodic("3 h"), Periodic("1 D"), Periodic("1 D", 1), Periodic("10 min")], ids=repr)
def test_periods_far_beyond_the_record_are_told_at_fit(effect):
    X, y = short()
    with pytest.warns(RecordWarning, match=r"contributions .* cancel: they reach .* largest is that of '(sin|cos)\["):
        model = DynamicBiasRegressor(time_constants=[2.0], effects=[effect]).fit(X, y)
    assert any("cancel" in note and "Leave that effect out" in note for note in model.notes_)


def test_time_constants_that_are_nearly_alike_are_told_at_fit():
    """Without a penalty, on 400 rows: contributions of ten thousand times the readings."""
    record = make_record(400, seed=1)
    X, y = record[["temperature"]], record["reading"]
    grid = list(np.geomspace(60, 60_000, 20))
    with pytest.warns(RecordWarning, match="cancel"):
        DynamicBiasRegressor(time_constants=grid, alpha=0.0).fit(X, y)


SETTINGS = [{}, {"time_constants": 6}, {"degree": 5}, {"products": True}, {"reference_temperature": -273.15}]


@pytest.mark.long
@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_healthy_fits_are_far_from_cancelling(settings, voltage):
    """No warning for the reference and simulated devices; T0 far away is the user's choice and no cancellation."""
    simulated = make_record(3000, seed=5, device="box", effects={"hysteresis": 2.0})
    for X, y in (voltage, (simulated[["temperature"]], simulated["reading"])):
        with silence():
            model = DynamicBiasRegressor(**settings).fit(X, y)
            model.correct(X, y), model.evaluate(X, y)


@pytest.mark.parametrize("method", ["correct", "evaluate"])
def test_corrected_readings_far_beyond_all_readings_are_told_once(method):
    X, y = short()
    model = DynamicBiasRegressor(time_constants=[2.0], effects=[Periodic("3 h")]).fit(X, y)
    words = r"far behind in 19 rows of 19, the first is row 0: it comes to .*contributions\(X\)"
    with pytest.warns(RecordWarning, match=words) as caught:
        getattr(model, method)(X, y)
    assert len(caught) == 1 and caught[0].filename == __file__


@pytest.fixture(scope="module")
def lab():
    record = make_record(3000, seed=2)
    X, y = record[["temperature"]], record["reading"]
    return DynamicBiasRegressor(time_constants=[300.0, 3600.0]).fit(X[:2000], y[:2000]), X[2000:], y[2000:]


def test_the_rows_are_named(lab):
    """A thermometer that says 400 K more in two rows: the second is accepted, and the lags remember it."""
    model, X, y = lab
    broken = X.copy()
    broken.iloc[500:502, 0] += 400.0
    with pytest.warns(RecordWarning, match=r"in \d+ rows of 1000, the first is row 501") as caught:
        corrected = model.correct(broken, y)
    worst = int(np.argmax(np.abs(corrected - y)))
    assert len(caught) == 1 and f"it comes to {corrected.iloc[worst]:.10g} in row {worst}," in str(caught[0].message)


@pytest.mark.parametrize(
    "change",
    [
        lambda y: y,
        lambda y: y * 0.0,
        lambda y: y * np.nan,
        lambda y: y + 1e6,
        lambda y: y.where(np.arange(len(y)) != 7, 1e9),
        lambda y: y.round().astype(int),
    ],
    ids=["as they are", "zeros", "missing", "another level", "one spike", "integers"],
)
def test_odd_readings_are_no_reason_to_warn(change, lab):
    model, X, y = lab
    with silence():
        model.correct(X, change(y))
        model.evaluate(X[:1], change(y)[:1])


def test_a_reference_temperature_outside_the_record_is_the_users_choice(lab):
    _, X, y = lab
    with silence():
        model = DynamicBiasRegressor(time_constants=[300.0], reference_temperature=-40.0).fit(X, y)
        corrected = model.correct(X, y)
    assert abs(corrected.mean() - y.mean()) > 10 * y.std()  # far away indeed


def test_a_stuck_reading_stays_where_it_is():
    X = room(23 + WAVE)
    model = DynamicBiasRegressor(time_constants=[600.0]).fit(X, np.full(N, 10.0))
    with silence():
        np.testing.assert_allclose(model.correct(X, np.full(N, 10.0)), 10.0, rtol=1e-12)


def test_variants_and_searches_of_a_healthy_record_have_nothing_to_say():
    record = make_record(1500, seed=6)
    X, y = record[["temperature"]], record["reading"]
    with silence():
        compare_variants(X, y, time_constants=["5 min", "1 h"])
        TimeConstantSearch().fit(X, y).correct(X, y)
