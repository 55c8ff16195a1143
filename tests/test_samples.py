"""Steppers: every kind of the catalogue, sample by sample in plain floats, against its columns."""

from __future__ import annotations

import errno

import numpy as np
import pytest
from effect_records import LIVE, LIVE_NAMES, learned, log, whole

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import CATALOGUE, Effect, Hysteresis, ThermalLag
from thermocorr.effects.expressions import Decays, Word
from thermocorr.effects.stream import STEPPED, Sample, own_starts, stepper_of
from thermocorr.equations import compiled, lag_differences


class Squared(Effect):
    """An effect with columns of its own, which asks for all that a block offers."""

    kind = "squared"

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["square", "clock", "late"]

    def columns(self, block, state):
        lag, state = lag_differences(block["humidity"], block.steps, np.array([500.0]), state)
        clock = block.seconds - 2 * block.elapsed
        return np.column_stack((block["humidity"] ** 2, clock, lag)), state


class Everything(Effect):
    """A user's own effect in the words of `Signals`: all of them, and words upon words."""

    kind = "everything"

    def inputs(self):
        return ["humidity"]

    def names(self):
        return ["late play", "rate", "late lag", "damped", "clock", "case", "size"]

    def signals(self, x):
        h = x["humidity"]
        late = x.delayed(h, 130.0) - h
        slow = x.lag(x.play(x.T, 0.3), [100.0, 900.0], "zero_order")
        rate = x.change_rate(h * x.T)
        damped = x.exp(-abs(h - 45.0) / 3) + x.sin(x.T / 7) * x.cos(h) / (1 + h**2)
        clock = x.minimum(x.seconds, x.elapsed + 600.0) / 3600 + x.log1p(x.elapsed)
        case = x.where(x.previous(x.T) != x.T, x.maximum(h, 45), 2 - x.T)
        return [slow[1] - slow[0], rate, x.lag(late, [50.0])[0], damped, clock, case, 3 * x.step]


ALL = [*LIVE, ThermalLag([90.0, 4000.0], "zero_order"), Squared(), Everything()]
IDS = [*LIVE_NAMES, "held", "own", "everything"]


def test_every_word_has_a_stepper():
    assert set(STEPPED) == set(Word.__subclasses__()) - {Decays}  # the clock is all that decays remember


def test_every_kind_says_its_signals():
    assert all(effect.columns is Effect.columns or effect.foresees for effect in CATALOGUE.values())


def stepped(effect, record, cuts=()):
    """Columns by the stepper; where `cuts` says, a block of rows goes through `columns` and hands on its state."""
    times = record.times
    stepper = stepper_of(effect, times, record.first_stamp(), "temperature")
    rows = []
    for block in record.blocks(10**9, starts=own_starts(record)):
        stepper.start(None)
        assert stepper.state() is None
        for k in range(len(block)):
            sample = Sample()
            sample.begins, sample.step, sample.temperature = k == 0, float(block.steps[k]), float(block.temperature[k])
            sample.values = {name: float(column[block.start + k]) for name, column in record.columns.items()}
            sample.seconds, sample.elapsed = float(block.seconds[k]), float(block.elapsed[k])
            sample.stamp, sample.segment_zero, sample.key = (
                record.stamp(block.start + k),
                block.segment_zero,
                block.segment,
            )
            rows.append(list(stepper.step(sample)))
            if block.start + k in cuts:  # another stepper takes over
                state, stepper = stepper.state(), stepper_of(effect, times, record.first_stamp(), "temperature")
                stepper.start(state)
    return np.array(rows)


@pytest.mark.parametrize("effect", ALL, ids=IDS)
@pytest.mark.parametrize("irregular", [0.0, 0.5])
def test_steppers_agree_with_columns(effect, irregular):
    effect, record = learned(effect, log(300, seed=1, irregular=irregular, holes=[120]), max_gap="1 h")
    expected = whole(effect, record)
    # Both sides round each product once; NumPy's and C's exponentials differ in the last digit. The recursion forgets.
    scale = np.abs(expected).max(axis=0) + 1e-300
    for cuts in ((), (50, 51, 119, 200)):
        np.testing.assert_array_less(np.abs(stepped(effect, record, cuts) - expected) / scale, 2e-14)


@pytest.mark.parametrize("effect", ALL, ids=IDS)
def test_states_of_steppers_and_of_columns_are_interchangeable(effect):
    effect, record = learned(effect, log(200, seed=2, irregular=0.3))
    (block,) = record.blocks(10**9, starts=own_starts(record))
    _, state = effect.columns(block, None)
    stepper = stepper_of(effect, record.times, record.first_stamp(), "temperature")
    stepper.start(state)
    again = stepper.state()
    assert type(again) is type(state)
    for one, other in zip(flat(state), flat(again), strict=True):
        np.testing.assert_array_equal(one, other)


def flat(state):
    """Numbers and arrays of a state."""
    if isinstance(state, tuple):
        return [part for inner in state for part in flat(inner)]
    return [] if state is None else [np.asarray(state, float)]


@pytest.mark.parametrize("fault", ["no folder", "full disk"])
def test_compiled_code_that_cannot_be_kept_is_compiled_all_the_same(fault, tmp_path, monkeypatch):
    """A read-only installation without a home, or a full disk: a speed of the next process is no error of this one."""
    pytest.importorskip("numba", reason="compiled code needs numba: pip install '.[fast]'")
    from numba.core import caching, config

    refused = []

    def full(*_):
        refused.append(1)
        raise OSError(errno.ENOSPC, "No space left on device")

    if fault == "no folder":
        monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    else:
        monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
        monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    compiled._compiled_play.cache_clear()
    try:
        followed = compiled.play(np.array([1.0, 0.0, 0.0]), np.array([2.0, 3.0, 0.5]), 0.0)
        assert compiled._compiled_play() is not None
    finally:
        compiled._compiled_play.cache_clear()
    assert followed.tolist() == [1.0, 1.0, 0.5] and bool(refused) == (fault == "full disk")


def test_compiled_play_is_the_loop_to_the_last_bit(monkeypatch):
    pytest.importorskip("numba", reason="numba is not installed: there is no compiled play")
    record = make_record(5000, seed=9)
    results = []
    for fast in (True, False):
        if not fast:
            monkeypatch.setattr("thermocorr.equations.compiled._compiled_play", lambda: None)
        model = DynamicBiasRegressor("temperature", ["10 min"], effects=[Hysteresis(0.4)])
        model.fit(record[["temperature"]], record["reading"])
        results.append(model.features_.transform(record[["temperature"]]))
    np.testing.assert_array_equal(*results)
