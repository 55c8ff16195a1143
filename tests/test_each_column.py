"""Columns of effects one by one are those of all together, whether steps are even or not."""

from __future__ import annotations

import numpy as np
import pytest
from effect_records import EXAMPLES, NAMES, learned, log, whole

from thermocorr.effects import Delay
from thermocorr.effects.signals import DelayState
from thermocorr.effects.stream import own_starts


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
