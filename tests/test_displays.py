"""Displays: numbers against independent computations, no spike lost, logs on disk, axes that are given.

Also: Displays of every kind of record, small ones too: labels with units, no warning, times as a person writes them.
"""

import builtins
import inspect
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError

from thermocorr import DynamicBiasRegressor, TimeConstantSearch, compare_variants, diagnose, displays, read_log, refine
from thermocorr.datasets import make_record
from thermocorr.displays import (
    AgainstDisplay,
    AllanDisplay,
    ContributionsDisplay,
    ErrorsDisplay,
    ResidualsDisplay,
    SpectrumDisplay,
    StepResponseDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
)
from thermocorr.effects import Delay, Drift
from thermocorr.equations import allan_deviation, moving_average
from thermocorr.output.axes import label_values, pyplot
from thermocorr.records.numbers import scale_of

pytestmark = pytest.mark.usefixtures("drawing")

N = 6000


@pytest.fixture(scope="module")
def fitted():
    record = make_record(N, device="layered", seed=3, effects={"hysteresis": 2.0})
    X, y = record.drop(columns="reading"), record["reading"]
    return DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y), X, y


@pytest.fixture(scope="module")
def found(fitted):
    return diagnose(*fitted)


@pytest.fixture(scope="module")
def refined(fitted):
    model, X, y = fitted
    return refine(model, X[:2000], y[:2000], max_steps=1)


def test_residuals_are_those_of_the_model(fitted):
    """6000 rows fall into 1000 cells: means and extremes of pandas over the same cells."""
    model, X, y = fitted
    frame = ResidualsDisplay.from_estimator(model, X, y).frame()
    residual = model.residuals(X, y)
    assert len(frame) == 1000
    assert frame["n"].sum() == N
    np.testing.assert_allclose(np.sum(frame["n"] * frame["residual"]), residual.sum(), atol=1e-9)
    cell = np.repeat(np.arange(len(frame)), frame["n"])
    np.testing.assert_allclose(frame["residual"], residual.groupby(cell).mean(), atol=1e-12)
    np.testing.assert_array_equal(frame["residual_low"], residual.groupby(cell).min())
    np.testing.assert_array_equal(frame["measured_high"], y.groupby(cell).max())
    np.testing.assert_allclose(frame["modelled"], pd.Series(model.predict(X)).groupby(cell).mean(), rtol=1e-12)
    times = pd.Series(X.index).groupby(cell).mean()
    assert abs(frame["time"] - times).max() < pd.Timedelta("1ms")


def test_a_single_spike_survives_in_frame_and_picture(fitted):
    model, X, y = fitted
    spiked = y.copy()
    spiked.iloc[4321] += 25.0
    display = ResidualsDisplay.from_estimator(model, X, spiked).plot()
    high = display.frame()["residual_high"]
    assert high.max() == model.residuals(X, spiked).max()
    assert display.axes_[1, 0].get_ylim()[1] > 20
    assert high.sort_values().iloc[-2] < 5


def test_failing_stretches_are_those_of_the_diagnosis(fitted, found):
    model, X, y = fitted
    display = ResidualsDisplay.from_estimator(model, X, y, found)
    where = found.where
    worst = where[(where["aspect"] == "time") & (where["lift"] > 1.5)]
    inside = np.zeros(N, bool)
    for low, high in display.failing:
        seconds = (X.index - X.index[0]).total_seconds()
        inside |= (seconds >= low) & (seconds <= high)
    assert len(worst)
    assert inside.sum() == pytest.approx(worst["n"].sum(), rel=0.03)  # ends are middles of short averages
    assert display.noise_floor == found.noise_floor
    labels = [text.get_text() for text in display.plot().axes_[0, 0].get_legend().get_texts()]
    assert labels == ["measured", "corrected", "model", "fails most"]


def test_allan_display_is_the_allan_deviation(fitted):
    model, X, y = fitted
    display = AllanDisplay.from_estimator(model, X, y, averaging_times="log")
    for found, values in ((display.before, y), (display.after, model.correct(X, y))):
        expected = allan_deviation(values.to_numpy(), 60.0, "log")
        np.testing.assert_allclose(found.deviation, expected.deviation, rtol=1e-9)
        np.testing.assert_array_equal(found.averaging_times, expected.averaging_times)
    frame = display.frame()
    assert (frame["low_after"] < frame["deviation_after"]).all()
    assert display.plot().ax_.get_ylabel() == "Allan deviation of reading [ppm]"


def test_the_step_response_is_the_closed_form(fitted):
    """b(t) = a1 + a2 - sum mu_j exp(-t/tau_j), eqs. (3) (19) after a step of 1 K at T0."""
    model, _, _ = fitted
    frame = StepResponseDisplay.from_estimator(model).frame()
    a, mu, tau = model.coef_[:2], model.coef_[2:4], model.time_constants_
    expected = a.sum() - np.exp(-frame["time"].to_numpy()[:, None] / tau) @ mu
    # the step takes a millionth of the first time, in which the fastest lag follows by as much
    np.testing.assert_allclose(frame["response"], expected, atol=1e-5 * abs(mu).sum())
    table = model.coef_table()
    assert frame["standard_error"].iloc[-1] < table["standard_error"].iloc[1:5].sum()
    both = StepResponseDisplay.from_estimator(model, step=2.0).frame()
    expected = 2 * a[0] + 4 * a[1] - 2 * np.exp(-both["time"].to_numpy()[:, None] / tau) @ mu
    np.testing.assert_allclose(both["response"], expected, atol=2e-5 * abs(mu).sum())


def test_errors_of_the_step_response_hold_what_they_say():
    """40 records of white noise: the truth within 2 standard errors at three times in about 95 %, not below 85 %."""
    inside = []
    rng = np.random.default_rng(0)
    T = 20 + np.cumsum(rng.normal(size=2000)) * 0.05
    X = pd.DataFrame({"temperature": T}, index=pd.timedelta_range(0, periods=2000, freq="1min"))
    options = {"time_constants": ["10 min", "15 min"], "degree": 1}
    probe = DynamicBiasRegressor(**options).fit(X, T)
    clean = probe.features_.transform(X)[:, :3] @ np.array([2.0, 1.0, 0.5])
    for _ in range(40):
        frame = StepResponseDisplay.from_estimator(
            DynamicBiasRegressor(**options).fit(X, clean + 0.1 * rng.normal(size=2000))
        ).frame()
        frame = frame.iloc[[20, 100, 199]]
        truth = 2.0 - np.exp(-frame["time"].to_numpy()[:, None] / [600.0, 900.0]) @ [1.0, 0.5]
        inside.append(np.abs(frame["response"] - truth) < 2 * frame["standard_error"])
    assert np.mean(inside) > 0.85


def test_effects_that_do_not_follow_the_temperature_leave_the_response_alone(fitted):
    _, X, y = fitted
    options = {"time_constants": ["5 min"], "degree": 1}
    model = DynamicBiasRegressor("temperature", effects=[Drift(), Delay("10 min")], **options).fit(X, y)
    frame = StepResponseDisplay.from_estimator(model).frame()
    names = list(model.features_.get_feature_names_out())
    late = model.coef_[names.index("delay[600 s]")]
    before = frame["response"][frame["time"] < 590].iloc[-1]
    after = frame["response"][frame["time"] > 610].iloc[0]
    mu = model.coef_[names.index("lag[300 s]")]
    assert after - before == pytest.approx(late, abs=1.2 * abs(mu) * (np.exp(-520 / 300) - np.exp(-690 / 300)))
    assert frame["response"].iloc[-1] == pytest.approx(model.coef_[0], rel=1e-3)


def test_contributions_are_those_of_the_model(fitted):
    model, X, _ = fitted
    display = ContributionsDisplay.from_estimator(model, X)
    parts = model.contributions(X)
    for name in parts:
        assert display.rms[name] == pytest.approx(parts[name].std(ddof=0), rel=1e-9)
        frame = display.frame()
        assert np.sum(frame["n"] * frame[name]) == pytest.approx(parts[name].sum(), abs=1e-6)
    assert display.rms.is_monotonic_decreasing
    assert display.plot().axes_.shape == (parts.shape[1], 2)
    response = StepResponseDisplay.from_estimator(model).frame()["response"]  # effects that follow, added up
    np.testing.assert_allclose(display.responses.drop(columns="time").sum(axis=1), response, atol=1e-12)


def test_spectrum_of_a_search_and_of_a_model(fitted):
    """The layered package: a minute-scale body and one of an hour and a half; a given set has no spectrum."""
    model, X, y = fitted
    search = TimeConstantSearch(method="cross_validation", count=3).fit(X[["temperature"]], y)
    display = SpectrumDisplay.from_estimator(search)
    table = model.coef_table()
    assert display.frame()["low"].tolist() == search.time_constants_["low"].tolist()
    assert display.spectrum is search.spectrum_
    assert len(display.plot().axes_) == 2
    given = SpectrumDisplay.from_estimator(model)
    assert given.spectrum is None
    assert given.frame()["low"].isna().all()
    lags = table[table["effect"] == "thermal lag"]
    assert given.frame()["standard_error"].tolist() == lags["standard_error"].tolist()
    chosen = DynamicBiasRegressor("temperature", 2).fit(X, y)
    own = SpectrumDisplay.from_estimator(chosen)
    assert own.spectrum["coefficient"].tolist() == chosen.search_.spectrum["coefficient"].tolist()
    assert own.spectrum["coefficient"].abs().max() > 0
    assert own.plot().ax_.get_ylabel() == "coefficient [ppm/K]"
    with pytest.raises(ValueError, match="no time constants"):
        SpectrumDisplay.from_estimator(DynamicBiasRegressor("temperature", ()).fit(X, y))


def test_where_and_suspects_show_the_diagnosis(fitted, found):
    _, X, _ = fitted
    where = WhereDisplay.from_diagnosis(found, X)
    frame = where.frame()
    pd.testing.assert_frame_equal(frame.drop(columns=["condition"]), found.where)
    assert (frame["low"] <= frame["high"]).all()
    times = frame[frame["aspect"] == "time"]
    first = pd.Timestamp(times["low"].min(), unit="s")
    assert pd.Timedelta(0) <= first - X.index[0] < pd.Timedelta("5min")  # the middle of a short average
    titles = [axes.get_title(loc="left") for axes in where.plot().axes_.ravel()]
    assert "temperature [°C]" in titles and "humidity [%]" in titles
    suspects = SuspectsDisplay.from_diagnosis(found)
    assert suspects.frame()["label"].iloc[0] == "hysteresis"
    assert suspects.frame()["gain_db"].tolist() == found.ranking["gain_db"].tolist()
    suspects.plot()
    assert suspects.ax_.get_title(loc="left") == "Verdict: missing (hysteresis)"
    assert "[dB]" in suspects.ax_.get_xlabel()
    figure = found.plot(X)
    figure.canvas.draw()


def test_an_effect_is_added_whatever_it_is_called(refined):
    steps = pd.concat([refined.steps.iloc[:1]] * 2, ignore_index=True)
    steps["effect"], steps["change"] = ["", "without load"], ["given", "added"]
    display = ErrorsDisplay.from_refinement(replace(refined, steps=steps)).plot()
    shown = [label.get_text() for label in display.ax_.get_yticklabels()]
    assert shown == ["given model", "+ without load"]


def test_the_errors_of_a_refinement_and_of_a_comparison_stand_on_one_scale(refined, fitted):
    display = ErrorsDisplay.from_refinement(refined).plot()
    assert display.frame()["error"].tolist() == refined.steps["later_rms"].tolist()
    assert display.noise_floor == refined.diagnoses[-1].noise_floor
    names = [tick.get_text() for tick in display.ax_.get_yticklabels()]
    assert names[0] == "given model" and names[1].startswith("+ hysteresis")
    refined.plot().canvas.draw()
    _, X, y = fitted
    comparison = compare_variants(X, y, temperature="temperature", time_constants=["5 min", "90 min"], n_blocks=2)
    frame = ErrorsDisplay.from_comparison(comparison).frame()
    assert frame["correction"].iloc[0] == "no correction"
    assert frame["error"].iloc[0] == comparison.advice.before
    assert dict(frame.to_numpy()[1:].tolist()) == comparison.advice.table["all"].iloc[3:].to_dict()


def test_what_is_left_over_a_condition_is_the_mean_of_its_rows(fitted):
    model, X, y = fitted
    residual = model.residuals(X, y)
    for against in (None, "humidity", "rate", "lag difference", "hour", "thermal lag"):
        display = AgainstDisplay.from_estimator(model, X, y, against).plot()
        frame = display.frame()
        assert frame["n"].sum() == len(X)
        assert np.sum(frame["n"] * frame["mean"]) == pytest.approx(residual.sum(), abs=1e-9)
    humidity = AgainstDisplay.from_estimator(model, X, y, "humidity").frame()
    edges = np.linspace(X["humidity"].min(), X["humidity"].max(), 61)
    number = np.clip(np.searchsorted(edges, X["humidity"], side="right") - 1, 0, 59)
    np.testing.assert_allclose(humidity["mean"], residual.groupby(number).mean(), atol=1e-9)
    lag = AgainstDisplay.from_estimator(model, X, y, "lag difference")
    assert lag.against.startswith("lag difference, ")


def test_a_ghost_is_the_mean_of_what_another_model_leaves(fitted, found):
    model, X, y = fitted
    better = model.with_effect(found.best).fit(X, y)
    display = ResidualsDisplay.from_estimator(better, X, y, columns=["humidity"], others={"before": model}).plot()
    labels = [text.get_text() for text in display.axes_[1, 0].get_legend().get_texts()]
    assert labels == ["measured less model", "before", "its mean"]
    drawn = display.others["before"]
    assert np.sum(drawn["n"] * drawn["residual"]) == pytest.approx(model.residuals(X, y).sum(), abs=1e-9)
    assert display.axes_.shape == (3, 1) and display.axes_[2, 0].get_ylabel() == "humidity [%]"


def test_variants_are_those_of_the_comparison(fitted):
    _, X, y = fitted
    comparison = compare_variants(X, y, temperature="temperature", time_constants=["5 min", "90 min"], n_blocks=2)
    display = VariantsDisplay.from_comparison(comparison)
    frame = display.frame()
    cell = np.repeat(np.arange(len(frame)), frame["n"])
    for name in comparison.residuals:
        smooth = pd.Series(moving_average(comparison.residuals[name].to_numpy(), comparison.window))
        np.testing.assert_allclose(frame[name], smooth.groupby(cell).mean(), atol=1e-12)
    display.plot()
    limits = {axes.get_ylim() for axes in display.axes_[1:].flat}
    assert len(limits) == 1
    assert "dB" in display.axes_[1, 0].get_title(loc="left")


@pytest.mark.parametrize("kind", ["frames", "memory map"])
def test_logs_on_disk_give_the_same_numbers(fitted, kind, tmp_path):
    model, X, y = fitted
    expected = ResidualsDisplay.from_estimator(model, X, y).frame()
    if kind == "frames":
        whole = X.assign(reading=y)
        log = read_log(whole[start : start + 2500] for start in range(0, len(X), 2500))
        options = {"temperature": "temperature"}
        log, reading = log.drop(columns="reading"), log["reading"]
    else:
        np.save(tmp_path / "T.npy", X[["temperature"]].to_numpy())
        log = np.load(tmp_path / "T.npy", mmap_mode="r")
        options, reading = {"sampling_period": 60.0}, y.to_numpy()
    same = DynamicBiasRegressor(time_constants=["5 min", "90 min"], **options).fit(log, reading)
    display = ResidualsDisplay.from_estimator(same, log, reading)
    np.testing.assert_allclose(display.frame()["residual_high"], expected["residual_high"], atol=1e-8)
    AllanDisplay.from_estimator(same, log, reading)
    assert display.plot().axes_[1, 0].get_xlabel() == ("time" if kind == "frames" else "time [d]")


def test_one_axes_is_divided_and_several_are_taken(fitted):
    from matplotlib import pyplot as plt

    model, X, y = fitted
    display = ResidualsDisplay.from_estimator(model, X, y)
    figure, axes = plt.subplots(1, 2)
    display.plot(axes[0])
    assert display.figure_ is figure and len(figure.axes) == 3
    two = plt.subplots(2)[1]
    assert display.plot(two).axes_[:, 0].tolist() == two.tolist()
    with pytest.raises(ValueError, match="one Axes or 2"):
        display.plot(plt.subplots(3)[1])


def test_a_missing_matplotlib_is_named(fitted, monkeypatch):
    model, X, y = fitted
    display = ResidualsDisplay.from_estimator(model, X, y)
    real = builtins.__import__

    def absent(name, *rest, **more):
        if name.split(".")[0] == "matplotlib":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(ImportError, match="pip install matplotlib"):
        display.plot()


def test_what_is_no_fitted_model_is_refused(fitted):
    _, X, y = fitted
    with pytest.raises(TypeError, match="DynamicBiasRegressor is needed"):
        ResidualsDisplay.from_estimator(object(), X, y)
    with pytest.raises(TypeError, match="refit=True"):
        SpectrumDisplay.from_estimator(TimeConstantSearch(refit=False))
    with pytest.raises(NotFittedError):
        ResidualsDisplay.from_estimator(DynamicBiasRegressor(), X, y)


def test_a_band_of_uncertainty_holds_the_residuals():
    record = make_record(9000, seed=3)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X[:6000], y[:6000])
    display = ResidualsDisplay.from_estimator(model, X, y, uncertainty=True).plot()
    display.figure_.canvas.draw()
    u = model.predict(X, return_std=True)[1]
    half = 0.5 * (display.frame()["high"] - display.frame()["low"])
    assert half.mean() == pytest.approx(1.96 * u.mean(), rel=1e-3)
    labels = [text.get_text() for text in display.axes_[0, 0].get_legend().get_texts()]
    assert "95 % of readings" in labels
    assert ResidualsDisplay.from_estimator(model, X, y).frame()["low"].isna().all()


pytestmark = pytest.mark.usefixtures("drawing")


def small(kind):
    """A model and a record of 30 or 360 rows."""
    options = {"temperature": "temperature", "time_constants": ["5 min"], "degree": 1}
    record = make_record(120, seed=1, gaps=2, runs=3) if kind == "gaps and runs" else make_record(30, seed=1)
    X, y = record.drop(columns="reading"), record["reading"]
    if kind == "gaps and runs":
        options |= {"run": "run", "max_gap": "10 min"}
    if kind == "time zone":
        X.index = y.index = X.index.tz_localize("UTC").tz_convert("Asia/Tokyo")
    if kind == "spans":
        X.index = y.index = X.index - X.index[0]
    if kind == "missing readings":
        y = y.where(np.arange(len(y)) % 7 != 3)
    if kind == "missing temperatures":
        X.loc[X.index[12], "temperature"] = np.nan
    if kind == "overlapping runs":
        X = X.reset_index(drop=True).assign(run=np.arange(30) // 15, clock=np.arange(30) % 15 * 60.0)
        y = y.reset_index(drop=True)
        options |= {"run": "run", "time": "clock"}
    if kind in ("array", "array with a period"):
        X, y = X[["temperature"]].to_numpy(), y.to_numpy()
        options |= {"temperature": 0, "sampling_period": None if kind == "array" else 60.0}
    return DynamicBiasRegressor(**options).fit(X, y), X, y


OF_A_MODEL = [
    getattr(displays, name) for name in displays.__all__ if hasattr(getattr(displays, name), "from_estimator")
]
KINDS = [
    "dates", "time zone", "spans", "missing readings", "missing temperatures", "gaps and runs", "overlapping runs",
    "array", "array with a period",
]  # fmt: skip


@pytest.mark.parametrize(
    "kind",
    [
        kind if kind in ("dates", "gaps and runs", "array") else pytest.param(kind, marks=pytest.mark.long)
        for kind in KINDS
    ],
)
def test_every_kind_of_small_record_is_drawn(kind):
    """Labels stand on the outer axes, and units where they are known; no warning, on the canvas neither."""
    model, X, y = small(kind)
    given = {"model": model, "X": X, "y": y}
    for kind_of_display in OF_A_MODEL:
        takes = inspect.signature(kind_of_display.from_estimator).parameters
        display = kind_of_display.from_estimator(**{name: given[name] for name in given if name in takes})
        assert len(display.frame())
        assert display.plot() is display
        assert display.to_svg(360).startswith("<svg")
        if kind in ("dates", "gaps and runs") or kind_of_display is ResidualsDisplay:
            display.figure_.canvas.draw()
        assert display.ax_.get_ylabel()
        assert np.ravel(display.axes_)[-1].get_xlabel()
        if not kind.startswith("array"):
            labels = " ".join(axes.get_xlabel() + axes.get_ylabel() for axes in np.ravel(display.axes_))
            assert "ppm" in labels or "[K]" in labels


@pytest.mark.parametrize("kind", ["dates", "overlapping runs"])
def test_variants_of_small_records_are_drawn(kind):
    model, X, y = small(kind)
    display = VariantsDisplay.from_comparison(compare_variants(X, y, model=model, n_blocks=2)).plot()
    display.figure_.canvas.draw()
    assert display.axes_.shape == (5, 2)
    assert display.axes_[-1, 1].get_xlabel() == "temperature [°C]"
    assert display.axes_[0, 0].get_ylabel() == "reading [ppm]"


def test_short_records_are_kept_row_by_row():
    model, X, y = small("missing readings")
    frame = ResidualsDisplay.from_estimator(model, X, y).frame()
    assert frame["time"].tolist() == X.index.tolist()
    np.testing.assert_array_equal(frame["measured"], y)
    np.testing.assert_allclose(frame["residual"], model.residuals(X, y), atol=1e-12)
    assert (frame["n"] == 1).all()


def test_nothing_to_show_is_said():
    empty = pd.DataFrame(columns=["aspect", "column", "time_constant", "low", "high", "unit", "share", "lift"])
    display = WhereDisplay(empty).plot()
    assert display.ax_.texts[0].get_text() == "No error beyond the noise."
    assert SuspectsDisplay(pd.DataFrame(), "nothing missing").plot().ax_.texts[0].get_text() == "No suspects."


def test_smoothing_does_not_reach_over_the_joint_of_two_runs():
    model, X, y = small("gaps and runs")
    y = y + 100.0 * X["run"]
    frame = VariantsDisplay.from_comparison(compare_variants(X, y, model=model, n_blocks=2)).frame()
    steps = frame["before correction"].diff()[frame["segment"].diff() == 0]
    assert steps.abs().max() < 5.0


@pytest.mark.parametrize(
    ("unit", "size", "label"),
    [("mV", 2e-4, "x [µV]"), ("mV", 2.0, "x [mV]"), ("ohm", 3e5, "x [kΩ]"), ("ppm", 2e-4, "x [10⁻⁴ ppm]")],
)
def test_an_axis_has_the_unit_that_suits_it_and_its_ticks_say_the_numbers(unit, size, label):
    figure, (even, log) = pyplot().subplots(2)
    even.plot([0.0, size])
    label_values(even.yaxis, "x", unit)
    log.semilogy([size / 150, size])
    label_values(log.yaxis, "x", unit)
    figure.canvas.draw()
    assert even.get_ylabel() == label
    factor = scale_of([size], unit).factor if unit != "ppm" else 1e4
    texts = [text.get_text().replace("\u2212", "-") for text in even.get_yticklabels()]
    ticks = [(float(text), value) for text, value in zip(texts, even.get_yticks(), strict=True)]
    for shown, value in ticks:
        assert shown == pytest.approx(factor * value, abs=1e-6 * factor * size)
    scaled, raised = (factor if unit != "ppm" else 1.0), str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    for text, y in zip(log.get_yticklabels(), log.get_yticks(), strict=True):
        said = text.get_text()
        if said:
            power = re.fullmatch("10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", said)
            value = 10.0 ** int(power[1].translate(raised)) if power else float(said)
            assert value == pytest.approx(scaled * y)
