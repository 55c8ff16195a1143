"""Start-up decays of each segment, eq. (18)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import accumulate
from numbers import Real
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval

from ..equations import decays
from ..records import BLOCK_ROWS, Block, Record, Segment
from .grids import time_grid
from .protocol import Effect, EffectInfo, time_text
from .signals import Signals, felt_decays
from .thermal import seconds_array


class InitialTransient(Effect):
    """Start-up columns exp(-t/tau) of eq. (18), one set per fitted segment.

    They stand for the unknown temperature field inside the device when a segment starts, and belong to that segment:
    other segments have zeros there.

    Parameters
    ----------
    time_constants : sequence
        [s], or spans such as "15 min".
    longest_share : float
        A decay longer than this share of all segments together is left out: over the record it looks like drift or
        ageing, and would swallow them without a word. In a segment shorter than that, one as long as the segment
        stands for all longer ones, unless the share is above 1.
    """

    kind = "initial_transient"
    of_time_alone = True
    learned = {"decays_": "times of segments", "labels_": "texts of segments"}
    info = EffectInfo(
        physics="The device was not at rest when the record began: warm-up after switching on, or settling after it "
        "was moved.",
        bench_check="Restart the instrument, or bring it in from another room: the same decay follows each start, at "
        "constant temperature too.",
        formula="decay[tau] = exp(-t/tau) since the start of its segment, zero elsewhere",
        parameters={"time_constants": "s"},
        tuned=("time_constants",),
        place=1.2,
    )
    _parameter_constraints = {"longest_share": [Interval(Real, 0, None, closed="left")]}

    def __init__(self, time_constants: Sequence[Any] = (), longest_share: float = 1.0):
        self.time_constants = time_constants
        self.longest_share = longest_share

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """One decay, from two steps to half a segment."""
        # With more segments, a start of its own for each of them is too much freedom for one suspect
        return [cls([tau]) for tau in time_grid(record, 2.0, 0.5)] if len(record.segments) <= 30 else []

    def learn(self, record: Record) -> None:
        """List each segment's decays: ``decays_[key]`` [s]."""
        self._validate_params()
        time_constants = seconds_array(self.time_constants)
        self.decays_: dict[int, np.ndarray] = {}
        self.labels_: dict[int, str] = {}
        alike = Counter(segment.run for segment in record.segments)
        durations = [record.read_duration(segment) for segment in record.segments]
        slow = time_constants[time_constants <= self.longest_share * sum(durations)]
        for key, (segment, limit) in enumerate(zip(record.segments, self.longest(durations), strict=True)):
            chosen = time_constants[time_constants <= limit]
            # A decay as long as its segment adds little to one that is less than 1.5 times as fast.
            if len(slow) and slow.max() > limit > 1.5 * chosen.max(initial=0.0):
                chosen = np.append(chosen, limit)
            chosen = chosen[chosen > _first_reading(record, segment)]  # what is over before can't be known
            if len(chosen) == 0 or segment.n_rows <= 2 * len(chosen):
                continue
            self.decays_[key] = chosen
            named = segment.run is not None and alike[segment.run] == 1
            self.labels_[key] = str(segment.run) if named else f"segment {key}"

    def longest(self, durations: Sequence[float]) -> list[float]:
        """The longest decay of each segment [s]."""
        limit = self.longest_share * sum(durations)
        if self.longest_share > 1:
            return [limit] * len(durations)
        return [min(limit, duration) if self.longest_share else 0.0 for duration in durations]

    @property
    def first_column_(self) -> dict[int, int]:
        """First column of each segment."""
        counts = [len(taus) for taus in self.decays_.values()]
        return dict(zip(self.decays_, accumulate(counts, initial=0), strict=False))

    def names(self) -> list[str]:
        """``decay[900 s]``, or ``decay[900 s, run9]`` where there are several segments."""
        single = len(self.decays_) == 1 and not any(self.decays_) and next(iter(self.labels_.values())) == "segment 0"
        return [
            f"decay[{time_text(tau)}]" if single else f"decay[{time_text(tau)}, {self.labels_[key]}]"
            for key, taus in self.decays_.items()
            for tau in taus
        ]

    def n_columns(self) -> int:
        """Number of the names, without making them."""
        return sum(map(len, self.decays_.values()))

    def memory(self) -> float:
        """0: the clock is its only state."""
        return 0.0

    def own(self, block: Block) -> np.ndarray:
        """Decays of a block's own segment."""
        return decays(block.elapsed, self.decays_.get(block.segment, np.zeros(0)))  # eq. (18)

    def alive(self, block: Block) -> slice:
        """Columns of the block's fitted segment, while they decay."""
        count = len(felt_decays(block, self.decays_))
        first = self.first_column_[block.segment_key] if count and block.segment_key is not None else 0
        return slice(first, first + count)

    def _fill_said(self, block: Block, state: Any, columns: np.ndarray) -> Any:
        """Write a block's columns, zeros left as they are."""
        columns[:] = 0.0
        columns[:, self.alive(block)] = decays(block.elapsed, felt_decays(block, self.decays_))  # eq. (18)
        return state

    def signals(self, x: Signals) -> Sequence[Any]:
        """Decays of the segment, zeros elsewhere [1]."""
        return x.decays(self.decays_)  # eq. (18)


def _first_reading(record: Record, segment: Segment) -> float:
    """Time from a segment's start to its first reading [s]."""
    if record.reading is None:
        return 0.0
    for start in range(segment.start, segment.stop, BLOCK_ROWS):
        rows = record.rows(start, min(start + BLOCK_ROWS, segment.stop))
        known = np.isfinite(np.asarray(record.reading[rows], float))
        if known.any():
            return record.times.between(record.stamp(start + int(known.argmax())), record.stamp(segment.start))
    return np.inf
