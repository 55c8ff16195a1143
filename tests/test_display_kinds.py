"""Displays of every kind of record, small ones too: labels with units, no warning, times as a person writes them."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, compare_variants, displays
from thermocorr.datasets import make_record
from thermocorr.displays import ResidualsDisplay, SuspectsDisplay, VariantsDisplay, WhereDisplay
from thermocorr.displays.axes import label_log_values, label_values, pyplot
from thermocorr.records.numbers import scale_of

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
    [("mV", 2e-4, "x [µV]"), ("mV", 2.0, "x [mV]"), ("ohm", 3e5, "x [kΩ]"), ("ppm", 2e-4, "x [$10^{-4}$ ppm]")],
)
def test_an_axis_has_the_unit_that_suits_it_and_its_ticks_say_the_numbers(unit, size, label):
    figure, (even, log) = pyplot().subplots(2)
    even.plot([0.0, size])
    label_values(even.yaxis, "x", unit)
    log.semilogy([size / 150, size])
    label_log_values(log.yaxis, "x", unit)
    figure.canvas.draw()
    assert even.get_ylabel() == label
    factor = scale_of([size], unit).factor if unit != "ppm" else 1e4
    texts = [text.get_text().replace("\u2212", "-") for text in even.get_yticklabels()]
    ticks = [(float(text), value) for text, value in zip(texts, even.get_yticks(), strict=True)]
    for shown, value in ticks:
        assert shown == pytest.approx(factor * value, abs=1e-6 * factor * size)
    decades = [re.fullmatch(r"\$\\mathdefault\{10\^\{(.+)\}\}\$", t.get_text()) for t in log.get_yticklabels()]
    found = [(int(d[1]), y) for d, y in zip(decades, log.get_yticks(), strict=True) if d]
    scaled = factor if unit != "ppm" else 1.0
    assert found and all(10.0**power == pytest.approx(scaled * y) for power, y in found)
