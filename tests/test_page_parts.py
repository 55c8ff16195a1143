"""Parts of the page: series thinned out without hiding a spike, numbers in words, names made harmless."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from thermocorr.pages.chapters import Scales, digits_down_to, parameters_text
from thermocorr.pages.charts import Extremes

import thermocorr.pages
from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.displays.words import aspect_text, ends_text, interval_text, place_text
from thermocorr.effects import Disturbance, Events, Hinge, Hysteresis, SeveralSteps, Step
from thermocorr.pages import Answer, PageData, document
from thermocorr.pages.html import number, plain, rendered, script_data, unit_text, units_of_axis, with_signs, with_unit
from thermocorr.records.numbers import scale_of

TEMPLATES = Path(thermocorr.pages.__file__).parent / "templates"

# ---- thinning out


def test_short_records_are_shown_whole():
    cells = Extremes(100)
    values = np.random.default_rng(0).normal(size=(90, 2))
    cells.add(0, np.arange(40.0), values[:40])
    cells.add(1, np.arange(50.0, 100.0), values[40:])
    seconds, points = cells.points()
    assert cells.width == 1
    assert np.isnan(points[40]).all()  # the line breaks between segments
    np.testing.assert_array_equal(np.delete(points, 40, axis=0), values)
    assert (np.diff(seconds) >= 0).all()


@pytest.mark.parametrize("block", [64, 100, 1000])
def test_no_extreme_is_lost_and_extremes_keep_their_order(block):
    rng = np.random.default_rng(1)
    n, most = 20_000, 500
    values = np.cumsum(rng.normal(size=(n, 2)), axis=0)
    values[rng.integers(n, size=300), 0] = np.nan
    values[12_345, 1] = 1e6  # a spike of one sample
    cells = Extremes(most)
    for start in range(0, n, block):
        cells.add(0, np.arange(start, min(start + block, n), dtype=float), values[start : start + block])
    seconds, points = cells.points()
    assert len(points) <= most
    starts, stops = seconds[::2].astype(int), seconds[1::2].astype(int) + 1
    np.testing.assert_array_equal(starts[1:], stops[:-1])  # every row is in one cell
    for k, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        part = values[start:stop]
        np.testing.assert_array_equal(np.sort(points[2 * k : 2 * k + 2], axis=0)[0], np.nanmin(part, axis=0))
        np.testing.assert_array_equal(np.sort(points[2 * k : 2 * k + 2], axis=0)[1], np.nanmax(part, axis=0))
        for j in range(2):
            first_is_high = points[2 * k, j] > points[2 * k + 1, j]
            assert first_is_high == (np.nanargmax(part[:, j]) < np.nanargmin(part[:, j]))


def test_averages_are_means_of_stretches_inside_segments():
    rng = np.random.default_rng(2)
    values, cells = rng.normal(size=(5000, 1)), Extremes(600)
    cells.add(0, np.arange(3001.0), values[:3001])
    cells.add(1, np.arange(3001.0, 5000.0), values[3001:])
    seconds, _ = cells.points()
    points, means = cells.averages(0, 4)
    for (first, last), mean in zip(points, means, strict=True):
        rows = slice(int(seconds[first]), int(seconds[last]) + 1)
        assert (rows.start < 3001) == (rows.stop <= 3001)
        assert mean == pytest.approx(values[rows].mean(), abs=1e-12)


def test_memory_is_bounded_even_where_every_row_is_a_segment():
    cells = Extremes(50)
    for i in range(2000):
        cells.add(i, np.array([float(i)]), np.array([[float(i % 7)]]))
    seconds, points = cells.points()
    assert len(seconds) <= 50
    assert seconds[-1] == 1999.0 and cells.width < 256
    assert np.ptp(points, axis=0) == 6.0


# ---- text


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0"), (2.0, "2.000"), (-0.25, "\u22120.2500"), (6.199e-5, "6.199 \u00d7 10⁻⁵"), (99997.94, "99998")],
)
def test_numbers_are_written_as_a_person_writes_them(value, shown):
    assert plain(value) == shown
    assert float(re.search(r'value="([^"]+)"', number(value))[1]) == value  # every digit is there for a machine


@pytest.mark.parametrize(
    ("aspect", "low", "high", "unit", "shown"),
    [
        ("time", "2018-02-14 19:10:19", "2018-02-14 20:45:19", "date", "2018-02-14 19:10:19 to 20:45:19"),
        ("time", "2024-03-17 20:42:08", "2024-03-18 13:57:22", "date", "2024-03-17 20:42:08 to 2024-03-18 13:57:22"),
        ("lag difference", -0.26, -0.08, "K", "\u22120.26 to \u22120.08"),
        ("time", 7200.0, 10800.0, "s", "2 h to 3 h"),
        ("hour", 18.0, 20.0, "h", "18 to 20 h"),
    ],
)
def test_places_are_written_as_a_person_writes_them(aspect, low, high, unit, shown):
    if unit == "date":
        low, high = (pd.Timestamp(text).timestamp() for text in (low, high))
    row = SimpleNamespace(aspect=aspect, column=None, time_constant=36_000.0, low=low, high=high, unit=unit)
    assert interval_text(row) == shown
    assert shown in place_text(row)
    if unit == "date":
        assert ends_text(row, 1e9)[0].endswith(shown[:4])
    if aspect == "hour":
        assert aspect_text(row) == "hour of day"
        row.unit = "h (UTC)"
        assert place_text(row) == "where hour of day (UTC) is 18 to 20 h"
    if aspect == "lag difference":
        assert aspect_text(row) == "lag difference, 10 h [K]"


def test_names_are_made_harmless_in_text_and_in_data():
    attack = "</script><!-- <script> & ]]> \u2028"
    shown = rendered("versions", versions=[(attack, "\x1b[2J")], source=attack, command=attack)
    known = "p code pre div table thead tbody tr th td"
    assert set(re.findall(r"<[!/]?(\w+|--)", shown)) == set(known.split())
    assert "\x1b" not in shown and shown.count("&lt;script&gt;") == 3
    assert not set("<>&") & set(script_data({"name": attack}))


@pytest.mark.parametrize("path", sorted(TEMPLATES.glob("*.html")), ids=lambda path: path.name)
def test_no_template_trusts_what_it_is_given(path):
    assert not re.search(r"\|\s*safe\b|autoescape", path.read_text(encoding="utf-8"))


# ---- units


def test_a_number_of_a_page_has_the_unit_that_suits_it_and_keeps_its_value():
    assert number(6.2e-05, "mV") == '<data value="6.2e-05" class="n">62.00\u00a0nV</data>'
    scale = scale_of([0.0014, 0.00013], "mV")
    assert with_unit("rms", scale.unit) == "rms [\u00b5V]"
    assert number(0.00013, scale=scale) == '<data value="0.00013" class="n">0.1300</data>'
    assert number(0.00013, "mV", scale=scale) == '<data value="0.00013" class="n">0.1300\u00a0\u00b5V</data>'


def test_units_have_the_signs_of_print_with_any_prefix():
    said = {
        "uV": "\u00b5V",
        "mohm": "m\u03a9",
        "uohm/K": "\u00b5\u03a9/K",
        "degC": "\u00b0C",
        "mV/(K^2)": "mV/(K\u00b2)",
        "min": "min",
    }
    assert {unit: unit_text(unit) for unit in said} == said
    assert units_of_axis("ppm") == [] and [-3, "\u00b5V", 1e-4] in units_of_axis("mV")


# ---- what speaks against the correction


def test_a_page_says_where_the_correction_leaves_the_readings_or_adds_noise():
    record = make_record(4000, seed=1)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["30 s", "10 min"]).fit(X, y)
    assert PageData.of(model, X, y).warnings == ()
    left, louder = PageData.of(model, X + 30.0, y).warnings
    assert left.startswith("The corrected readings have a mean of ") and "the correction adds noise" in louder
    page_text = document.page(PageData.of(model, X + 30.0, y), Answer())
    assert page_text.index("The corrected readings have a mean of") < page_text.index("<nav>")
    elsewhere = DynamicBiasRegressor("temperature", ["10 min"], reference_temperature=60.0).fit(X, y)
    assert PageData.of(elsewhere, X, y).warnings == ()  # asked for


# ---- parameters of effects


@pytest.mark.parametrize(
    ("effect", "dated", "undated"),
    [
        (Step(5000.0), "time 2024-03-04 01:23:20", "time 1.39 h"),
        (Disturbance(5000.0, 9000.0), "start 2024-03-04 01:23:20; end 2024-03-04 02:30:00", "start 1.39 h; end 2.5 h"),
        (SeveralSteps([60.0, 9000.0]), "times 2024-03-04 00:01:00, 2024-03-04 02:30:00", "times 1 min, 2.5 h"),
        (Events([60.0]), "time 2024-03-04 00:01:00", "time 1 min"),
        (Hinge(0.5, time_constants=[60.0]), "knee 0.500 °F; time constant 1 min", "knee 0.500 °F; time constant 1 min"),
        (Hysteresis(0.5), "width 0.500 °F", "width 0.500 °F"),
    ],
    ids=lambda given: getattr(given, "kind", ""),
)
def test_moments_are_dates_and_temperatures_have_their_unit(effect, dated, undated):
    start = pd.Timestamp("2024-03-04").timestamp()
    assert parameters_text(effect, Scales(start, "degF")) == dated
    assert parameters_text(effect, Scales(None, "degF")) == undated


def test_a_coefficient_has_digits_down_to_its_standard_error():
    """U0 was 10.0000 with an error of 2.57e-8."""
    assert plain(10.0000068, digits_down_to(2.57e-8, 10.0000068)) == "10.000006800"
    assert plain(1.23456789, digits_down_to(0.1, 1.23456789)) == "1.23457"
    assert {digits_down_to(error, 1.0) for error in (0.0, np.nan, np.inf)} == {6}


def test_sentences_have_the_signs_of_print_and_no_rounding_of_zero():
    """uV stood beside µV, degF² beside °F, and a range began at -3.253e-17."""
    assert with_signs("a drift of 73 uohm, 5 uncorrected, [degF/h]") == "a drift of 73 µΩ, 5 uncorrected, [°F/h]"
    assert unit_text("uohm/degF^2") == "µΩ/°F²" and unit_text("V*degC") == "V*°C"
    place = pd.Series({"aspect": "rate", "unit": "K/h", "low": -3.253e-17, "high": 0.2})
    assert ends_text(place) == ("0", "0.2")
