"""Numbers with units as a person reads them, against texts written by hand and the numbers themselves."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from thermocorr.records.numbers import (
    SPANS,
    UNKNOWN,
    number_text,
    prefix_and_unit,
    prefixed,
    quantity_text,
    quantity_texts,
    scale_of,
    span_text,
    span_texts,
    span_unit,
)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.00097, "ohm", "0.97 mohm"), (0.00097, "Ohm", "0.97 mOhm"), (3.1e-5, "V", "31 uV"), (-3.1e-5, "V", "-31 uV"),
        (0.00097, "mV", "0.97 uV"), (0.05, "mV", "50 uV"), (20_000.0, "mV", "20 V"), (103.957, "mV", "104 mV"),
        (1234.5, "mV", "1234 mV"), (1.5e5, "ohm", "150 kohm"), (1013.2, "hPa", "1013 hPa"), (0.002, "hPa", "0.2 Pa"),
        (12_345.0, "g", "12.3 kg"), (123_456.0, "kg", "123456 kg"), (4.2e-6, "mV/K", "4.2 nV/K"),
        (3e-6, "V/(K^2)", "3 uV/(K^2)"), (1e-7, "\u00b5V", "0.1 pV"), (2e-4, "\u03a9", "0.2 m\u03a9"),
        (55_800.0, "s", "55800 s"), (2e-7, "s", "0.2 us"), (0.0, "V", "0 V"), (math.nan, "V", UNKNOWN),
        (math.inf, "V", "inf V"), (1e-5, "ppm", "1e-05 ppm"), (2e-5, "K", "2e-05 K"),
        (2e-5, "degC", "2e-05 degC"), (2e-5, "%", "2e-05 %"),
        (1e-5, "m3/m3", "1e-05 m3/m3"), (2e-4, "V^2", "0.0002 V^2"), (1e-4, "pH", "0.0001 pH"),
        (0.00025, "", "0.00025"),
        (1e-5, "furlong", "1e-05 furlong"), (1e-20, "V", "1e-05 fV"), (9.9999e-8, "V", "100 nV"),
    ],
)  # fmt: skip
def test_a_quantity_has_the_prefix_that_suits_it(value, unit, text):
    assert quantity_text(value, unit) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (900, "15 min"), (55_800, "15.5 h"), (2.77e5, "3.21 d"), (59.97, "1 min"), (3597, "1 h"), (0.02, "20 ms"),
        (0.0002, "200 us"), (0, "0 s"), (-90, "-1.5 min"), (math.nan, UNKNOWN), (math.inf, "inf s"), (1e12, "31688 y"),
    ],
)  # fmt: skip
def test_a_span_has_the_unit_that_suits_it(seconds, text):
    assert span_text(seconds) == text


@given(
    st.floats(-1e9, 1e9).filter(lambda v: abs(v) > 1e-13), st.sampled_from(["mV", "V", "ohm", "uA", "hPa", "kg", "ppm"])
)
def test_no_more_is_lost_than_the_digits_say(value, unit):
    """Read back, a text of four digits is the number to half a unit of the fourth digit."""
    number, shown = quantity_text(value, unit, 4).split()
    factor = next((10.0**step.power for step in prefixed(unit) if step.unit == shown), 1.0)
    assert float(number) * factor == pytest.approx(value, rel=5.001e-4)


@given(st.floats(1e-8, 1e12))
def test_no_more_of_a_span_is_lost_than_the_digits_say(seconds):
    number, unit = span_text(seconds, 4).split()
    assert float(number) * SPANS[unit] == pytest.approx(seconds, rel=5.001e-4)
    assert float(number) >= 1 or unit == "ns"


@given(st.lists(st.floats(1e-3, 1e8), min_size=1, max_size=4), st.sampled_from(["mV", "ppm"]))
def test_what_is_compared_has_one_unit(values, unit):
    assert len({text.split()[1] for text in quantity_texts(values, unit)}) == 1
    assert scale_of(values, unit).unit == quantity_texts(values, unit)[0].split()[1]


def test_what_differs_is_told_apart():
    assert span_texts([3600, 3605]) == ["1 h", "1.001 h"] and span_texts([6000, 6001]) == ["1.6667 h", "1.6669 h"]
    assert quantity_texts([0.0011912, 0.0011913], "mV") == ["1.1912 uV", "1.1913 uV"]
    assert span_texts([600, 600]) == ["10 min", "10 min"]


def test_spans_that_are_far_apart_have_units_of_their_own():
    assert span_texts([15, 1e6]) == ["15 s", "11.6 d"] and span_texts([900, 55_800]) == ["15 min", "930 min"]
    assert span_texts([]) == [] and span_texts([0, 600]) == ["0 min", "10 min"]


def test_the_steps_of_a_unit_are_those_by_which_a_scale_is_chosen():
    """The page's charts choose by `prefixed`: a number from `least` on, and below the next one's, has that unit."""
    for unit in ("V", "mV", "uV", "kohm", "mV/K", "kg"):
        steps = prefixed(unit)
        for step, above in zip(steps, (*steps[1:], None), strict=True):
            for size in (step.least * 1.001, (above.least if above else 1e3 * step.least) * 0.999):
                assert scale_of([size], unit).unit == (unit if 0.1 <= size < 1e4 else step.unit)
    assert prefixed("ppm") == prefixed("K") == prefixed("") == ()


def test_small_helpers():
    assert [number_text(v) for v in (0.06512, 15.5, 84_012.0, math.nan)] == ["0.0651", "15.5", "84012", "-"]
    assert [prefix_and_unit(unit) for unit in ("mV", "m", "pH")] == [("m", "V"), ("", "m"), ("", "pH")]
    assert [span_unit(s) for s in (0.5, 100.0, 3600.0, 86_400.0, 1e7, 1e9)] == ["ms", "s", "min", "h", "d", "y"]
