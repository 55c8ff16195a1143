"""Numbers with units as a person reads them, against texts written by hand and the numbers themselves.

Also: Later data that state the unit of their temperature, for models whose record did or did not.
"""

import math
import re
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.firmware import export_c
from thermocorr.output.answer import Answer
from thermocorr.output.model_file import load, save
from thermocorr.output.report import report_text
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
    unit_text,
)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.00097, "ohm", "0.97 mΩ"), (0.00097, "Ohm", "0.97 mOhm"), (3.1e-5, "V", "31 µV"), (-3.1e-5, "V", "-31 µV"),
        (0.00097, "mV", "0.97 µV"), (0.05, "mV", "50 µV"), (20_000.0, "mV", "20 V"), (103.957, "mV", "104 mV"),
        (1234.5, "mV", "1234 mV"), (1.5e5, "ohm", "150 kΩ"), (1013.2, "hPa", "1013 hPa"), (0.002, "hPa", "0.2 Pa"),
        (12_345.0, "g", "12.3 kg"), (123_456.0, "kg", "123456 kg"), (4.2e-6, "mV/K", "4.2 nV/K"),
        (3e-6, "V/(K^2)", "3 µV/(K²)"), (1e-7, "\u00b5V", "0.1 pV"), (2e-4, "\u03a9", "0.2 m\u03a9"),
        (55_800.0, "s", "55800 s"), (2e-7, "s", "0.2 µs"), (0.0, "V", "0 V"), (math.nan, "V", UNKNOWN),
        (math.inf, "V", "inf V"), (1e-5, "ppm", "1e-05 ppm"), (2e-5, "K", "2e-05 K"),
        (2e-5, "degC", "2e-05 °C"), (2e-5, "%", "2e-05 %"),
        (1e-5, "m3/m3", "1e-05 m3/m3"), (2e-4, "V^2", "0.0002 V²"), (1e-4, "pH", "0.0001 pH"),
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
        (0.0002, "200 µs"), (0, "0 s"), (-90, "-1.5 min"), (math.nan, UNKNOWN), (math.inf, "inf s"), (1e12, "31688 y"),
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
    factor = next((10.0**step.power for step in prefixed(unit) if unit_text(step.unit) == shown), 1.0)
    assert float(number) * factor == pytest.approx(value, rel=5.001e-4)


@given(st.floats(1e-8, 1e12))
def test_no_more_of_a_span_is_lost_than_the_digits_say(seconds):
    number, unit = span_text(seconds, 4).split()
    assert float(number) * SPANS[unit.replace("µ", "u")] == pytest.approx(seconds, rel=5.001e-4)
    assert float(number) >= 1 or unit == "ns"


@given(st.lists(st.floats(1e-3, 1e8), min_size=1, max_size=4), st.sampled_from(["mV", "ppm"]))
def test_what_is_compared_has_one_unit(values, unit):
    assert len({text.split()[1] for text in quantity_texts(values, unit)}) == 1
    assert unit_text(scale_of(values, unit).unit) == quantity_texts(values, unit)[0].split()[1]


def test_what_differs_is_told_apart():
    assert span_texts([3600, 3605]) == ["1 h", "1.001 h"] and span_texts([6000, 6001]) == ["1.6667 h", "1.6669 h"]
    assert quantity_texts([0.0011912, 0.0011913], "mV") == ["1.1912 µV", "1.1913 µV"]
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


TO = {"degC": lambda T: T, "degF": lambda T: 1.8 * T + 32.0, "K": lambda T: T + 273.15}
N = 1200


@pytest.fixture(scope="module")
def record():
    return make_record(N, seed=4, start="2024-03-04")[["temperature", "reading"]]


def stated(record, unit, said, shift=0.0):
    """The record in a unit, which it states as another one, or not at all ("")."""
    X = record[["temperature"]].assign(temperature=TO[unit](record["temperature"] + shift))
    X.attrs = {"units": {"temperature": said}} if said else {}
    return X


CASES = {
    "degF for degF that was not named": ("degF", "", "degF", 0.0, "By their values they are degF too"),
    "degC for degC that was not named": ("degC", "", "degC", 0.0, ""),
    "no unit for none": ("degF", "", "", 0.0, ""),
    "degF for degC that was not named": ("degC", "", "degF", 0.0, "names no unit .*by the values they are. Convert"),
    "degC for degF that was not named": ("degF", "", "degC", 0.0, "look like degF. Convert this column to degF"),
    "frost in degF, room in degC not named": ("degC", "", "degF", -30.0, "do not tell .* fit again with the unit"),
    "cold rooms in degF, not named": ("degF", "", "degF", -20.0, "do not tell .* fit again with the unit"),
    "degF for degC that was named": ("degC", "degC", "degF", 0.0, "is in degF, and the model was fitted to .* in degC"),
    "kelvin for degC that was not named": ("degC", "", "K", 0.0, "is in K, .* Convert this column to degC"),
}


@pytest.mark.parametrize("way", ["predict", "a saved model", "a block of a stream", "the command"])
@pytest.mark.parametrize("case", CASES)
def test_a_stated_unit_is_compared_with_the_fitted_one(way, case, record, tmp_path, capsys):
    unit, said_then, said_now, shift, words = CASES[case]
    fitted = stated(record, unit, said_then, shift if "cold" in case else 0.0)
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(fitted, record["reading"])
    later = stated(record, said_now or unit, said_now, shift)
    if way in ("a saved model", "the command"):
        save(model, tmp_path / "model.json")
        model = load(tmp_path / "model.json")
    noted, refused = "too" in words, words and "too" not in words
    if way == "the command":
        log = later.assign(reading=record["reading"])
        header, rows = log.to_csv(index_label="time").split("\n", 1)
        sign = {"degC": "°C", "degF": "°F", "": ""}.get(said_now, said_now)
        (tmp_path / "log.csv").write_text(
            f"{header}\n,{sign},\n{rows}" if sign else f"{header}\n{rows}", encoding="utf-8"
        )
        status = main(["correct", str(tmp_path / "log.csv"), "--model", str(tmp_path / "model.json")])
        shown = capsys.readouterr()
        assert status == (2 if refused else 0)
        assert not refused or re.search(words, shown.err)
        assert shown.err.count("By their values they are degF too") == noted
        return

    def ask():
        if way == "a block of a stream":
            return OnlineCorrector(model).update_many(later, record["reading"])["bias"]
        return model.predict(later)

    if refused:
        with pytest.raises(RecordError, match=words):
            ask()
        return
    with pytest.warns(RecordWarning, match=words) if noted else warnings.catch_warnings():
        if not noted:
            warnings.simplefilter("error")
        assert np.isfinite(ask()).all()


@pytest.mark.parametrize("way", ["predict", "a block of a stream", "the command"])
@pytest.mark.parametrize("median", [0.0, -3.5, -8.5, -20.0, 45.0])
def test_what_is_colder_or_warmer_in_the_unit_that_was_taken_is_accepted(median, way, record, tmp_path, capsys):
    """Rooms of about 22 were fitted: no temperatures in degF, whatever the later ones would be in it."""
    model = DynamicBiasRegressor("temperature", ["5 min"]).fit(stated(record, "degC", ""), record["reading"])
    later = stated(record, "degC", "degC", median - record["temperature"].median())
    if way == "predict":
        assert np.isfinite(model.predict(later)).all()
    elif way == "a block of a stream":
        assert np.isfinite(OnlineCorrector(model).update_many(later, record["reading"])["bias"]).all()
    else:
        save(model, tmp_path / "model.json")
        log = later.rename(columns={"temperature": "temperature [°C]"}).assign(reading=record["reading"])
        log.to_csv(tmp_path / "log.csv", index_label="time")
        named = ["--model", str(tmp_path / "model.json"), "--temperature", "temperature [°C]"]
        assert main(["correct", str(tmp_path / "log.csv"), *named]) == 0
        assert len(capsys.readouterr().out.splitlines()) == 1 + N


def test_a_unit_that_the_header_names_is_one_that_is_known(record):
    X = stated(record, "degF", "").rename(columns={"temperature": "T [°F]"})
    reading = DynamicBiasRegressor("T [°F]", ["5 min"]).fit(X, record["reading"]).reading_
    assert (reading.temperature_unit, reading.unit_named) == ("degF", True)
    bare = DynamicBiasRegressor("T", ["5 min"]).fit(X.set_axis(["T"], axis=1), record["reading"]).reading_
    assert (bare.temperature_unit, bare.unit_named) == ("degC", False)


@pytest.mark.parametrize("named", [True, False])
def test_page_and_export_say_that_a_unit_was_taken_by_its_size(named, record, tmp_path):
    X = stated(record, "degC", "degC" if named else "")
    model = DynamicBiasRegressor("temperature", ["5 min"]).fit(X, record["reading"])
    page = report_text(model, X, record["reading"], Answer())
    assert ("name no unit of &#39;temperature&#39;: °C is assumed" in page) != named
    export_c(model, tmp_path / "bias", name="bias")
    line = next(line for line in (tmp_path / "bias" / "bias.h").read_text().splitlines() if "Temperature: " in line)
    assert " degC" in line and ("the record named none" in line) != named
