"""Columns as a diagnosis makes them, by shorter ways: even steps, lags side by side, one column at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_records import EXAMPLES, NAMES, learned, log, read, whole
from sklearn.base import clone

from thermocorr.effects import Covariate, Delay, Hinge, LaggedCovariate, LagProducts, ThermalLag
from thermocorr.effects.covariates import ColumnLags
from thermocorr.effects.signals import BlockSignals, DelayState
from thermocorr.effects.stream import own_starts
from thermocorr.estimators import averages


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
    together = averages.averaged_columns(record, effects, 500)
    for effect, columns in zip(effects, together, strict=True):
        (alone,) = averages.averaged_columns(record, [effect], 500)
        np.testing.assert_allclose(columns, alone, rtol=1e-12, atol=1e-12, err_msg=str(effect))


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
    together = averages.averaged_columns(record, effects, 500)
    for effect, columns in zip(effects, together, strict=True):
        np.testing.assert_array_equal(columns, averages.averaged_columns(record, [effect], 500)[0])
