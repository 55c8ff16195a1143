"""Readings that count more or less, that are masked, and a measurand that is stepped."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import make_pipeline

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, RecordError, TimeConstantSearch
from thermocorr.datasets import make_record
from thermocorr.effects import Events

TAUS = ["10 min", "90 min"]


@pytest.fixture(scope="module")
def lab():
    record = make_record(4000, seed=1)
    return record[["temperature"]], record["reading"]


@pytest.fixture(scope="module")
def weight(lab):
    weight = np.random.default_rng(0).integers(1, 60, len(lab[0])).astype(float)
    weight[500:600] = 0.0
    return weight


def test_weighted_coefficients_are_those_of_scikit_learn(lab, weight):
    X, y = lab
    model = DynamicBiasRegressor("temperature", TAUS).fit(X, y, sample_weight=weight)
    columns = DiffusiveFeatures(TAUS, degree=2, temperature="temperature").fit_transform(X)
    given = LinearRegression().fit(columns, y, sample_weight=weight)
    assert np.allclose(model.predict(X), given.predict(columns), atol=1e-9)


def test_only_ratios_of_weights_count(lab, weight):
    X, y = lab
    one, other = (DynamicBiasRegressor("temperature").fit(X, y, sample_weight=k * weight) for k in (1.0, 1e-9))
    assert np.allclose(one.predict(X), other.predict(X), atol=1e-9)
    alike = DynamicBiasRegressor("temperature").fit(X, y, sample_weight=np.full(len(X), 7.0))
    assert np.array_equal(alike.coef_, DynamicBiasRegressor("temperature").fit(X, y).coef_)


def test_known_uncertainties_make_the_law_surer(lab):
    X, y = lab
    rng, errors = np.random.default_rng(3), []
    deviation = np.where(rng.random(len(X)) < 0.3, 0.01, 1.0) * y.std()
    truth = DynamicBiasRegressor("temperature", TAUS).fit(X, y).predict(X)
    for _ in range(5):
        noisy = y + deviation * rng.standard_normal(len(X))
        plain, weighted = (
            DynamicBiasRegressor("temperature", TAUS).fit(X, noisy, **given).predict(X)
            for given in ({}, {"sample_weight": deviation**-2.0})
        )
        errors.append([np.std(plain - truth), np.std(weighted - truth)])
    plain, weighted = np.sqrt(np.mean(np.square(errors), axis=0))
    assert weighted < plain / 10


def test_a_weight_of_zero_a_mask_and_nan_are_one_thing(lab):
    X, y = lab
    out = np.zeros(len(X), bool)
    out[500:600] = True
    spoiled = y.mask(out, y + 1e3)
    model = DynamicBiasRegressor("temperature")
    wanted = model.fit(X, y.mask(out)).coef_.copy()
    first, last = X.index[500], X.index[599]
    after = (first - X.index[0]).total_seconds(), str(last - X.index[0])
    for given in (
        {"mask": out},
        {"mask": pd.Series(out, X.index)},
        {"mask": [(first, last)]},
        {"mask": [after]},
        {"sample_weight": 1.0 - out},
    ):
        assert np.array_equal(model.fit(X, spoiled, **given).coef_, wanted)
        assert model.reading_.name == "reading" and model.reading_.n_readings == len(X) - 100
    assert np.isfinite(model.correct(X, spoiled)).all()  # the lags went on


def test_searches_take_weights_and_masks(lab, weight):
    X, y = lab
    sets = {"time_constants": [["10 min"], TAUS]}
    plain = GridSearchCV(DynamicBiasRegressor("temperature"), sets, cv=TimeSeriesSplit(3))
    assert plain.fit(X, y, sample_weight=weight, mask=weight == 0).best_params_["time_constants"] == TAUS
    with sklearn.config_context(enable_metadata_routing=True):
        asking = DynamicBiasRegressor("temperature", TAUS).set_fit_request(sample_weight=True, mask=True)
        routed = GridSearchCV(asking.set_score_request(sample_weight=True), sets, cv=TimeSeriesSplit(3))
        assert routed.fit(X, y, sample_weight=weight, mask=weight == 0).best_params_["time_constants"] == TAUS
        piped = make_pipeline(asking).fit(X, y, sample_weight=weight, mask=weight == 0)
    alone = DynamicBiasRegressor("temperature", TAUS).fit(X, y, sample_weight=weight)
    assert np.array_equal(piped[-1].coef_, alone.coef_)
    search = TimeConstantSearch(candidates=[["10 min"], TAUS]).fit(X, y, sample_weight=weight)
    assert np.allclose(search.best_estimator_.coef_, alone.coef_, rtol=1e-6)
    assert 0.9 < alone.score(X, y, sample_weight=weight) <= 1.0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"sample_weight": np.ones(3)}, r"expected \(4000,\): one weight for each row"),
        ({"sample_weight": np.r_[np.nan, np.ones(3999)]}, "not negative. Row 0 has nan .1 such row of"),
        ({"sample_weight": np.r_[1.0, -np.ones(3999)]}, "not negative. Row 1 has -1.0 .3999 such rows of"),
        ({"sample_weight": np.zeros(4000)}, "there is nothing to learn from"),
        ({"mask": np.ones(3, bool)}, "must say of each of the 4000 rows"),
        ({"mask": np.full(4000, 2)}, "must say of each of the 4000 rows"),
        ({"mask": ["2024-01-01"]}, r"or a list of \(start, end\)"),
        ({"mask": [("2 h", "1 h")]}, "ends before it starts"),
        ({"mask": [("soon", "later")]}, "The 'mask' parameter of fit must be seconds since the record began"),
        ({"mask": np.ones(4000, bool)}, "The mask leaves out all readings of the 4000 rows"),
    ],
)
def test_what_is_no_weight_and_no_mask(lab, given, said):
    with pytest.raises(ValueError, match=said):
        DynamicBiasRegressor("temperature", TAUS).fit(*lab, **given)


def test_other_arguments_of_fit_are_refused(lab):
    with pytest.raises(TypeError, match="unexpected keyword argument 'weight'"):
        DynamicBiasRegressor("temperature", TAUS).fit(*lab, weight=1)


@pytest.fixture(scope="module")
def loaded(lab):
    """Loads of 5, 12 and 0 units, put on in rows 1000, 1800 and 3000; a column that says when."""
    X, y = lab
    load = np.zeros(len(X))
    load[1000:], load[1800:], load[3000:] = 5.0, 12.0, 0.0
    stepped = np.zeros(len(X))
    stepped[[1000, 1800, 1801, 3000]] = 1  # somebody held the button
    return X.assign(stepped=stepped), y + load, load


def test_levels_are_kept_and_the_lags_go_on(lab, loaded):
    X, y, load = loaded
    plain = DynamicBiasRegressor("temperature", TAUS).fit(X, lab[1])
    wanted = plain.correct(X, lab[1])
    given = Events([X.index[k] for k in (1000, 1800, 3000)])
    for events in (given, Events(column="stepped"), Events([X.index[1000]], "stepped")):
        model = DynamicBiasRegressor("temperature", TAUS, effects=[events]).fit(X, y)
        corrected = model.correct(X, y) - load
        assert np.abs(corrected - wanted - (corrected - wanted).mean()).max() < 2 * plain.residual_std_
        assert model.residual_std_ < 1.01 * plain.residual_std_
    ignorant = DynamicBiasRegressor("temperature", TAUS).fit(X, y)
    assert ignorant.residual_std_ > 10 * plain.residual_std_  # the test can fail


def test_events_live_and_by_name(loaded):
    X, y, _ = loaded
    model = DynamicBiasRegressor("temperature", TAUS, effects=[Events(column="stepped")]).fit(X[:3500], y[:3500])
    assert "events: 3" in model.contributions(X)
    live = OnlineCorrector(model).update_many(X[3500:], y[3500:])
    assert np.abs(live["corrected"] - model.correct(X, y)[3500:]).max() < 1e-12


def test_a_column_that_is_no_list_of_events(loaded):
    X, y, _ = loaded
    model = DynamicBiasRegressor("temperature", TAUS, effects=[Events(column="stepped")])
    with pytest.raises(RecordError, match=r"'stepped' must hold 0 and 1 in every row\. Got 0\.5 at 6000 s"):
        model.fit(X.assign(stepped=np.where(np.arange(4000) == 100, 0.5, X["stepped"])), y)
    with pytest.raises(RecordError, match="There are 2000 events, and 1000 are the most"):
        model.fit(X.assign(stepped=np.arange(4000) % 2), y)


@pytest.mark.parametrize("numbered", [False, True])
@pytest.mark.parametrize("name", ["sample_weight", "mask"])
def test_rows_in_another_order_are_refused(lab, weight, name, numbered):
    """A Series says by its index which row is which: it is not used by position."""
    X, y = lab
    given = pd.Series(weight if name == "sample_weight" else weight > 30, index=y.index)
    X, y, given = (frame.reset_index(drop=True) if numbered else frame for frame in (X, y, given))
    model = DynamicBiasRegressor("temperature", TAUS, sampling_period="1 min" if numbered else None)
    with pytest.raises(RecordError, match=f"{name} has|{name}.reindex"):
        model.fit(X, y, **{name: given[::-1]})
    model.fit(X, y, **{name: given})


def test_a_date_as_the_end_of_a_mask_is_its_whole_day(lab):
    X, y = lab
    day = X.index[0].normalize() + pd.Timedelta("1D")
    model = DynamicBiasRegressor("temperature", TAUS)
    whole = model.fit(X, y, mask=[(f"{day:%Y-%m-%d}", f"{day:%Y-%m-%d}")]).reading_.n_readings
    assert whole == len(y) - 1440
    to_noon = model.fit(X, y, mask=[(f"{day:%Y-%m-%d}", f"{day:%Y-%m-%d} 11:59")]).reading_.n_readings
    assert to_noon == len(y) - 720


def test_a_mask_beside_the_record_is_said(lab):
    X, y = lab
    with pytest.warns(UserWarning, match="in which there are no rows"):
        DynamicBiasRegressor("temperature", TAUS).fit(X, y, mask=[("2023-01-01", "2023-01-02")])


def test_several_readings_with_weights(lab):
    """scikit-learn finds the weights in the signature of `fit`."""
    X, y, weight = lab[0], lab[1], np.random.default_rng(1).uniform(0.5, 2.0, len(lab[0]))
    both = np.column_stack((y, 2 * y))
    found = MultiOutputRegressor(DynamicBiasRegressor("temperature", TAUS)).fit(X, both, sample_weight=weight)
    alone = DynamicBiasRegressor("temperature", TAUS).fit(X, 2 * y, sample_weight=weight)
    np.testing.assert_array_equal(found.predict(X)[:, 1], alone.predict(X))
