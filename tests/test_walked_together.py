"""Columns as a diagnosis makes them, by shorter ways: even steps, lags side by side, one column at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_records import EXAMPLES, NAMES, learned, log, read, whole
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone

from thermocorr.effects import Covariate, Delay, Effect, Hinge, LaggedCovariate, LagProducts, ThermalLag
from thermocorr.effects.covariates import ColumnLags
from thermocorr.effects.signals import BlockSignals, DelayState
from thermocorr.effects.stream import own_starts, walk
from thermocorr.equations.shifted import shifted
from thermocorr.judgement import blocks
from thermocorr.judgement.copies import moved
from thermocorr.judgement.lag_banks import banks


@examples(200)
@given(
    values=st.lists(st.floats(-100, 100), min_size=1, max_size=9),
    first=st.one_of(st.integers(-30, 30), st.floats(-30, 30)),
    n=st.integers(1, 12),
)
def test_values_between_rows_are_those_of_straight_lines(values, first, n):
    expected = np.interp(first + np.arange(n), np.arange(len(values)), values)
    np.testing.assert_allclose(shifted(np.array(values), first, n), expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("holes", [(), (150,)], ids=["one segment", "two"])
@pytest.mark.parametrize("size", [37, 10**9])
@pytest.mark.parametrize("example", EXAMPLES, ids=NAMES)
def test_each_column_is_that_of_columns_whether_steps_are_even_or_not(example, size, holes):
    """Where a hole makes two segments, no step is known to be that of all rows: the same rows by the longer way."""
    effect, record = learned(example, log(irregular=0.0, holes=holes))
    assert (record.times.even_step is None) == bool(holes)
    parts, state = [], None
    for block in record.blocks(size, starts=own_starts(record)):
        state = None if block.begins else state
        each, state = effect.each_column(block, state)
        parts.append(np.column_stack([np.broadcast_to(column, len(block)) for column in each]))
    np.testing.assert_allclose(np.vstack(parts), whole(effect, record), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("size", [100, 37, 8])
@pytest.mark.parametrize("example", EXAMPLES, ids=NAMES)
def test_rows_that_are_passed_over_are_known_to_be_lacking_wherever_blocks_end(example, size):
    X = log(irregular=0.0)
    X.iloc[[120, 121, 122, 250], 0] = np.nan
    effect, record = learned(example, X)
    parts = [step.columns for step in walk([effect], record, starts=own_starts(record), size=size)]
    np.testing.assert_allclose(np.vstack(parts), whole(effect, record), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("example", [e for e in EXAMPLES if e.kind in ("delay", "lead", "thermometer_noise")], ids=str)
def test_a_known_step_changes_nothing(example):
    effect, record = learned(example, log(irregular=0.0))
    unknown = replace(record, times=replace(record.times))
    unknown.times.__dict__["_even_ticks"] = None
    np.testing.assert_allclose(whole(effect, record), whole(effect, unknown), rtol=0, atol=1e-10)


def test_a_delay_reaches_back_into_rows_of_other_steps():
    """A stream went on with other steps: what came before is looked up by its time."""
    effect, record = learned(Delay(300.0), log(200, irregular=0.0))
    (block,) = record.blocks(10**9)
    elapsed = np.array([-400.0, -290.0, -170.0, -31.0])
    before = (elapsed, np.array([20.0, 21.0, 19.0, 22.0]))
    found = effect.columns(block, DelayState(*before))[0][:, 0]
    known = np.concatenate((elapsed, block.elapsed)), np.concatenate((before[1], block.temperature))
    expected = np.interp(block.elapsed - 300.0, *known) - block.temperature
    np.testing.assert_allclose(found, expected, atol=1e-12)


BANKED = [
    *(LaggedCovariate("humidity", [tau]) for tau in (120.0, 900.0, 9000.0, 900.0)),
    LaggedCovariate("humidity", ["1 h"], power=2),
    LaggedCovariate("humidity", ["2 h"], hold="zero_order"),
    *(ColumnLags("humidity", [tau]) for tau in (60.0, 900.0)),
    *(Hinge(knee, side, times) for knee in (22.8, 23.2) for side in ("above", "below") for times in ([], [600], [60])),
    ThermalLag([300.0]),
    ThermalLag([600.0, 6000.0]),
    ThermalLag([300.0], form="paper"),
    LagProducts([300.0]),
    LagProducts([600.0]),
    Covariate("humidity"),
    Covariate("humidity", power=2),
    ThermalLag([300.0 * (1 + 1e-9)]),
]
"""Those of one kind differ in their time constants alone, or in more; the last one's name is another one's too."""


@pytest.mark.parametrize("missing", [False, True])
def test_effects_walked_together_have_the_columns_of_each(missing):
    X = log(3000)
    effects = [clone(effect) for effect in BANKED]
    record = replace(read(X), reading=np.where(missing & (np.arange(3000) % 7 == 3), np.nan, X["temperature"]))
    for effect in effects:
        effect.learn(record)
    together = blocks.averaged_columns(record, effects, 500)
    for effect, columns in zip(effects, together, strict=True):
        (alone,) = blocks.averaged_columns(record, [effect], 500)
        np.testing.assert_allclose(columns, alone, rtol=1e-12, atol=1e-12, err_msg=str(effect))


class Odd(Effect):
    """A user's own: truth, a list, one number for all rows, as an array too."""

    def names(self):
        return ["warm", "list", "one", "array of one", "whole"]

    def signals(self, x):
        return [x.T > 23.0, x.T.tolist(), 2, np.array([3.0]), np.arange(len(x.T))]


@pytest.mark.parametrize("n", [3000, 2998, 400])
def test_columns_of_an_own_effect_are_averaged_whatever_numbers_they_are(n):
    effect, X = Odd(), log(n)
    record = replace(read(X), reading=X["temperature"].to_numpy())
    (found,) = blocks.averaged_columns(record, [effect], 500)
    (block,) = record.blocks(10**9)
    columns, _ = effect.columns(block, None)
    width = blocks.stretch_of(record, 500)
    means = [columns[low : low + width].mean(axis=0) for low in range(0, n, width)]
    np.testing.assert_allclose(found, means, rtol=1e-13)


def test_a_late_column_is_its_own():
    """What an effect does to it in place must not reach the user's data."""
    (block,) = read(log(50, irregular=0.0)).blocks(10**9)
    for delay in (60.0, 90.0, 1e9):
        late = BlockSignals(block, None).delayed(block.temperature, delay)
        assert not np.shares_memory(late, block.temperature)


class Late(LaggedCovariate):
    """One that has its time constants by another parameter."""

    def __init__(self, tau=3600.0):
        super().__init__("humidity", [tau])
        self.tau = tau


class Between(ThermalLag):
    """One column, of two lags; any two have its name."""

    def names(self):
        return ["between"]

    def signals(self, x):
        fast, slow = super().signals(x)
        return [slow - fast]


class Balanced(ThermalLag):
    """Each column depends on all lags."""

    def signals(self, x):
        lags = super().signals(x)
        return [lag - sum(lags) / len(lags) for lag in lags]


@pytest.mark.parametrize(
    "effects",
    [[Late(60.0), Late(600.0)], *([kind([600, 6000]), kind([60, 9000])] for kind in (Between, Balanced))],
    ids=["late", "between", "balanced"],
)
def test_effects_derived_from_those_with_lags_are_walked_alone(effects):
    record = replace(read(log(3000)), reading=np.arange(3000.0))
    for effect in effects:
        effect.learn(record)
    together = blocks.averaged_columns(record, effects, 500)
    for effect, columns in zip(effects, together, strict=True):
        np.testing.assert_array_equal(columns, blocks.averaged_columns(record, [effect], 500)[0])


def test_as_many_effects_are_walked_as_differ_in_more_than_time_constants():
    record = read(log(300))
    effects = [clone(effect) for effect in BANKED]
    edges, wanted = 0, []
    for effect in effects:
        effect.learn(record)
        wanted.append((record, effect, range(edges, edges := edges + effect.n_columns())))
    walked = banks(wanted[:-1])
    assert len(walked) < len(wanted) - 8
    assert sorted(place for bank in walked for same in bank.places for place in same) == list(range(wanted[-2][2].stop))
    lags = [effect.time_constants_.tolist() for _, effect, _ in wanted if type(effect) is LaggedCovariate]
    assert len(lags) == 6
    assert [120.0, 900.0, 9000.0] in [getattr(bank.effect, "time_constants_", np.zeros(0)).tolist() for bank in walked]


@pytest.mark.parametrize("holes", [(), (150,)], ids=["all rows", "without a cell"])
def test_copies_of_a_column_know_their_means(holes):
    X = log(300)
    X.iloc[list(holes), 1] = np.nan
    record = read(X)
    effect = Covariate("humidity", 2)
    effect.learn(record)
    record.moments("temperature")
    for copy in moved(record, effect):
        assert ("temperature", 1) in copy.known_moments
        assert (("humidity", 2) in copy.known_moments) == (not holes)
        of = copy.moments("humidity", 2)
        anew = replace(copy, known_moments={}).moments("humidity", 2)
        np.testing.assert_allclose((of.mean, of.std, of.low, of.high), (anew.mean, anew.std, anew.low, anew.high))
