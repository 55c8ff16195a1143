"""Logs that are read piece by piece, and records that stand for one."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Self

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

    def with_columns(self, names: Collection[Any]) -> Self:
        """The log with some of its columns, its index and column of times among them."""
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
