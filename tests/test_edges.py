"""What seldom comes: types at their edges, times of other kinds, samples far beyond the fit."""

import json
import math
from datetime import datetime

import numpy as np
import pandas as pd
import pytest
from streams import one_by_one, stream

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate
from thermocorr.records import Layout, read_record
from thermocorr.records.numbers import as_numbers
from thermocorr.records.times import Times


def test_whole_numbers_beyond_all_floats_are_infinite_and_text_beside_them_is_none():
    with pytest.raises(RecordError, match="infinity in row 1"):
        as_numbers(np.array([1, 10**400, "3"], dtype=object), "It", "temperature")
    with pytest.raises(RecordError, match=r"not a number in row 2: 'warm' \(1 such row"):
        as_numbers(np.array([1, 10**400, "warm", None], dtype=object), "It", "temperature")


def test_a_guessed_temperature_is_said_where_the_user_called():
    X, y = stream(60, 1, holes=False)
    for fit in (DynamicBiasRegressor(time_constants=[60.0]).fit, DiffusiveFeatures([60.0]).fit):
        with pytest.warns(RecordWarning, match="No column is called 'temperature'") as caught:
            fit(X.rename(columns={"temperature": "oven"}), y)
        assert {warning.filename for warning in caught if "No column" in str(warning.message)} == {__file__}


def test_dates_of_other_centuries_are_refused():
    index = pd.date_range("1700-01-01", "2100-01-01", periods=60, unit="s")
    X = pd.DataFrame({"temperature": np.arange(60.0)}, index=index)
    with pytest.raises(RecordError, match=r"is 1700-01-01T00:00:00 in row 0. Times may lie between 1880 and 2170"):
        read_record(X, Layout("temperature"))
    read_record(X[30:], Layout("temperature"))


def test_rows_without_times_are_counted_in_seconds():
    assert Times(5, "rows", period=15.0).label(2) == "30 s"


@pytest.mark.parametrize("T", [1e39, -1e39])
def test_a_temperature_whose_powers_are_no_numbers_has_no_result(T):
    X, y = stream(300, 3, holes=False)
    model = DynamicBiasRegressor(time_constants=[300.0], degree=9).fit(X[:200], y[:200])
    X = X.assign(temperature=X["temperature"].where(X.index != X.index[250], T))
    together = OnlineCorrector(model).update_many(X[200:], y[200:])
    single = one_by_one(OnlineCorrector(model), X[200:], y[200:])
    for k, sample in enumerate(single):
        assert (sample.flag, math.isnan(sample.corrected)) == (
            together["flag"].iloc[k], math.isnan(together["corrected"].iloc[k]),
        )  # fmt: skip
    assert single[50].flag == "sentinel" and math.isnan(single[50].corrected) and math.isnan(single[50].bias)


@pytest.mark.parametrize("track", [None, "1 h"])
def test_a_block_without_any_temperature_takes_up_its_rows(track):
    """In a record without times: what comes then has the place that it has in one block or sample by sample."""
    X, y = stream(300, 4, holes=False)
    X, y = X[["temperature"]].reset_index(drop=True), y.reset_index(drop=True)
    X.loc[200:204] = math.nan
    model = DynamicBiasRegressor(time_constants=[300.0], sampling_period=60.0).fit(X[:200], y[:200])
    X, y = X[200:], y[200:]
    live, single = OnlineCorrector(model, track=track), OnlineCorrector(model, track=track)
    parts = [live.update_many(X[:3], y[:3]), live.update_many(X[3:], y[3:])]
    together = pd.concat(parts)
    samples = [single.update(None, T, U) for T, U in zip(X["temperature"], y, strict=True)]
    assert parts[0]["flag"].eq("no temperature").all() and parts[0]["corrected"].isna().all()
    assert together["flag"].tolist() == [sample.flag for sample in samples]
    np.testing.assert_allclose(together["corrected"], [sample.corrected for sample in samples], rtol=1e-12)
    assert live.state()["next_row"] == single.state()["next_row"]
    if track is not None:
        np.testing.assert_allclose(together["reference"], [sample.reference for sample in samples], rtol=1e-12)


@pytest.mark.parametrize(
    ("kind", "bad", "wanted"),
    [
        ("rows", 5, r"None \(the next row\)"),
        ("rows", "2024-01-01", r"None \(the next row\)"),
        ("spans", "soon", "a time span or a number of seconds"),
        ("spans", None, "a time span or a number of seconds"),
        ("spans", [1], "a time span or a number of seconds"),
    ],
)
def test_times_of_no_kind_are_refused(kind, bad, wanted):
    X, y = stream(200, 5, holes=False)
    X = X.reset_index(drop=True) if kind == "rows" else X.set_axis(X.index - X.index[0])
    more = {"sampling_period": 60.0} if kind == "rows" else {}
    live = OnlineCorrector(DynamicBiasRegressor(time_constants=[300.0], **more).fit(X, y.to_numpy()))
    with pytest.raises(RecordError, match=f"A sample's time must be {wanted}"):
        live.update(bad, 23.0, 1.0)


@pytest.mark.parametrize(
    "far",
    [
        datetime(8024, 1, 1), pd.Timestamp("8024-01-01"), np.datetime64("8024-01-01"), "8024-01-01T00:00:00",
        np.datetime64("800024-01-01T00:00:00"),
    ],
    ids=repr,
)  # fmt: skip
def test_dates_that_no_clock_reaches_are_refused_in_a_sentence(far):
    X, y = stream(200, 5, holes=False)
    live = OnlineCorrector(DynamicBiasRegressor(time_constants=[300.0]).fit(X, y))
    with pytest.raises(RecordError, match=r"A sample's time is .*8\d*024-01-01.*\. Times may lie between 1880"):
        live.update(far, 23.0, 1.0)


def test_rows_between_the_fitted_ones_are_not_taken_for_theirs():
    """A log of another sensor, half a step later: what the model knows of its own rows tells nothing of these."""
    X, y = stream(200, 5, holes=False)
    X = X.set_axis(pd.date_range("2024-01-01", periods=200, freq="60s"))
    y = y.set_axis(X.index)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:150], y[:150])
    late = X.index + pd.Timedelta("30s")
    found = model.evaluate(X[20:60].set_axis(late[20:60]), y[20:60].set_axis(late[20:60]))
    assert found["flag"].iloc[0] == "washout"
    fresh = model.evaluate(X[20:60].set_axis(late[20:60] - pd.Timedelta("90D")), y[20:60].to_numpy())
    np.testing.assert_allclose(found["corrected"], fresh["corrected"], rtol=1e-12)


def test_a_state_that_begins_behind_rows_that_were_passed_over_goes_straight_across_them():
    record = make_record(600, seed=1)
    X, y = record[["temperature"]].copy(), record["reading"]
    X.iloc[[1, 50, 51, 200, 300], 0] = 9.9e37
    with pytest.warns(RecordWarning, match="left out"):
        model = DynamicBiasRegressor("temperature", ["10 min"]).fit(X, y)
    whole = model.evaluate(X, y)["corrected"]
    for start in (52, 301):
        np.testing.assert_allclose(model.evaluate(X[start:], y[start:])["corrected"], whole[start:], rtol=1e-12)


def test_rows_at_the_ends_of_runs_are_in_no_segment_and_not_passed_over():
    X = make_record(600, seed=1)[["temperature"]].assign(run=np.arange(600) // 300)
    X.iloc[[0, 1, 100, 298, 299, 300, 599], 0] = 9.9e37
    record = DiffusiveFeatures(["10 min"], temperature="temperature", run="run").read(X, quiet=True)
    assert [segment[:2] for segment in record.segments] == [(2, 298), (301, 599)]
    assert record.skipped.tolist() == [100] and record.n_used == 593


def test_the_first_time_without_a_zone_is_named():
    times = [f"2024-05-31T14:0{k}:00Z" for k in range(8)]
    times[5] = times[5].removesuffix("Z")
    X = pd.DataFrame({"time": times, "temperature": np.arange(8.0)})
    with pytest.raises(RecordError, match="others none, the first in row 5: '2024-05-31T14:05:00'"):
        read_record(X, Layout(time="time"))


def test_powers_of_an_absurd_column_are_no_numbers_and_flagged():
    record = make_record(600, effects={"covariate": 1.0}, seed=2)
    X, y = record[["temperature", "supply"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["10 min"], effects=[Covariate("supply", power=9)], screen=False)
    model.fit(X, y)
    time, T = X.index[-1] + pd.Timedelta("1 min"), float(X["temperature"].iloc[-1])
    sample = OnlineCorrector(model).update(time, T, 1.0, supply=1e39)
    assert math.isnan(sample.corrected) and sample.flag == "outside fitted range"


def test_a_state_that_goes_on_from_absurd_numbers_can_be_saved_again():
    """A forged lag within its bound, times a coefficient, makes a corrected reading beyond that bound."""
    record = make_record(600, seed=3)
    X, y = record[["temperature"]], 1e3 * record["reading"]
    live = OnlineCorrector(DynamicBiasRegressor("temperature", ["10 min"]).fit(X, y), average=3, track="1 h")
    live.update_many(X[-5:], y[-5:])
    node = json.loads(json.dumps(live.state()))
    lags = next(state for state in node["state"]["states"] if state)["$LagState"]
    lags[0]["$array"][1][0] = 9e119
    again = OnlineCorrector.from_state(live.model, node)
    sample = again.update(X.index[-1] + pd.Timedelta("1 min"), float(X["temperature"].iloc[-1]), float(y.iloc[-1]))
    assert abs(sample.corrected) > 1e120
    OnlineCorrector.from_state(live.model, json.loads(json.dumps(again.state(), allow_nan=False)))
