"""Columns are not accused for a few slow swings: copies of them moved in time explain as much of what is no effect."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Interaction
from thermocorr.judgement.causes import Search
from thermocorr.judgement.choice import Tried
from thermocorr.judgement.copies import Copies, moved
from thermocorr.judgement.levels import COPIES, INFLATION
from thermocorr.judgement.pool import Explanation
from thermocorr.judgement.worth import Worth
from thermocorr.records import read_record
from thermocorr.records.read import Layout

pytestmark = pytest.mark.newest


def swinging(n, seed):
    """A random walk: a column that has nothing to do with the record."""
    return np.cumsum(np.random.default_rng(seed).standard_normal(n)) / np.sqrt(n)


def a_record(seed, n=4000):
    """A device without a hidden effect, and three columns that swing slowly."""
    record = make_record(n, seed=seed, effects={})
    X = record.drop(columns="reading")
    return X.assign(**{f"c{k}": swinging(n, 100 * seed + k) for k in range(3)}), record["reading"]


def slower_and_faster(n, size):
    """A swing that grows faster and larger: no noise, no effect, and no wave."""
    share = np.linspace(0, 1, n)
    return size * np.sin(40 * share**2) * np.exp(-(((share - 0.5) / 0.3) ** 2)) * (1 + 3 * share)


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_no_column_is_accused_of_structure_that_its_copies_explain_as_well(seed):
    X, y = a_record(seed)
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y + slower_and_faster(len(y), 0.3 * y.std()))
    assert not [cause.label for cause in found.causes if cause.effect.inputs()]


def test_what_the_copies_explained_is_said():
    X, y = a_record(1)
    y = y + slower_and_faster(len(y), 0.3 * y.std())
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.left.copied and f"goes with {found.left.copied[0]}, and nearly as well with copies" in str(found)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_slow_column_that_is_the_cause_is_named(seed):
    X, y = a_record(seed)
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y + 0.5 * X["c0"]), X, y + 0.5 * X["c0"])
    assert found.causes[0].effect.inputs() == ["c0"] and not found.left.copied


def test_which_law_of_a_column_it_is_is_not_asked_of_its_copies():
    """Copies explained more beside the product, which was likelier than the late one; that one was named, alone."""
    record = make_record(23_040, sampling_period=30.0, setting="chamber", device="box", noise=0.2, seed=299,
                         effects={"interaction": 0.5})  # fmt: skip
    X, y = record.drop(columns="reading"), record["reading"]
    (cause,) = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y).causes
    assert isinstance(cause.effect, Interaction) and cause.effect.inputs() == ["pressure"]


def test_copies_that_other_parameters_outdo_are_outdone():
    """A lag that was likelier, and helped a little less than twice as much, gave way to half of it; true are 12 d."""
    assert not weighed(5 * INFLATION, 1.9).outdoes and weighed(5 * INFLATION, 1.9, outdone=True).outdoes
    record = make_record(17_280, sampling_period=600.0, setting="outdoor", device="plate", noise=0.2, seed=3001,
                         effects={"lagged_covariate": 1.0, "log_ageing": 1.0})  # fmt: skip
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.causes[0].effect.inputs() == ["supply"] and found.causes[0].effect.time_constants[0] > 500_000


def test_copies_hold_the_same_values_at_other_times():
    X, y = a_record(0, 500)
    record = read_record(X, Layout(temperature="temperature"), y=y.to_numpy(), needed=list(X.columns))
    copies = list(moved(record, Interaction("c1")))
    columns = [np.asarray(copy.columns["c1"]) for copy in copies]
    assert len(columns) == COPIES and len({tuple(column) for column in columns}) == COPIES
    for copy, column in zip(copies, columns, strict=True):
        np.testing.assert_array_equal(np.sort(column), np.sort(X["c1"]))
        assert not np.isclose(column, X["c1"]).mean() > 0.5
        np.testing.assert_array_equal(copy.columns["temperature"], X["temperature"])
        np.testing.assert_array_equal(copy.columns["c0"], X["c0"])


def test_missing_cells_stay_where_they_are_and_copies_are_whole_elsewhere():
    X, y = a_record(0, 500)
    X.iloc[100:120, X.columns.get_loc("c1")] = np.nan
    with pytest.warns(RecordWarning):
        record = read_record(X, Layout(temperature="temperature"), y=y.to_numpy(), needed=list(X.columns))
    for copy in moved(record, Interaction("c1")):
        column = np.asarray(copy.columns["c1"])
        assert np.isnan(column[100:120]).all() and np.isnan(column).sum() == 20
        np.testing.assert_array_equal(np.sort(column[np.isfinite(column)]), np.sort(X["c1"].dropna()))


def weighed(inflation, helped, later=3.0, blocks=2.0, outdone=False):
    """A column's evidence beside copies that gain, and help, so much."""
    before = Tried(
        explanation=Explanation(Covariate("c1"), np.zeros((3, 1))), number=0, score=25.0, full=35.0, as_law=35.0,
        p_value=1e-9, worth=Worth(later=later, blocks=blocks), scatter=3.0, uneven=False,
    )  # fmt: skip
    search = object.__new__(Search)
    search.family = SimpleNamespace(price=lambda number: 5.0, p_value=lambda gain, number: float(np.exp(-gain)))
    search.copies = {before.key: Copies(inflation=inflation, help=helped, outdone=outdone)}
    return search._beside_copies(before)


def test_evidence_is_divided_by_what_the_copies_gain():
    after = weighed(5 * INFLATION, 1.9)
    assert (after.score, after.full) == (1.0, 3.0) and after.copied and not after.named
    assert weighed(INFLATION, 1.9).proven and weighed(1.2 * INFLATION, 1.9).proven
    assert not weighed(1.2 * INFLATION, 1.9).copied


def test_a_column_that_helps_more_than_its_copies_is_a_cause_and_not_proven():
    after = weighed(5 * INFLATION, 0.9)
    assert after.named and not after.proven and after.score == 25.0 and not after.copied
    assert not weighed(5 * INFLATION, -3.0, later=0.9).named  # too little for a user to notice
    assert not weighed(5 * INFLATION, 1.1).named
