"""Whether a correction helps on later data: the sentence that `analyze` begins with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, compare_variants, later_errors
from thermocorr.datasets import make_record
from thermocorr.estimators.holdout import BEFORE, LaterErrors


def variants(X, y, time_constants=("5 min", "90 min")):
    return {
        "static": DynamicBiasRegressor("temperature", ()).fit(X, y),
        "dynamic": DynamicBiasRegressor("temperature", list(time_constants)).fit(X, y),
    }


@pytest.fixture(scope="module")
def device():
    record = make_record(4000, seed=7)
    return record[["temperature"]], record["reading"]


def test_each_block_is_foretold_from_what_came_before(device):
    X, y = device
    found = later_errors(variants(X, y), X, y, n_blocks=4)
    assert list(found.table.columns) == [1, 2, 3, 4, "all"] and found.table.index[0] == BEFORE
    for number, (low, high) in enumerate([(2000, 2500), (2500, 3000), (3000, 3500), (3500, 4000)], 1):
        known = y.where(np.arange(4000) < low)
        missed = (y - DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, known).predict(X))[low:high]
        assert found.table.loc["dynamic", number] == pytest.approx(np.sqrt(np.mean(missed**2)), rel=1e-12)
        plain = y[low:high] - y[:low].mean()
        assert found.table.loc[BEFORE, number] == pytest.approx(np.sqrt(np.mean(plain**2)), rel=1e-12)


def test_a_dynamic_device_is_to_be_corrected_and_the_least_error_is_marked(device):
    X, y = device
    found = later_errors(variants(X, y), X, y)
    assert found.helps("dynamic") and found.best == "dynamic"
    assert found.advice("dynamic").startswith("Use it: better in 5 of 5 later blocks")
    assert "dynamic *" in str(found) and "static *" not in str(found)


def test_the_range_of_blocks_holds_what_all_of_them_leave():
    """It said "1.03 uV rms (1 to 1)": two digits, unless they do not hold the value in three."""
    blocks = [0.0000010281, 0.0000010314, 0.0000010337]
    columns = [1, 2, 3, "all"]
    rows = {BEFORE: [2e-6] * 4, "static": [2e-6] * 4, "dynamic": [*blocks, float(np.sqrt(np.mean(np.square(blocks))))]}
    found = LaterErrors(table=pd.DataFrame(rows, index=columns).T, dynamic=("dynamic",), unit="V")
    assert "leaves 1.03 uV rms (1.03 to 1.03)" in found.advice("dynamic")
    wide = found.table.copy()
    wide.loc["dynamic"] = [0.5e-6, 1.2e-6, 1.1e-6, 0.98e-6]
    assert "(0.5 to 1.2)" in replace(found, table=wide).advice("dynamic")


def test_what_has_no_memory_is_not_said_to_need_one():
    X = make_record(3000, seed=8)[["temperature"]]
    rng = np.random.default_rng(8)
    y = 3 * X["temperature"] + rng.standard_normal(3000)
    found = later_errors(variants(X, y, ["2 h", "20 h"]), X, y)
    said = found.advice("dynamic")
    assert not found.helps("dynamic") and said.startswith("Not shown to help"), said


def test_too_short_a_record_says_so():
    record = make_record(40, seed=1)
    X, y = record[["temperature"]], record["reading"]
    for kept in (slice(30, None), slice(33, None)):
        late = y.where(np.isin(np.arange(40), np.arange(40)[kept]))
        found = later_errors(variants(X, late, ["5 min"]), X, late)
        assert found.helps("dynamic") is None and "too short" in found.advice("dynamic")
        assert "later blocks" in str(found)


def test_blocks_that_some_variant_cannot_foretell_count_for_none(device):
    X, y = device
    y = y.where((np.arange(4000) < 3) | (np.arange(4000) >= 2004))  # next to none before the first block
    found = later_errors(variants(X, y), X, y, n_blocks=4)
    known = list(found.blocks.columns)
    assert known == [2, 3, 4]
    for row in found.table.itertuples():
        errors = found.blocks.loc[row.Index].to_numpy()
        assert found.table.loc[row.Index, "all"] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-3)


def test_variants_of_a_comparison_are_taken_as_they_are(device):
    X, y = device
    comparison = compare_variants(X, y, temperature="temperature", time_constants=["5 min", "90 min"])
    told = []
    found = later_errors(comparison.models, X, y, n_blocks=3, progress=told.append)
    assert list(found.table.index) == [BEFORE, *comparison.models]
    assert len(told) == 12 and told[-1] == "later block 3 of 3: dynamic nonlinear"


def test_a_memory_is_in_the_model_and_not_in_its_name(device):
    X, y = device
    static, dynamic = variants(X, y).values()
    found = later_errors({"dynamic in name alone": static, "mine": dynamic}, X, y)
    assert found.dynamic == ("mine",) and found.helps("mine")
