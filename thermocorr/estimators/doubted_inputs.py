"""What a fitted regressor says where its inputs are not known: cells that were missing, gaps between rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..records import Block, Record, SegmentStart
from ..records.flags import Flags
from ..records.screen import LeftOut
from .features import DiffusiveFeatures
from .filling_error import SPOILT, FillingError
from .gap_error import GapError, error_behind_gaps
from .input_law import InputLaw, law_of_inputs


class DoubtedInputs:
    """The part of `DynamicBiasRegressor` that knows what its inputs may be wrong by."""

    if TYPE_CHECKING:

        @property
        def features_(self) -> DiffusiveFeatures: ...  # noqa: D102

        @property
        def coef_(self) -> np.ndarray: ...  # noqa: D102

        @property
        def residual_std_(self) -> float: ...  # noqa: D102

    def filling_error(self) -> FillingError:
        """Propagates the errors of filled cells to the bias."""
        return FillingError([*self._laws_of_inputs(one.column for one in self.features_.filling_.stand_ins)])

    def gap_error(self) -> GapError:
        """Propagates what happened in gaps of later rows to the bias."""
        gaps = self.features_.history_.gaps
        return GapError([*self._laws_of_inputs(gaps.squares)], gaps)

    def resumed(self, X: Any, y: Any = None) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """A new record tied to the fitted one, with what filled cells may move its bias by."""
        record, starts, states = self.features_.resume(X, y)
        return self.with_filling_error(record), starts, states

    def with_filling_error(self, record: Record) -> Record:
        """The record with what filled cells may move its bias by, where it has some and that is not yet known."""
        if not record.filled or record.filling_error is not None:
            return record
        return replace(record, filling_error=self.filling_error().of_record(record))

    def judged(self, X: Any, y: Any = None) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """`resumed`, with what its inputs may have moved the bias by in gaps."""
        record, starts, states = self.resumed(X, y)
        if record.gap_variance is None:
            record = replace(record, gap_variance=self.gap_error().of_record(record, starts))
        return record, starts, states

    def without_spoilt(self, record: Record) -> Record:
        """The record without the readings where filled cells or gaps may move the bias by much.

        By a share of the residuals' deviation: in their own rows, and for a while after these.
        """
        if record.reading is None:
            return record
        limit = SPOILT * self.residual_std_
        rows, error = error_behind_gaps(record, self._laws_of_inputs(record.columns), limit)
        rows = rows[np.argsort(-error, kind="stable")[: record.n_used // 2]]  # a poor first law would leave out all
        if record.filled:
            spoilt = self.filling_error().of_record(record) > limit
            for errors in record.filled.values():
                spoilt |= np.isfinite(errors)
            rows = np.concatenate((rows, np.flatnonzero(spoilt)))
        if not len(rows):
            return record
        reading: Any = LeftOut(record.reading, np.unique(rows))
        return replace(record, reading=reading)

    def mark_doubted(self, flags: Flags, block: Block) -> None:
        """Flag a block's rows where what is not known of the inputs matters."""
        record = block.record
        if record.filling_error is not None:
            filled = np.logical_or.reduce([np.isfinite(errors[block.rows]) for errors in record.filled.values()])
            self.mark_filled(flags, record.filling_error[block.rows], filled)
        if record.gap_variance is not None:
            self.mark_behind_gaps(flags, record.gap_variance[block.rows])

    def mark_filled(self, flags: Flags, error: np.ndarray, filled: np.ndarray) -> None:
        """Flag rows with filled cells, and those where these may move the bias by more than the residuals' deviation.

        Where nothing graver is said of them.
        """
        mild = flags.are("", "outside fitted range")
        flags[mild & filled] = "filled"
        flags[mild & (error > self.residual_std_)] = "thermometer lost"

    def mark_behind_gaps(self, flags: Flags, variance: np.ndarray) -> None:
        """Flag rows in which gaps may move the bias by more than the residuals' deviation."""
        flags[flags.are("", "outside fitted range", "filled") & (variance > self.residual_std_**2)] = "behind gap"

    def _laws_of_inputs(self, columns: Iterable[Any]) -> Iterator[InputLaw]:
        """Made when they are asked for."""
        features = self.features_
        temperature = features.history_.record.temperature_name
        yield from law_of_inputs(features.effect_list(), self.coef_, temperature, [*columns], self.residual_std_)
