"""A fitted model walked over a record, in the form that displays need: bounded memory for any length."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from ..effects.thermal import column_text
from ..estimators.flat import Inner
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.tables import distinct
from ..estimators.time_constant_search import TimeConstantSearch
from ..estimators.uncertainty.rows import ErrorWalk
from ..records import Block, Record
from .timeline import TimeLine, zone_of


class SegmentRows(NamedTuple):
    """Rows of one segment, in time order."""

    segment: int
    rows: Any
    """Rows of the user's data, a slice or numbers."""
    seconds: np.ndarray
    """Since the first row of the record [s]."""
    temperature: np.ndarray
    measured: np.ndarray
    """NaN where no readings are given."""
    contributions: np.ndarray
    """Shape (n, number of effects)."""


class Walk:
    """A model on a record: its time line, and its rows block by block.

    `model` (DynamicBiasRegressor, or a fitted search with a ``best_estimator_``). `X`, `y` (as for
    `DynamicBiasRegressor.evaluate_blocks`; y may be left out).
    """

    def __init__(self, model: Any, X: Any, y: Any = None):
        self.model = regressor_of(model)
        self._reading = None if y is None else self.model.reading_numbers(X, y)
        self._blocks = self.model.contribution_blocks(X)
        self._first = next(self._blocks)  # a record has at least one block
        self.record: Record = self._first[0].record
        self.timeline = TimeLine.of(self.record, zone_of(X, self.model.features_.time), without_times(self.model))
        self._shift = self.record.times.between(self.record.first_stamp(), self._first[0].zero)

    @property
    def n_rows(self) -> int:
        """Rows inside segments."""
        return self.record.n_used

    @property
    def temperature_name(self) -> str:
        """Name of the temperature, as in the user's data."""
        return column_text(self.record.temperature_name)

    def labels(self) -> list[str]:
        """Names of the effects."""
        return distinct([effect.label() for effect in self.model.features_.effect_list()])

    def corrected(self, part: SegmentRows) -> np.ndarray:
        """Readings of a part less the bias that `correct` removes."""
        return np.asarray(part.measured - self.model.removed_part(part.contributions))

    def parts(self) -> Iterator[SegmentRows]:
        """Walk; once."""
        for block, contributions in chain([self._first], self._blocks):
            yield self._part(block, contributions)

    def inner(self) -> Iterator[tuple[int, np.ndarray, np.ndarray, Inner]]:
        """Segment, seconds since the first row, ambient and inner temperatures of the rows, block by block."""
        for inner in self.model.inner_blocks(self.record):
            block = inner.block
            yield block.segment, block.seconds - self._shift, block.temperature, inner

    def uncertainties(self) -> Iterator[np.ndarray]:
        """Standard uncertainty of a reading in the rows of each of the `parts`, shape (n,)."""
        joint = self.model.joint_errors()
        for _, _, errors in ErrorWalk(self.model, joint, removed=False).blocks(self.record):
            yield np.sqrt(errors.of_readings(joint.noise))

    def _part(self, block: Block, contributions: np.ndarray) -> SegmentRows:
        if self._reading is None:
            measured = np.full(len(block), np.nan)
        else:
            measured = self.model.believed(block, np.asarray(self._reading[block.rows], float))
        return SegmentRows(
            segment=block.segment,
            rows=block.rows,
            seconds=block.seconds - self._shift,
            temperature=block.temperature,
            measured=measured,
            contributions=contributions,
        )


def regressor_of(model: Any) -> DynamicBiasRegressor:
    """The fitted `DynamicBiasRegressor`, also of a search."""
    found = getattr(model, "best_estimator_", model)
    if isinstance(found, TimeConstantSearch):
        raise TypeError("The search has no fitted model. Fit it first, with refit=True.")
    if not isinstance(found, DynamicBiasRegressor):
        raise TypeError(f"A fitted DynamicBiasRegressor is needed, or a search with one. Got {type(found).__name__}.")
    found.features_  # noqa: B018 - raises NotFittedError where nothing is fitted
    return found


def without_times(fitted: DynamicBiasRegressor) -> bool:
    """Whether the rows of a model's record have no times, so that only their number is known."""
    return fitted.features_.history_.kind == "rows" and fitted.features_.sampling_period is None
