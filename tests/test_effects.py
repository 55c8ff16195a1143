"""Columns of effects: however a record is cut, continuation, closed forms.

Also: Columns of effects one by one are those of all together, whether steps are even or not. Steppers: every kind of
the catalogue, sample by sample in plain floats, against its columns.
"""

import errno
import pickle
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from effect_records import EXAMPLES, LIVE, LIVE_NAMES, NAMES, columns_of, learned, log, ramp, timed, whole
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import (
    CATALOGUE,
    Covariate,
    Delay,
    Drift,
    Effect,
    Hinge,
    Hysteresis,
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
from thermocorr.effects.expressions import Decays, Word
from thermocorr.effects.signals import DelayState
from thermocorr.effects.stream import STEPPED, Sample, own_starts, stepper_of, walk
from thermocorr.equations import compiled, lag_differences
from thermocorr.records import Block


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
                record=record,
                segment=block.segment,
                start=start,
                stop=stop,
                begins=begins,
                steps=steps,
                zero=block.zero,
                segment_zero=block.segment_zero,
                segment_key=block.segment_key,
            )
            part, state = effect.columns(piece, state)
            parts.append(np.asarray(part).reshape(stop - start, -1))
            state = pickle.loads(pickle.dumps(state))
    return np.vstack(parts)


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
@examples(25)
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


@pytest.mark.parametrize("effect", LIVE, ids=LIVE_NAMES)
def test_following_rows_continue_the_fitted_record(effect):
    """To the last bit."""
    X = log(600, seed=2, holes=[200])
    y = X["temperature"] + np.random.default_rng(0).normal(0, 0.1, 600)
    for layout in ({}, {"max_gap": "1 h"}):
        model = DynamicBiasRegressor(time_constants=[300.0], **layout).with_effect(effect).fit(X[:450], y[:450])
        features = model.pipeline_[0]
        together = features.transform(X)
        assert np.isfinite(together).all()
        np.testing.assert_array_equal(features.transform(X[450:]), together[450:])
        np.testing.assert_array_equal(features.transform(X[300:400]), together[300:400])
        fitted = DiffusiveFeatures([300.0], 2, effects=[effect], **layout)
        np.testing.assert_array_equal(fitted.fit_transform(X[:450]), together[:450])
        np.testing.assert_array_equal(model.predict(X[450:]), model.predict(X)[450:])


def test_rows_without_times_continue_too():
    T = log(400)[["temperature", "humidity"]].to_numpy()
    effects = [Delay(150.0), Hysteresis(0.5), Drift(), Rate(), LaggedCovariate(1, [600.0]), Periodic(7200.0)]
    features = DiffusiveFeatures([600.0], effects=effects, sampling_period=60.0).fit(T[:300])
    np.testing.assert_array_equal(features.transform(T[300:]), features.transform(T)[300:])


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
    np.testing.assert_allclose(above, np.where(seconds > 0, 3.0, 0.0) - 2.94, atol=1e-12)  # mean: 25.94 degC
    expected = np.where(seconds > 0, -3.0 * np.exp(-(seconds - 60.0) / 600.0), 0.0)
    np.testing.assert_allclose(lag, expected, atol=1e-14)
    T = log()["temperature"].to_numpy()
    sides = [columns_of(Hinge(22.5, side), log())[:, 0] for side in ("above", "below")]
    np.testing.assert_allclose(sum(sides), T - T.mean(), atol=1e-12)
    for column, clip in zip(sides, (np.maximum, np.minimum), strict=True):
        np.testing.assert_allclose(column, clip(T - 22.5, 0.0) - clip(T.mean() - 22.5, 0.0), atol=1e-12)


@pytest.mark.parametrize("T0", ["mean", 23.0, 21.0])
@pytest.mark.parametrize(("side", "knee"), [("above", 22.0), ("below", 24.0)])
def test_U0_beside_a_hinge_is_the_reading_at_T0(side, knee, T0):
    """A device that reads 100 at 23 degC without the knee, and more or less by it."""
    record = make_record(6000, seed=2)
    T = 23.0 + (record["temperature"] - record["temperature"].mean()) * 1.5 / record["temperature"].std()
    clip = np.maximum if side == "above" else np.minimum

    def law(at):
        return 100.0 + 0.5 * (at - 23.0) + 2.0 * clip(at - knee, 0.0)

    y = law(T) + 0.01 * np.random.default_rng(1).normal(size=len(T))
    model = DynamicBiasRegressor(time_constants=["20 min"], effects=[Hinge(knee, side)], reference_temperature=T0)
    model.fit(T.to_frame(), y)
    at = model.reference_temperature_
    assert model.intercept_ == pytest.approx(law(at), abs=0.01)
    assert model.correct(T.to_frame(), y).mean() == pytest.approx(law(at), abs=0.01)
    column = "(max(T-22) - " if side == "above" else "(min(T-24) + "
    assert (column in model.equation()) == (T0 != 21.0 or side == "below")


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
    third = [a**3, a * a * b, a * b * b, b**3, T0 * a * a, T0 * a * b, T0 * b * b, T0**2 * a, T0**2 * b]
    cubic = LagProducts([90.0, 4000.0], temperature_products=True, order=3)
    np.testing.assert_allclose(columns_of(cubic, X), np.column_stack((products, *third)), atol=1e-12)
    cubic, _ = learned(cubic, X)
    assert cubic.units() == ["K^2"] * 5 + ["K^3"] * 9 and cubic.names()[5] == "lag[90 s]*lag[90 s]*lag[90 s]"
    np.testing.assert_allclose(columns_of(LagProducts([90.0], order=3), X)[:, 1], a * a * a, rtol=1e-14)
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


@pytest.mark.parametrize("moment", ["1,5 h", "00:10:00,5", "12:30", "1,000 s"])
def test_a_moment_without_a_day_is_no_date_of_today(moment):
    with pytest.raises(ValueError, match="'time' parameter of Step"):
        learned(Step(moment), log())


def test_dates_with_dots_are_no_spans():
    X = log(300)
    for text in ("04.03.2024 03:23:45", "4.3.2024 03:23:45", "2024-03-04 03:23:45", "2 h", "7200", "02:00:00"):
        assert learned(Step(text), X)[0].seconds_ == 7200.0


@pytest.mark.parametrize("holes", [(), (150,)], ids=["one segment", "two"])
@pytest.mark.parametrize("size", [37, 10**9])
@pytest.mark.parametrize("example", EXAMPLES, ids=NAMES)
def test_each_column_is_that_of_columns_whether_steps_are_even_or_not(example, size, holes):
    """Where a hole makes two segments, no step is known to be that of all rows: the same rows by the longer way."""
    effect, record = learned(example, log(irregular=0.0, holes=holes))
    assert (record.times.even_step is None) == bool(holes)
    parts, state = [], None
    for block in record.blocks(size, starts=own_starts(record)):
        state = None if block.begins else state
        each, state = effect.each_column(block, state)
        parts.append(np.column_stack([np.broadcast_to(column, len(block)) for column in each]))
    np.testing.assert_allclose(np.vstack(parts), whole(effect, record), rtol=1e-11, atol=1e-11)


def test_a_delay_reaches_back_into_rows_of_other_steps():
    """A stream went on with other steps: what came before is looked up by its time."""
    effect, record = learned(Delay(300.0), log(200, irregular=0.0))
    (block,) = record.blocks(10**9)
    elapsed = np.array([-400.0, -290.0, -170.0, -31.0])
    before = (elapsed, np.array([20.0, 21.0, 19.0, 22.0]))
    found = effect.columns(block, DelayState(*before))[0][:, 0]
    known = np.concatenate((elapsed, block.elapsed)), np.concatenate((before[1], block.temperature))
    expected = np.interp(block.elapsed - 300.0, *known) - block.temperature
    np.testing.assert_allclose(found, expected, atol=1e-12)


class Squared(Effect):
    """An effect with columns of its own, which asks for all that a block offers."""

    kind = "squared"

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["square", "clock", "late"]

    def columns(self, block, state):
        lag, state = lag_differences(block["humidity"], block.steps, np.array([500.0]), state)
        clock = block.seconds - 2 * block.elapsed
        return np.column_stack((block["humidity"] ** 2, clock, lag)), state


class Everything(Effect):
    """A user's own effect in the words of `Signals`: all of them, and words upon words."""

    kind = "everything"

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["late play", "rate", "late lag", "damped", "clock", "case", "size"]

    def signals(self, x):
        h = x["humidity"]
        late = x.delayed(h, 130.0) - h
        slow = x.lag(x.play(x.T, 0.3), [100.0, 900.0], "zero_order")
        rate = x.change_rate(h * x.T)
        damped = x.exp(-abs(h - 45.0) / 3) + x.sin(x.T / 7) * x.cos(h) / (1 + h**2)
        clock = x.minimum(x.seconds, x.elapsed + 600.0) / 3600 + x.log1p(x.elapsed)
        case = x.where(x.previous(x.T) != x.T, x.maximum(h, 45), 2 - x.T)
        return [slow[1] - slow[0], rate, x.lag(late, [50.0])[0], damped, clock, case, 3 * x.step]


ALL = [*LIVE, ThermalLag([90.0, 4000.0], "zero_order"), Squared(), Everything()]
IDS = [*LIVE_NAMES, "held", "own", "everything"]


def test_every_word_has_a_stepper():
    assert set(STEPPED) == set(Word.__subclasses__()) - {Decays}  # the clock is all that decays remember


def test_every_kind_says_its_signals():
    assert all(effect.columns is Effect.columns or effect.foresees for effect in CATALOGUE.values())


def stepped(effect, record, cuts=()):
    """Columns by the stepper; where `cuts` says, a block of rows goes through `columns` and hands on its state."""
    times = record.times
    stepper = stepper_of(effect, times, record.first_stamp(), "temperature")
    rows = []
    for block in record.blocks(10**9, starts=own_starts(record)):
        stepper.start(None)
        assert stepper.state() is None
        for k in range(len(block)):
            sample = Sample()
            sample.begins, sample.step, sample.temperature = k == 0, float(block.steps[k]), float(block.temperature[k])
            sample.values = {name: float(column[block.start + k]) for name, column in record.columns.items()}
            sample.seconds, sample.elapsed = float(block.seconds[k]), float(block.elapsed[k])
            sample.stamp, sample.segment_zero, sample.key = (
                record.stamp(block.start + k),
                block.segment_zero,
                block.segment,
            )
            rows.append(list(stepper.step(sample)))
            if block.start + k in cuts:  # another stepper takes over
                state, stepper = stepper.state(), stepper_of(effect, times, record.first_stamp(), "temperature")
                stepper.start(state)
    return np.array(rows)


@pytest.mark.parametrize("effect", ALL, ids=IDS)
@pytest.mark.parametrize("irregular", [0.0, 0.5])
def test_steppers_agree_with_columns(effect, irregular):
    effect, record = learned(effect, log(300, seed=1, irregular=irregular, holes=[120]), max_gap="1 h")
    expected = whole(effect, record)
    # Both sides round each product once; NumPy's and C's exponentials differ in the last digit. The recursion forgets.
    scale = np.abs(expected).max(axis=0) + 1e-300
    for cuts in ((), (50, 51, 119, 200)):
        np.testing.assert_array_less(np.abs(stepped(effect, record, cuts) - expected) / scale, 2e-14)


@pytest.mark.parametrize("effect", ALL, ids=IDS)
def test_states_of_steppers_and_of_columns_are_interchangeable(effect):
    effect, record = learned(effect, log(200, seed=2, irregular=0.3))
    (block,) = record.blocks(10**9, starts=own_starts(record))
    _, state = effect.columns(block, None)
    stepper = stepper_of(effect, record.times, record.first_stamp(), "temperature")
    stepper.start(state)
    again = stepper.state()
    assert type(again) is type(state)
    for one, other in zip(flat(state), flat(again), strict=True):
        np.testing.assert_array_equal(one, other)


def flat(state):
    """Numbers and arrays of a state."""
    if isinstance(state, tuple):
        return [part for inner in state for part in flat(inner)]
    return [] if state is None else [np.asarray(state, float)]


@pytest.mark.parametrize("fault", ["no folder", "full disk"])
def test_compiled_code_that_cannot_be_kept_is_compiled_all_the_same(fault, tmp_path, monkeypatch):
    """A read-only installation without a home, or a full disk: a speed of the next process is no error of this one."""
    pytest.importorskip("numba", reason="compiled code needs numba: pip install '.[fast]'")
    from numba.core import caching, config

    refused = []

    def full(*_):
        refused.append(1)
        raise OSError(errno.ENOSPC, "No space left on device")

    if fault == "no folder":
        monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    else:
        monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
        monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    compiled.compiled.cache_clear()
    try:
        followed = compiled.play(np.array([1.0, 0.0, 0.0]), np.array([2.0, 3.0, 0.5]), 0.0)
        assert compiled.compiled(compiled._play) is not None
    finally:
        compiled.compiled.cache_clear()
    assert followed.tolist() == [1.0, 1.0, 0.5] and bool(refused) == (fault == "full disk")


def test_compiled_play_is_the_loop_to_the_last_bit(monkeypatch):
    pytest.importorskip("numba", reason="numba is not installed: there is no compiled play")
    record = make_record(5000, seed=9)
    results = []
    for fast in (True, False):
        if not fast:
            lags = compiled.compiled(compiled._follow)
            monkeypatch.setattr(compiled, "compiled", {compiled._play: None, compiled._follow: lags}.get)
        model = DynamicBiasRegressor("temperature", ["10 min"], effects=[Hysteresis(0.4)])
        model.fit(record[["temperature"]], record["reading"])
        results.append(model.features_.transform(record[["temperature"]]))
    np.testing.assert_array_equal(*results)
