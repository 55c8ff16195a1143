"""A record that was read once, in the place of the data: the same results, and refusals where it cannot serve."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, RecordError, compare_variants, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate
from thermocorr.records import Layout, Record, read_record
from thermocorr.validation import thermometer_errors

USED = ["temperature", "pressure", "supply", "mains"]


@pytest.fixture(scope="module")
def data():
    frame = make_record(2500, effects={"hysteresis": 2.0}, seed=5).reset_index()
    frame["time"] = frame["time"].dt.strftime("%Y-%m-%d %H:%M:%S")
    frame.loc[700:704, "temperature"] = np.nan
    return frame[["time", *USED]], frame["reading"]


@pytest.fixture(scope="module")
def record(data):
    X, y = data
    return read_record(X, Layout(time="time"), y=y, needed=USED, quiet=True)


@pytest.fixture(scope="module")
def model(data):
    X, y = data
    return DynamicBiasRegressor("temperature", time="time", effects=[Covariate("pressure")]).fit(X, y)


def test_results_are_those_of_the_data(data, record, model):
    X, y = data
    other = DynamicBiasRegressor("temperature", time="time", effects=[Covariate("pressure")]).fit(record, y)
    assert list(other.feature_names_in_) == USED
    for name in ("predict", "bias"):
        np.testing.assert_array_equal(getattr(other, name)(record), getattr(model, name)(X))
    for read in (other, model):  # a record for a model of the data, too
        np.testing.assert_array_equal(read.correct(record, y), model.correct(X, y))
        pd.testing.assert_frame_equal(read.evaluate(record, y).reset_index(drop=True), model.evaluate(X, y))
    np.testing.assert_array_equal(other.uncertainty(record, y).u, model.uncertainty(X, y).u)
    pd.testing.assert_frame_equal(thermometer_errors(other, record), thermometer_errors(model, X))


@pytest.mark.long
@pytest.mark.newest
def test_judgements_are_those_of_the_data(data, record, model):
    X, y = data
    by_data, by_record = diagnose(model, X, y), diagnose(model, record, y)
    assert str(by_record) == str(by_data) and by_data.best.kind == "hysteresis"
    own = [Covariate("pressure")]
    start = DynamicBiasRegressor("temperature", time="time", time_constants=[300.0, 3000.0], effects=own)
    pd.testing.assert_frame_equal(refine(start, record, y).steps, refine(start, X, y).steps)
    options = {"temperature": "temperature", "time": "time", "time_constants": [300.0, 3000.0], "effects": own}
    pd.testing.assert_frame_equal(compare_variants(record, y, **options).table, compare_variants(X, y, **options).table)


def test_columns_that_the_model_was_not_fitted_with_are_suspects(data, record):
    X, y = data
    few = X[["time", "temperature", "pressure"]]
    model = DynamicBiasRegressor("temperature", time="time", effects=[Covariate("pressure")]).fit(few, y)
    by_data, by_record = diagnose(model, X, y), diagnose(model, record, y)
    assert str(by_record) == str(by_data)
    assert {"supply", "mains"} & set(by_record.ranking["column"])
    assert by_record.data.equation == by_data.data.equation and by_record.data.span == by_data.data.span
    assert len(by_record.to_html()) == len(by_data.to_html())


def test_weights_and_masks(data, record):
    X, y = data
    weight, mask = np.linspace(1, 2, len(y)), np.arange(len(y)) < 300
    start = DynamicBiasRegressor("temperature", time="time", time_constants=[300.0], effects=[Covariate("pressure")])
    for given in ({"sample_weight": weight}, {"mask": mask}):
        by_data = start.fit(X, y, **given).coef_
        np.testing.assert_array_equal(start.fit(record, y, **given).coef_, by_data)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (DynamicBiasRegressor("supply"), "was read with 'temperature' as its temperature, the model wants 'supply'"),
        (DynamicBiasRegressor(max_gap=10), "step of 6 min inside a segment, and max_gap is 10 s"),
        (DynamicBiasRegressor(effects=[Covariate("humidity")]), "no column 'humidity' in the record"),
        (DynamicBiasRegressor(effects=[Covariate("pressure")], fill={"pressure": "end"}), "for records in memory"),
    ],
)
def test_what_it_was_not_read_for_is_refused(record, data, model, said):
    with pytest.raises(RecordError, match=said):
        model.fit(record, data[1])


def test_readings_must_be_as_many(record, data):
    with pytest.raises(RecordError, match="X has 2500 rows and y has 2499"):
        DynamicBiasRegressor().fit(record, data[1][:-1])
    assert len(record) == 2500 and isinstance(record, Record)
