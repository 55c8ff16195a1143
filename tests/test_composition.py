"""scikit-learn's ways of composing estimators: each runs, or refuses in one sentence that says what to do."""

import copy
import pickle
import warnings

import joblib
import numpy as np
import pytest
from sklearn.base import clone
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.dummy import DummyRegressor
from sklearn.ensemble import BaggingRegressor, StackingRegressor, VotingRegressor
from sklearn.experimental import enable_halving_search_cv  # noqa: F401
from sklearn.feature_selection import RFE, SelectFromModel, SelectKBest, SequentialFeatureSelector, f_regression
from sklearn.impute import SimpleImputer
from sklearn.inspection import partial_dependence, permutation_importance
from sklearn.linear_model import Lasso, Ridge, RidgeCV
from sklearn.model_selection import (
    GridSearchCV,
    GroupKFold,
    HalvingGridSearchCV,
    KFold,
    RandomizedSearchCV,
    TimeSeriesSplit,
    cross_val_predict,
    cross_val_score,
    cross_validate,
    learning_curve,
    permutation_test_score,
    train_test_split,
    validation_curve,
)
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import make_pipeline, make_union
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler
from sklearn.utils import resample

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, RecordError, RecordWarning, TimeConstantSearch, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import LaggedCovariate

RECORD = make_record(1500, seed=1)
X, y = RECORD[["temperature", "humidity"]], RECORD["reading"]
TIMES = ["5 min", "1 h"]
SETS = [["5 min"], TIMES]
IN_TIME = TimeSeriesSplit(3)


def model(**options):
    return DynamicBiasRegressor("temperature", TIMES, **options)


def features(**options):
    return DiffusiveFeatures(TIMES, temperature="temperature", **options)


def fitted(pipeline):
    return pipeline.fit(X, y).predict(X)


def framed(step):
    return step.set_output(transform="pandas")


RUN = {
    "clone": lambda: clone(model()),
    "deep copy": lambda: copy.deepcopy(model().fit(X, y)).predict(X),
    "pickle": lambda: pickle.loads(pickle.dumps(model().fit(X, y))).predict(X),
    "features and Ridge": lambda: fitted(make_pipeline(features(), Ridge())),
    "features, scaler and RidgeCV": lambda: fitted(make_pipeline(features(), StandardScaler(), RidgeCV())),
    "features and Lasso": lambda: fitted(make_pipeline(features(), StandardScaler(), Lasso(0.01))),
    "scaler before, with names": lambda: fitted(make_pipeline(framed(StandardScaler()), features(), Ridge())),
    "imputer before, with names": lambda: fitted(make_pipeline(framed(SimpleImputer()), features(), Ridge())),
    "powers before": lambda: fitted(make_pipeline(framed(PolynomialFeatures()), features(), Ridge())),
    "the model last": lambda: fitted(make_pipeline(FunctionTransformer(), model())),
    "ColumnTransformer": lambda: fitted(
        make_pipeline(ColumnTransformer([("t", features(), ["temperature"])], remainder="passthrough"), Ridge())
    ),
    "FeatureUnion": lambda: fitted(make_pipeline(make_union(features(), FunctionTransformer()), Ridge())),
    "TransformedTargetRegressor": lambda: fitted(TransformedTargetRegressor(model(), transformer=StandardScaler())),
    "VotingRegressor": lambda: fitted(VotingRegressor([("a", model()), ("b", model(degree=1))])),
    "StackingRegressor": lambda: fitted(StackingRegressor([("a", model()), ("b", model(degree=1))], cv=KFold(3))),
    "MultiOutputRegressor": lambda: (
        MultiOutputRegressor(model()).fit(X, np.column_stack([y, y])).predict(X).mean(axis=1)
    ),
    "GridSearchCV over time constants": lambda: fitted(GridSearchCV(model(), {"time_constants": SETS}, cv=IN_TIME)),
    "GridSearchCV of a pipeline": lambda: fitted(
        GridSearchCV(make_pipeline(features(), Ridge()), {"diffusivefeatures__time_constants": SETS}, cv=IN_TIME)
    ),
    "GridSearchCV over an effect": lambda: fitted(
        GridSearchCV(
            model(effects=[("wet", LaggedCovariate("humidity", ["1 h"]))]),
            {"wet__time_constants": [["1 h"], ["3 h"]]},
            cv=IN_TIME,
        )
    ),
    "GridSearchCV in blocks": lambda: fitted(GridSearchCV(model(), {"degree": [1, 2]}, cv=KFold(3))),
    "GridSearchCV on shuffled rows": lambda: fitted(
        GridSearchCV(model(), {"degree": [1, 2]}, cv=KFold(3, shuffle=True, random_state=0))
    ),
    "GridSearchCV in two processes": lambda: fitted(GridSearchCV(model(), {"degree": [1, 2]}, cv=IN_TIME, n_jobs=2)),
    "RandomizedSearchCV": lambda: fitted(
        RandomizedSearchCV(model(), {"degree": [1, 2, 3]}, n_iter=2, cv=IN_TIME, random_state=0)
    ),
    "cross_val_score": lambda: cross_val_score(model(), X, y, cv=IN_TIME),
    "cross_val_score of a search": lambda: cross_val_score(
        TimeConstantSearch(DynamicBiasRegressor("temperature")), X, y, cv=IN_TIME
    ),
    "cross_val_score by groups": lambda: cross_val_score(
        model(), X, y, cv=GroupKFold(3), groups=np.arange(len(y)) // 500
    ),
    "cross_val_predict": lambda: cross_val_predict(model(), X, y, cv=KFold(3)),
    "cross_validate": lambda: cross_validate(
        model(), X, y, cv=IN_TIME, scoring=["r2", "neg_root_mean_squared_error"], return_estimator=True
    )["test_r2"],
    "learning_curve": lambda: learning_curve(model(), X, y, cv=IN_TIME, train_sizes=[0.5, 1.0])[1],
    "validation_curve": lambda: validation_curve(model(), X, y, param_name="degree", param_range=[1, 2], cv=IN_TIME)[1],
    "SelectFromModel": lambda: SelectFromModel(model()).fit(X, y).estimator_.predict(X),
    "SelectKBest behind the features": lambda: fitted(
        make_pipeline(features(), SelectKBest(f_regression, k=4), Ridge())
    ),
    "permutation_importance": lambda: (
        permutation_importance(model().fit(X, y), X, y, n_repeats=2, random_state=0).importances_mean
    ),
    "partial_dependence": lambda: partial_dependence(model().fit(X, y), X, ["temperature"])["average"],
    "joblib": lambda: joblib.Parallel(2)(joblib.delayed(fitted)(model()) for _ in range(2))[0],
    "names of the features": lambda: features().fit(X).get_feature_names_out(),
    "score": lambda: model().fit(X, y).score(X, y),
    "score with weights": lambda: model().fit(X, y).score(X, y, sample_weight=np.ones(len(y))),
    "y in a frame": lambda: model().fit(X, y.to_frame()).predict(X),
    "y in a list": lambda: model().fit(X, y.tolist()).predict(X),
    "arrays": lambda: fitted_arrays(),
    "a split without shuffling": lambda: split_in_time(),
    "DummyRegressor besides it": lambda: cross_val_score(DummyRegressor(), X, y, cv=IN_TIME),
    "metadata routing": lambda: str(model().get_metadata_routing()),
    "a picture of itself": lambda: model()._repr_html_(),
}


def fitted_arrays():
    arrays = DynamicBiasRegressor(0, [300, 3600], sampling_period=60)
    return arrays.fit(X.to_numpy(), y.to_numpy()).predict(X.to_numpy())


def split_in_time():
    early, late, before, after = train_test_split(X, y, shuffle=False)
    return model().fit(early, before).score(late, after)


@pytest.mark.parametrize("name", RUN)
def test_it_runs(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = RUN[name]()
    if isinstance(result, np.ndarray) and result.dtype.kind == "f":
        assert np.isfinite(result).all()
        if len(result) == len(y) and result.ndim == 1:
            assert np.corrcoef(result, y)[0, 1] > 0.99


SHUFFLED = r"Time goes backward at row \d+: .* The rows are shuffled: split with shuffle=False or TimeSeriesSplit"
REFUSED = {
    "shuffled rows": (
        lambda: model().fit(X.sample(frac=1, random_state=0), y.sample(frac=1, random_state=0)), SHUFFLED,
    ),
    "a split that shuffles": (lambda: model().fit(*train_test_split(X, y, random_state=0)[::2]), SHUFFLED),
    "rows drawn again": (lambda: model().fit(*resample(X, y, random_state=0)), SHUFFLED),
    "HalvingGridSearchCV": (
        lambda: HalvingGridSearchCV(
            model(), {"degree": [1, 2, 3]}, cv=IN_TIME, min_resources=300, random_state=0, error_score="raise"
        ).fit(X, y),
        r"HalvingGridSearchCV, cannot be used \(GridSearchCV can\)",
    ),
    "BaggingRegressor, which drops the names": (
        lambda: BaggingRegressor(model(), n_estimators=2, random_state=0).fit(X, y), "pass a DataFrame with named",
    ),
    "RFE, which drops the names": (lambda: RFE(model(), n_features_to_select=1).fit(X, y), "pass a DataFrame"),
    "SequentialFeatureSelector, which drops the names": (
        lambda: SequentialFeatureSelector(model(), n_features_to_select=1, cv=IN_TIME).fit(X, y), "pass a DataFrame",
    ),
    "readings in another order": (
        lambda: permutation_test_score(model(), X, y, cv=IN_TIME, n_permutations=2), "X and y have different times",
    ),
    "two columns of readings": (lambda: model().fit(X, np.column_stack([y, y])), "y must be one column"),
    "columns in another order": (
        lambda: model().fit(X, y).predict(X[["humidity", "temperature"]]), "must be in the same order",
    ),
    "a column less": (lambda: model().fit(X, y).predict(X[["humidity"]]), "now missing:\n- temperature"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_it_refuses_in_a_sentence(name):
    call, words = REFUSED[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ValueError, match=words):
            call()


def test_a_column_that_lacks_many_values_is_no_suspect_and_is_said_to_be_none():
    holes = np.random.default_rng(0).random(len(RECORD)) < 0.1
    X_all = RECORD.drop(columns="reading").assign(room=np.where(holes, np.nan, RECORD["temperature"]))
    with pytest.warns(
        RecordWarning, match=r"'room': no number in (9|10|11)% of the rows or more\. Not under suspicion"
    ):
        diagnose(model().fit(X_all, y), X_all, y)


def test_a_record_that_runs_backward_is_not_called_shuffled():
    with pytest.raises(RecordError, match="Sort the rows by time"):
        model().fit(X[::-1], y[::-1])
