"""`products="auto"`: products of lags are added where they clearly help, and nowhere else."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, ParquetLog, RecordWarning, compare_variants, load_model, save_model
from thermocorr.datasets import make_record

NOISE = 0.2


def split(n, nonlinearity, seed, **options):
    """The first 70 % of a record, the rest, and its noise there."""
    record, truth = make_record(
        n, sampling_period=60.0, noise=NOISE, nonlinearity=nonlinearity, seed=seed, return_truth=True, **options
    )
    X, y, m = record[["temperature"]], record["reading"], int(0.7 * n)
    return X[:m], y[:m], X[m:], y[m:], truth["noise"][m:]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("n", [9_000, 40_000])  # decided on all rows, and on averages
@pytest.mark.parametrize("seed", [1, 2])
def test_a_device_that_is_not_linear_gets_products_and_forecasts_to_the_noise(n, seed):
    X, y, later, readings, noise = split(n, 0.1, seed, device="slab")
    model = DynamicBiasRegressor("temperature").fit(X, y)
    assert model.products_ is True and model.search_.products is True
    explicit = DynamicBiasRegressor("temperature", products=True).fit(X, y)
    np.testing.assert_array_equal(model.coef_, explicit.coef_)
    assert rms(model.residuals(later, readings)) < 1.01 * rms(noise)
    plain = DynamicBiasRegressor("temperature", products=False).fit(X, y)
    assert plain.products_ is False
    assert rms(plain.residuals(later, readings)) > 1.05 * rms(noise)


@pytest.mark.parametrize("device", ["slab", "plate", "layered", "box"])
@pytest.mark.parametrize("n", [6_000, 30_000])
def test_a_linear_device_gets_none(n, device):
    record = make_record(n, device=device, noise=NOISE, seed=7)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    assert model.products_ is False
    plain = DynamicBiasRegressor("temperature", products=False).fit(X, y)
    np.testing.assert_array_equal(model.predict(X), plain.predict(X))


def test_nothing_is_added_to_lags_that_are_given_or_to_a_linear_law():
    X, y, *_ = split(6_000, 0.1, 1)
    assert DynamicBiasRegressor("temperature").fit(X, y).products_ is True
    assert DynamicBiasRegressor("temperature", [300.0, 5000.0]).fit(X, y).products_ is False
    assert DynamicBiasRegressor("temperature", degree=1).fit(X, y).products_ is False


def test_an_exact_record_gets_none():
    """What is left of a law that the columns hold exactly is rounding, which no block is predicted better from."""
    T = 23.0 + np.sin(np.arange(6_000) / 150.0) + 0.3 * np.sin(np.arange(6_000) / 41.0)
    model = DynamicBiasRegressor("temperature", sampling_period=60.0)
    assert model.fit(pd.DataFrame({"temperature": T}), 10.0 + 2.0 * T + 0.1 * (T - 23.0) ** 2).products_ is False


def test_what_is_chosen_again_or_held_is_the_same():
    X, y, *_ = split(6_000, 0.1, 1)
    model = DynamicBiasRegressor("temperature").fit(X, y)
    assert clone(model).products == "auto"
    assert model._as_chosen().fit(X[:200], y[:200]).products_ is True  # part of the model, as its degree is
    held = clone(model).set_params(**model._choices(), alpha=model.alpha_).fit(X, y)
    np.testing.assert_allclose(held.predict(X), model.predict(X), rtol=0, atol=1e-9)
    assert model.set_params(time_constants=[300.0]).fit(X, y).products_ is False  # an earlier choice is forgotten


def test_a_model_file_knows_them(tmp_path):
    X, y, later, *_ = split(6_000, 0.1, 1)
    model = DynamicBiasRegressor("temperature").fit(X, y)
    save_model(model, tmp_path / "m.json")
    loaded = load_model(tmp_path / "m.json")
    assert loaded.products == "auto" and loaded.products_ is True
    np.testing.assert_array_equal(loaded.predict(later), model.predict(later))
    with pytest.raises(ValueError, match="'products' parameter"):
        DynamicBiasRegressor(products="all").fit(X, y)


def test_columns_of_time_and_runs_codes_and_holes_are_averaged_too():
    """A record of 40 000 rows is decided on in averages, whatever it is made of."""
    record = make_record(40_000, sampling_period=60.0, noise=NOISE, nonlinearity=0.1, device="slab", seed=1)
    minutes = np.arange(len(record)) * 60.0
    frame = record.reset_index(drop=True).assign(seconds=minutes, humidity=np.sin(minutes / 3e4))
    X, y = frame.drop(columns="reading"), frame["reading"].copy()
    y.iloc[5_000:5_100] = np.nan
    y.iloc[7_000] = 9.9e37
    X.loc[20_000:20_020, "temperature"] = np.nan
    for options in ({}, {"temperature": ["temperature", "humidity"]}):
        model = DynamicBiasRegressor(**{"temperature": "temperature", "time": "seconds", **options})
        with pytest.warns(RecordWarning, match="9.9e\\+37|9.9E37|sentinel"):
            assert model.fit(X, y).products_ is True, options


def test_a_log_in_a_file_and_one_in_memory_decide_alike(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    record = make_record(40_000, sampling_period=60.0, noise=NOISE, nonlinearity=0.1, device="slab", seed=2)
    record.to_parquet(tmp_path / "log.parquet", row_group_size=7_000)
    log = ParquetLog(tmp_path / "log.parquet")
    inside = DynamicBiasRegressor("temperature").fit(record[["temperature"]], record["reading"])
    outside = DynamicBiasRegressor("temperature").fit(log, log["reading"])
    assert inside.products_ is outside.products_ is True
    np.testing.assert_allclose(outside.coef_, inside.coef_, rtol=1e-7)


def test_the_table_has_a_fifth_variant_where_they_help():
    X, y, *_ = split(6_000, 0.1, 1)
    assert "dynamic nonlinear with products" in compare_variants(X, y, temperature="temperature").models
    record = make_record(3_000, noise=NOISE, seed=3)
    X, y = record[["temperature"]], record["reading"]
    assert len(compare_variants(X, y, temperature="temperature").models) == 4
    assert len(compare_variants(X, y, temperature="temperature", products=True).models) == 5
