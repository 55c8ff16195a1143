"""Logs that are read piece by piece, and records that stand for one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .errors import RecordError, listing, quoted
from .times import Times


class Log:
    """Base of logs that are read piece by piece: the X of estimators, where a DataFrame would not fit in memory."""

    @property
    def columns(self) -> list[str]:
        """Names of the columns, the index left out."""
        raise NotImplementedError

    def __len__(self) -> int:
        raise NotImplementedError

    def __getitem__(self, name: str) -> Any:
        """A column, read when it is sliced: has ``len``, ``dtype``, ``ndim`` and row numbers or slices in brackets."""
        raise NotImplementedError

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, the index left out."""
        return len(self), len(self.columns)

    @property
    def index_name(self) -> str | None:
        """Column of dates or spans that was the index of the frame written."""
        return None

    def to_record(self, layout: Any, y: Any, needed: Any) -> Any:
        """The validated record, for logs that know better than `read_record` how to get it; None otherwise."""
        return None

    def times(self, name: str) -> Times:
        """Times from a column of dates, spans or seconds."""
        raise NotImplementedError


class SomeColumns(Log):
    """Some columns of a log, its index and column of times among them."""

    def __init__(self, log: Log, names: Sequence[str]):
        self.log, self._names = log, list(names)

    @property
    def columns(self) -> list[str]:
        """Names of these columns."""
        return self._names

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise RecordError(f"There is no column {quoted(name)} among these: {listing(self._names)}.")
        return self.log[name]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.log, name)

    @property
    def index_name(self) -> str | None:
        """Column of dates or spans that was the index of the frame written."""
        return self.log.index_name

    def to_record(self, layout: Any, y: Any, needed: Any) -> Any:
        """The validated record of the whole log, where it knows better than `read_record` how to get it."""
        return self.log.to_record(layout, y, needed)

    def times(self, name: str) -> Times:
        """Times from a column of dates, spans or seconds."""
        return self.log.times(name)
