"""Later rows tied to the fitted record: the same bits, whether they repeat it, follow on it or come after a gap."""

import numpy as np
import pandas as pd
import pytest
from effect_records import temperatures

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, RecordError, load_model, save_model

LONG = 3000
KINDS = ["dates", "dates with zone", "spans", "seconds"]
ROWS = ["dates", "15 s", "0.1 s"]  # regular ones, the last two without times


def log(kind="dates", regular=True, digits=6, seed=0, n=LONG, run=None):
    """A log, and the layout to read it with."""
    T = np.round(temperatures(n, seed), digits)
    X = pd.DataFrame({"temperature": T} if run is None else {"temperature": T, "run": run})
    if kind in ("15 s", "0.1 s"):
        return X, {"sampling_period": kind}
    t = 15.0 * np.arange(n) if regular else np.cumsum(np.random.default_rng(9).integers(1, 60_000, n) / 1000)
    if kind == "seconds":
        return X.assign(t=1e5 + t), {"time": "t"}
    spans = pd.to_timedelta(np.round(t * 1e3).astype(int), unit="ms")
    zone = "Europe/Berlin" if kind == "dates with zone" else None
    return X.set_index(spans if kind == "spans" else pd.Timestamp("2024-03-31", tz=zone) + spans), {}


def features(initial_state="fit", **layout):
    return DiffusiveFeatures(
        [2.0, 40.0, 90.0], 2, products=True, reference_temperature=20.0, initial_state=initial_state, **layout
    )


@pytest.mark.parametrize("initial_state", ["fit", "equilibrium"])
@pytest.mark.parametrize(("kind", "regular"), [*((kind, False) for kind in KINDS), *((kind, True) for kind in ROWS)])
def test_rows_that_repeat_or_follow_the_fitted_record_get_the_same_bits(kind, regular, initial_state):
    X, layout = log(kind, regular)
    whole = features(initial_state, **layout).fit_transform(X)
    model = features(initial_state, **layout).fit(X[:2000])
    for start, stop in ((0, 2000), (1, 2000), (700, 1100), (1999, 2000), (2000, LONG), (1500, LONG)):
        assert np.array_equal(model.transform(X[start:stop]), whole[start:stop]), f"rows {start} to {stop}"


@pytest.mark.parametrize("kind", ["dates", "15 s"])
@pytest.mark.parametrize(("start", "stop"), [(0, 400), (700, 1100), (1500, LONG)])
def test_rows_that_begin_with_missing_temperatures_repeat_the_record_that_misses_them_too(kind, start, stop):
    X, layout = log(kind)
    X.iloc[start : start + 3] = np.nan
    whole = features(**layout).fit_transform(X)
    columns = features(**layout).fit(X[:2000]).transform(X[start:stop])
    assert np.array_equal(columns, whole[start:stop], equal_nan=True) and np.isnan(columns[:3]).all()


@pytest.mark.parametrize("kind", ["dates", "15 s"])
def test_record_too_long_to_keep_is_repeated_and_followed_all_the_same(kind, monkeypatch):
    monkeypatch.setattr("thermocorr.records.history.HISTORY_ROWS", 300)
    X, layout = log(kind)
    whole = features(**layout).fit_transform(X)
    model = features(**layout).fit(X[:2000])
    assert np.array_equal(model.transform(X[:2000]), whole[:2000])
    assert np.array_equal(model.transform(X[2000:]), whole[2000:])
    # atol: between kept rows the temperature is a straight line over 7 rows, in which it wanders by 0.05 sqrt(7)
    np.testing.assert_allclose(model.transform(X[700:1100])[:, 2:5], whole[700:1100, 2:5], rtol=0, atol=0.15)


def test_a_row_that_the_fitted_record_lacks_makes_another_record():
    """It follows on the fitted rows, as others without times do; a thermometer that stands still hides the row."""
    X, layout = log("15 s")
    X.iloc[890:910] = X.iloc[890]
    fitted, again = X[:2000].copy(), X[600:900]
    fitted.iloc[898] = np.nan
    whole = features(**layout).fit_transform(pd.concat([fitted, again], ignore_index=True))
    assert np.array_equal(features(**layout).fit(fitted).transform(again), whole[2000:])


@pytest.mark.parametrize("rows", [slice(1500, 1900), slice(2000, None)])
@pytest.mark.parametrize("digits", [2, 1, 0])
@pytest.mark.parametrize("kind", ["dates", "15 s"])
def test_thermometer_of_few_digits_is_no_obstacle(kind, digits, rows):
    X, layout = log(kind, digits=digits)
    X.iloc[2000, 0] = X.iloc[1999, 0]  # the first new temperature is the last fitted one
    whole = features(**layout).fit_transform(X)
    assert np.array_equal(features(**layout).fit(X[:2000]).transform(X[rows]), whole[rows])


@pytest.mark.parametrize("kind", KINDS)
def test_rows_after_a_gap_continue_across_it_unless_it_exceeds_max_gap(kind):
    X, layout = log(kind, regular=False)
    kept = np.r_[0:1000, 1400:LONG]  # a gap of three hours
    whole = features(**layout).fit_transform(X.iloc[kept])
    after = X[1400:]
    assert np.array_equal(features(**layout).fit(X[:1000]).transform(after), whole[1000:])
    afresh = features(**layout, max_gap="1 h").fit(X[:1000]).transform(after)
    alone = features(**layout).fit_transform(after)
    assert np.array_equal(afresh[:, :5], alone[:, :5])
    assert not afresh[:, 5:8].any()  # decays belong to the fitted segment
    between = features(**layout).fit(X.iloc[kept]).transform(X[1200:1400])  # rows that the fit had left out
    assert np.array_equal(between, features(**layout).fit(X[:1000]).transform(X[1200:1400]))


def test_each_run_goes_on_where_it_ended_and_another_one_or_an_earlier_start_begins_afresh():
    X, layout = log("seconds", run=np.arange(LONG) % 2)
    whole = features(run="run", **layout).fit_transform(X)
    model = features(run="run", **layout).fit(X[:2000])
    assert np.array_equal(model.transform(X[2000:]), whole[2000:])
    for rows in (X[2001::2].assign(run=7), X[:500:2].assign(t=X["t"] - 9e3)):
        assert np.array_equal(model.transform(rows)[:, :5], features(**layout).fit_transform(rows)[:, :5])
        assert not model.transform(rows)[:, 5:11].any()  # decays of either fitted run


@pytest.mark.parametrize("kind", ["spans", "seconds"])
@pytest.mark.parametrize("rows", [slice(0, 500), slice(700, 1100)])
def test_another_log_with_the_same_relative_times_starts_afresh(kind, rows):
    (X, layout), other = log(kind), log(kind, seed=7)[0][rows]
    columns = features(**layout).fit(X).transform(other)
    assert np.array_equal(columns[:, :5], features(**layout).fit_transform(other)[:, :5])
    assert not columns[:, 5:8].any()


@pytest.mark.parametrize("initial_state", ["fit", "equilibrium"])
def test_kind_of_time_makes_no_difference_and_products_are_those_of_the_lags(initial_state):
    (X, layout), (other, none) = log("15 s"), log("dates")
    columns = features(initial_state, **layout).fit_transform(X)
    lags, products, with_temperature = columns[:, 2:5], columns[:, -9:-3], columns[:, -3:]
    assert np.array_equal(lags, features(initial_state, **none).fit_transform(other)[:, 2:5])
    assert np.array_equal(products, np.stack([lags[:, j] * lags[:, k] for j in range(3) for k in range(j, 3)], axis=1))
    np.testing.assert_allclose(with_temperature, columns[:, :1] * lags, rtol=1e-12)


@pytest.mark.parametrize(("fitted", "given"), [("dates", "dates with zone"), ("dates", "spans"), ("seconds", "15 s")])
def test_kinds_of_times_that_differ_are_refused(fitted, given):
    (X, layout), (other, _) = log(fitted), log(given)
    model = features(**layout).fit(X)
    if fitted == "seconds":
        model, other = model.set_params(time=None, sampling_period=15), other.assign(t=0.0)
    with pytest.raises(RecordError, match="times of kind"):
        model.transform(other)


@pytest.mark.parametrize("later", [0.0, 0.5, 60.0, 3600.0])
def test_another_log_that_counts_its_seconds_from_its_own_start_is_not_the_fitted_one(tmp_path, later):
    """A clock that agrees proves little: no flag, and states of the other log."""
    seconds = 60.0 * np.arange(LONG)
    one, other = (pd.DataFrame({"temperature": temperatures(LONG, seed).round(1), "s": seconds}) for seed in (1, 2))
    other.loc[0, "temperature"] = one.loc[0, "temperature"]  # by chance
    reading = one["temperature"] + np.random.default_rng(0).normal(0, 0.1, LONG)
    model = DynamicBiasRegressor(time="s", time_constants=[300.0, 6000.0]).fit(one, reading)
    save_model(model, tmp_path / "model.json")
    again, new = load_model(tmp_path / "model.json"), other.assign(s=seconds + later)
    assert (again.flags(new)[:300] == "washout").all()
    assert np.isnan(again.predict(new, return_std=True)[1][:300]).all()
    for fitted, rows in ((again, slice(0, LONG)), (model, slice(1234, 1300))):
        assert not (fitted.flags(one[rows]) == "washout").any()
