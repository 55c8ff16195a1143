"""Parts of the page: numbers in words, names made harmless, what speaks against a correction."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import thermocorr.output
from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import Disturbance, Events, Hinge, Hysteresis, SeveralSteps, Step
from thermocorr.output.answer import Answer
from thermocorr.output.axes import labelled
from thermocorr.output.html import number
from thermocorr.output.report import digits_down_to, report_text
from thermocorr.output.style import PALETTE, css, svg_of
from thermocorr.output.words import aspect_text, ends_text, interval_text, parameters_text, place_text, plain
from thermocorr.records.numbers import scale_of, unit_text

TEMPLATES = Path(thermocorr.output.__file__).parent / "templates"

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


@pytest.mark.parametrize("path", sorted(TEMPLATES.glob("*.html")), ids=lambda path: path.name)
def test_no_template_trusts_what_it_is_given(path):
    assert not re.search(r"\|\s*safe\b|autoescape", path.read_text(encoding="utf-8"))


# ---- units


def test_a_number_of_a_page_has_the_unit_that_suits_it_and_keeps_its_value():
    assert number(6.2e-05, "mV") == '<data value="6.2e-05" class="n">62.00\u00a0nV</data>'
    scale = scale_of([0.0014, 0.00013], "mV")
    assert labelled("rms", scale.unit) == "rms [\u00b5V]"
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


# ---- what speaks against the correction


def test_a_page_says_where_the_correction_leaves_the_readings_or_adds_noise():
    record = make_record(4000, seed=1)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["30 s", "10 min"]).fit(X, y)

    def leads(fitted, seen):
        page = report_text(fitted, seen, y, Answer())
        return re.findall('<p class="lead">(.*?)</p>', page.split("<main>")[0])

    assert leads(model, X) == []
    left, louder = leads(model, X + 30.0)
    assert left.startswith("The corrected readings have a mean of ") and "the correction adds noise" in louder
    elsewhere = DynamicBiasRegressor("temperature", ["10 min"], reference_temperature=60.0).fit(X, y)
    assert leads(elsewhere, X) == []  # asked for


# ---- pictures


def test_a_figure_is_one_element_without_style_script_or_address_in_the_colours_of_its_page():
    from matplotlib.figure import Figure

    def drawn():
        figure = Figure(figsize=(3, 2))
        ax = figure.subplots()
        ax.plot([0.123456, 1.0], [0.0, 2.0], color=PALETTE["blue"][0], label="<script>alert(1)</script>")
        ax.legend()
        return svg_of(figure, "a &quot;b&quot;")

    text = drawn()
    assert text == drawn() and text.startswith('<svg class="picture" role="img" aria-label="a &quot;b&quot;" viewBox')
    assert not re.search(r"<style|style=|<script|<metadata|\bon\w+=", text)
    assert set(re.findall(r'https?://[^"]*', text)) == {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert "var(--blue)" in text and not re.search(r"\"#[0-9a-f]{6}\"", re.sub("#000000|#cccccc", "", text))
    assert len(set(re.findall(r'id="([0-9a-f]{8})-', text))) == 1  # two pictures on one page have no id in common
    assert all(f"--{name}:" in css() for name in PALETTE)


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
    assert parameters_text(effect, start, "degF") == dated
    assert parameters_text(effect, None, "degF") == undated


def test_a_coefficient_has_digits_down_to_its_standard_error():
    """U0 was 10.0000 with an error of 2.57e-8."""
    assert plain(10.0000068, digits_down_to(2.57e-8, 10.0000068)) == "10.000006800"
    assert plain(1.23456789, digits_down_to(0.1, 1.23456789)) == "1.23457"
    assert {digits_down_to(error, 1.0) for error in (0.0, np.nan, np.inf)} == {6}


def test_sentences_have_the_signs_of_print_and_no_rounding_of_zero():
    """uV stood besides µV, degF² besides °F, and a range began at -3.253e-17."""
    assert unit_text("uohm/degF^2") == "µΩ/°F²" and unit_text("V*degC") == "V*°C"
    place = pd.Series({"aspect": "rate", "unit": "K/h", "low": -3.253e-17, "high": 0.2})
    assert ends_text(place) == ("0", "0.2")
