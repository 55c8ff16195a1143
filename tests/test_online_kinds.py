"""Live correction of every kind of effect and of time: the numbers of the whole record."""

import json
import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from effect_records import LIVE, LIVE_NAMES
from streams import agree, one_by_one, stream

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError
from thermocorr.effects import Covariate, Effect
from thermocorr.equations import lag_differences


class Fan(Effect):
    """A user's own effect: no stepper."""

    kind = "fan"

    def inputs(self):
        return ["humidity"]

    def learn(self, record):
        self.mean_ = record.moments("humidity").mean

    def names(self):
        return ["fan", "late fan", "age"]

    def columns(self, block, state):
        values = block["humidity"] - self.mean_
        lag, state = lag_differences(values, block.steps, np.array([600.0]), state)
        return np.column_stack((values**2, lag, block.seconds / 86_400 + block.elapsed / 3600)), state


@pytest.mark.parametrize("effect", [*LIVE, Fan()], ids=[*LIVE_NAMES, "own"])
def test_every_kind_of_effect_lives(effect):
    X, y = stream(600, 3)
    model = DynamicBiasRegressor(time_constants=[300.0], max_gap="1 h").with_effect(effect).fit(X[:450], y[:450])
    for rows in (slice(0, 600), slice(450, 600)):
        some, readings = X[rows], y[rows]
        single = one_by_one(OnlineCorrector(model), some, readings, humidity=some["humidity"])
        agree(model, some, readings, [s.corrected for s in single], [s.flag for s in single])
        live = OnlineCorrector(model)
        got = []
        for start in range(0, len(some), 37):  # by turns one by one and in blocks, with a restart in between
            part, values = some[start : start + 37], readings[start : start + 37]
            if start % 2:
                got += [s.corrected for s in one_by_one(live, part, values, humidity=part["humidity"])]
            else:
                got += live.update_many(part, values)["corrected"].tolist()
            live = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state(), allow_nan=False)))
        agree(model, some, readings, got, [s.flag for s in single])


LAYOUTS = {
    "zone": lambda X: (X.tz_localize("Europe/Berlin"), {}),
    "spans": lambda X: (X.set_axis(X.index - X.index[0]), {}),
    "seconds": lambda X: (X.assign(s=0.1 + (X.index - X.index[0]).total_seconds()), {"time": "s"}),
    "rows": lambda X: (X.reset_index(drop=True), {"sampling_period": "1 min"}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_kind_of_time_lives(layout):
    X, y = stream(500, 4, holes=False)
    X, more = LAYOUTS[layout](X)
    y = y.set_axis(X.index)
    model = DynamicBiasRegressor(time_constants=[300.0, 5000.0], **more).fit(X[:300], y[:300])
    X, y = X[300:], y[300:]
    times = {"seconds": X.get("s"), "rows": [None] * 200}.get(layout, X.index)
    live = OnlineCorrector(model)
    single = [live.update(t, T, U) for t, T, U in zip(times, X["temperature"], y, strict=True)]
    agree(model, X, y, [s.corrected for s in single], [s.flag for s in single])
    live = OnlineCorrector(model)
    halves = [live.update_many(X[:90], y[:90]), live.update_many(X[90:], y[90:])]
    agree(model, X, y, pd.concat(halves)["corrected"], pd.concat(halves)["flag"])


@pytest.mark.parametrize(
    "form",
    [
        lambda t: t.to_pydatetime(), str, lambda t: t.to_datetime64(), lambda t: t.isoformat(),
        lambda t: t.as_unit("s"),
    ],
    ids=["datetime", "text", "numpy", "iso", "other unit"],
)  # fmt: skip
def test_dates_may_come_in_any_form(form):
    X, y = stream(200, 5, holes=False)
    X = X.set_axis(X.index.round("1s"))
    y = y.set_axis(X.index)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:150], y[:150])
    live = OnlineCorrector(model)
    rows = zip(X.index[150:], X["temperature"][150:], y[150:], strict=True)
    got = [live.update(form(t), T, U) for t, T, U in rows]
    agree(model, X[150:], y[150:], [s.corrected for s in got], [s.flag for s in got])


@pytest.mark.parametrize("first", [1e40, -1e40, 2.0**53])
def test_a_first_time_so_large_that_a_second_less_is_the_same(first):
    """A damaged one: it is doubted until the next sample tells, in blocks as one by one."""
    X, y = stream(200, 5, holes=False)
    X = X.assign(s=60.0 * np.arange(200)).reset_index(drop=True)
    model = DynamicBiasRegressor(time="s", time_constants=[300.0]).fit(X[:150], y[:150].to_numpy())
    X, y = X[150:].assign(s=X["s"].where(X.index > 150, first)), y[150:].to_numpy()
    live = OnlineCorrector(model)
    single = [live.update(s, T, U) for s, T, U in zip(X["s"], X["temperature"], y, strict=True)]
    for cut in (0, 1, 20):
        live = OnlineCorrector(model)
        blocks = pd.concat([live.update_many(X[:cut], y[:cut]), live.update_many(X[cut:], y[cut:])])
        np.testing.assert_allclose(blocks["corrected"], [sample.corrected for sample in single], rtol=1e-12)
        assert blocks["flag"].tolist() == [sample.flag for sample in single]
    assert "stale time" not in {sample.flag for sample in single}


def test_a_bias_that_is_no_number_is_flagged_alike_one_by_one_and_in_blocks():
    """Squares of the column overflow where the temperature is an ordinary one; a lost reading is said first."""
    X, y = stream(200, 5, holes=False)
    squared = DynamicBiasRegressor(time_constants=[300.0], effects=[Covariate("humidity", 2)], screen=False)
    model = squared.fit(X[:150], y[:150])
    X, y = X[150:].copy(), y[150:].copy()
    X.iloc[[5, 6], X.columns.get_loc("humidity")], y.iloc[6] = 1e200, np.nan
    single = one_by_one(OnlineCorrector(model), X, y, humidity=X["humidity"])
    blocks = OnlineCorrector(model).update_many(X, y)
    assert blocks["flag"].tolist() == [sample.flag for sample in single]
    assert blocks["flag"].iloc[[5, 6]].tolist() == ["outside fitted range", "no reading"]
    assert np.flatnonzero(blocks["bias"].isna()).tolist() == [5, 6]
    assert [k for k, sample in enumerate(single) if math.isnan(sample.bias)] == [5, 6]


@pytest.mark.parametrize("cut", [0, 1, 2, 20])
def test_a_first_date_a_century_early_is_as_far_away_in_blocks(cut):
    """As far as times reach: no difference of two wraps to a step backward."""
    X, y = stream(200, 5, holes=False)
    X = X.set_axis(pd.date_range("2024-03-01", periods=200, freq="1min"))
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:150], y[:150].to_numpy())
    X = X[150:].set_axis(X.index[150:].where(np.arange(50) > 0, pd.Timestamp("1880-01-02")))
    y, live = y[150:].to_numpy(), OnlineCorrector(model)
    single = [live.update(*row) for row in zip(X.index, X["temperature"], y, strict=True)]
    live = OnlineCorrector(model)
    blocks = pd.concat([live.update_many(X[:cut], y[:cut]), live.update_many(X[cut:], y[cut:])])
    np.testing.assert_allclose(blocks["corrected"], [sample.corrected for sample in single], rtol=1e-12)
    assert blocks["flag"].tolist() == [sample.flag for sample in single]
    assert blocks["flag"].tolist()[1] == "suspect time"


@pytest.mark.parametrize(("gap", "minutes"), [(None, 10), ("10 min", 10), ("1 h", 60)])
@pytest.mark.parametrize("late", [3, 9, 27, 400])
def test_a_false_first_time_is_doubted_wherever_the_stream_is_cut(late, gap, minutes):
    """A date beyond the gap is taken back by the next sample, also in a corrector that was restored between the two."""
    X, y = stream(80, 6, holes=False)
    X = X.set_axis(pd.date_range("2024-03-01", periods=80, freq="1min"))
    model = DynamicBiasRegressor(time_constants=[300.0], max_gap=gap).fit(X[:60], y[:60].to_numpy())
    times = X.index[60:].where(np.arange(20) > 0, X.index[60] + pd.Timedelta(minutes=late))
    rows = list(zip(times, X["temperature"][60:], y[60:], strict=True))
    live = OnlineCorrector(model)
    whole = [live.update(*row) for row in rows]
    for cut in (1, 2, 5):
        live = OnlineCorrector(model)
        before = [live.update(*row) for row in rows[:cut]]
        again = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
        samples = [*before, *(again.update(*row) for row in rows[cut:])]
        assert [s.flag for s in samples] == [s.flag for s in whole]
        np.testing.assert_array_equal([s.corrected for s in samples], [s.corrected for s in whole])
    assert (sum(math.isnan(s.corrected) for s in whole) <= 1) == (late >= minutes)


@pytest.mark.parametrize("zone", [None, "UTC"])
def test_dates_of_the_other_kind_are_refused_in_any_form(zone):
    """Whoever leaves out the zone may mean any hour."""
    X, y = stream(200, 5, holes=False)
    index = X.index.round("1s").tz_localize(zone)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X.set_axis(index), y.to_numpy())
    other = (index[-1] + pd.Timedelta("1 min")).tz_localize("UTC" if zone is None else None)
    live = OnlineCorrector(model)
    for form in (other, other.to_pydatetime(), other.isoformat()):
        with pytest.raises(RecordError, match=f"must be a date with{'out' if zone is None else ''} a time zone"):
            live.update(form, 23.0, 1.0)


@pytest.mark.parametrize("bad", ["soon", None, math.nan, -math.inf, 1e41, [1], pd.Timestamp("2024")])
def test_what_is_no_number_of_seconds_is_refused_where_the_record_counts_them(bad):
    X, y = stream(200, 5, holes=False)
    X = X.assign(s=60.0 * np.arange(200)).reset_index(drop=True)
    live = OnlineCorrector(DynamicBiasRegressor(time="s", time_constants=[300.0]).fit(X, y.to_numpy()))
    with pytest.raises(RecordError, match="A sample's time must be a number of seconds"):
        live.update(bad, 23.0, 1.0)
    assert (
        live.update("12000", 23.0, 1.0).corrected == OnlineCorrector(live.model).update(12_000.0, 23.0, 1.0).corrected
    )


def test_zoned_dates_and_spans_may_come_in_any_form():
    X, y = stream(200, 5, holes=False)
    zoned = X.set_axis(X.index.round("1s").tz_localize("UTC"))
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(zoned[:150], y[:150].to_numpy())
    t = zoned.index[150]
    forms = [
        t,
        t.to_pydatetime(),
        t.isoformat(),
        t.tz_convert("Asia/Tokyo"),
        datetime.fromtimestamp(t.timestamp(), UTC),
    ]
    got = {OnlineCorrector(model).update(form, 23.0, 1.0) for form in forms}
    assert len(got) == 1
    spans = X.set_axis(X.index - X.index[0])
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(spans[:150], y[:150].to_numpy())
    forms = [pd.Timedelta("4 h"), "4 h", timedelta(hours=4), 14_400, 14_400.0, np.timedelta64(4, "h")]
    assert len({OnlineCorrector(model).update(form, 23.0, 1.0) for form in forms}) == 1


def test_a_sample_without_the_label_of_its_run_is_refused():
    X, y = stream(300, 7, holes=False)
    X = X.assign(run="a")
    model = DynamicBiasRegressor(time_constants=[300.0], run="run").fit(X, y)
    live = OnlineCorrector(model)
    for label in ({}, {"run": None}, {"run": float("nan")}):
        with pytest.raises(RecordError, match="no label of its run"):
            live.update(X.index[-1] + (X.index[1] - X.index[0]), 22.0, 250.0, **label)


def test_seconds_in_text_are_seconds():
    """Everywhere that spans are taken; pandas counts nanoseconds."""
    X, y = stream(300, 7, holes=False)
    bare, texts = (DynamicBiasRegressor(time_constants=times).fit(X, y) for times in ([900.0], ["900"]))
    assert bare.time_constants_ == texts.time_constants_
    assert OnlineCorrector(bare, track="86400").track is not None
    with pytest.raises(ValueError, match="'1,5 h'"):
        OnlineCorrector(bare, track="1,5 h")
