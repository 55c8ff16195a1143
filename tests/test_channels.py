"""Several readings beside one temperature."""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.multioutput import MultiOutputRegressor

from thermocorr import DynamicBiasRegressor, RecordError
from thermocorr.cluster.fleet import fit_channels
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate


@pytest.fixture(scope="module")
def rack():
    record = make_record(4000, seed=1)
    rng = np.random.default_rng(2)
    y = record["reading"]
    Y = pd.DataFrame({k: (k + 1) * y + 0.1 * y.std() * rng.standard_normal(4000) for k in range(5)}, index=y.index)
    Y.columns = [f"channel {k}" for k in Y]
    Y.iloc[500:900, 2] = np.nan  # one of them was off
    Y.iloc[1234, 3] = 1e6 * y.std()  # a spike
    return record[["temperature", "humidity"]], Y


def alone(X, Y, model):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {name: DynamicBiasRegressor(**model).fit(X, Y[name]) for name in Y}


@pytest.mark.parametrize(
    "given",
    [
        {"temperature": "temperature"},
        {"temperature": "temperature", "time_constants": ["10 min", "90 min"], "effects": [Covariate("humidity")]},
        {"temperature": "temperature", "time_constants": 2, "screen": False, "max_gap": "1 h"},
        {"temperature": ["temperature", "humidity"]},
    ],
)
def test_each_channel_has_the_model_that_it_would_have_alone(rack, given):
    X, Y = rack
    one_by_one = alone(X, Y, given)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        together = fit_channels(X, Y, DynamicBiasRegressor(**given))
    assert list(together) == list(Y)
    for name, model in together.items():
        wanted = one_by_one[name]
        assert np.array_equal(model.time_constants_, wanted.time_constants_)
        assert np.abs(model.predict(X) - wanted.predict(X)).max() < 1e-10 * Y[name].std()
        assert np.allclose(model.standard_errors(), wanted.standard_errors(), rtol=1e-6)
        assert model.reading_ == wanted.reading_ or model.reading_.name == name
        assert np.isfinite(model.correct(X, Y[name])[1000:1200]).all()


def test_one_set_of_time_constants_for_all(rack):
    X, Y = rack
    models = fit_channels(X, Y.iloc[:, :3], DynamicBiasRegressor("temperature"), shared_time_constants=True)
    assert len({tuple(model.time_constants_) for model in models.values()}) == 1


def test_arrays_and_scikit_learns_own_way(rack):
    X, Y = rack
    some = Y.iloc[:, :2]
    numbered = fit_channels(X, some.to_numpy(), DynamicBiasRegressor("temperature", ["10 min"]))
    named = fit_channels(X, some, DynamicBiasRegressor("temperature", ["10 min"]))
    theirs = MultiOutputRegressor(DynamicBiasRegressor("temperature", ["10 min"])).fit(X, some.to_numpy())
    for k, name in enumerate(some):
        assert np.array_equal(numbered[k].predict(X), named[name].predict(X))
        assert np.allclose(theirs.predict(X)[:, k], named[name].predict(X), atol=1e-9)


def test_what_cannot_be_fitted_is_said_of_its_channel(rack):
    X, Y = rack
    with pytest.raises(RecordError, match="Channel 'channel 1': All 4000 readings are missing"):
        fit_channels(X, Y.assign(**{"channel 1": np.nan}))
    with pytest.raises(RecordError, match=r"X has 4000 rows, Y the shape \(4000,\)"):
        fit_channels(X, Y["channel 1"].to_numpy())
    with pytest.raises(TypeError, match="X must be a DataFrame"):
        fit_channels(X.to_numpy(), Y)
    with pytest.raises(RecordError, match="or fit a model for each with thermocorr"):
        DynamicBiasRegressor("temperature").fit(X, Y)
