"""Runs at different levels: each has its U0, the rest of the model is that of one level, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from thermocorr import (
    DynamicBiasRegressor,
    OnlineCorrector,
    RecordError,
    RecordWarning,
    TimeConstantSearch,
    compare_variants,
    diagnose,
    load_model,
    save_model,
)
from thermocorr.datasets import make_record
from thermocorr.effects import CATALOGUE, Step
from thermocorr.judgement.data import record_of
from thermocorr.judgement.refine import with_missing
from thermocorr.model.averages import rms

NOISE = 0.2
TIMES = ["5 min", "90 min"]


def two_runs(apart=0.0, seed=3, rows=3000, pause="2 D"):
    """One device in two runs, the second at another level."""
    first, second = (make_record(rows, seed=seed + k, noise=NOISE) for k in (0, 1))
    second.index = second.index - second.index[0] + first.index[-1] + pd.Timedelta(pause)
    both = pd.concat([first, second])
    both["run"] = np.repeat(["a", "b"], rows)
    return both[["temperature", "run"]], both["reading"] + np.where(both["run"] == "b", apart, 0.0)


def fitted(X, y, **options):
    return DynamicBiasRegressor("temperature", TIMES, run="run", **options).fit(X, y)


@pytest.mark.parametrize("apart", [-4000.0, 50.0, 4e6])
@pytest.mark.parametrize("seed", [3, 40])
def test_each_run_is_corrected_to_its_own_level(apart, seed):
    """The readings of the second run by so much higher: all else is as before."""
    X, y = two_runs(seed=seed)
    at_one, apart_model = fitted(X, y), fitted(X, two_runs(apart, seed)[1])
    levels = apart_model.correct(X, two_runs(apart, seed)[1]).groupby(X["run"]).mean()
    assert abs(levels["b"] - levels["a"] - apart) < 0.1  # the two fields at the starts differ
    assert apart_model.residual_std_ < 1.02 * at_one.residual_std_
    lags = [name.startswith("lag") for name in at_one.features_.get_feature_names_out()]
    np.testing.assert_allclose(
        apart_model.coef_[: len(lags)][lags], at_one.coef_[lags], atol=4 * at_one._standard_errors()[1:][lags].max()
    )


def test_levels_belong_to_every_model_with_one_effect_more():
    """A step besides them once made all runs share one level, and the fit worse than without it."""
    X, y = two_runs(apart=0.5)
    model = fitted(X, y)
    longer = with_missing(model, Step(float(60 * 1500))).fit(X, y)
    assert longer._run_levels.times == model._run_levels.times and len(model._run_levels.times) == 1
    assert longer.residual_std_ <= 1.001 * model.residual_std_
    assert model.contributions(X)["several steps: 1"].iloc[-1] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("kind", [kind for kind in CATALOGUE if kind not in ("lead", "events")])
def test_an_effect_more_never_raises_the_error_in_sample(kind):
    """Of every kind, in runs at levels of their own: a nested model fits no worse."""
    X, y = two_runs(apart=30.0, rows=1500)
    X = X.assign(humidity=45 + np.cumsum(np.random.default_rng(1).normal(0, 0.2, len(X))))
    model = fitted(X, y)
    record = record_of(model, X, y)
    record = replace(record, columns={**record.columns, "humidity": X["humidity"].to_numpy()})
    before = rms(model.residuals(X, y))
    for effect in CATALOGUE[kind].candidates(record, ["humidity"])[::7]:
        try:
            longer = with_missing(model, effect).set_params(alpha=model.alpha_).fit(X, y)
        except RecordError:  # too many columns for so few rows
            continue
        assert rms(longer.residuals(X, y)) <= before * (1 + 1e-6), effect


def test_runs_at_set_points_say_that_no_law_is_learned():
    """One temperature for each run: what differs between them is their levels."""
    rng = np.random.default_rng(0)
    T = np.repeat([18.0, 23.0, 28.0], 400) + 0.01 * rng.normal(size=1200)
    X = pd.DataFrame(
        {"temperature": T, "run": np.repeat([1, 2, 3], 400)}, index=pd.RangeIndex(1200) * pd.Timedelta("1min")
    )
    y = pd.Series(100 + 5 * (T - 23) + 0.01 * rng.normal(size=1200), index=X.index)
    with pytest.warns(RecordWarning, match="the static law is not learned.*leave out run"):
        fitted(X, y)
    model = DynamicBiasRegressor("temperature", TIMES).fit(X, y)
    assert model.correct(X, y).std() < 0.05


def test_a_missing_column_is_found_beside_the_levels():
    record = make_record(8000, seed=5, noise=NOISE, effects={"covariate": 1.0})
    X = record.drop(columns="reading").assign(run=np.arange(8000) // 1000)
    assert diagnose(fitted(X, record["reading"]), X, record["reading"]).best.kind == "covariate"


def test_a_level_does_not_hide_a_missing_effect():
    X, y = two_runs(apart=300.0)
    humidity = 45 + np.cumsum(np.random.default_rng(1).normal(0, 0.2, len(X)))
    X = X.assign(humidity=humidity)
    found = diagnose(fitted(X, y + 0.2 * (humidity - 45)), X, y + 0.2 * (humidity - 45))
    assert found.best.label() == "covariate: humidity"
    assert diagnose(fitted(X, y), X, y).verdict == "nothing missing"


def test_a_file_and_a_stream_know_the_levels(tmp_path):
    X, y = two_runs(apart=300.0)
    model = fitted(X[:5000], y[:5000])
    save_model(model, tmp_path / "m.json")
    loaded = load_model(tmp_path / "m.json")
    np.testing.assert_array_equal(loaded.predict(X), model.predict(X))
    live = OnlineCorrector(loaded)
    shown = live.update_many(X[5000:], y[5000:])["corrected"]
    np.testing.assert_allclose(shown, model.correct(X, y)[5000:], atol=1e-9)
    assert abs(np.nanmean(shown) - 300 - model.correct(X, y)[:3000].mean()) < 0.2


def test_the_table_of_variants_is_of_levels_too():
    X, y = two_runs(apart=4000.0)
    table = compare_variants(X, y, temperature="temperature", time_constants=TIMES, run="run").table
    assert table.loc["dynamic nonlinear", "std"] < 1.05 * NOISE


def test_runs_at_once_at_different_levels_are_refused():
    X, y = two_runs(apart=300.0, pause="-1 D")
    with pytest.raises(RecordError, match=r"Runs .a. and .b. overlap in time and have readings at different levels"):
        fitted(X, y)
    with pytest.warns(RecordWarning, match="overlap in time: all have one level"):
        assert fitted(*two_runs(pause="-1 D"))._run_levels.times == ()


def test_a_run_without_readings_and_a_single_run_have_no_level():
    X, y = two_runs()
    assert fitted(X, y.where(X["run"] == "a"))._run_levels.times == ()
    assert fitted(X[:3000], y[:3000])._run_levels.times == ()


def test_a_search_of_time_constants_knows_the_levels():
    X, y = two_runs(apart=4000.0)
    search = TimeConstantSearch(DynamicBiasRegressor("temperature", run="run")).fit(X, y)
    alike = TimeConstantSearch(DynamicBiasRegressor("temperature", run="run")).fit(X, two_runs()[1])
    assert search.best_estimator_.residual_std_ < 1.03 * alike.best_estimator_.residual_std_


def test_three_resistors_in_four_runs_keep_their_levels(measured):
    """Measured: four runs in an oven, elements 2, 2, 1 and 3 of a kind, 10 to 50 ppm apart."""
    record = pd.read_csv(measured / "vhd200_resistor" / "vhd200_resistor.csv")
    X, y = record.drop(columns="resistance_ohm"), record["resistance_ohm"]
    model = DynamicBiasRegressor("oven_temp_degC", run="run", time="time").fit(X, y)
    levels = model.correct(X, y).groupby(record["run"]).mean()
    one = DynamicBiasRegressor("oven_temp_degC", time="time").fit(X, y)
    assert len(model._run_levels.times) == 3
    assert model.residual_std_ < one.residual_std_ / 3
    assert abs(levels["run9"] - levels["run10"]) < 0.004  # ohm: the same element
    assert levels["run17"] - levels["run9"] == pytest.approx(0.053, abs=0.004)
    assert levels["run15"] - levels["run9"] == pytest.approx(-0.010, abs=0.004)


def test_a_loaded_model_is_judged_as_the_fitted_one(tmp_path):
    X, y = two_runs(apart=300.0)
    model = fitted(X, y)
    save_model(model, tmp_path / "m.json")
    loaded = load_model(tmp_path / "m.json")
    assert loaded._run_levels.times == model._run_levels.times
    assert diagnose(loaded, X, y).verdict == diagnose(model, X, y).verdict == "nothing missing"


def test_a_run_without_readings_in_between_gets_no_level_of_its_own():
    X, y = two_runs(apart=300.0)
    between = X[X["run"] == "a"].set_axis(X.index[:3000] + (X.index[3000] - X.index[0]) / 2)[:200].assign(run="c")
    X = pd.concat([X[:3000], between, X[3000:]])
    y = pd.concat([y[:3000], pd.Series(np.nan, between.index), y[3000:]])
    model = fitted(X, y)
    assert len(model._run_levels.times) == 1


def test_an_error_on_a_run_whose_level_is_unknown_does_not_count():
    X, y = two_runs(apart=4000.0)
    advice = compare_variants(X, y, model=fitted(X, y)).advice
    assert advice.table.loc["dynamic linear", "all"] < 1.2 * NOISE


def test_a_setpoint_is_a_cause_and_a_copy_of_the_reading_none():
    """Readings in ppm around setpoints: a straight line of the setpoint explains all but 1e-12 of the variance."""
    record = make_record(3000, seed=3, noise=NOISE)
    setpoint = np.array([1.0, 10.0])[np.repeat(np.random.default_rng(0).permutation(np.arange(30) % 2), 100)]
    y = (setpoint + (record["reading"] - record["reading"].mean()) * 1e-6).rename("reading")
    X = record[["temperature"]].assign(setpoint=setpoint)
    found = diagnose(DynamicBiasRegressor("temperature", TIMES).fit(X, y), X, y)
    assert found.best.label() == "covariate: setpoint"


def test_a_reading_of_a_run_that_was_never_seen_may_be_at_any_of_the_levels():
    """Corrected readings keep their level, and are as sure as ever."""
    X, y = two_runs(apart=40.0)
    model = fitted(X, y)
    assert len(model._run_levels.times) == 1
    new = X[-500:].assign(run="c").set_axis(X.index[-500:] + pd.Timedelta("1 D"))
    unknown, known = (model.predict(some, return_std=True)[1] for some in (new, X[-500:]))
    np.testing.assert_allclose(unknown[-100:], 40.0, rtol=0.02)
    assert known.max() < 2 * NOISE
    assert model.correct(new, y[-500:].set_axis(new.index), return_std=True)[1][-100:].max() < 2 * NOISE
