"""Lines of plain CSV as samples for a corrector, and what is wrong with them."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..estimators.unit_guard import UnitGuard
from ..files.result_files import new_names
from ..foreign import RUN
from ..foreign.clocks import SPANS
from ..foreign.roles import named_time
from ..foreign.timed import unit_of_times
from ..live.corrector import OnlineCorrector
from ..records import RecordError
from ..records.errors import listing, quoted, times_word
from ..records.files import fields_of, header_of, is_comment, miscounted
from ..records.grammar import label, number
from ..records.units import ENOUGH, unit_of

SHOWN = 20
"""Bad lines that are named one by one; further ones are counted."""


class LineRows:
    """Reads lines for a corrector, and answers each.

    `live` (OnlineCorrector). `options` (Namespace): Of the command: `reading` and `time` name columns. `called`
    (mapping): Column of the log for each thermometer that goes by another name. `complain` (callable): Takes a sentence
    about a line.
    """

    def __init__(
        self,
        live: OnlineCorrector,
        options: argparse.Namespace,
        called: Mapping[Any, str],
        complain: Callable[[str], None],
    ):
        self.live, self.options, self.called, self.complain = live, options, called, complain
        self.header: list[str] = []
        self.number = 0
        """Lines read."""
        self.left_out = 0
        self.without_result: Counter[str] = Counter()
        self._guard = UnitGuard.of(live.model)
        self._first: dict[Any, list[float]] = {name: [] for name in self._guard.ranges}
        """Temperatures of each thermometer until there are enough to tell its unit."""
        history = live.model.features_.history_
        self._thermometers = live.model.thermometers_
        self._timed, self._seconds = history.kind != "rows", history.kind == "seconds"
        self._temperature = history.record.temperature_name
        self._labels = [segment.run for segment in history.record.segments]

    def begin(self, line: bytes) -> list[str]:
        """Read the header; returns its fields and the names of the results."""
        self.number, model = 1, self.live.model
        header = self.header = header_of(line, "line 1")
        names = {name: self.called.get(name, str(name)) for name in (self._temperature, *self.live.columns)}
        self._columns = {
            name: self._place(column, "temperature" if name in model.thermometers_ else "")
            for name, column in names.items()
        }
        self._reading = self._place(self.options.reading or model.reading_.name, "reading")
        self._guard.check_reading(header[self._reading], None)
        for thermometer in self._guard.ranges:
            column = self.called.get(thermometer, str(thermometer))
            self._guard.check_temperature(thermometer, unit_of(column, None), column=column)
        self._run = None if model.run in (None, RUN) else self._place(str(model.run), "")
        self._time, self._unit = None, 1.0
        if self._timed:
            taken = {*self._columns.values(), self._reading, self._run}
            free = [name for at, name in enumerate(header) if at not in taken]
            name = self.options.time or model.time or named_time(free) or "time"
            self._time = self._place(str(name), "time")
            self._unit = SPANS.get(unit_of_times(str(name), {}), 1.0) if self._seconds else 1.0
        return [*header, *new_names(self.live.names, header)]

    def answer(self, line: bytes) -> list[str] | None:
        """A row and its results; None for an empty line, and for one that is left out and complained of.

        Raises RecordError where temperatures are in another unit than the fitted ones.
        """
        self.number += 1
        try:
            fields = fields_of(line)
            if not fields or fields == self.header or is_comment(fields[0], len(fields), len(self.header)):
                return None
            if len(fields) != len(self.header):
                raise RecordError(miscounted(len(fields), len(self.header)))
            values = {
                name: number(fields[at], str(name), switch=name not in self._thermometers)
                for name, at in self._columns.items()
            }
            U = number(fields[self._reading], "the reading")
            run = self._label(fields)
            stamp = None if self._time is None else self.live.stamp(self._moment(fields[self._time].strip()))
        except (RecordError, TypeError) as error:
            self.left_out += 1
            if self.left_out <= SHOWN:
                self.complain(f"line {self.number} is left out: {' '.join(str(error).split())}")
            if self.left_out == SHOWN:
                self.complain("further lines that are left out are counted only")
            return None
        self._look(values)
        found = self.live.update_stamp(stamp, run, values, U)
        if math.isnan(found.corrected):
            self.without_result[found.flag] += 1
        results = [getattr(found, name) for name in self.live.names]
        return [*fields, *(value if isinstance(value, str) else _cell(value) for value in results)]

    def summary(self) -> str:
        """Count of rows without a result, with reasons; empty where all have one."""
        reasons = [f"{count} {why}" for why, count in self.without_result.most_common()]
        if self.left_out:
            reasons.insert(0, f"{times_word(self.left_out, 'line')} left out")
        rows = self.left_out + sum(self.without_result.values())
        lines = times_word(self.number - 1, "line")
        return f"{rows} of {lines} got no result: {', '.join(reasons)}" if reasons else ""

    @property
    def damaged(self) -> bool:
        """True if rows got no result for what is wrong with the log, not for a cell that it leaves empty."""
        return bool(self.left_out or any("time" in flag for flag in self.without_result))

    def _place(self, name: str, option: str) -> int:
        if name not in self.header:
            hint = f" Name it with --{option}." if option else ""
            raise RecordError(f"The log has no column {quoted(name)}; it has {listing(self.header)}.{hint}")
        return self.header.index(name)

    def _label(self, fields: list[str]) -> Any:
        if self.live.model.run == RUN and RUN not in self.header:
            return self.options.log  # learned from several files, each a run: this is one more
        return None if self._run is None else label(fields[self._run], self._labels)

    def _moment(self, cell: str) -> Any:
        return number(cell, "the time") * self._unit if self._seconds else cell

    def _look(self, values: Mapping[Any, float]) -> None:
        """Ask the first temperatures for their unit."""
        for name in list(self._first):
            if math.isfinite(values[name]):
                self._first[name].append(values[name])
            if len(self._first[name]) >= ENOUGH:
                column = self.called.get(name, str(name))
                median = float(np.median(self._first.pop(name)))
                self._guard.check_temperature(name, unit_of(column, None), median, column)


def _cell(value: float) -> str:
    """All the digits that tell a number from others; nothing for NaN."""
    return "" if math.isnan(value) else repr(float(value))
