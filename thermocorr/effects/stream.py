"""One walk through a record: every effect fills its columns of each block, states handed on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..records import BLOCK_ROWS, Block, History, Record, Segment, SegmentStart
from .protocol import Effect


class Walked(NamedTuple):
    """Columns of one block."""

    block: Block
    columns: np.ndarray
    """Shape (n, p), Fortran order; the walk does not touch it again."""
    states: list[Any]
    """State of each effect after the block."""


def own_starts(record: Record) -> dict[int, SegmentStart]:
    """Starts of a record that is being fitted: each segment is its own."""
    return {key: SegmentStart(key, record.stamp(segment.start), None) for key, segment in enumerate(record.segments)}


def walk(
    effects: Sequence[Effect],
    record: Record,
    *,
    zero: float | None = None,
    starts: dict[int, SegmentStart] | None = None,
    states: dict[int, list[Any]] | None = None,
    size: int = BLOCK_ROWS,
    extra: int = 0,
) -> Iterator[Walked]:
    """Columns of all effects, block by block in time order.

    Parameters
    ----------
    effects : sequence of Effect
        Learned effects.
    record : Record
        What to walk through.
    zero, starts : see `Record.blocks`
        How the record hangs on the fitted one.
    states : dict of segment number -> list of states
        Where to start; segments that are not in it start afresh.
    size : int
        Rows of a block.
    extra : int
        Free columns to leave behind the effects' own.
    """
    widths = [effect.n_columns() for effect in effects]
    width = sum(widths)
    current: list[Any] = []
    for block in record.blocks(size, zero, starts):
        if block.start == record.segments[block.segment].start:
            current = list((states or {}).get(block.segment) or [None] * len(effects))
        columns = np.empty((len(block), width + extra), order="F")
        at = 0
        for i, (effect, n_columns) in enumerate(zip(effects, widths, strict=True)):
            current[i] = effect.fill(block, current[i], columns[:, at : at + n_columns])
            at += n_columns
        yield Walked(block, columns, current)


def needed_columns(effects: Sequence[Effect]) -> list[Any]:
    """Recorded columns that the effects read beside the temperature."""
    return list(dict.fromkeys(name for effect in effects for name in effect.inputs()))


def resume(
    effects: Sequence[Effect], history: History, record: Record
) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
    """Tie a new record to the fitted one, and find the states with which its segments start."""
    record, starts, replay = history.locate(record)
    states: dict[int, list[Any]] = {}
    for number, row in replay.items():
        key = starts[number].key
        assert key is not None  # it hangs on a fitted segment
        states[number] = states_before(effects, history, key, row)
    return record, starts, states


def states_before(effects: Sequence[Effect], history: History, key: int, row: int | None) -> list[Any]:
    """States after the kept rows of fitted segment `key` that come before `row`; after all of them for None."""
    return list(history.end_states[key]) if row is None else _replay(effects, history, key, row)


def _replay(effects: Sequence[Effect], history: History, key: int, row: int) -> list[Any]:
    """States after the kept rows of fitted segment `key` that come before `row`."""
    kept = history.record
    segment = kept.segments[key]
    part = Record(
        kept.times,
        kept.temperature_name,
        kept.columns,
        (Segment(segment.start, row, segment.run),),
        skipped=kept.skipped[kept.skipped < row],
    )
    start = {0: SegmentStart(key, kept.stamp(segment.start), None)}
    states: list[Any] = []
    for step in walk(effects, part, zero=history.zero, starts=start):
        states = step.states
    return states
