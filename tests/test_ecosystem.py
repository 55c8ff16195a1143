"""Other people's tools: skops, cloudpickle, joblib, scikit-learn's output settings, polars."""

import io
import pickle
import sys

import joblib
import numpy as np
import pandas as pd
import pytest
import sklearn
from effect_records import EXAMPLES, NAMES, log
from sklearn.base import clone
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import SplineTransformer, StandardScaler

from thermocorr import (
    DiffusiveFeatures,
    DynamicBiasRegressor,
    OnlineCorrector,
    RecordError,
    TimeConstantSearch,
    compare_variants,
    diagnose,
)
from thermocorr.effects import Covariate
from thermocorr.model import MergedRidge


@pytest.fixture(scope="module")
def lab():
    X = log(1200, seed=2)
    return X, (X["temperature"] + np.random.default_rng(0).normal(0, 0.1, len(X))).rename("reading")


@pytest.fixture(scope="module")
def model(lab):
    return DynamicBiasRegressor(time_constants=[300.0, 7200.0]).fit(*lab)


def through_skops(estimator):
    """There and back, trusting nothing but this package's own classes."""
    sio = pytest.importorskip("skops.io", reason="skops is not installed: pip install skops")
    stored = sio.dumps(estimator)
    unknown = sio.get_untrusted_types(data=stored)
    assert all(name.startswith("thermocorr.") for name in unknown)
    return sio.loads(stored, trusted=unknown)


def through_cloudpickle(estimator):
    cloudpickle = pytest.importorskip("cloudpickle", reason="cloudpickle is not installed: pip install cloudpickle")
    return pickle.loads(cloudpickle.dumps(estimator))


def through_joblib(estimator):
    buffer = io.BytesIO()
    joblib.dump(estimator, buffer, compress=3)
    buffer.seek(0)
    return joblib.load(buffer)


WAYS = [through_skops, through_cloudpickle, through_joblib]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
def test_every_kind_survives(way, effect, lab):
    X, y = lab
    model = DynamicBiasRegressor(time_constants=[300.0]).with_effect(effect).fit(X[:900], y[:900])
    again = way(model)
    np.testing.assert_array_equal(again.predict(X[900:]), model.predict(X[900:]))
    pd.testing.assert_frame_equal(again.coef_table(), model.coef_table())


@pytest.mark.parametrize("way", WAYS)
def test_other_estimators_survive(way, lab, model):
    X, y = lab
    features = DiffusiveFeatures([300.0], degree=2, products=True).fit(X)
    np.testing.assert_array_equal(way(features).transform(X), features.transform(X))
    ridge = MergedRidge(1e-3).fit(features.transform(X), y)
    np.testing.assert_array_equal(way(ridge).predict(features.transform(X)), ridge.predict(features.transform(X)))
    searched = DynamicBiasRegressor(time_constants=2).fit(X, y)
    again = way(searched)
    np.testing.assert_array_equal(again.predict(X), searched.predict(X))
    np.testing.assert_array_equal(again.search_.time_constants, searched.search_.time_constants)


@pytest.mark.parametrize("way", [through_cloudpickle, through_joblib])
def test_searches_survive(way, lab):
    search = TimeConstantSearch(candidates=[["5 min"], ["1 h"]]).fit(*lab)
    again = way(search)
    assert again.best_params_ == search.best_params_
    np.testing.assert_array_equal(again.predict(lab[0]), search.predict(lab[0]))


def test_a_searched_model_does_not_carry_its_record_twice(lab):
    """A model keeps the record once, in its history; what the search worked on goes when it is done."""
    X, y = lab
    searched = DynamicBiasRegressor(time_constants=2).fit(X, y)
    given = DynamicBiasRegressor(time_constants=searched.time_constants_).fit(X, y)
    size = len(pickle.dumps(searched)) - len(pickle.dumps(given))
    assert size < X["temperature"].to_numpy().nbytes


@pytest.mark.parametrize("kind", ["pandas", "polars"])
def test_output_settings(kind, lab, model):
    X, y = lab
    frames = pytest.importorskip(kind, reason=f"{kind} is not installed")
    plain = DiffusiveFeatures([300.0]).fit_transform(X)
    with sklearn.config_context(transform_output=kind):
        features = DiffusiveFeatures([300.0])
        for columns in (features.fit_transform(X), features.transform(X)):
            assert isinstance(columns, frames.DataFrame)
            assert list(columns.columns) == list(features.get_feature_names_out())
            np.testing.assert_array_equal(columns.to_numpy(), plain)
        again = clone(model).fit(X, y)
        np.testing.assert_array_equal(again.predict(X), model.predict(X))
        np.testing.assert_allclose(again.pipeline_.predict(X), model.predict(X), rtol=1e-13)
        pipeline = make_pipeline(DiffusiveFeatures([300.0, 7200.0]), StandardScaler(), Ridge(1e-6)).fit(X, y)
        assert pipeline.score(X, y) > 0.9
        spline = DynamicBiasRegressor(time_constants=[300.0], effects=[SplineTransformer(3)]).fit(X, y)
    expected = DynamicBiasRegressor(time_constants=[300.0], effects=[SplineTransformer(3)]).fit(X, y)
    np.testing.assert_array_equal(spline.predict(X), expected.predict(X))


@pytest.fixture(scope="module")
def polars(lab):
    """The lab's log as a polars frame with a column of dates, and its readings."""
    pl = pytest.importorskip("polars", reason="polars is not installed: pip install polars")
    X, y = lab
    frame = pl.DataFrame({"time": X.index.to_numpy(), **{name: X[name].to_numpy() for name in X}})
    return pl, frame, pl.Series("reading", y.to_numpy())


def test_a_polars_frame_is_as_good_as_a_pandas_one(lab, polars):
    X, y = lab
    pl, frame, readings = polars
    model = DynamicBiasRegressor(time_constants=[300.0, 7200.0]).fit(X[:900], y[:900])
    other = DynamicBiasRegressor(time_constants=[300.0, 7200.0], time="time").fit(frame[:900], readings[:900])
    for rows in (slice(0, 900), slice(900, 1200), slice(200, 300)):
        np.testing.assert_array_equal(other.predict(frame[rows]), model.predict(X[rows]))
        np.testing.assert_array_equal(other.correct(frame[rows], readings[rows]), model.correct(X[rows], y[rows]))
        np.testing.assert_array_equal(other.flags(frame[rows]), model.flags(X[rows]))
        evaluated = other.evaluate(frame[rows], readings[rows])
        np.testing.assert_array_equal(evaluated["residual"], model.evaluate(X[rows], y[rows])["residual"])
    assert other.reading_.name == "reading" and list(other.feature_names_in_) == ["time", "temperature", "humidity"]
    frame_y = pl.DataFrame({"reading": readings})
    again = clone(other).fit(frame[:900], frame_y[:900])
    np.testing.assert_array_equal(again.predict(frame), other.predict(frame))
    live = OnlineCorrector(other).update_many(frame[900:], readings[900:])
    np.testing.assert_array_equal(live["corrected"], model.correct(X[900:], y[900:]))


@pytest.mark.parametrize("output", ["default", "pandas", "polars"])
def test_features_of_a_polars_frame(lab, polars, output):
    pl, frame, _ = polars
    features = DiffusiveFeatures([300.0], time="time").set_output(transform=output)
    columns = features.fit_transform(frame)
    assert type(columns) is {"default": np.ndarray, "pandas": pd.DataFrame, "polars": pl.DataFrame}[output]
    expected = DiffusiveFeatures([300.0]).fit_transform(lab[0])
    np.testing.assert_array_equal(np.asarray(columns), expected)
    np.testing.assert_array_equal(np.asarray(features.transform(frame)), expected)


def test_polars_zones_spans_nulls_and_text(lab, polars):
    pl, frame, readings = polars
    zoned = frame.with_columns(pl.col("time").dt.replace_time_zone("Europe/Berlin"))
    model = DynamicBiasRegressor(time_constants=[300.0], time="time").fit(zoned[:900], readings[:900])
    assert model.features_.history_.kind == "datetime with time zone"
    expected = lab[0].tz_localize("Europe/Berlin").index[0].tz_convert("UTC").tz_localize(None)
    assert model.features_.history_.zero == expected.value
    spans = frame.with_columns(pl.col("time") - pl.col("time").first())
    assert DiffusiveFeatures([300.0], time="time").fit(spans).history_.kind == "timedelta"
    holes = frame.with_columns(
        pl.when(pl.int_range(pl.len()) == 5).then(None).otherwise("temperature").alias("temperature")
    )
    columns = DiffusiveFeatures([300.0], time="time").fit_transform(holes)
    assert np.flatnonzero(np.isnan(columns).any(axis=1)).tolist() == [5]
    runs = frame.with_columns(run=pl.when(pl.int_range(pl.len()) < 600).then(pl.lit("a")).otherwise(pl.lit("b")))
    assert len(DiffusiveFeatures([300.0], time="time", run="run").fit(runs).history_.record.segments) == 2
    with pytest.raises(RecordError, match="no temperature 'oven'"):
        DiffusiveFeatures([300.0], temperature="oven").fit(frame)


def test_search_comparison_and_diagnosis_take_polars_frames(lab, polars):
    X, y = lab
    _, frame, readings = polars
    search = TimeConstantSearch(DynamicBiasRegressor(time="time"), candidates=[["5 min"], ["1 h"]]).fit(frame, readings)
    expected = TimeConstantSearch(candidates=[["5 min"], ["1 h"]]).fit(X, y)
    assert search.best_params_ == expected.best_params_
    model = DynamicBiasRegressor(time_constants=[300.0])
    table = compare_variants(frame, readings, model=clone(model).set_params(time="time")).frame()
    pd.testing.assert_frame_equal(table, compare_variants(X, y, model=model).frame())
    found = diagnose(clone(model).set_params(time="time").fit(frame, readings), frame, readings)
    assert str(found.verdict) == str(diagnose(model.fit(X, y), X, y).verdict)


@pytest.mark.parametrize("kind", ["pyarrow", "duckdb", "polars.lazy"])
def test_tables_of_other_packages(lab, kind):
    X, y = lab
    pytest.importorskip("narwhals", reason="narwhals is not installed: pip install '.[frames]'")
    package = pytest.importorskip(kind.split(".")[0], reason=f"{kind} is not installed: pip install '.[test]'")
    frame = pd.DataFrame({"time": X.index, **{name: X[name].to_numpy() for name in X}, "reading": y.to_numpy()})
    frame.loc[5, "humidity"] = np.nan
    if kind == "pyarrow":
        table = package.Table.from_pandas(frame)
    else:
        table = package.from_df(frame) if kind == "duckdb" else package.from_pandas(frame).lazy()
    model = DynamicBiasRegressor("temperature", [300.0, 7200.0], time="time", effects=[Covariate("humidity")])
    expected = clone(model).fit(frame, y.to_numpy())
    found = clone(model).fit(table, y.to_numpy())
    np.testing.assert_array_equal(found.coef_, expected.coef_)
    np.testing.assert_array_equal(found.predict(table), expected.predict(frame))
    np.testing.assert_array_equal(
        OnlineCorrector(found).update_many(table, y.to_numpy())["corrected"], expected.correct(frame, y.to_numpy())
    )
    assert str(diagnose(found, table, y.to_numpy()).verdict) == str(diagnose(expected, frame, y.to_numpy()).verdict)


def test_a_table_that_nobody_can_read_says_what_is_needed(lab, monkeypatch):
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install '.[parquet]'")
    monkeypatch.setitem(sys.modules, "narwhals", None)
    with pytest.raises(RecordError, match=r"a table of pyarrow, for which the package narwhals is needed"):
        DynamicBiasRegressor(time="time").fit(pyarrow.table({"time": [1.0]}), lab[1])
