"""Later data that state the unit of their temperature, for models whose record did or did not."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.files.model_file import load, save
from thermocorr.firmware import export_c
from thermocorr.pages import Answer, PageData, document

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
    page = document.page(PageData.of(model, X, record["reading"]), Answer())
    assert ("name no unit of &#39;temperature&#39;: its values were taken for °C by their size" in page) != named
    export_c(model, tmp_path / "bias", name="bias")
    line = next(line for line in (tmp_path / "bias" / "bias.h").read_text().splitlines() if "Temperature: " in line)
    assert " degC" in line and ("the record named no unit" in line) != named
