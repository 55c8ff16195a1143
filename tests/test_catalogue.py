"""The catalogue of effects: what each kind says, tries, promises and refuses."""

import inspect
import pickle
from collections import Counter

import numpy as np
import pandas as pd
import pytest
from effect_records import EXAMPLES, NAMES, columns_of, learned, log, read, whole
from scipy.signal import lfilter
from sklearn.base import clone

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor
from thermocorr.effects import (
    CATALOGUE,
    Covariate,
    Delay,
    Disturbance,
    Drift,
    Effect,
    Hinge,
    Hysteresis,
    InitialTransient,
    LaggedCovariate,
    LaggedModulation,
    LagProducts,
    Lead,
    LogAgeing,
    Periodic,
    Rate,
    SaturatingCovariate,
    SensitivityDrift,
    SensitivityStep,
    StaticPolynomial,
    Step,
)
from thermocorr.records import Layout, read_record


def test_the_catalogue_is_the_one_that_was_promised():
    assert set(CATALOGUE) >= {
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
    assert "learned" in vars(effect), "what `learn` fixes, by which model files are checked; {} for nothing"
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
    record = read(log(700, seed=1))
    params, moved = effect.get_params(), Counter()
    for other in effect.nearby(record):
        changed = [name for name, value in other.get_params().items() if value != params[name]]
        assert len(changed) == 1
        moved.update(changed)
        other.learn(record)
        assert np.isfinite(whole(other, record)).all()
    tuned = {name: 2 * np.size(params[name]) for name in effect.info.tuned if params[name] is not None}
    assert all(moved[name] == count for name, count in tuned.items())
    own = set(moved) - set(tuned)  # by a `nearby` of its own
    assert bool(own) == (type(effect).nearby is not Effect.nearby) and {moved[name] for name in own} <= {2}


@pytest.mark.parametrize("kind", CATALOGUE)
def test_a_record_of_two_rows_breaks_no_search_range(kind):
    record = read(log(2))
    for effect in CATALOGUE[kind].candidates(record, ["humidity"]):
        effect.learn(record)
        assert len(whole(effect, record)) == 2


def test_squares_are_tried_where_they_are_no_copies():
    rng = np.random.default_rng(0)
    X = log(500).assign(
        current=rng.uniform(0, 1, 500), mains=230 + np.arange(500) / 1000, heater=rng.integers(0, 2, 500) * 1.7
    )
    record = read_record(X, Layout(), needed=["current", "mains", "heater"], quiet=True)
    tried = [(effect.column, effect.power) for effect in Covariate.candidates(record, ["current", "mains", "heater"])]
    assert tried == [("current", 1), ("current", 2), ("mains", 1), ("heater", 1)]  # on or off, it is its own square
    assert {effect.power for effect in LaggedCovariate.candidates(record, ["heater"])} == {1}
    assert not SaturatingCovariate.candidates(record, ["heater"])


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


@pytest.mark.parametrize("given", [(), [], Rate(), [Rate()], [("fast", Rate())]])
def test_with_effect_adds_to_whatever_was_given(given):
    X = log(300)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=given)
    names = model.with_effect(Hysteresis(0.5)).fit(X, X["temperature"]).coef_table().index
    assert list(names[-2:]) == (["rate", "hysteresis[0.5]"] if given else ["decay[300 s]", "hysteresis[0.5]"])
    assert model.effects is given


def test_all_kinds_in_one_model():
    X = log(3000, seed=6)
    y = X["temperature"] + np.random.default_rng(1).normal(0, 0.1, 3000)
    beside_the_static_law = [effect for effect in reversed(EXAMPLES) if type(effect) is not StaticPolynomial]
    one_of_each = list({type(effect): effect for effect in beside_the_static_law}.values())
    model = DynamicBiasRegressor(time_constants=[300.0], effects=one_of_each).fit(X, y)
    table = model.coef_table()
    assert table.index.is_unique
    parts = model.contributions(X)
    assert parts.columns.is_unique
    np.testing.assert_allclose(parts.sum(axis=1) + model.intercept_, model.predict(X), rtol=1e-12)
    assert "hysteresis[w] = p - T" in model.equation()
    assert table.unit["drift*temperature"] == "1/(K d)" and table.unit["rate"] == "1/(K/s)"


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
    (SensitivityStep("breakfast"), "The 'time' parameter of SensitivityStep must be seconds .* Got 'breakfast'"),
    (Disturbance(0.0, "breakfast"), "The .end. parameter of Disturbance must be seconds .* Got .breakfast. instead"),
    (Disturbance(60.0, 60.0), "The 'end' parameter of Disturbance must lie after its start, 60.0. Got 60.0 instead"),
    (LaggedModulation(), "LaggedModulation needs a column as 'fast' or 'slow'"),
    (LaggedModulation(slow="humidity", time_constant=0), "must be a positive time"),
    (Periodic(0), "The 'period' parameter must be a positive time"),
    (Periodic(harmonics=0), r"The 'harmonics' parameter of Periodic must be an int in the range \[1, 10000\]. Got 0"),
    (Hinge("warm"), "The 'knee' parameter of Hinge must be a float .* Got 'warm' instead"),
    (Hinge(0.0, "left"), "The 'side' parameter of Hinge must be a str among .* Got 'left' instead"),
    (Hinge(0.0, time_constants=[0]), "The 'time_constants' parameter must be a positive time"),
    (Covariate("humidity", 0), r"The 'power' parameter of Covariate must be an int in the range \[1, 9\]"),
    (LaggedCovariate("humidity", hold="third"), "The 'hold' parameter of LaggedCovariate must be a str among"),
    (LagProducts([60.0], temperature_products=2.5), "The 'temperature_products' parameter of LagProducts must be"),
    (StaticPolynomial(12), "The 'degree' parameter of StaticPolynomial must be"),
    (InitialTransient([60.0], -1), "The 'longest_share' parameter of InitialTransient must be"),
]


@pytest.mark.parametrize(("effect", "words"), BAD, ids=[f"{type(e).__name__}-{i}" for i, (e, _) in enumerate(BAD)])
def test_bad_parameters_are_named_in_one_sentence(effect, words):
    with pytest.raises(ValueError, match=words):
        learned(effect, log(50))
    with pytest.raises(ValueError, match=words):
        DiffusiveFeatures((), effects=[effect]).fit(log(50))


def test_another_law_and_a_disturbance_are_what_their_formulas_say():
    X = log(500, seed=4)
    seconds = (X.index - X.index[0]).total_seconds().to_numpy()
    T = X["temperature"].to_numpy()
    later = (seconds >= 7200.0).astype(float)
    np.testing.assert_allclose(columns_of(SensitivityStep("2 h"), X), np.column_stack((later, later * (T - T.mean()))))
    date = X.index[0] + pd.Timedelta("2 h")
    np.testing.assert_array_equal(columns_of(SensitivityStep(date), X), columns_of(SensitivityStep(7200), X))
    inside = ((seconds >= 5000) & (seconds < 7200)).astype(float)
    np.testing.assert_array_equal(columns_of(Disturbance(5000.0, date), X)[:, 0], inside)
    assert learned(Disturbance(60.0, 120.0), X)[0].label() == "disturbance: 2024-03-04 01:24:45 to 2024-03-04 01:25:45"
    assert Disturbance(60.0, "2 h").label() == "disturbance: 60 s to 2 h"


def test_a_modulation_is_a_product_with_what_was():
    """The lagged column by scipy's own integration of tau d(lagged)/dt = slow - lagged, on an even grid."""
    X = log(400, seed=5, irregular=0.0)
    humidity, T = X["humidity"].to_numpy(), X["temperature"].to_numpy()
    fine = np.interp(np.arange(0, 399, 0.01), np.arange(400), humidity)
    kept = np.exp(-0.01 * 60 / 900)
    lagged = lfilter([1 - kept], [1, -kept], fine, zi=[kept * fine[0]])[0][::100]
    found = columns_of(LaggedModulation(slow="humidity", time_constant=900), X)[:-1, 0]
    expected = (T - T.mean())[:399] * (lagged - humidity.mean())
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())


def test_a_date_needs_dates():
    X = log(50).assign(time=60.0 * np.arange(50))
    with pytest.raises(ValueError, match=r"a date where the record has dates \(this one has seconds\)"):
        learned(Step("2024-03-04"), X)


def test_a_title_says_spans_as_a_person_does_and_a_label_stays_a_name():
    said = {
        Delay("25 min"): ("delay: 1500 s", "delay: 25 min"),
        Lead("25 min"): ("lead: 1500 s", "lead: 25 min"),
        Periodic("1 D"): ("periodic: 86400 s", "periodic: 1 d"),
        Hinge(22.8, "below", ["10 min", "2 h"]): (
            "hinge: below 22.8, lag 600 s, 7200 s", "hinge: below 22.8, lag 10 min, 2 h"
        ),
        LaggedModulation(None, "humidity", "6 h"): (
            "lagged modulation: temperature by humidity, 21600 s late",
            "lagged modulation: temperature by humidity, 6 h late",
        ),
        Covariate("humidity"): ("covariate: humidity", "covariate: humidity"),
    }  # fmt: skip
    for effect, names in said.items():
        assert (effect.label(), effect.title()) == names
