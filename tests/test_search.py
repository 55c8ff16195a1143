"""Choice of time constants: same errors as scikit-learn's search, planted time constants found, honest intervals."""

import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, KFold, LeaveOneGroupOut, TimeSeriesSplit, cross_val_score
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, RecordError, RecordWarning, TimeConstantSearch
from thermocorr.datasets import make_record
from thermocorr.equations import lag_differences

TRUE = np.array([400.0, 6000.0])


@pytest.fixture(scope="module")
def lab():
    record = make_record(6000, seed=5)
    return record[["temperature"]], record["reading"]


def planted(seed, n=20_000):
    """A device with two lags, known to the last digit, in a simulated room."""
    room = make_record(n, seed=seed)[["temperature"]]
    T = room["temperature"].to_numpy()
    lags, _ = lag_differences(T, np.full(n, 60.0), TRUE)
    return room, 10 * T + lags @ [4.0, 5.0] + 0.2 * np.random.default_rng(seed).normal(size=n)


def test_same_scores_and_choice_as_grid_search_over_a_pipeline(lab):
    """GridSearchCV sees each fold anew; the search has one pass. Penalties act alike on both sides for degree 1.

    Without a gap: in one, the pipeline does not see the temperature and takes it as a straight line.
    """
    X, y = lab
    sets = [(300.0,), (300.0, 3600.0), (250.0, 5000.0), (120.0, 900.0, 7200.0), (250.0, 300.0, 360.0)]
    alphas = [1e-6, 1.0]
    cv = TimeSeriesSplit(4)
    pipeline = Pipeline(
        [("features", DiffusiveFeatures()), ("scale", StandardScaler()), ("ridge", Ridge(solver="svd"))]
    )
    grid = {"features__time_constants": sets, "ridge__alpha": alphas}
    expected = GridSearchCV(pipeline, grid, cv=cv, scoring="neg_root_mean_squared_error").fit(X, y)
    model = DynamicBiasRegressor(degree=1)
    search = TimeConstantSearch(model, sets, alphas=alphas, cv=cv).fit(X, y)
    wanted = {
        (tuple(params["features__time_constants"]), params["ridge__alpha"]): [
            expected.cv_results_[f"split{f}_test_score"][i] for f in range(4)
        ]
        for i, params in enumerate(expected.cv_results_["params"])
    }
    for i, params in enumerate(search.cv_results_["params"]):
        found = [search.cv_results_[f"split{f}_test_score"][i] for f in range(4)]
        np.testing.assert_allclose(found, wanted[params["time_constants"], params["alpha"]], rtol=1e-9)
    first = search.cv_results_["params"][int(np.argmin(search.cv_results_["rank_test_score"]))]
    assert first["time_constants"] == expected.best_params_["features__time_constants"]
    assert first["alpha"] == expected.best_params_["ridge__alpha"]
    np.testing.assert_array_equal(search.predict(X), search.best_estimator_.predict(X))


def test_all_sets_of_a_pool_are_tried_and_forward_steps_come_close(lab, monkeypatch):
    X, y = lab
    pool = np.geomspace(120, 40_000, 7)
    every = [tuple(pool[[i, j]]) for i in range(7) for j in range(i)]

    def least(candidates, **more):
        search = TimeConstantSearch(None, candidates, alphas=[1e-6], refit=False, **more).fit(X, y)
        of_grid = [all(t in pool for t in params["time_constants"]) for params in search.cv_results_["params"]]
        return search.cv_results_["mean_test_score"][of_grid].max()

    of_pairs = least(every)
    assert least(pool, method="cross_validation", count=2) == pytest.approx(of_pairs, rel=1e-10)
    monkeypatch.setattr("thermocorr.model.search.EXHAUSTIVE_LIMIT", 0)
    assert least(pool, method="cross_validation", count=2) >= of_pairs * 1.003  # scores are negative: within 0.3 %


def test_planted_time_constants_are_found_and_intervals_hold_them():
    """8 seeds, 2 time constants: 16 intervals at 95 %. Fewer than 12 hits has a chance below 1e-4 if they are true."""
    hits = 0
    for seed in range(8):
        search = TimeConstantSearch(method="cross_validation", refit=False).fit(*planted(seed))
        table = search.time_constants_
        assert len(table) == 2, "two bodies, two time constants"
        np.testing.assert_allclose(table["time_constant"], TRUE, rtol=0.15)
        hits += int(((table["low"] < TRUE) & (table["high"] > TRUE)).sum())
    assert hits >= 12


def test_intervals_are_those_of_the_last_fit_and_survive_pickling(lab):
    X, y = lab
    search = TimeConstantSearch(candidates=[[600.0], [600.0, 6000.0]], refit=False)
    kept = pickle.loads(pickle.dumps(search.fit(X, y)))  # before anybody has asked
    pd.testing.assert_frame_equal(kept.time_constants_, search.time_constants_)
    search.set_params(candidates=[[1200.0]]).fit(X, y)
    assert search.time_constants_["time_constant"].tolist() == [1200.0]
    with pytest.raises(NotFittedError):
        clone(search).time_constants_  # noqa: B018


def test_default_choice_is_the_regressors_own(lab):
    X, y = lab
    search, model = TimeConstantSearch().fit(X, y), DynamicBiasRegressor().fit(X, y)
    np.testing.assert_allclose(search.best_estimator_.time_constants_, model.time_constants_)
    np.testing.assert_allclose(search.best_estimator_.coef_, model.coef_)
    spectrum = search.spectrum_
    assert len(spectrum) == 25
    assert (spectrum["excitation"] > 0).all()
    assert spectrum["alike_next"].iloc[:-1].between(0.5, 1).all()


def test_a_record_says_which_time_constants_it_cannot_determine(lab):
    X, y = lab
    with pytest.warns(RecordWarning, match="longer than the record"):
        DynamicBiasRegressor(time_constants=["1 h", "30 D"]).fit(X, y)
    with pytest.warns(RecordWarning, match="shorter than half the sampling step"):
        DynamicBiasRegressor(time_constants=[20.0, 3600.0]).fit(X, y)
    with pytest.warns(RecordWarning, match="1 h and 1.001 h work against each other"):
        DynamicBiasRegressor(time_constants=[300.0, 3600.0, 3605.0]).fit(X, y)
    with pytest.warns(RecordWarning, match=r"1\.6667 h and 1\.6669 h cannot be distinguished"):
        model = DynamicBiasRegressor(time_constants=[400.0, 6000.0, 6001.0]).fit(*planted(1, 4000))
    assert any("distinguished" in note for note in model.notes_)


def test_runs_are_groups():
    record = make_record(1500, runs=3, seed=2)
    X, y = record[["temperature", "run"]], record["reading"]
    model = DynamicBiasRegressor("temperature", run="run", max_gap=3600)
    search = TimeConstantSearch(model, cv=LeaveOneGroupOut()).fit(X, y)
    assert search.n_splits_ == 3
    assert -search.best_score_ < 0.3  # noise 0.2: a run that nothing was learned of is predicted


@pytest.mark.parametrize("dated", [True, False])
def test_shuffled_folds_are_said_wherever_they_are_used(dated):
    record = make_record(3000, seed=1)
    if not dated:
        record = record.reset_index(drop=True)
    model, cv = DynamicBiasRegressor("temperature", [300.0]), KFold(3, shuffle=True, random_state=0)
    with pytest.warns(RecordWarning, match="as in shuffled folds" if dated else "do not shuffle folds"):
        cross_val_score(model, record[["temperature"]], record["reading"], cv=cv)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        cross_val_score(model, record[["temperature"]], record["reading"], cv=TimeSeriesSplit(3))
    assert not any("shuffle" in str(each.message) for each in said)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"cv": KFold(3, shuffle=True, random_state=0)}, "shuffled"),
        ({"cv": 1}, "'cv' parameter must be a number of folds from 2"),
        ({"cv": "three"}, "'cv' parameter must be"),
        ({"candidates": "all"}, "'candidates' parameter must be 'auto'"),
        ({"candidates": [[-5.0]]}, "must be a positive time"),
        ({"method": "random"}, "'method' parameter"),
    ],
)
def test_wrong_settings_are_refused(lab, parameters, words):
    with pytest.raises(ValueError, match=words):
        TimeConstantSearch(**parameters).fit(*lab)


def test_a_record_too_short_for_a_search_is_refused(lab):
    X, y = lab
    with pytest.raises(RecordError, match="too short for a search: 90 readings"):
        TimeConstantSearch(method="cross_validation").fit(X[:90], y[:90])


@pytest.mark.parametrize("seed", [100, 101, 102])
def test_a_noisy_thermometer_does_not_cost_the_gain_half_a_per_cent(seed):
    """Slow lags that explain next to nothing had shared the static law, and moved the gain by up to 2 %."""
    record, truth = make_record(20_160, seed=seed, sampling_period=60.0, return_truth=True)
    noisy = record[["temperature"]] + 0.1 * np.random.default_rng(seed).standard_normal((20_160, 1))
    model = DynamicBiasRegressor("temperature").fit(noisy, record["reading"])
    assert abs(model.coef_[0] / truth.attrs["device"]["sensitivity"] - 1) < 0.005
