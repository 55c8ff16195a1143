"""Planted effects: the promised strength, a truth that adds up, formulas that agree with the effects."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.datasets._planted import PLANTS
from thermocorr.effects import (
    CATALOGUE,
    Effect,
    Hinge,
    Hysteresis,
    LaggedCovariate,
    Rate,
    SaturatingCovariate,
    SeveralSteps,
    Step,
)
from thermocorr.effects.stream import own_starts, walk
from thermocorr.records import Layout, read_record

UNKNOWN = ["random_telegraph", "random_walk"]
SETTINGS = {"lab": 60.0, "outdoor": 600.0, "chamber": 30.0}
PARAMETERS = ["time_constants", "delay", "width", "time", "knee", "onset", "period"]
"""The one that shapes a contribution, kind by kind."""

PLANTED = [kind for kind in CATALOGUE if kind in PLANTS]


def left_by_quadratic(T, values):
    """Rms of what a polynomial of second degree leaves, by numpy's own orthogonal fit."""
    fit = np.polynomial.Legendre.fit(T, values, 2)
    return np.sqrt(np.mean((values - fit(T)) ** 2))


def test_most_kinds_of_the_catalogue_have_a_formula_of_their_own_here():
    assert set(PLANTED) == set(PLANTS) - set(UNKNOWN) and len(PLANTED) >= 16


class Fan(Effect):
    """A user's effect: a fan that cools more the warmer it is, and tires."""

    kind = "fan"

    def __init__(self, column="mains", tires=3600.0):
        self.column = column
        self.tires = tires

    def inputs(self):
        return [self.column]

    def names(self):
        return ["fan", "fan, warm"]

    def columns(self, block, state):
        own = block[self.column] * np.exp(-block.elapsed / self.tires / 100)
        return np.column_stack((own, own * (block.temperature - 22.0))), None


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize(
    "effect",
    [SaturatingCovariate("humidity", 5.0), SeveralSteps([7200.0, 90_000.0]), Fan()],
    ids=lambda effect: effect.kind,
)
def test_effects_without_a_formula_are_planted_by_their_columns(effect, runs):
    record, truth = make_record(3000, effects=[(effect, 2.0)], runs=runs, gaps=1, seed=3, return_truth=True)
    left = left_by_quadratic(record["temperature"].to_numpy(), truth[effect.kind].to_numpy())
    assert left == pytest.approx(2.0 * record.attrs["noise"], rel=1e-6)
    assert truth.attrs["effects"][effect.kind]["parameters"] == effect.get_params(deep=False)
    again = make_record(3000, effects=[(effect, 2.0)], runs=runs, gaps=1, seed=3)
    pd.testing.assert_frame_equal(again, record)
    assert left_over(effect, record.drop(columns="reading"), truth[effect.kind].to_numpy()) < 1e-9


def test_a_kind_without_a_formula_is_asked_for_as_an_effect():
    with pytest.raises(ValueError, match=r"the effect itself.* Got 'saturating_covariate' instead"):
        make_record(500, effects={"saturating_covariate": 1.0})


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("kind", PLANTS)
def test_strength_is_what_a_static_quadratic_leaves(kind, setting):
    record, truth = make_record(
        3000, setting=setting, sampling_period=SETTINGS[setting], effects={kind: 0.5}, seed=11, return_truth=True
    )
    left = left_by_quadratic(record["temperature"].to_numpy(), truth[kind].to_numpy())
    # Promised to 1 %; the projection is exact but for rounding.
    assert left == pytest.approx(0.5 * record.attrs["noise"], rel=1e-6)
    about = truth.attrs["effects"][kind]
    assert about["kind"] == kind and about["strength"] == 0.5 and about["rms"] == pytest.approx(left)


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("kind", PLANTED)
def test_the_effect_of_the_same_kind_and_parameters_explains_it(kind, setting):
    """The planted formula and the effect's columns are written twice; they span the same contribution."""
    for seed in range(3):
        record, truth = make_record(
            2500, setting=setting, sampling_period=SETTINGS[setting], irregular=0.4, effects={kind: 2.0}, seed=seed,
            return_truth=True,
        )  # fmt: skip
        parameters = truth.attrs["effects"][kind]["parameters"]
        effect = CATALOGUE[kind](**parameters)
        X = record.drop(columns="reading")
        assert left_over(effect, X, truth[kind].to_numpy()) < 1e-9
        # A test that any columns pass would be worth nothing: with another parameter the effect explains less.
        name = next((name for name in PARAMETERS if parameters.get(name)), None)
        if name is not None:
            value = parameters[name]
            other = {**parameters, name: [3 * value[0]] if isinstance(value, list) else 1.5 * value}
            assert left_over(CATALOGUE[kind](**other), X, truth[kind].to_numpy()) > 1e-3


@pytest.mark.parametrize("kind", PLANTED)
def test_adding_the_planted_effect_brings_the_error_down_to_the_noise(kind):
    record, truth = make_record(6000, effects={kind: 2.0}, seed=1, return_truth=True)
    X, y = record.drop(columns="reading"), record["reading"]
    base = DynamicBiasRegressor(time_constants=np.geomspace(60.0, 20_000.0, 7))
    effect = CATALOGUE[kind](**truth.attrs["effects"][kind]["parameters"])
    before, after = base.fit(X, y).residual_std_, base.with_effect(effect).fit(X, y).residual_std_
    # 6000 rows know their standard deviation to 1 %; 2 % more for what seven lags leave of the device.
    assert after == pytest.approx(record.attrs["noise"], rel=0.03)
    if kind not in ("thermal_lag", "delay", "rate", "initial_transient"):  # seven lags can imitate these
        assert before > 1.1 * after


def left_over(effect, X, contribution):
    """Share of a contribution's standard deviation that 1, T and the effect's columns leave."""
    layout = Layout(run="run" if "run" in X else None)
    record = read_record(X, layout, needed=effect.inputs(), quiet=True)
    effect.learn(record)
    columns = np.vstack([step.columns for step in walk([effect], record, starts=own_starts(record))])
    design = np.column_stack([np.ones(len(X)), X["temperature"] - X["temperature"].mean(), columns])
    design /= np.maximum(np.abs(design).max(axis=0), 1e-300)
    coefficients = np.linalg.lstsq(design, contribution, rcond=1e-13)[0]
    return (contribution - design @ coefficients).std() / contribution.std()


def test_truth_adds_up_and_nothing_else_changes():
    options = {"n": 800, "gaps": 2, "runs": 2, "irregular": 0.3, "coloured_noise": (0.1, 900.0), "seed": 3}
    plain, bare = make_record(**options, return_truth=True)
    effects = {"hysteresis": 2.0, "lagged_covariate": 0.5, "random_telegraph": 1.0}
    record, truth = make_record(**options, effects=effects, return_truth=True)
    pd.testing.assert_frame_equal(record.drop(columns="reading"), plain.drop(columns="reading"))
    assert list(truth) == ["noise_free", "device", "coloured_noise", *effects, "noise"]
    added = truth[list(effects)].sum(axis=1)
    np.testing.assert_allclose(record["reading"] - plain["reading"], added, atol=1e-11)
    np.testing.assert_array_equal(truth["noise_free"] + truth["noise"], record["reading"])
    same = ["device", "coloured_noise", "noise"]
    pd.testing.assert_frame_equal(truth[same], bare[same])
    assert bare.attrs["effects"] == {}


def test_effects_do_not_disturb_one_another():
    together = make_record(600, effects={"drift": 1.0, "hysteresis": 2.0}, seed=5, return_truth=True)[1]
    for kind in ("drift", "hysteresis"):
        alone = make_record(600, effects={kind: together.attrs["effects"][kind]["strength"]}, seed=5, return_truth=True)
        np.testing.assert_array_equal(alone[1][kind], together[kind])
    louder = make_record(600, effects={"hysteresis": 4.0}, seed=5, return_truth=True)[1]
    np.testing.assert_allclose(louder["hysteresis"], 2 * together["hysteresis"], rtol=1e-12)


def test_seeds_draw_parameters_inside_a_plausible_range():
    drawn = [
        make_record(1500, effects={"hysteresis": 1.0, "covariate": 1.0}, seed=seed, return_truth=True)
        for seed in range(12)
    ]
    about = [truth.attrs["effects"] for _, truth in drawn]
    for (record, _), effects in zip(drawn, about, strict=True):
        swing = np.ptp(record["temperature"])
        assert 0.01 * swing < effects["hysteresis"]["parameters"]["width"] < 0.4 * swing
    assert {effects["covariate"]["parameters"]["column"] for effects in about} == {"humidity", "pressure", "supply"}
    assert {np.sign(effects["hysteresis"]["coefficient"]) for effects in about} == {-1.0, 1.0}


def test_given_parameters_and_effects_as_objects():
    effects = [
        ("hysteresis", 1.0, {"width": 0.7}),
        ("hysteresis", 2.0),
        (LaggedCovariate("pressure", ["2 h"]), 1.0),
        (Step(pd.Timestamp("2024-03-04 10:00")), 1.0),
        (Hinge(22.5, "below", ["30 min"]), 0.5),
        (Rate("5 min"), 0.5),
        ("covariate", 0.3, {"column": "mains"}),
    ]
    record, truth = make_record(2000, effects=effects, seed=2, return_truth=True)
    about = truth.attrs["effects"]
    assert list(about) == [
        "hysteresis", "hysteresis_2", "lagged_covariate", "step", "hinge", "rate", "covariate",
    ]  # fmt: skip
    assert about["hysteresis"]["parameters"]["width"] == 0.7 != about["hysteresis_2"]["parameters"]["width"]
    assert about["lagged_covariate"]["parameters"] == {"column": "pressure", "time_constants": [7200.0]}
    assert about["step"]["parameters"] == {"time": 36_000.0}
    assert about["covariate"]["parameters"]["column"] == "mains"
    X = record.drop(columns="reading")
    for given, label in [(Hysteresis(0.7), "hysteresis"), *((e, e.kind) for e, *_ in effects[2:6])]:
        assert left_over(given, X, truth[label].to_numpy()) < 1e-9


def test_two_of_a_kind_are_not_the_same():
    _, truth = make_record(1500, effects=[("random_walk", 1.0), ("random_walk", 1.0)], return_truth=True)
    assert abs(np.corrcoef(truth["random_walk"], truth["random_walk_2"])[0, 1]) < 0.99


def test_runs_start_afresh_and_time_runs_on():
    effects = {"hysteresis": 2.0, "drift": 1.0, "initial_transient": 1.0, "periodic": 1.0}
    record, truth = make_record(700, runs=3, gaps=1, effects=effects, seed=8, return_truth=True)
    first = truth[(record["run"].diff() != 0).to_numpy()]
    assert (first["hysteresis"] == 0).all()
    days = (truth.index - truth.index[0]) / pd.Timedelta("1 day")
    drift = truth["drift"].to_numpy()
    np.testing.assert_allclose(drift, drift[-1] * days / days[-1], atol=1e-12)
    # Each run starts with its own excess, and decays with the same time constant.
    tau = truth.attrs["effects"]["initial_transient"]["parameters"]["time_constants"][0]
    starts = first["initial_transient"].to_numpy()
    assert len(set(starts)) == 3
    for run, start in zip((1, 2, 3), starts, strict=True):
        part = truth["initial_transient"][(record["run"] == run).to_numpy()]
        t = (part.index - part.index[0]).total_seconds()
        np.testing.assert_allclose(part, start * np.exp(-t / tau), rtol=1e-9)


def test_unknown_causes_are_what_they_say():
    _, truth = make_record(20_000, effects=dict.fromkeys(UNKNOWN, 1.0), seed=4, return_truth=True)
    telegraph, walk_ = truth["random_telegraph"].to_numpy(), truth["random_walk"].to_numpy()
    assert len(np.unique(telegraph)) == 2
    dwell = truth.attrs["effects"]["random_telegraph"]["parameters"]["dwell"]
    switches = np.count_nonzero(np.diff(telegraph))
    assert switches == pytest.approx(20_000 * 60 / dwell, abs=4 * np.sqrt(20_000 * 60 / dwell))  # Poisson, 4 sigma
    # Steps of a random walk are white, and m steps are sqrt(m) times as wide as one (to 3 % from 20 000).
    steps = np.diff(walk_)
    assert abs(np.corrcoef(steps[1:], steps[:-1])[0, 1]) < 4 / np.sqrt(20_000)
    assert np.std(walk_[16:] - walk_[:-16]) == pytest.approx(4 * steps.std(), rel=0.1)


def test_no_strength_adds_nothing():
    record, truth = make_record(300, effects={"rate": 0}, return_truth=True)
    assert (truth["rate"] == 0).all()
    np.testing.assert_array_equal(record["reading"], make_record(300)["reading"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"effects": {"dust": 1.0}}, "The 'effects' parameter of make_record must be one of .* Got 'dust' instead"),
        ({"effects": {"rate": -1.0}}, r"The 'effects\['rate'\]' parameter .* \[0.0, inf\). Got -1.0 instead"),
        ({"effects": {"rate": "strong"}}, "Got 'strong' instead"),
        ({"effects": ["rate"]}, r"a list of \(kind or effect, strength\).* Got 'rate' instead"),
        ({"effects": 2.0}, "Got 2.0 instead"),
        (
            {"effects": [("delay", 1.0, {"dleay": 5})]},
            "names a parameter 'dleay' of 'delay'. Its parameters are: delay",
        ),
        ({"effects": [("drift", 1.0, {"rate": 5})]}, "Its parameters are: none"),
        ({"effects": [("delay", 1.0, {"delay": 0})]}, "'delay' parameter must be a positive time"),
        ({"effects": [("hysteresis", 1.0, {"width": 0})]}, r"a float in the range \(0.0, inf\). Got 0 instead"),
        ({"effects": [("covariate", 1.0, {"column": "dew"})]}, "must be one of 'temperature', 'humidity'.* Got 'dew'"),
        ({"effects": [("hinge", 1.0, {"side": "left"})]}, "must be one of 'above', 'below'. Got 'left' instead"),
        ({"effects": [("periodic", 1.0, {"harmonics": 0})]}, r"an int in the range \[1, inf\). Got 0 instead"),
        ({"effects": [("step", 1.0, {"time": None})]}, r"'time'\]' parameter .* must be a float .* Got None"),
        ({"effects": {"rate": 1.0}, "noise": 0.0}, "count in noise: pass noise > 0"),
        ({"effects": [("static_polynomial", 1.0, {"degree": 2})]}, "static quadratic in temperature explains it"),
        ({"effects": [("step", 1.0, {"time": 1e9})]}, "static quadratic in temperature explains it"),
    ],
)
def test_bad_effects_are_named_in_one_sentence(options, words):
    with pytest.raises(ValueError, match=words):
        make_record(200, **options)
