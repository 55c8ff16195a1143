"""Effects of the catalogue: however a record is cut, closed forms, continuation, contracts."""

from __future__ import annotations

import inspect
import pickle
import time
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor
from thermocorr.effects import (
    CATALOGUE,
    Covariate,
    Delay,
    Drift,
    Hinge,
    Hysteresis,
    InitialTransient,
    Interaction,
    LaggedCovariate,
    LagProducts,
    LogAgeing,
    Periodic,
    Rate,
    SensitivityDrift,
    StaticPolynomial,
    Step,
    ThermalLag,
)
from thermocorr.effects.stream import own_starts, walk
from thermocorr.records import Block, Layout, read_record

EXAMPLES = [
    StaticPolynomial(3, lowest_power=2),
    ThermalLag([90.0, 4000.0]),
    InitialTransient(["10 min"]),
    LagProducts([90.0, 4000.0], temperature_products=True),
    Rate(),
    Rate("5 min"),
    Delay(7.0),
    Delay("25 min"),
    Covariate("humidity"),
    Covariate("humidity", power=2),
    LaggedCovariate("humidity", ["20 min"], power=2),
    Interaction("humidity"),
    Drift(),
    LogAgeing("2 h"),
    SensitivityDrift(),
    Step(5000.0),
    Hysteresis(0.6),
    Hinge(22.8, "below", ["10 min", "2 h"]),
    Hinge(23, "above"),
    Periodic("3 h", harmonics=3),
]
NAMES = [f"{type(effect).__name__}-{number}" for number, effect in enumerate(EXAMPLES)]


def log(n=400, seed=0, irregular=0.5, holes=()):
    """A record in dates; `holes` are rows after which half a day is missing."""
    rng = np.random.default_rng(seed)
    steps = 60.0 * (1 + irregular * rng.uniform(-0.9, 0.9, n))
    steps[list(holes)] += 43_200.0
    seconds = np.round(np.cumsum(steps) - steps[0], 6)
    temperature = 23 + np.sin(seconds / 3000) + np.cumsum(rng.normal(0, 0.05, n))
    humidity = 45 + np.cumsum(rng.normal(0, 0.3, n))
    index = pd.Timestamp("2024-03-04 01:23:45") + pd.to_timedelta(seconds, unit="s")
    return pd.DataFrame({"temperature": temperature, "humidity": humidity}, index=index)


def read(X, **layout):
    needed = ["humidity"] if "humidity" in X else []
    return read_record(X, Layout(time="time" if "time" in X else None, **layout), needed=needed, quiet=True)


def whole(effect, record):
    """Columns of a learned effect, one block for each segment, as an array of shape (n, width)."""
    return np.vstack([step.columns for step in walk([effect], record, starts=own_starts(record), size=10**9)])


def learned(effect, X, **layout):
    record = read(X, **layout)
    effect = clone(effect)
    effect.learn(record)
    return effect, record


def columns_of(effect, X, **layout):
    return whole(*learned(effect, X, **layout))


def ramp(n=200, step=60.0, slope=0.001):
    """Temperature that rises by `slope` [K/s]; seconds since the start beside it."""
    seconds = step * np.arange(n)
    return timed(20 + slope * seconds, seconds), seconds


def timed(temperature, seconds):
    return pd.DataFrame({"temperature": temperature}, index=pd.to_timedelta(seconds, unit="s"))


# --------------------------------------------------------------------------------------- the catalogue


def test_the_catalogue_is_the_one_that_was_promised():
    assert set(CATALOGUE) == {
        "static_polynomial", "thermal_lag", "initial_transient", "lag_products", "rate", "delay", "covariate",
        "lagged_covariate", "interaction", "drift", "log_ageing", "sensitivity_drift", "step", "hysteresis", "hinge",
        "periodic",
    }  # fmt: skip
    assert {effect.kind for effect in EXAMPLES} == set(CATALOGUE)
    assert all(kind == effect.kind for kind, effect in CATALOGUE.items())


@pytest.mark.parametrize("kind", CATALOGUE)
def test_every_kind_says_what_it_is(kind):
    effect = CATALOGUE[kind]
    info = effect.info
    for sentence in (info.physics, info.bench_check):
        assert sentence[0].isupper() and sentence.endswith(".") and len(sentence) > 30
    assert info.formula
    assert set(info.parameters) <= set(inspect.signature(effect).parameters)
    assert vars(effect)["__doc__"]


@pytest.mark.parametrize("kind", CATALOGUE)
def test_every_kind_knows_what_to_try(kind):
    X = log(3000, seed=1)
    record = read(X)
    candidates = CATALOGUE[kind].candidates(record, ["humidity"])
    assert 1 <= len(candidates) <= 150
    assert all(type(effect) is CATALOGUE[kind] for effect in candidates)
    names = []
    for effect in candidates:
        effect.learn(record)
        names.append(tuple(effect.names()))
        columns = whole(effect, record)
        assert columns.shape == (3000, len(names[-1])) and np.isfinite(columns).all()
        assert columns.std() > 0
    assert len(set(names)) == len(names)
    nothing = CATALOGUE[kind].candidates(record, [])
    assert not any(effect.inputs() for effect in nothing)
    assert [effect.inputs() for effect in CATALOGUE[kind].candidates(record)] == [e.inputs() for e in candidates]


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
def test_a_local_search_finds_neighbours(effect):
    record = read(log(500, seed=1))
    around = effect.nearby(record)
    tunable = {"knee": 2, "time": 2} if isinstance(effect, Hinge | Step) else {}
    params = effect.get_params()
    expected = sum(tunable.get(name, 0) for name in params)
    for name in effect.info.tuned:
        expected += 2 * np.size(params[name]) if params[name] is not None else 0
    assert len(around) == expected
    for other in around:
        changed = [name for name, value in other.get_params().items() if value != params[name]]
        assert len(changed) == 1
        other.learn(record)
        assert np.isfinite(whole(other, record)).all()


def test_neighbours_lie_on_either_side():
    record = read(log(500, seed=1, irregular=0.0))
    assert [e.width for e in Hysteresis(1.0).nearby(record, 0.25)] == [0.8, 1.25]
    lags = [e.time_constants for e in ThermalLag(["1 min", 100]).nearby(record, 1.0)]
    assert lags == [[30.0, 100.0], [120.0, 100.0], [60.0, 50.0], [60.0, 200.0]]
    low, high = [e.time for e in Step("2024-03-04 03:03:45").nearby(record)]  # 6000 s since the start
    assert (low + high) / 2 == pytest.approx(6000.0) and high - low == pytest.approx(0.5 * 499 * 60 / 49)
    low, high = [e.knee for e in Hinge(0.0).nearby(record)]
    assert low == -high < 0


@pytest.mark.parametrize("kind", CATALOGUE)
def test_a_record_of_two_rows_breaks_no_search_range(kind):
    record = read(log(2))
    for effect in CATALOGUE[kind].candidates(record, ["humidity"]):
        effect.learn(record)
        assert len(whole(effect, record)) == 2


def test_squares_are_tried_where_they_are_no_copies():
    X = log(500).assign(current=np.random.default_rng(0).uniform(0, 1, 500), mains=230 + np.arange(500) / 1000)
    record = read_record(X, Layout(), needed=["current", "mains"], quiet=True)
    tried = [(effect.column, effect.power) for effect in Covariate.candidates(record, ["current", "mains"])]
    assert tried == [("current", 1), ("current", 2), ("mains", 1)]


# ------------------------------------------------------------------- one loop: state in, state out


def cut(effect, record, cuts):
    """Columns with every segment cut where `cuts` says; states pass through pickle on their way."""
    parts = []
    for block in record.blocks(10**9, starts=own_starts(record)):
        edges = [block.start, *sorted({c for c in cuts if block.start < c < block.stop}), block.stop]
        state = None
        for start, stop in pairwise(edges):
            begins = start == block.start
            steps = block.steps[start - block.start : stop - block.start]
            piece = Block(
                record, block.segment, start, stop, begins, steps, block.zero, block.segment_zero, block.segment_key
            )
            part, state = effect.columns(piece, state)
            parts.append(np.asarray(part).reshape(stop - start, -1))
            state = pickle.loads(pickle.dumps(state))
    return np.vstack(parts)


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
@settings(max_examples=25, deadline=None)
@given(
    cuts=st.lists(st.integers(1, 399), max_size=60),
    irregular=st.sampled_from([0.0, 0.5]),
    holes=st.lists(st.integers(2, 397), max_size=3),
    seed=st.integers(0, 3),
)
def test_cuts_change_nothing_to_the_last_bit(effect, cuts, irregular, holes, seed):
    X = log(400, seed, irregular, holes)
    effect, record = learned(effect, X, max_gap="1 h")
    assert len(record.segments) == 1 + len(set(holes))
    np.testing.assert_array_equal(cut(effect, record, cuts), whole(effect, record))


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
def test_states_stay_small(effect):
    """100 blocks of 1000 rows: the state holds what the delay reaches back to, and no more."""
    X = log(100_000, irregular=0.2)
    effect, record = learned(effect, X)
    sizes = {len(pickle.dumps(step.states)) for step in walk([effect], record, starts=own_starts(record), size=1000)}
    assert max(sizes) < 4000


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
def test_following_rows_continue_the_fitted_record(effect):
    X = log(600, seed=2, holes=[200])
    y = X["temperature"] + np.random.default_rng(0).normal(0, 0.1, 600)
    for layout in ({}, {"max_gap": "1 h"}):
        model = DynamicBiasRegressor(time_constants=[300.0], **layout).with_effect(effect).fit(X[:450], y[:450])
        features = model.pipeline_[0]
        together = features.transform(X)
        assert np.isfinite(together).all()
        np.testing.assert_array_equal(features.transform(X[450:]), together[450:])
        np.testing.assert_array_equal(features.transform(X[300:400]), together[300:400])
        fitted = DiffusiveFeatures([300.0], 2, effects=[effect], longest_decay_share=0.04, **layout)
        np.testing.assert_array_equal(fitted.fit_transform(X[:450]), together[:450])
        np.testing.assert_array_equal(model.predict(X[450:]), model.predict(X)[450:])


def test_rows_without_times_continue_too():
    T = log(400)[["temperature", "humidity"]].to_numpy()
    effects = [Delay(150.0), Hysteresis(0.5), Drift(), Rate(), LaggedCovariate(1, [600.0]), Periodic(7200.0)]
    features = DiffusiveFeatures([600.0], effects=effects, sampling_period=60.0).fit(T[:300])
    np.testing.assert_array_equal(features.transform(T[300:]), features.transform(T)[300:])


# ------------------------------------------------------------------------------------------ closed forms


def test_rate_of_a_ramp():
    X, seconds = ramp()
    rate = columns_of(Rate(), X)[:, 0]
    assert rate[0] == 0.0
    np.testing.assert_allclose(rate[1:], 0.001, rtol=1e-10)  # differences of numbers near 20: 1e-15 * 20 / 0.06
    smooth = columns_of(Rate(600.0), X)[:, 0]
    np.testing.assert_allclose(smooth, 0.001 * (1 - np.exp(-seconds / 600.0)), atol=1e-15)


def test_smoothed_rate_is_the_lag_by_another_name():
    X = log()
    np.testing.assert_allclose(columns_of(Rate(600.0), X), columns_of(ThermalLag([600.0]), X) / -600.0, rtol=1e-15)


def test_rate_starts_anew_with_each_segment():
    X = log(100, holes=[40, 70])
    rate = columns_of(Rate(), X, max_gap="1 h")[:, 0]
    assert (rate[[0, 40, 70]] == 0).all() and np.count_nonzero(rate) == 97


def test_delay_of_a_ramp_and_against_plain_loops():
    X, seconds = ramp()
    expected = -0.001 * np.minimum(seconds, 500.0)  # before the record began: the first temperature
    np.testing.assert_allclose(columns_of(Delay(500.0), X)[:, 0], expected, atol=1e-13)

    X = log(300, seed=5, holes=[120])
    t = (X.index - X.index[0]).total_seconds().to_numpy()
    T = X["temperature"].to_numpy()
    delayed = []
    for moment in t - 400.0:
        after = int(np.sum(t <= moment))  # samples up to that moment
        if after == 0:
            delayed.append(T[0])
        else:
            share = (moment - t[after - 1]) / (t[after] - t[after - 1])
            delayed.append((1 - share) * T[after - 1] + share * T[after])
    np.testing.assert_allclose(columns_of(Delay(400.0), X)[:, 0], np.array(delayed) - T, atol=1e-12)


def test_hysteresis_against_its_definition():
    X = log(500, seed=7)
    T, w = X["temperature"].to_numpy(), 0.8
    p = [T[0]]
    for value in T[1:]:
        p.append(min(max(p[-1], value - w / 2), value + w / 2))
    np.testing.assert_array_equal(columns_of(Hysteresis(w), X)[:, 0], np.array(p) - T)


def test_hysteresis_forgets_its_start_and_knows_no_rate():
    up_and_down = np.concatenate([np.linspace(20, 24, 81), np.linspace(24, 20, 81)[1:]])
    fast = timed(up_and_down, 1.0 * np.arange(161))
    slow = timed(up_and_down, 3600.0 * np.arange(161) ** 1.5)
    loop = columns_of(Hysteresis(1.0), fast)[:, 0]
    np.testing.assert_array_equal(loop, columns_of(Hysteresis(1.0), slow)[:, 0])
    # Once dragged, half the width behind: below going up, above going down; at 22 K the branches are w apart.
    np.testing.assert_allclose(loop[11:81], -0.5, atol=1e-12)
    np.testing.assert_allclose(loop[101:], 0.5, atol=1e-12)
    assert loop[120] - loop[40] == pytest.approx(1.0)
    assert np.abs(loop).max() <= 0.5 + 1e-12


def test_hysteresis_is_fast():
    effect, record = learned(Hysteresis(0.5), log(100_000))
    times = []
    for _ in range(3):
        start = time.perf_counter()
        whole(effect, record)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.2


def test_effects_of_time_alone():
    X = log(300, seed=3)
    t = (X.index - X.index[0]).total_seconds().to_numpy()
    T = X["temperature"].to_numpy()
    days = (t - t.mean()) / 86_400
    np.testing.assert_allclose(columns_of(Drift(), X)[:, 0], days, atol=1e-14)
    np.testing.assert_allclose(columns_of(SensitivityDrift(), X)[:, 0], days * (T - T.mean()), atol=1e-13)
    logarithm = np.log(1 + t / 7200.0)
    np.testing.assert_allclose(columns_of(LogAgeing("2 h"), X)[:, 0], logarithm - logarithm.mean(), atol=1e-13)


def test_time_runs_on_through_gaps_and_segments():
    X = log(300, holes=[150])
    for effect in (Drift(), LogAgeing("2 h"), SensitivityDrift(), Periodic("7 h")):
        np.testing.assert_array_equal(columns_of(effect, X, max_gap="1 h"), columns_of(effect, X))


def test_log_ageing_before_the_fitted_record_is_at_rest():
    X = log(100)
    features = DiffusiveFeatures((), effects=[LogAgeing("1 h")]).fit(X)
    columns = features.transform(X.set_axis(X.index - pd.Timedelta("900 days")))
    assert np.isfinite(columns).all() and np.ptp(columns[:, -1]) == 0


@pytest.mark.parametrize(
    "moment", [6000, "6000 s", pd.Timedelta("100 min"), "2024-03-04 03:03:45", pd.Timestamp("2024-03-04 03:03:45")]
)
def test_step_at_a_moment(moment):
    X = log(300, irregular=0.0)
    effect, record = learned(Step(moment), X)
    np.testing.assert_array_equal(whole(effect, record)[:, 0], np.arange(300) >= 100)
    assert effect.names() == ["step[2024-03-04 03:03:45]"]
    assert "03:03:45" in effect.label()


def test_step_in_another_zone_and_without_dates():
    X = log(300, irregular=0.0).tz_localize("UTC")
    step = columns_of(Step(pd.Timestamp("2024-03-04 04:03:45+01:00")), X)[:, 0]
    np.testing.assert_array_equal(step, np.arange(300) >= 100)
    plain = X.assign(time=60.0 * np.arange(300) + 5.0)
    effect, record = learned(Step("100 min"), plain)
    assert effect.names() == ["step[6000 s]"]
    np.testing.assert_array_equal(whole(effect, record)[:, 0], np.arange(300) >= 100)


def test_hinge_and_its_lag():
    # 20 degC, then 26 degC from one step after t = 0 on: the hinge steps from 0 to 3 K above 23 degC.
    seconds = 60.0 * np.arange(100)
    X = timed(np.where(seconds > 0, 26.0, 20.0), seconds)
    above, lag = columns_of(Hinge(23.0, time_constants=[600.0], hold="zero_order"), X).T
    np.testing.assert_array_equal(above, np.where(seconds > 0, 3.0, 0.0))
    expected = np.where(seconds > 0, -3.0 * np.exp(-(seconds - 60.0) / 600.0), 0.0)
    np.testing.assert_allclose(lag, expected, atol=1e-14)
    T = log()["temperature"].to_numpy()
    sides = [columns_of(Hinge(22.5, side), log())[:, 0] for side in ("above", "below")]
    np.testing.assert_allclose(sum(sides), T - 22.5, atol=1e-14)
    assert (sides[0] >= 0).all() and (sides[1] <= 0).all()


@pytest.mark.parametrize(
    ("knee", "side", "name"), [(0, "above", "max(T-0)"), (-2.5, "below", "min(T+2.5)"), (4, "above", "max(T-4)")]
)
def test_names_of_hinges(knee, side, name):
    assert learned(Hinge(knee, side, ["1 h"]), log())[0].names() == [name, f"{name} lag[3600 s]"]


def test_periodic_counts_from_absolute_time():
    X = log(300)
    clock = X.index.hour * 3600 + X.index.minute * 60 + X.index.second + X.index.microsecond / 1e6
    angle = 2 * np.pi * clock.to_numpy() / 86_400
    expected = np.column_stack([np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)])
    # Seconds since 1970 as a float are good to 2.4e-7 s, or 2e-11 of a turn.
    np.testing.assert_allclose(columns_of(Periodic(), X), expected, atol=1e-10)
    np.testing.assert_allclose(columns_of(Periodic(), X[100:]), expected[100:], atol=1e-10)


def test_products_and_powers():
    X = log(300, seed=4)
    T, h = X["temperature"].to_numpy(), X["humidity"].to_numpy()
    a, b = columns_of(ThermalLag([90.0, 4000.0]), X).T
    T0 = T - T.mean()
    products = columns_of(LagProducts([90.0, 4000.0], temperature_products=True), X)
    np.testing.assert_allclose(products, np.column_stack([a * a, a * b, b * b, T0 * a, T0 * b]), atol=1e-13)
    np.testing.assert_array_equal(columns_of(LagProducts([90.0, 4000.0]), X), products[:, :3])
    np.testing.assert_allclose(columns_of(Interaction("humidity"), X)[:, 0], T0 * (h - h.mean()), atol=1e-12)
    np.testing.assert_allclose(columns_of(Covariate("humidity", 2), X)[:, 0], h**2 - (h**2).mean(), atol=1e-9)
    powers = columns_of(StaticPolynomial(4), X)
    np.testing.assert_array_equal(columns_of(StaticPolynomial(4, lowest_power=3), X), powers[:, 2:])
    np.testing.assert_allclose(powers, T0[:, None] ** np.arange(1, 5), rtol=1e-12)


def test_lagged_square_is_the_lag_of_the_square():
    X = log(300)
    square = X.assign(humidity=X["humidity"] ** 2)
    np.testing.assert_array_equal(
        columns_of(LaggedCovariate("humidity", [600.0], power=2), X),
        columns_of(LaggedCovariate("humidity", [600.0]), square),
    )


# --------------------------------------------------------------------------------------------- contracts


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
def test_clone_pickle_names_units(effect):
    twin = clone(effect)
    assert twin.get_params() == effect.get_params() and not any(name.endswith("_") for name in vars(twin))
    assert isinstance(twin.label(), str) and twin.label()  # known before learning: a suspect is shown by it
    twin, record = learned(effect, log(200))
    again = pickle.loads(pickle.dumps(twin))
    np.testing.assert_array_equal(whole(again, record), whole(twin, record))
    names = twin.names()
    assert len(set(names)) == len(names) == len(twin.units()) == whole(twin, record).shape[1]
    assert twin.memory() >= 0


def test_all_kinds_in_one_model():
    X = log(3000, seed=6)
    y = X["temperature"] + np.random.default_rng(1).normal(0, 0.1, 3000)
    one_of_each = list({type(effect): effect for effect in reversed(EXAMPLES[1:])}.values())
    model = DynamicBiasRegressor(time_constants=[300.0], effects=one_of_each).fit(X, y)
    table = model.coef_table()
    assert table.index.is_unique
    parts = model.contributions(X)
    assert parts.columns.is_unique
    np.testing.assert_allclose(parts.sum(axis=1) + model.intercept_, model.predict(X), rtol=1e-12)
    assert "hysteresis[w] = p - T" in model.equation()
    assert table.unit["drift*temperature"] == "1/(K d)" and table.unit["rate"] == "1/K/s"


@pytest.mark.parametrize(
    "effect", [Drift, LogAgeing, lambda **p: Step(60_000.0, **p), lambda **p: Periodic("7 h", **p)]
)
def test_what_correct_removes_is_a_choice(effect):
    X = log(2000, seed=8)
    y = X["temperature"] + 0.5 * columns_of(effect(), X).sum(axis=1)
    for removed in (True, False):
        model = DynamicBiasRegressor(time_constants=(), effects=[effect(removed_by_correct=removed)]).fit(X, y)
        left = model.correct(X, y) - model.intercept_
        own = model.contributions(X).iloc[:, -1]
        np.testing.assert_allclose(left, 0.0 if removed else own, atol=1e-9)
        assert own.std() > 0.01
    assert [e().removed_by_correct for e in (Drift, LogAgeing, SensitivityDrift, Periodic)] == [
        False,
        False,
        True,
        True,
    ]


BAD = [
    (Hysteresis(-1), r"The 'width' parameter of Hysteresis must be a float in the range \(0.0, inf\). Got -1 instead."),
    (Hysteresis(float("nan")), "'width' parameter of Hysteresis .* Got nan instead"),
    (Delay(0), "The 'delay' parameter must be a positive time: .* Got 0 instead"),
    (Delay("soon"), "Got 'soon' instead"),
    (Rate(-5.0), "The 'time_constant' parameter must be a positive time"),
    (LogAgeing(0.0), "The 'onset' parameter must be a positive time"),
    (Drift(removed_by_correct="no"), "The 'removed_by_correct' parameter of Drift must be .* Got 'no' instead"),
    (Step("breakfast"), "The 'time' parameter of Step must be seconds .* Got 'breakfast' instead"),
    (Step(None), "The 'time' parameter of Step must be .* Got None instead"),
    (Step(float("inf")), "The 'time' parameter of Step .* Got inf instead"),
    (Step("2024-03-04 02:00+01:00"), "The 'time' parameter of Step must be a date without a time zone"),
    (Periodic(0), "The 'period' parameter must be a positive time"),
    (Periodic(harmonics=0), r"The 'harmonics' parameter of Periodic must be an int in the range \[1, inf\). Got 0"),
    (Hinge("warm"), "The 'knee' parameter of Hinge must be a float .* Got 'warm' instead"),
    (Hinge(0.0, "left"), "The 'side' parameter of Hinge must be a str among .* Got 'left' instead"),
    (Hinge(0.0, time_constants=[0]), "The 'time_constants' parameter must be a positive time"),
    (Covariate("humidity", 0), r"The 'power' parameter of Covariate must be an int in the range \[1, 9\]"),
    (LaggedCovariate("humidity", hold="third"), "The 'hold' parameter of LaggedCovariate must be a str among"),
    (LagProducts([60.0], temperature_products=2.5), "The 'temperature_products' parameter of LagProducts must be"),
    (StaticPolynomial(12), "The 'degree' parameter of StaticPolynomial must be"),
    (ThermalLag([60.0], form="french"), "The 'form' parameter of ThermalLag must be"),
    (InitialTransient([60.0], -1), "The 'longest_share' parameter of InitialTransient must be"),
]


@pytest.mark.parametrize(("effect", "words"), BAD, ids=[f"{type(e).__name__}-{i}" for i, (e, _) in enumerate(BAD)])
def test_bad_parameters_are_named_in_one_sentence(effect, words):
    with pytest.raises(ValueError, match=words):
        learned(effect, log(50))
    with pytest.raises(ValueError, match=words):
        DiffusiveFeatures((), effects=[effect]).fit(log(50))


def test_a_date_needs_dates():
    X = log(50).assign(time=60.0 * np.arange(50))
    with pytest.raises(ValueError, match=r"a date where the record has dates \(this one has seconds\)"):
        learned(Step("2024-03-04"), X)
