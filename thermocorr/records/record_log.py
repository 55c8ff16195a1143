"""A record that was read once, as the X of estimators and of whatever else takes data."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, Self

from numpy.typing import NDArray

from .errors import RecordError, listing, quoted
from .log import Log
from .numbers import as_pandas, refuse_no_table, span_text
from .record import Record
from .screen import reading_of
from .times import Times


class RecordLog(Log):
    """A record as the X of estimators: its times, segments and rows passed over are those that were found once.

    `record` (Record). `attrs` (mapping, optional): What is noted of its columns, such as their units.
    """

    def __init__(self, record: Record, attrs: Mapping[str, Any] | None = None):
        self.record, self.attrs = record, dict(attrs or {})

    @property
    def columns(self) -> list[Any]:
        """Names of the columns."""
        return list(self.record.columns)

    def __len__(self) -> int:
        return self.record.n_rows

    def __getitem__(self, name: Any) -> NDArray[Any]:
        if name not in self.record.columns:
            raise RecordError(
                f"There is no column {quoted(name)} in the record. Its columns are {listing(self.columns)}. Read it "
                "with needed=[...], which names all that are used."
            )
        return self.record.columns[name]

    def with_columns(self, names: Collection[Any]) -> Self:
        """The log with some of its columns, and the temperature."""
        wanted = {*names, self.record.temperature_name}
        columns = {name: column for name, column in self.record.columns.items() if name in wanted}
        return type(self)(replace(self.record, columns=columns), self.attrs)

    def times(self, name: str) -> Times:
        """Times of the record, whatever their column was called."""
        return self.record.times

    def to_record(self, layout: Any, y: Any, needed: Any) -> Record:
        """The record itself, with other readings."""
        names = dict.fromkeys((self._temperature(layout), *needed))
        if (most := layout.longest_step()) is not None:
            self._check_gaps(most)
        columns = {name: self[name] for name in names}
        reading, weight = reading_of(y, self, layout.reference)
        return replace(self.record, columns=columns, reading=reading, weight=weight, refused=(), known_moments={})

    def _temperature(self, layout: Any) -> Any:
        name = self.record.temperature_name
        if layout.temperature not in (None, name):
            raise RecordError(
                f"The record was read with {quoted(name)} as its temperature, the model wants "
                f"{quoted(layout.temperature)}. Read it with that one."
            )
        return name

    def _check_gaps(self, most: float) -> None:
        """A step longer than max_gap inside a segment would be taken for a straight line, against what was asked."""
        stretches = (self.record.kept(segment.start, segment.stop) for segment in self.record.segments)
        longest = max((float(self.record.times.steps(rows)[1:].max(initial=0.0)) for rows in stretches), default=0.0)
        if longest > most:
            raise RecordError(
                f"The record has a step of {span_text(longest)} inside a segment, and max_gap is {span_text(most)}. "
                "Read it with the same max_gap."
            )


def as_data(X: Any) -> Any:
    """Data as the package works with them: a record that was read as a log, tables of other packages as pandas'.

    Raises RecordError for a dict, and for the name of a file.
    """
    refuse_no_table(X)
    return RecordLog(X) if isinstance(X, Record) else as_pandas(X)
