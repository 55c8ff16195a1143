"""Diagnosis and refinement: a small part of `benchmarks/hidden_effects.py`, on seeds that served for no tuning."""

import pickle
import re

import numpy as np
import pytest
from sklearn.preprocessing import SplineTransformer

from thermocorr import DynamicBiasRegressor, RecordError, compare_variants, diagnose, refine
from thermocorr.datasets import load_voltage_reference, make_record
from thermocorr.displays import WhereDisplay
from thermocorr.effects import Covariate, Effect, Hysteresis
from thermocorr.effects.protocol import EffectInfo
from thermocorr.effects.wrap import TransformerEffect
from thermocorr.firmware import export_c
from thermocorr.output.words import aspect_text, each_row, place_text

N = 10_000


def hidden(effects, seed, **more):
    record = make_record(N, effects=effects, seed=seed, **more)
    X, y = record.drop(columns="reading"), record["reading"]
    return DynamicBiasRegressor("temperature").fit(X, y), X, y


@pytest.mark.newest
def test_refinement_removes_the_built_in_moisture():
    record = load_voltage_reference(hidden="moisture")[::4]
    X, y = record.drop(columns="voltage"), record["voltage"]
    result = refine(DynamicBiasRegressor("temperature"), X, y)
    assert result.steps["effect"].tolist()[:2] == ["", "lagged covariate: humidity"]
    assert result.steps["held_out_rms"].iloc[-1] < 0.75 * result.steps["held_out_rms"][0]
    left = result.diagnoses[-1].left  # of a quarter of the rows, in which fast lags are hardly to be seen
    assert not result.diagnoses[-1].causes and (not left.structured or left.matters_from > 50)
    assert result.model_.residual_std_ < 1.03 * record.attrs.get("noise", 5.85e-5)
    assert "lagged covariate: humidity" in str(result)
    assert "later [dB]" in str(result).splitlines()[0] and " db " not in str(result)


def test_no_cause_is_its_own_rival():
    """The spectrum of lags, in which a column helps later data most, is a form of what was found, no rival of it."""
    record = make_record(3000, effects={"lagged_covariate": 3.0}, seed=4)
    X, y = record[["temperature", "humidity"]], record["reading"]
    found = diagnose(compare_variants(X, y, temperature="temperature").models["dynamic linear"], X, y)
    assert found.best.kind == "lagged_covariate" and len(found.best.time_constants) > 1
    assert found.verdict == "missing"


def test_an_excluded_kind_or_column_is_not_named():
    model, X, y = hidden({"hysteresis": 2.0}, 63)
    found = diagnose(model, X, y, exclude=["hysteresis"])
    assert "hysteresis" not in set(found.ranking["kind"])
    named = diagnose(model, X, y, columns=["humidity"])
    assert set(named.ranking["column"].dropna()) <= {"humidity"}
    with pytest.raises(ValueError, match="no kinds"):
        diagnose(model, X, y, exclude=["hysteresys"])


def test_the_place_of_a_hinge_is_found():
    record = make_record(N, effects={"hinge": 2.0}, seed=64)
    X, y = record.drop(columns="reading"), record["reading"]
    where = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y).where
    assert {"time", "temperature", "hour", "rate", "column"} <= set(where["aspect"])
    assert "humidity" in set(where["column"]) and (where["low"] <= where["high"]).all()
    parts = where[where["aspect"] == "temperature"]
    assert parts["share"].sum() == pytest.approx(1.0, abs=1e-6)
    assert parts["n"].sum() == N


@pytest.mark.newest
@pytest.mark.parametrize("n", [6000, 27_000])
def test_the_rms_of_a_place_is_that_of_single_readings(n):
    """Ranges of temperature together have the rms residual, whether rows or averages are judged; each has its own."""
    record = make_record(n, effects={"hysteresis": 1.0}, seed=65)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["10 min"], degree=1).fit(X, y)
    found = diagnose(model, X, y)
    for _, parts in found.where[found.where["aspect"].isin(["temperature", "rate"])].groupby("aspect"):
        together = np.sqrt(np.average(parts["rms"] ** 2, weights=parts["n"]))
        assert together == pytest.approx(found.residual_rms, rel=1e-9)
    residual = model.residuals(X, y)
    for row in each_row(found.where[found.where["aspect"] == "temperature"]):
        inside = residual[X["temperature"].between(row.low, row.high)]
        assert row.rms == pytest.approx(np.sqrt(np.mean(inside**2)), rel=0.08)  # averages near an end are in one of two
    assert (found.where["share"] >= 0).all()


def test_the_residual_is_held_against_white_noise():
    """A slow cause lifts long averaging times; the noise of short ones is white: within four standard deviations."""
    table = diagnose(*hidden({"lagged_covariate": 2.0}, 62)).allan
    assert table["excess"].iloc[0] == pytest.approx(1.0, abs=0.2)
    assert table["excess"].max() > 2
    clean = diagnose(*hidden(None, 51)).allan
    assert clean["excess"].iloc[:6].to_numpy() == pytest.approx(1.0, abs=0.25)
    assert clean["white"].to_numpy() == pytest.approx(
        clean["white"].iloc[0] * np.sqrt(clean["averaging_time"].iloc[0] / clean["averaging_time"]), rel=1e-12
    )


@pytest.mark.newest
def test_a_model_fitted_on_the_temperature_alone_is_judged_on_all_columns():
    record = make_record(N, effects={"covariate": 2.0}, seed=61)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor().fit(X[["temperature"]], y)
    found = diagnose(model, X, y)
    assert found.best.kind == "covariate"
    assert refine(model, X, y, max_steps=1).model_.predict(X).shape == (N,)
    assert repr(found) == str(found)
    assert max(map(len, str(found).splitlines())) <= 110


def test_too_short_a_record_is_not_judged():
    record = make_record(90, seed=1)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", [600.0]).fit(X, y)
    with pytest.raises(RecordError, match="too short to judge: 90 readings"):
        diagnose(model, X, y)


class Cubed(Effect):
    """What a user writes: the cube of a recorded column."""

    kind = "cubed"

    def __init__(self, column="supply"):
        self.column = column

    @classmethod
    def candidates(cls, record, columns=None):
        return [cls("supply"), cls("humidity")]

    def inputs(self):
        return [self.column]

    def names(self):
        return [f"{self.column}^3"]

    def columns(self, block, state):
        return (block[self.column] - 5.0) ** 3 * 1e6, state


def with_cube():
    record = make_record(N, seed=71)
    cube = ((record["supply"] - 5.0) ** 3).to_numpy()
    X, y = record.drop(columns="reading"), record["reading"] + 0.5 * cube / cube.std()
    return DynamicBiasRegressor("temperature").fit(X, y), X, y


@pytest.mark.newest
@pytest.mark.parametrize("suspect", [Cubed("supply"), Cubed])
def test_a_users_own_suspect_is_named_and_added(suspect):
    model, X, y = with_cube()
    found = diagnose(model, X, y, suspects=[suspect])
    assert isinstance(found.best, Cubed) and found.best.column == "supply"
    result = refine(model, X, y, suspects=[suspect], max_steps=1)
    assert result.steps["held_out_rms"].iloc[-1] < 0.75 * result.steps["held_out_rms"][0]


def test_a_transformer_can_be_a_suspect():
    model, X, y = with_cube()
    spline = TransformerEffect(SplineTransformer(n_knots=4, include_bias=False), ["supply"])
    found = diagnose(model, X, y, suspects=[spline], exclude=["covariate", "lagged_covariate", "interaction"])
    assert found.best.kind == "transformer"
    assert found.ranking["column"][0] == "supply"


def test_refinement_can_be_stopped_and_keeps_what_it_has():
    model, X, y = hidden({"hysteresis": 2.0}, 63)

    def stop(text):
        if "step 1" in text:
            raise KeyboardInterrupt

    result = refine(model, X, y, progress=stop)
    assert len(result.steps) == 1
    assert result.model_.predict(X).shape == (N,)


class Fan(Covariate):
    """A user's own kind."""

    kind = "fan"
    info = EffectInfo("A fan blows.", "Stop the fan.", "its speed")


def test_a_suspect_is_one_object_everywhere():
    """On the printed page, in HTML and in the table; columns may be called as other aspects are."""
    record, truth = make_record(N, effects={"covariate": 2.0}, seed=70, return_truth=True)
    guilty = next(iter(truth.attrs["effects"].values()))["parameters"]["column"]
    innocent = next(name for name in ("pressure", "supply", "humidity") if name != guilty)
    X = record.drop(columns="reading").rename(columns={guilty: "time", innocent: "frequency"})
    y = record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y, suspects=[Fan("time")], exclude=["covariate", "lagged_covariate"])
    assert found.best.kind == "fan" and found.suspects[0].effect.info.bench_check == "Stop the fan."
    assert found.ranking["label"][0] == "fan: time" == found.best.label()
    html = found.to_html()
    assert "Stop the fan." in str(found) and "Stop the fan." in html and "A fan blows." in html
    columns = found.where[found.where["aspect"] == "column"]
    assert {"time", "frequency"} <= set(columns["column"]) and columns["high"].max() < 1e5


def test_the_temperature_is_called_by_the_name_of_its_column():
    """In text, page and picture; the table keeps its aspect `temperature`, and arrays have no names."""
    record = make_record(3000, effects={"hinge": 6.0}, seed=64).rename(columns={"temperature": "oven"})
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("oven", ["10 min"]).fit(X, y), X, y)
    of_oven = found.where[found.where["aspect"] == "temperature"]
    assert set(of_oven["column"]) == {"oven"}
    words = [text for text in (str(found), found.to_html()) if "where temperature is" in text]
    assert not words and place_text(next(each_row(of_oven))).startswith("where oven is ")
    assert "<td>oven</td>" in found.to_html() and "<td>temperature</td>" not in found.to_html()
    assert "oven" in set(WhereDisplay.from_diagnosis(found, X).frame()["condition"])
    array = np.asarray(X[["oven"]])
    bare = diagnose(DynamicBiasRegressor(0, [60.0]).fit(array, y.to_numpy()), array, y.to_numpy())
    assert "temperature" in {aspect_text(row) for row in each_row(bare.where)}


def test_differences_of_temperatures_in_degf_are_said_in_degf(tmp_path):
    """No K stands where the record has none."""
    record = make_record(5000, effects={"hysteresis": 2.0}, seed=1)
    X, y = (record[["temperature"]] * 1.8 + 32).rename(columns={"temperature": "case [degF]"}), record["reading"]
    model = DynamicBiasRegressor("case [degF]", ["10 min"], degree=1).fit(X, y)
    found = diagnose(model, X, y)
    assert isinstance(found.best, Hysteresis)
    rows = {row.aspect: row for row in each_row(found.where)}
    assert aspect_text(rows["rate"]) == "rate [\u00b0F/h]"
    assert aspect_text(rows["lag difference"]) == "lag difference, 10 min [\u00b0F]"
    told = model.with_effect(found.best).fit(X, y)
    html = found.to_html()
    cells = re.findall(r"<(?:td|p)>(.*?)</(?:td|p)>", html, flags=re.S)
    for text in (str(found), told.equation(), str(told.coef_table()), *cells):
        assert not re.search(r"(?<![A-Za-z])K(?![A-Za-z])", text)
    assert " degF" in export_c(told, tmp_path).paths[0].read_text()
    assert f"width {found.best.width:.3f} \u00b0F" in html and "rate [\u00b0F/h]" in " ".join(cells)
    assert "degF" not in re.sub(r"<(pre|script).*?</\1>", "", html, flags=re.S).replace("case [degF]", "")


def test_a_pickled_diagnosis_is_small():
    found = diagnose(*hidden({"hysteresis": 2.0}, 62))
    assert found.record is not None
    content = pickle.dumps(found)
    copy = pickle.loads(content)
    assert len(content) < 100_000 and str(copy) == str(found)
    with pytest.raises(ValueError, match="holds no record"):
        copy.to_html()
