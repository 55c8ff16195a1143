"""Live correction: the numbers of the whole record, however the samples arrive, stop and go on."""

import itertools
import json
import math
from datetime import date

import numpy as np
import pandas as pd
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from sklearn.preprocessing import SplineTransformer
from streams import agree, one_by_one, stream

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError
from thermocorr.datasets import make_record
from thermocorr.effects import Drift, LaggedCovariate


def test_temperatures_in_another_unit_do_not_drive_the_states(default):
    """Single ones are as if they had not come, live and in a whole record; a block of them is refused as by predict."""
    model, X, y = default
    some, readings = X[900:1000], y[900:1000]
    odd = some.copy()
    odd.iloc[40:43, odd.columns.get_loc("temperature")] += 273.15
    missing = odd.where(odd["temperature"] < 100.0)
    live = OnlineCorrector(model)
    with pytest.raises(RecordError, match="looks like kelvin where degC was fitted"):
        live.update_many(some.assign(temperature=some["temperature"] + 273.15), readings)
    singly = one_by_one(live, odd, readings)
    agree(model, odd, readings, [one.corrected for one in singly], [one.flag for one in singly])
    block = OnlineCorrector(model).update_many(odd, readings)
    agree(model, odd, readings, block["corrected"], block["flag"])
    assert block["flag"].eq("other unit").to_numpy().nonzero()[0].tolist() == [40, 41, 42]
    np.testing.assert_allclose(block["corrected"], model.correct(missing, readings), rtol=1e-12)


@pytest.fixture(scope="module")
def default():
    """The default kind of model (six lags, degree 2) fitted to the first third of a stream, and the stream."""
    X, y = stream()
    model = DynamicBiasRegressor(time_constants=[60.0, 180.0, 600.0, 1800.0, 5400.0, 16_000.0], max_gap="1 h")
    return model.fit(X[:900], y[:900]), X, y


@pytest.mark.parametrize("rows", [slice(0, 3000), slice(900, 3000), slice(400, 3000), slice(1700, 3000)])
def test_live_is_what_the_whole_record_says(default, rows):
    """From the fitted record's start on, after its end, from its middle on, and (beyond a long gap) afresh."""
    model, X, y = default
    X, y = X[rows], y[rows]
    single = one_by_one(OnlineCorrector(model), X, y)
    agree(model, X, y, [sample.corrected for sample in single], [sample.flag for sample in single])
    many = OnlineCorrector(model).update_many(X, y)
    np.testing.assert_array_equal(many["corrected"], model.correct(X, y))
    np.testing.assert_array_equal(many["bias"], model.bias(X))
    assert many.index.equals(X.index)
    assert [sample.flag for sample in single] == many["flag"].tolist()


@examples(40)
@given(cuts=st.lists(st.integers(1, 2099), max_size=30), seed=st.integers(0, 2**16))
def test_cuts_and_restarts_change_nothing(default, cuts, seed):
    model, X, y = default
    X, y = X[900:], y[900:]
    rng, live, got = np.random.default_rng(seed), OnlineCorrector(model, average=5, track="2 h"), []
    edges = [0, *sorted(set(cuts)), len(X)]
    for low, high in itertools.pairwise(edges):
        part, values = X[low:high], y[low:high]
        if rng.random() < 0.5 and high - low < 300:
            got.append(pd.DataFrame(one_by_one(live, part, values), index=part.index))
        else:
            got.append(live.update_many(part, values))
        live = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state(), allow_nan=False)))
    got = pd.concat(got)
    whole = OnlineCorrector(model, average=5, track="2 h").update_many(X, y)
    for column in ("corrected", "bias", "smoothed", "reference"):
        np.testing.assert_allclose(got[column], whole[column], rtol=0, atol=5e-14)


def test_a_state_from_before_the_first_sample_begins_afresh(default):
    """In 1960 too, which is before the zero of dates."""
    model, X, y = default
    early = X.index - pd.Timedelta("30000 days")
    for part, values in ((X[900:910], y[900:910]), (X[:10].set_axis(early[:10]), y[:10].set_axis(early[:10]))):
        again = OnlineCorrector.from_state(model, json.loads(json.dumps(OnlineCorrector(model).state())))
        assert str(one_by_one(again, part, values)) == str(one_by_one(OnlineCorrector(model), part, values))


def test_flags_tell_every_reason(default):
    model, X, _y = default
    end = X.index[899]
    live = OnlineCorrector(model)
    high = X["temperature"].max() + 5
    minute = pd.Timedelta("1 min")
    usual = live.update(end + minute, 23.0, 1.0)
    assert usual.flags == ()
    assert live.update(end + minute, 23.0, 1.0).flags == ("stale time",)
    assert live.update(end, 23.0, 1.0).flags == ("backward time",)
    held = live.update(end + 2 * minute, high, 1.0)  # 23.0 stands in its place
    assert held.flag == "jump" and held.bias == pytest.approx(usual.bias, abs=0.3)
    silent = live.update(end + 3 * minute, high, None)
    assert silent.flags == ("no reading", "doubtful input", "outside fitted range") and math.isnan(silent.corrected)
    assert math.isfinite(silent.bias) and silent.flag == "no reading"
    lost = live.update(end + 4 * minute, math.nan, 1.0)
    assert lost.flags == ("no temperature",) and math.isnan(lost.corrected) and math.isnan(lost.bias)
    assert set(live.update(end + 5 * minute, 23.0, 1.0).flags) <= {"doubtful input"}  # the lags may feel the heat
    after = end + 5 * minute + 2 * pd.Timedelta(seconds=model.washout_)
    assert live.update(after, 23.0, 1.0).flags == ("washout", "gap")  # max_gap starts a new segment
    assert live.update(after + minute, math.inf, 1.0).flags == ("no temperature",)


def test_a_gap_without_max_gap_is_flagged_and_bridged():
    X, y = stream(500, 6, holes=False)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:300], y[:300])
    kept = np.r_[300:350, 420:500]
    X, y = X.iloc[kept], y.iloc[kept]
    single = one_by_one(OnlineCorrector(model), X, y)
    assert [k for k, s in enumerate(single) if s.flags == ("gap",)] == [50]
    agree(model, X, y, [s.corrected for s in single], [s.flag for s in single])
    assert OnlineCorrector(model).update_many(X, y)["flag"].iloc[50] == "gap"


def test_refused_samples_change_nothing(default):
    """Duplicates and samples out of order, one by one and in blocks."""
    model, X, y = default
    X, y = X[900:1300], y[900:1300]
    order = np.arange(400)
    messy = np.insert(order, [50, 51, 200, 399], [49, 10, 199, 0])
    bad = np.zeros(404, bool)
    bad[[50, 52, 202, 402]] = True
    assert (messy[~bad] == order).all()
    clean = OnlineCorrector(model).update_many(X, y)
    for cut in (0, 51, 202, 404):
        live = OnlineCorrector(model)
        got = pd.concat([live.update_many(X.iloc[part], y.iloc[part]) for part in (messy[:cut], messy[cut:])])
        np.testing.assert_allclose(got["corrected"][~bad], clean["corrected"], rtol=0, atol=1e-14)
        assert got["flag"][bad].tolist() == ["stale time", "backward time", "stale time", "backward time"]
        assert got["corrected"][bad].isna().all()
    single = one_by_one(OnlineCorrector(model), X.iloc[messy], y.iloc[messy])
    assert [s.flag for s in single] == got["flag"].tolist()


@pytest.mark.parametrize("max_gap", [None, "10 min"])
@pytest.mark.parametrize("late", [[], [0], [50], [99, 250], [120, 121], [-1]])
def test_gaps_in_a_block_are_told_from_false_dates_as_one_by_one(late, max_gap):
    """Gaps anywhere, two in a row, one before the last row; what is in doubt in the end is the same too."""
    X, y = stream(1300, 8, holes=False)
    model = DynamicBiasRegressor(time_constants=[120.0, 900.0], max_gap=max_gap).fit(X[:800], y[:800])
    rows = np.setdiff1d(np.arange(800, 1300), np.r_[840:860, 861:875, 900:930, 1010:1040, 1270:1299])
    X, y, dates = X.iloc[rows], y.iloc[rows], X.index[rows].to_numpy().copy()
    dates[late] += np.timedelta64(1, "D")  # the first of two such dates is accepted, as the second speaks for it
    X = X.set_axis(pd.DatetimeIndex(dates))
    single = OnlineCorrector(model, uncertainty=True, average=5)
    samples = one_by_one(single, X, y)
    expected, doubt = pd.DataFrame(samples), single.state()["doubt"]
    for cuts in ([], [1], [41, 42, 300]):
        live, edges = OnlineCorrector(model, uncertainty=True, average=5), [0, *cuts, len(X)]
        parts = [live.update_many(X[a:b], y[a:b].to_numpy()) for a, b in itertools.pairwise(edges)]
        got = pd.concat(parts)
        assert got["flag"].tolist() == [sample.flag for sample in samples]
        for column in ("corrected", "bias", "smoothed", "u"):
            np.testing.assert_allclose(got[column], expected[column], rtol=1e-11)
        in_doubt = live.state()["doubt"]
        assert (in_doubt or {}).get("last") == (doubt or {}).get("last")


def test_rows_that_hardly_ever_follow_on_one_another(default):
    model, X, y = default
    X, y = X[900:1200].copy(), y[900:1200]
    X.iloc[::2, 0] = np.nan
    got = OnlineCorrector(model).update_many(X, y)
    agree(model, X, y, got["corrected"], got["flag"])
    assert got["corrected"].notna().sum() == 150


def test_runs_start_anew():
    X, y = stream(900, 7, holes=False)
    X = X.assign(run=np.repeat(["a", "b", "c"], 300))
    model = DynamicBiasRegressor(time_constants=[300.0], run="run").fit(X[:600], y[:600])
    later, readings = X[500:], y[500:]
    single = one_by_one(OnlineCorrector(model), later, readings, run=later["run"])
    agree(model, later, readings, [s.corrected for s in single], [s.flag for s in single])
    assert single[100].flag == "washout"
    live = OnlineCorrector(model)
    got = pd.concat([live.update_many(later[:150], readings[:150]), live.update_many(later[150:], readings[150:])])
    agree(model, later, readings, got["corrected"], got["flag"])


def test_another_instrument_starts_afresh(default):
    model, X, _y = default
    sample = OnlineCorrector(model, continues=False).update(X.index[900], 23.0, 1.0)
    assert sample.flags == ("washout",)
    assert OnlineCorrector(model).update(X.index[900], 23.0, 1.0).flags == ()
    live = OnlineCorrector(model)
    first = live.update(X.index[900], 23.0, 1.0)
    live.update(X.index[910], 25.0, 1.0)
    live.reset()
    assert live.update(X.index[900], 23.0, 1.0) == first


def test_the_moving_average_looks_back_over_corrected_readings(default):
    model, X, y = default
    X, y = X[900:], y[900:]
    single = one_by_one(OnlineCorrector(model, average=25), X, y)
    corrected = pd.Series([s.corrected for s in single])
    known = corrected.dropna()
    expected = known.rolling(25, min_periods=1).mean().reindex(corrected.index)  # eq. (26), NaN passed over
    np.testing.assert_allclose([s.smoothed for s in single], expected, rtol=1e-13)
    many = OnlineCorrector(model, average=25).update_many(X, y)
    np.testing.assert_allclose(many["smoothed"], expected, rtol=1e-13)


def test_the_tracked_reference_follows_a_drift_late():
    """A reading that creeps at rate r is followed r tau behind, once the start is forgotten."""
    t = 10.0 * np.arange(6000)
    X = pd.DataFrame({"temperature": 23 + np.sin(t / 900), "s": t})
    drift = 1e-4
    y = pd.Series(2 * X["temperature"] + drift * t)
    model = DynamicBiasRegressor(time="s", time_constants=[100.0], degree=1, effects=[Drift()]).fit(X, y)
    live = OnlineCorrector(model, track=2000.0)
    references = np.array([live.update(*row).reference for row in zip(t, X["temperature"], y, strict=True)])
    # Exponential weights over samples 10 s apart lag tau (1 - dt/2 tau) behind, up to a term of (dt/tau)^2.
    behind = model.correct(X, y) - references
    np.testing.assert_allclose(behind[-100:], drift * (2000.0 - 5.0), rtol=1e-4)
    np.testing.assert_allclose(
        OnlineCorrector(model, track=2000.0).update_many(X, y)["reference"], references, rtol=1e-14
    )
    assert references[0] == model.intercept_


def test_untrusted_readings_do_not_move_the_tracked_reference(default):
    model, X, _y = default
    live = OnlineCorrector(model, track="1 h")
    minute, end = pd.Timedelta("1 min"), X.index[899]
    before = live.update(end + minute, 23.0, 23.0).reference
    assert live.update(end + 2 * minute, 99.0, 1e6).reference == before
    assert live.update(end + 3 * minute, 23.0, math.nan).reference == before
    assert live.update(end + 4 * minute, math.nan, 1e6).reference == before
    far = end + 4 * minute + 2 * pd.Timedelta(live.model.max_gap)
    assert live.update(far, 23.0, 1e6).reference == before  # washout


@pytest.mark.parametrize("bad", [{"average": 0}, {"average": 2.5}, {"average": True}, {"track": 0}, {"track": "soon"}])
def test_bad_settings_are_named(default, bad):
    with pytest.raises(ValueError, match=f"The '{next(iter(bad))}' parameter must be"):
        OnlineCorrector(default[0], **bad)


def test_bad_calls_say_what_is_wrong(default):
    model, X, y = default
    live = OnlineCorrector(model)
    for bad in (None, 5.0, 2024, date(2024, 1, 1), "soon", pd.NaT, "2024-01-01T00:00:00+01:00", [1]):
        with pytest.raises(RecordError, match="must be a date without a time zone"):
            live.update(bad, 23.0, 1.0)
    with pytest.raises((TypeError, ValueError)):
        live.update(X.index[950], "warm", 1.0)
    with pytest.raises(RecordError, match="no temperature 'temperature'"):
        live.update_many(X[["humidity"]], y)
    with pytest.raises(RecordError, match="is not a number in row 3"):
        live.update_many(X.astype(object).assign(temperature=["1", "2", "3", "x"] * 750), y)
    with pytest.raises(RecordError, match="The reading y is not a number in row 3: 'x'"):
        live.update_many(X, ["1", "2", "3", "x"] * 750)
    with pytest.raises(RecordError, match="times of kind"):
        live.update_many(X.reset_index(drop=True), y)
    with pytest.raises(TypeError, match="must be a DynamicBiasRegressor"):
        OnlineCorrector(model.features_)
    wet = DynamicBiasRegressor(time_constants=[300.0], effects=[LaggedCovariate("humidity")]).fit(X[:200], y[:200])
    with pytest.raises(TypeError, match="needs the column 'humidity'"):
        OnlineCorrector(wet).update(X.index[250], 23.0, 1.0)
    assert len(live.update_many(X[:0], y[:0])) == 0
    single = live.update(X.index[900], 23.0, 1.0)
    assert single == OnlineCorrector(model).update(X.index[900], 23.0, 1.0)  # nothing of the above has left a trace


def test_transformers_live(default):
    _, X, y = default
    X, y = X[:700], y[:700]
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[SplineTransformer(3)]).fit(X[:600], y[:600])
    got = OnlineCorrector(model).update_many(X[600:], y[600:])
    agree(model, X[600:], y[600:], got["corrected"], got["flag"])
    single = one_by_one(OnlineCorrector(model), X[600:], y[600:])
    agree(model, X[600:], y[600:], [s.corrected for s in single], [s.flag for s in single])
    with pytest.raises(RecordError, match=r"X has 100 rows and y has 99"):
        OnlineCorrector(model).update_many(X[600:], y[601:])


@pytest.mark.parametrize("times", ["auto", ["5 min", "90 min"]], ids=["searched", "given"])
def test_live_uncertainties_are_those_of_correct(times):
    """One by one, in blocks, and after a stop: to 12 digits of what `correct` states for the whole."""
    lab = make_record(2600, seed=12)
    X, y = lab[["temperature"]], lab["reading"].copy()
    y.iloc[2100:2105] = np.nan
    model = DynamicBiasRegressor("temperature", times).fit(X[:2000], y[:2000])
    u = model.correct(X, y, return_std=True)[1].to_numpy()
    blocks = OnlineCorrector(model, uncertainty=True, average=30)
    together = pd.concat([blocks.update_many(X[low:high], y[low:high]) for low, high in ((0, 900), (900, 2600))])
    np.testing.assert_allclose(together["u"], u, rtol=1e-12)
    live = OnlineCorrector(model, uncertainty=True, average=30)
    singly = [live.update(*row) for row in zip(X.index[:950], X["temperature"][:950], y[:950], strict=True)]
    np.testing.assert_allclose([one.u for one in singly], u[:950], rtol=1e-12)
    np.testing.assert_allclose([one.u_smoothed for one in singly], together["u_smoothed"][:950], rtol=1e-12)
    assert (together["u_smoothed"][100:] < together["u"][100:]).sum() == np.isfinite(u[100:]).sum()
    again = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
    np.testing.assert_allclose(again.update_many(X[950:], y[950:])["u"], u[950:], rtol=1e-12)
    assert "u" not in OnlineCorrector(model).update_many(X[:20], y[:20])
