"""Rows of a log as samples for a corrector, and what deserves no trust among them."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..estimators import DynamicBiasRegressor
from ..estimators.unit_guard import UnitGuard
from ..files.result_files import new_names
from ..foreign import RUN
from ..foreign.clocks import SPANS
from ..foreign.roles import named_time
from ..foreign.sniffing import are_units, units_below
from ..foreign.timed import unit_of_times
from ..live.corrector import OnlineCorrector
from ..live.samples import COLUMNS
from ..records import RecordError
from ..records.errors import listing, quoted, times_word
from ..records.files import fields_of, header_of, is_comment, miscounted
from ..records.grammar import is_missing, label, number
from ..records.labels import parted_state
from ..records.numbers import span_text
from ..records.times import date_of_text, unix_time
from ..records.units import ENOUGH, unit_of

MANY = 0.1
"""Share of flagged rows from which it is said how many there are."""


class RowTrust:
    """Looks at the rows of a log as they are corrected.

    `model` (DynamicBiasRegressor).
    """

    def __init__(self, model: DynamicBiasRegressor):
        self.model = model
        self._guard = UnitGuard.of(model)
        self._first: dict[Any, list[float]] = {name: [] for name in self._guard.ranges}
        """Temperatures of each thermometer until there are enough to tell its unit."""
        self._flags: Counter[str] = Counter()
        self._called: dict[Any, str] = {}
        self._stated: dict[Any, str] = {}

    def read_from(self, reading: str, columns: Mapping[Any, str], units: Mapping[str, str]) -> None:
        """Say which columns of the log are read; RecordError where they are in another unit than the fitted ones.

        `reading` (str). `columns` (mapping): Column of each thermometer that goes by another name than in the fitted
        record. `units` (mapping): Units of columns that stand elsewhere than in their names.
        """
        self._guard.check_reading(reading, units.get(reading))
        for thermometer in self._guard.ranges:
            column = self._called[thermometer] = columns.get(thermometer, str(thermometer))
            self._stated[thermometer] = units.get(column) or unit_of(column, None)
            self._guard.check_temperature(thermometer, self._stated[thermometer], column=column)

    def look(self, values: Mapping[Any, Any]) -> None:
        """Look at the temperatures of a row, or of several; RecordError where they are in another unit."""
        for name in list(self._first):
            given = np.atleast_1d(np.asarray(values[name], float))
            self._first[name] += given[np.isfinite(given)].tolist()
            if len(self._first[name]) >= ENOUGH:
                median = float(np.median(self._first.pop(name)))
                self._guard.check_temperature(name, self._stated[name], median, self._called[name])

    def count(self, flags: Iterable[str]) -> None:
        """Count rows by their flags."""
        self._flags.update(flags)

    def summary(self) -> str:
        """Count of rows by flag, with advice; empty where nearly all have none."""
        flagged, rows = Counter({flag: n for flag, n in self._flags.items() if flag}), sum(self._flags.values())
        if sum(flagged.values()) <= MANY * rows:
            return ""
        by_flag = [f"{count} {flag}" for flag, count in flagged.most_common()]
        head = f"{sum(flagged.values())} of {rows} lines are flagged"
        if len(by_flag) == 1:
            (only,) = flagged
            return f"{head} {only}{self._advice(only, ': ')}."
        advice = "".join(self._advice(flag, f". {flag}: ") for flag, n in flagged.most_common() if n > MANY * rows)
        return f"{head}: {', '.join(by_flag)}{advice}."

    def _advice(self, flag: str, before: str) -> str:
        if flag == "washout":
            return (
                f"{before}the log lacks the time before them, which the model remembers for about "
                f"{span_text(self.model.washout_)}. No uncertainty is given for them. Go on from a saved state "
                "(--state), or begin the log earlier"
            )
        if flag == "outside fitted range":
            low, high = self.model.reading_.temperature_range
            return (
                f"{before}the model was fitted to temperatures of {low:.4g} to {high:.4g} "
                f"{self.model.reading_.temperature_unit}, and nothing is known beyond. Fit it to a record that "
                "reaches further"
            )
        return ""


REFUSED = ("stale time", "backward time")
"""Flags of rows that get no result for their time."""
_SHOWN = 20
"""Bad lines that are named one by one; further ones are counted."""


class LogRow(NamedTuple):
    """One row, read."""

    fields: list[str]
    stamp: Any
    """None in a log without times."""
    run: Any
    values: dict[Any, float]
    """Temperature and recorded columns."""
    reading: float


class LogRows:
    """Reads the rows of a log for a corrector, and corrects them.

    `live` (OnlineCorrector). `options` (Namespace): Of the command: `temperature`, `reading`, `time` name columns.
    `complain` (callable): Takes a sentence about a line. `time_name` (str, optional): Column of the times where none
    is named. `place` (callable): What the line of a number, the header's being the first, is called in its file, see
    `Lines.place`. `units` (mapping, optional): Units of columns that stand elsewhere than in the header, see
    `Lines.units`.
    """

    def __init__(
        self,
        live: OnlineCorrector,
        options: argparse.Namespace,
        complain: Callable[[str], None],
        time_name: str | None = None,
        place: Callable[[int], str] = "line {}".format,
        units: Mapping[str, str] | None = None,
    ):
        self.live, self.options, self.complain, self._time_name = live, options, complain, time_name
        self._place_of, self._units = place, units or {}
        self.header: list[str] | None = None
        self.number = 0
        """Lines read."""
        self.done = 0
        """Rows that the corrector has seen, in this run of the command and those before."""
        self.without_result: Counter[str] = Counter()
        self.left_out = 0
        self.trust = RowTrust(live.model)
        self.time_unit = ""
        """Unit of times that are numbers, where it is not the second."""
        self.says_unix = True
        """True if it is to be said that times are Unix times in another unit; not where the reader of the file did."""
        self._accepted = False
        history = live.model.features_.history_
        self._kind = history.kind
        self._timed, self._temperature_name = history.kind != "rows", history.record.temperature_name
        self._seconds = history.kind == "seconds"
        self._by_size = options.time_format is None and options.timezone is None
        """True if the log alone says what its times are, by their names, their units and their size."""
        self._labels = [segment.run for segment in history.record.segments]

    def begin(self, line: bytes, new_file: bool = False) -> list[str]:
        """Read the header; returns its fields and the names of the results."""
        self.number += 1
        header = header_of(line, self._place_of(1))
        if self.header is not None and new_file and header != self.header:
            raise RecordError(
                f"The log goes on in a file with other columns: {listing(header)} instead of {listing(self.header)}. "
                "Start the command again."
            )
        self.header = header
        model = self.live.model
        named = self._named = self._thermometers()
        self._temperature = self._place(named.get(self._temperature_name, self._temperature_name), "temperature")
        self._reading = self._place(self.options.reading or model.reading_.name, "reading")
        self.trust.read_from(header[self._reading], named, self._units)
        self._others = {column: self._place_or_state(str(named.get(column, column))) for column in self.live.columns}
        self._run, self._one_run = None, None
        if model.run == RUN and RUN not in header:  # learned from several files, each a run: this is one more
            self._one_run = Path(self.options.log).name
        elif model.run is not None:
            self._run = self._place(str(model.run), "")
        taken = {self._temperature, self._reading, self._run, *(at for at, _ in self._others.values())}
        free = [name for at, name in enumerate(header) if at not in taken]
        own = self._time_name if self._time_name in free else named_time(free)
        name = self.options.time or model.time or own or "time"
        self._time = self._place(name, "time") if self._timed else None
        self.time_unit = self._unit_of_times(name)
        self._extra = self.live.names
        return [*header, *new_names(self._extra, header)]

    def read(self, line: bytes) -> LogRow | None:
        """A row; None for an empty line, a header that comes again, and a line that is left out and complained of.

        Raises RecordError where the line below the header has units, and these are others than the fitted columns'.
        """
        self.number += 1
        assert self.header is not None
        if self.number == 2 and self._is_of_units(line):
            return None
        fields: list[str] = []
        try:
            fields = fields_of(line)
            if not fields or fields == self.header or is_comment(fields[0], len(fields), len(self.header)):
                return None
            if len(fields) != len(self.header):
                raise RecordError(miscounted(len(fields), len(self.header)))
            sample = self._sample(fields)
        except (RecordError, TypeError) as error:
            if not self._accepted and len(fields) == len(self.header):
                self._refuse_other_zone(fields)
            self.leave_out(str(error))
            return None
        self._accepted = True
        return sample

    def _is_of_units(self, line: bytes) -> bool:
        """True if a line has the units of the columns, as it may below the header of a pipe, which are asked then."""
        assert self.header is not None
        fields = _cells(line)
        if len(fields) != len(self.header) or not are_units(fields):
            return False
        self._units = units_below(self.header, fields)
        self.trust.read_from(self.header[self._reading], self._named, self._units)
        before = self.time_unit
        self.time_unit = "" if self._time is None else self._unit_of_times(self.header[self._time])
        if self.time_unit != before:
            self.complain(f"times in {self.time_unit or 's'}, by the units below the header")
        return True

    def _unit_of_times(self, name: str) -> str:
        """The unit of the log's times, where these are numbers and none of seconds; "" where the user says a form."""
        return unit_of_times(name, self._units) if self._seconds and self._by_size else ""

    def _refuse_other_zone(self, fields: list[str]) -> None:
        """Refuse a log whose first times have no zone where the model's have one, or the other way round."""
        kind = self.live.model.features_.history_.kind
        if self._time is None or not kind.startswith("datetime"):
            return
        try:
            date = date_of_text(fields[self._time].strip())
        except RecordError:
            return
        zoned = kind == "datetime with time zone"
        if pd.isna(date) or (date.tzinfo is not None) == zoned:
            return
        name = quoted(self.header[self._time]) if self.header else ""
        raise RecordError(
            f"The times in {name} have no zone, and those that the model was fitted to have one: pass --timezone with "
            "the logger's, such as --timezone Europe/Berlin, for a log that is read as a whole, or write them as "
            "2024-05-31T14:00:00+02:00."
            if zoned
            else f"The times in {name} have a zone, and those that the model was fitted to have none: write them as "
            "the fitted log has them, or fit the model to times with their zone (--timezone)."
        )

    def leave_out(self, why: str) -> None:
        """Count a line that is no row, and say so."""
        self.left_out += 1
        if self.left_out <= _SHOWN:
            self.complain(f"{self._place_of(self.number)} is left out: {' '.join(why.split())}")
        if self.left_out == _SHOWN:
            self.complain("further lines that are left out are counted only")

    def replay(self, rows: list[list[str]]) -> None:
        """Let the corrector see rows whose results have been written."""
        for low in range(0, len(rows), 8192):  # its memory stays bounded
            self.many([self._sample(fields) for fields in rows[low : low + 8192]])

    def many(self, samples: list[LogRow]) -> list[list[str]]:
        """Correct rows, to the last digit as `DynamicBiasRegressor.correct`; returns the cells of their results."""
        names = samples[0].values
        values = {name: np.array([sample.values[name] for sample in samples]) for name in names}
        reading = np.array([sample.reading for sample in samples])
        self.trust.look(values)
        stamps = np.array([sample.stamp for sample in samples]) if self._timed else None
        runs = None if self.live.model.run is None else pd.Series([sample.run for sample in samples], dtype=object)
        out = self.live.update_stamps(stamps, values, reading, runs, 64 if self.options.follow else 1)
        columns = [getattr(out, COLUMNS.get(name, name)).tolist() for name in self._extra]
        for flag, corrected in zip(out.flags, out.corrected, strict=True):
            self._count(flag, corrected)
        return [[_cell(value) for value in row] for row in zip(*columns, strict=True)]

    def summary(self) -> str:
        """Count of rows without a result, with reasons; empty where all have one."""
        reasons = [f"{count} {why}" for why, count in self.without_result.most_common()]
        if self.left_out:
            reasons.insert(0, f"{times_word(self.left_out, 'line')} left out")
        if not reasons:
            return ""
        rows = self.left_out + sum(self.without_result.values())
        stale = self.without_result[REFUSED[0]]
        said = ". Stale is the time of the row before" if stale else ""
        said += ": the log has each row twice" if stale and stale == self.done - stale else ""
        return f"{rows} of {times_word(self.number - 1, 'line')} got no result: {', '.join(reasons)}{said}"

    @property
    def damaged(self) -> bool:
        """True if rows got no result for what is wrong with the log, not for a cell that it leaves empty."""
        return bool(self.left_out or any(self.without_result[flag] for flag in REFUSED))

    def _count(self, flag: str, corrected: float) -> None:
        self.done += 1
        self.trust.count([flag])
        if math.isnan(corrected):
            self.without_result[flag] += 1

    def _thermometers(self) -> dict[Any, str]:
        """Column of the log for each thermometer of the model that --temperature names."""
        given, own = self.options.temperature or [], list(self.live.model.thermometers_)
        if len(given) > 1 and len(given) != len(own):
            raise RecordError(
                f"--temperature names {len(given)} columns ({listing(given)}); the model has "
                f"{times_word(len(own), 'thermometer')}: {listing(own)}. Name one for each, in this order, or the "
                "first alone."
            )
        return dict(zip(own, given, strict=False))

    def _place(self, name: Any, option: str) -> int:
        assert self.header is not None
        if name not in self.header:
            hint = f" Name it with --{option}." if option else ""
            raise RecordError(f"The log has no column {quoted(name)}; it has {listing(self.header)}.{hint}")
        return self.header.index(name)

    def _place_or_state(self, name: str) -> tuple[int, str | None]:
        """Index of a recorded column; for a state ("operator=Kim") that of its column, and its word."""
        assert self.header is not None
        parted = None if name in self.header else parted_state(name, self.header)
        if parted is not None:
            return self.header.index(parted[0]), parted[1]
        return self._place(name, ""), None

    def _sample(self, fields: list[str]) -> LogRow:
        T = number(fields[self._temperature], "the temperature")
        U = number(fields[self._reading], "the reading")
        values: dict[Any, float] = {self._temperature_name: T}
        for column, (at, word) in self._others.items():
            if word is None:
                values[column] = number(fields[at], str(column), switch=True)
            else:
                cell = fields[at].strip()
                values[column] = math.nan if is_missing(cell) else float(cell == word)
        run = self._one_run if self._run is None else label(fields[self._run], self._labels)
        if self._time is None:
            return LogRow(fields, None, run, values, U)
        time: Any = fields[self._time].strip()
        if self._by_size and not self.time_unit:
            unit, time = unix_time(time, self._kind)
            if unit and self.says_unix:
                self.complain(f"read as: Unix times in {unit}")
                self.says_unix = False
        if self._seconds and isinstance(time, str):
            time = number(time, "the time") * SPANS.get(self.time_unit, 1.0)
        return LogRow(fields, self.live.stamp(time), run, values, U)


def _cells(line: bytes) -> list[str]:
    """Fields of a line; none of one that cannot be read, which is said once its turn comes."""
    try:
        return fields_of(line)
    except RecordError:
        return []


def _cell(value: Any) -> str:
    """All the digits that tell a number from others; nothing for NaN."""
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else repr(value)
