"""Diagnosis and refinement of logs in files, and of longer records than memory should hold."""

import re

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, diagnose, read_log, refine
from thermocorr.datasets import make_record
from thermocorr.judgement import data
from thermocorr.records import RecordError

pytestmark = pytest.mark.newest

N = 12_000


def record_with(effect, n=N, seed=91):
    record = make_record(n, effects={effect: 2.0}, seed=seed)
    return record.drop(columns="reading"), record["reading"]


def as_log(X, y):
    """The record in parts."""
    whole = X.assign(reading=y)
    log = read_log(whole[start : start + 777] for start in range(0, len(X), 777))
    return log.drop(columns="reading"), log["reading"]


@pytest.mark.parametrize("effect", ["hysteresis", "covariate"])
def test_a_log_is_judged_as_the_frame_is(effect):
    X, y = record_with(effect, 5000)
    y.iloc[[700, 2500]] += 40.0
    X.iloc[100:110, X.columns.get_loc("humidity")] = np.nan  # a suspect with a short hole
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X[["temperature"]], y)
    log, reading = as_log(X, y)
    expected, found = diagnose(model, X, y), diagnose(model, log, reading)
    assert str(found) == str(expected) and found.best.kind == effect
    pd.testing.assert_frame_equal(found.where, expected.where)
    pages = (re.sub("<svg.*?</svg>", "", one.to_html(), flags=re.DOTALL) for one in (found, expected))
    assert len({page[page.index("readings of") - 8 : page.index("readings of") + 60] for page in pages}) == 1


def test_a_log_is_refined_as_the_frame_is():
    X, y = record_with("step", 4000)
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
    log, reading = as_log(X, y)
    expected, found = refine(model, X, y), refine(model, log, reading)
    pd.testing.assert_frame_equal(found.steps, expected.steps)
    np.testing.assert_allclose(found.model_.coef_, expected.model_.coef_, rtol=1e-9)


def test_more_rows_than_memory_should_hold_are_refused_with_a_way_out(monkeypatch):
    X, y = record_with("step", 2000)
    monkeypatch.setattr(data, "MOST_ROWS", 1999)
    with pytest.raises(RecordError, match=r"has 2000 rows, .* at most 1999 in memory. Average them"):
        diagnose(DynamicBiasRegressor("temperature", ["5 min"]).fit(X, y), X, y)
