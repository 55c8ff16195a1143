"""Bad input through Python: every case raises a message that names place and remedy; none returns numbers."""

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError

from thermocorr import (
    DiffusiveFeatures,
    DynamicBiasRegressor,
    OnlineCorrector,
    TimeConstantSearch,
    compare_variants,
    diagnose,
    refine,
)
from thermocorr.datasets import load_real_record, make_record
from thermocorr.effects import Covariate, LaggedCovariate
from thermocorr.equations import allan_deviation
from thermocorr.model import MergedRidge
from thermocorr.validation import held_out_residuals

N = 300


def frame() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    index = pd.date_range("2024-05-01", periods=N, freq="1min")
    T = 23 + np.cumsum(rng.normal(size=N)) * 0.1
    return pd.DataFrame({"temperature": T, "humidity": 40 + rng.normal(size=N)}, index=index)


X = frame()
Y = pd.Series(5 + 0.1 * X["temperature"] + np.random.default_rng(1).normal(size=N) * 0.01, name="reading")


def with_value(column, row, value):
    changed = X.astype({column: object}) if isinstance(value, str | dict) else X.copy()
    changed[column] = [value if k == row else v for k, v in enumerate(changed[column])]
    return changed


def fit(data=None, y=None, **options):
    options = {"time_constants": [300.0], **options}
    data = X if data is None else data
    return DynamicBiasRegressor(**options).fit(data, Y.set_axis(data.index[:N]) if y is None else y)


def search(**options):
    return TimeConstantSearch(method="cross_validation", **options).fit(X, Y)


def reindexed(order):
    return X.set_axis(X.index[order])


def untimed(**columns):
    return X.reset_index(drop=True).assign(**columns)


def plain(data, **options):
    return fit(data, Y.to_numpy()[: len(data)], **options)


swap = np.arange(N)
swap[[10, 11]] = [11, 10]
twice = np.arange(N)
twice[57] = 56
model = fit()

CASES = {
    "temperature all missing": (lambda: fit(X.assign(temperature=np.nan)), "No row has a number.*Check"),
    "infinite temperature": (lambda: fit(with_value("temperature", 7, np.inf)), "infinity in row 7.*Replace"),
    "text in temperature": (lambda: fit(with_value("temperature", 5, "23 C")), "not a number in row 5: '23 C'.*Remove"),
    "dict in temperature": (lambda: fit(with_value("temperature", 3, {})), "row 3"),
    "complex temperature": (lambda: fit(X.assign(temperature=1j)), "complex.*pass real"),
    "dates as temperature": (lambda: fit(X.assign(temperature=X.index)), "holds times.*time="),
    "constant temperature": (lambda: fit(X.assign(temperature=23.0)), "never changes.*right column"),
    "temperature column absent": (lambda: fit(temperature="oven"), "no temperature 'oven'.*Name one"),
    "array column absent": (lambda: plain(X.to_numpy(), temperature=5), "not a column.*0 to 1"),
    "infinite reading": (lambda: fit(y=Y.where(np.arange(N) != 9, np.inf)), "infinity in row 9.*Replace"),
    "text in reading": (lambda: fit(y=np.array(["a"] * N)), "not a number in row 0.*to_numeric"),
    "no reading at all": (lambda: fit(y=np.full(N, np.nan)), "300 readings are missing.*Check"),
    "no y": (lambda: DynamicBiasRegressor().fit(X, None), "requires y"),
    "y too short": (lambda: plain(X, time_constants=[300.0]) and fit(y=np.ones(5)), "300 rows and y has 5"),
    "y with two columns": (lambda: fit(y=X), "y has 2 columns.*Pass one"),
    "y of two dimensions": (lambda: fit(y=np.ones((N, 3))), "one column of readings.*shape"),
    "y at other times": (lambda: fit(y=Y.set_axis(X.index + pd.Timedelta("1h"))), "different times: in row 0.*Align"),
    "duplicate times": (lambda: plain(reindexed(twice)), "same time.*56 and 57.*Drop"),
    "backward times": (lambda: plain(reindexed(swap)), "backward at row 11.*Sort"),
    "missing time": (lambda: plain(untimed(t=X.index.where(X.index != X.index[4])), time="t"), "row 4.*drop"),
    "unreadable time": (lambda: plain(untimed(t="noon"), time="t"), "row 0: 'noon'.*Write dates"),
    "numbers as text for time": (lambda: plain(untimed(t=[str(k) for k in range(N)]), time="t"), "Convert it to float"),
    "true/false for time": (lambda: plain(untimed(t=True), time="t"), "true/false.*Give dates"),
    "time column absent": (lambda: plain(X, time="when"), "no time column 'when'.*Name one"),
    "time column for an array": (lambda: plain(X.to_numpy(), time="t"), "array has no named columns"),
    "run column absent": (lambda: plain(X, run="run"), "no run column 'run'.*Name one"),
    "run number an array lacks": (lambda: plain(X.to_numpy(), run=2, sampling_period=1), "run=2 is not.*2 columns"),
    "negative run number": (lambda: plain(X.to_numpy(), run=-1, sampling_period=1), "run=-1 is not.*2 columns"),
    "run name for an array": (lambda: plain(X.to_numpy(), run="run", sampling_period=1), "run='run' is not.*2 columns"),
    "run label missing": (lambda: plain(X.assign(run=[None] + ["a"] * (N - 1)), run="run"), "empty in row 0.*Label"),
    "runs interleaved without times": (
        lambda: plain(untimed(run=[k % 2 for k in range(N)]), run="run", sampling_period=1),
        "interleaved.*Sort the rows",
    ),
    "duplicate column names": (lambda: fit(pd.concat([X, X], axis=1)), "unique names"),
    "empty frame": (lambda: DynamicBiasRegressor().fit(X[:0], Y[:0]), "0 rows.*Check"),
    "no columns": (lambda: plain(X[[]]), "no columns"),
    "series for X": (lambda: DynamicBiasRegressor().fit(X["temperature"], Y), "is a Series.*to_frame"),
    "one dimension for X": (lambda: DynamicBiasRegressor().fit(np.ones(N), Y), "Reshape your data"),
    "record too short": (lambda: fit(X[:4], Y.set_axis(X.index)[:4]), "too short: 4 samples.*Record longer"),
    "record too short for blocks": (
        lambda: held_out_residuals(DynamicBiasRegressor("temperature", [60]), X[["temperature"]][:6], Y[:6]),
        "3 of 6 readings are outside of held-out block 1 of 2.*too short: 3 samples",
    ),
    "negative time constant": (lambda: fit(time_constants=[-5]), "positive time.*Got -5"),
    "zero time constant": (lambda: fit(time_constants=[0]), "positive time.*Got 0"),
    "time constant in words": (lambda: fit(time_constants=["soon"]), "positive time.*'soon'"),
    "same time constant twice": (lambda: fit(time_constants=[60, "1 min"]), "distinct times.*60 s twice"),
    "no time constants to choose": (lambda: fit(time_constants=0), "number to choose from 1"),
    "too many to choose": (lambda: fit(time_constants=99), "number to choose from 1"),
    "true for time constants": (lambda: fit(time_constants=True), "number to choose from 1"),
    "negative degree": (lambda: fit(degree=-1), "'degree' parameter.*Got -1"),
    "negative alpha": (lambda: fit(alpha=-1.0), "'alpha' parameter.*Got -1"),
    "negative alpha of the ridge": (lambda: MergedRidge(-1.0).fit(X, Y), "'alpha' parameter.*Got -1"),
    "unknown initial state": (
        lambda: DiffusiveFeatures([60], initial_state="warm").fit(X),
        "'initial_state' parameter.*'warm'",
    ),
    "unknown hold": (lambda: DiffusiveFeatures([60], hold="cubic").fit(X), "'hold' parameter.*'cubic'"),
    "unknown reference": (lambda: fit(reference_temperature="median"), "'reference_temperature' parameter"),
    "zero sampling period": (lambda: plain(untimed(), sampling_period=0), "'sampling_period'.*positive time"),
    "sampling period in words": (lambda: plain(untimed(), sampling_period="fast"), "'sampling_period'.*'fast'"),
    "negative max_gap": (lambda: fit(max_gap=-1), "'max_gap'.*positive time"),
    "effect that is none": (lambda: fit(effects=["humidity"]), "'effects' parameter.*'humidity'"),
    "effect as a class": (lambda: fit(effects=[Covariate]), "'effects' parameter"),
    "effects of one name": (lambda: fit(effects=[("a", Covariate("humidity"))] * 2), "two effects called 'a'"),
    "covariate column absent": (lambda: fit(effects=[Covariate("dew")]), "no column 'dew'.*Name one"),
    "infinite covariate": (
        lambda: fit(with_value("humidity", 8, -np.inf), effects=[LaggedCovariate("humidity")]),
        "'humidity' contains infinity in row 8",
    ),
    "not fitted": (lambda: DynamicBiasRegressor().predict(X), "not fitted yet"),
    "kelvin where degC was fitted": (
        lambda: model.predict(X.assign(temperature=X["temperature"] + 273.15)),
        "kelvin where degC was fitted.*Convert",
    ),
    "column missing at predict": (lambda: model.predict(X[["humidity"]]), "feature names|no temperature"),
    "more columns at predict": (lambda: model.predict(X.assign(extra=1.0)), "feature names"),
    "other kind of times at predict": (lambda: model.predict(untimed()), "times of kind.*Give both"),
    "residuals of another length": (lambda: model.residuals(X, Y[:5]), "300 rows and y has 5"),
    "variants without readings": (lambda: compare_variants(X, np.full(N, np.nan)), "readings are missing.*Check"),
    "options besides a model": (
        lambda: compare_variants(X, Y, model=model, time_constants=[60.0], foo=3),
        "not both.*time_constants, foo",
    ),
    "nonlinear of degree 0": (lambda: compare_variants(X, Y, degree=0), r"'degree' parameter.*\[1"),
    "window of none": (lambda: compare_variants(X, Y, window=0), r"'window' parameter.*\[1"),
    "one block of variants": (lambda: compare_variants(X, Y, n_blocks=1), r"'n_blocks' parameter.*\[2"),
    "one held-out block": (lambda: held_out_residuals(model, X, Y, n_blocks=1), r"'n_blocks' parameter.*\[2"),
    "half a block": (lambda: held_out_residuals(model, X, Y, n_blocks=2.5), "'n_blocks' parameter.*2.5"),
    "steps below none": (lambda: refine(model, X, Y, max_steps=-1), "'max_steps' parameter.*-1"),
    "suspects that are none": (lambda: diagnose(model, X, Y, suspects="drift"), "'suspects' parameter"),
    "decimal comma in a span": (lambda: fit(max_gap="1,5 h"), "'max_gap' parameter.*'1,5 h'"),
    "decimal comma in a time constant": (lambda: fit(time_constants=["1,5 h"]), "'time_constants' parameter.*'1,5 h'"),
    "alphas of NaN": (lambda: search(alphas=[np.nan]), "'alphas' parameter.*nan"),
    "no alphas": (lambda: search(alphas=[]), "'alphas' parameter"),
    "negative alphas": (lambda: search(alphas=[-1.0]), "'alphas' parameter.*-1"),
    "alphas in words": (lambda: search(alphas="many"), "'alphas' parameter.*'many'"),
    "no candidates": (lambda: search(candidates=[]), "'candidates' parameter is empty"),
    "one number as candidates": (lambda: search(candidates=5), "'candidates' parameter.*5"),
    "sets and times as candidates": (lambda: search(candidates=[300.0, [3.0]]), "'candidates' parameter.*300"),
    "confidence in percent": (lambda: allan_deviation(np.arange(9.0), confidence=95), "'confidence' parameter.*95"),
    "negative sampling period": (lambda: allan_deviation(np.arange(9.0), -1.0), "'sampling_period' parameter.*-1"),
    "continues in words": (lambda: OnlineCorrector(model, continues="False"), "'continues' parameter.*'False'"),
    "simulated record without a start": (lambda: make_record(9, start=None), "'start' parameter.*None"),
    "simulated record of one row": (lambda: make_record(1), "'n' parameter.*Got 1"),
    "measured record of unknown name": (lambda: load_real_record("nothing", "."), "nothing"),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore:Mean of empty slice", "ignore:Degrees of freedom")
def test_bad_input_is_refused_with_place_and_remedy(case):
    attempt, message = CASES[case]
    with pytest.raises((ValueError, TypeError, FileNotFoundError, NotFittedError), match=f"(?s){message}"):
        attempt()
