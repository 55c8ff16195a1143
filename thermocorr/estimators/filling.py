"""Cells that are missing for a while, in the rows of a record: which are filled, and what is not learned from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..records import History, Record, Segment, seconds_of
from ..records.errors import quoted, times_word
from ..records.screen import LeftOut, Limits, Screen, screened
from .stand_in import RULES, StandIn, learned_stand_in

FEWEST_ROWS = 50
"""With fewer known rows nothing is foretold."""


class FilledRows(NamedTuple):
    """Consecutive rows whose missing cells are filled."""

    values: dict[Any, np.ndarray]
    errors: dict[Any, np.ndarray]
    """Standard deviation of the filled cells of each column, NaN for others."""
    states: list[np.ndarray]
    """To go on with the rows that follow."""
    begins: np.ndarray
    """Whether a hole before this row ends the segment, shape (n,)."""


@dataclass(frozen=True)
class Filling:
    """All stand-ins of a model."""

    stand_ins: tuple[StandIn, ...] = ()
    end: tuple[np.ndarray, ...] = ()
    """What each remembers at the end of the fitted record."""

    def before(self, history: History | None, stamp: Any, run: Any) -> tuple[Sequence[np.ndarray] | None, float]:
        """What is remembered where rows begin, and the time since then [s]: they may follow on the fitted record."""
        if history is None or history.kind == "rows" or not self.end:
            return None, 0.0
        fitted = history.record
        step = history.between(stamp, fitted.stamp(fitted.n_rows - 1))
        follows = 0 < step <= (np.inf if history.max_gap is None else history.max_gap)
        return (self.end, step) if follows and run == fitted.segments[-1].run else (None, 0.0)

    def fill(
        self,
        given: Mapping[Any, np.ndarray],
        steps: np.ndarray,
        states: Sequence[np.ndarray] | None = None,
    ) -> FilledRows:
        """Fill the missing cells of columns, see `StandIn.fill`."""
        before = [None] * len(self.stand_ins) if states is None else states
        found = {one.column: one.fill(given, steps, state) for one, state in zip(self.stand_ins, before, strict=True)}
        return FilledRows(
            {**given, **{name: filled.values for name, filled in found.items()}},
            {name: filled.errors for name, filled in found.items()},
            [filled.state for filled in found.values()],
            np.logical_or.reduce([filled.begins for filled in found.values()]),
        )

    def believed(self, given: Mapping[Any, np.ndarray], stamp_of: Callable[[int], Any]) -> dict[Any, np.ndarray]:
        """Columns that are filled or fill others, NaN where a cell is none; `stamp_of` gives a row's time stamp."""
        columns = {name: np.array(given[name], float) for name in self.columns}
        for one in self.stand_ins:
            for rows, _ in one.limits.reasons(columns[one.column], stamp_of):
                columns[one.column][rows] = np.nan
        return columns

    def in_record(self, record: Record, history: History | None) -> Record:
        """A record whose missing cells are filled, and those that are codes for none, or end the segment."""
        columns = self.believed(record.columns, record.times.stamp)
        errors = {one.column: np.full(record.n_rows, np.nan) for one in self.stand_ins}
        segments: list[Segment] = []
        for start, stop, run in record.segments:
            segments.append(Segment(start, stop, run))
            rows = record.rows(start, stop)
            given = {name: values[rows] for name, values in columns.items()}
            if all(np.isfinite(values).all() for values in given.values()):
                continue
            states, since = self.before(history, record.stamp(start), run)
            steps = np.concatenate(([since], record.times.steps(rows)[1:]))
            filled = self.fill(given, steps, states)
            for name, each in filled.errors.items():
                columns[name][rows], errors[name][rows] = filled.values[name], each
            edges = [start, *(np.flatnonzero(filled.begins[1:]) + start + 1).tolist(), stop]
            segments[-1:] = [Segment(low, high, run) for low, high in pairwise(edges)]
        gone = {name: each for name, each in errors.items() if np.isfinite(each).any()}
        kept = {name: columns[name] for name in gone}
        if len(segments) > len(record.segments):
            record = replace(record, segments=tuple(segments), known_moments={})
        return replace(record, columns={**record.columns, **kept}, filled=gone) if gone else record

    def at_end_of(self, record: Record) -> Filling:
        """The stand-ins with what they remember at the end of a record whose rows lack nothing, or are filled."""
        start, stop, _ = record.segments[-1]
        rows = record.kept(start, stop)
        given = {name: np.asarray(record.columns[name][rows], float) for name in self.columns}
        for name, errors in record.filled.items():
            given[name] = np.where(np.isfinite(errors[rows]), np.nan, given[name])
        return replace(self, end=tuple(self.fill(given, record.times.steps(rows)).states))

    @property
    def columns(self) -> list[Any]:
        """Columns that are filled, or that fill others."""
        return list(dict.fromkeys(name for one in self.stand_ins for name in (one.column, *one.others)))


def filling_of(
    record: Record, thermometers: Sequence[Any], rules: Mapping[Any, Any] | None, screen: Screen | None
) -> Filling:
    """Stand-ins for a record's columns, learned from it.

    Parameters
    ----------
    record : Record
        Rows that lack something are passed over.
    thermometers : sequence of columns
        Where there are several, each is estimated from the others unless a rule says otherwise.
    rules : mapping of column to rule
        One of `RULES`, or one and the length of a hole up to which it is filled, or does not end the segment.
    screen : Screen, optional
        What is refused of the first thermometer; where there is one, that of the others is found.
    """
    limits: dict[Any, Limits] = {}
    if screen is not None:
        limits[thermometers[0]] = screen.temperature
        for name in thermometers[1:]:
            record, limits[name] = _screened(record, name)
    several = list(thermometers) if len(thermometers) > 1 else []
    wanted = {**dict.fromkeys(several, "estimate"), **(rules or {})}
    stand_ins = []
    for name, given in wanted.items():
        rule, longest = given if isinstance(given, tuple) else (given, None)
        if record.n_used < FEWEST_ROWS:
            continue
        others = [other for other in thermometers if other != name] if rule == "estimate" else []
        limit = seconds_of(longest, "fill") if longest is not None else 0.0 if rule == "end" else np.inf
        stand_in = learned_stand_in(record, name, tuple(others), rule=rule, longest=limit)
        known = record.moments(name)
        stand_ins.append(replace(stand_in, limits=limits.get(name, Limits()), range=(known.low, known.high)))
    return Filling(tuple(stand_ins))


def _screened(record: Record, name: Any) -> tuple[Record, Limits]:
    """The record without rows in which a further thermometer shows what is no temperature, and what that is."""
    plain = replace(record, temperature_name=name, reading=None, refused=(), notes=())
    found, screen = screened(plain)
    return replace(record, segments=found.segments, skipped=found.skipped, known_moments={}), screen.temperature


def learned_beside(full: Record, known: Record, notes: Sequence[str]) -> Record:
    """A filled record to learn from: without the readings beside filled cells.

    Parameters
    ----------
    full : Record
        Filled.
    known : Record
        Its rows that lack nothing, with the readings that are believed.
    notes : sequence of str
        What was said of those that are not.
    """
    beside = np.zeros(full.n_rows, bool)
    said = []
    for name, errors in full.filled.items():
        filled = np.isfinite(errors)
        beside |= filled
        count = times_word(int(filled.sum()), "cell")
        said.append(
            f"{count} of {quoted(name)} filled, the first in row {int(filled.argmax())}; their readings are "
            "not learned from."
        )
    reading: Any = LeftOut(known.reading, np.flatnonzero(beside)) if known.reading is not None else None
    return replace(full, reading=reading, refused=known.refused, notes=(*full.notes, *notes, *said))


def check_rules(rules: Any, thermometers: Sequence[Any], needed: Sequence[Any]) -> None:
    """ValueError for rules that are none, and for columns that the model does not read."""
    known = [*thermometers, *needed]
    for name, given in ({} if rules is None else rules).items():
        rule = given[0] if isinstance(given, tuple) and len(given) == 2 else given
        if rule not in RULES:
            raise ValueError(
                f"The 'fill' parameter must say {', '.join(map(repr, RULES))} of a column, or (one of these, the "
                f"longest hole). Got {given!r} for {name!r}."
            )
        if name not in known:
            raise ValueError(f"The 'fill' parameter names {name!r}, which the model does not read: {known!r}.")
        if rule == "estimate" and (len(thermometers) < 2 or name not in thermometers):
            raise ValueError(
                f"The 'fill' parameter wants {name!r} estimated: it is no thermometer with others beside it. Pass "
                "temperature=[...], or fill the column before, with pandas' ffill() or interpolate()."
            )
