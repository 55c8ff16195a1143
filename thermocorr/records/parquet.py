"""Logs in Parquet files, read column by column and row group by row group.

What pyarrow does not read or write, or would do in another way, is left to pandas.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from copy import copy
from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .errors import RecordError, existing_file, listing, quoted
from .log import Log
from .times import Kind, Times, seconds_within_range, within_range
from .types import ColumnKind, kind_of_arrow, require_role

_PER_SECOND = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
_UNIT = {per_second: unit for unit, per_second in _PER_SECOND.items()}


class ParquetLog(Log):
    """A log in one Parquet file or several, in time order, as X of every estimator; needs pyarrow.

    Columns are read row group by row group when they are needed, and forgotten: `fit`, `TimeConstantSearch` and
    `DynamicBiasRegressor.evaluate_blocks` need the memory of a few row groups, whatever the length of the log. Write
    row groups of about a million rows (the default of most writers).

    Parameters
    ----------
    paths : path or sequence of paths
        Files with the same columns; one follows the other in time.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from thermocorr import DynamicBiasRegressor, ParquetLog
    >>> from thermocorr.datasets import make_record
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "log.parquet"
    >>> make_record(3000, seed=1).to_parquet(path)
    >>> log = ParquetLog(path)
    >>> model = DynamicBiasRegressor(time_constants=["5 min", "1 h"]).fit(log, log["reading"])
    >>> print(f"{model.residual_std_:.1f}")
    0.2
    """

    def __init__(self, paths: str | PathLike[str] | Sequence[str | PathLike[str]]):
        self.paths: list[str] = [str(paths)] if isinstance(paths, str | PathLike) else [str(path) for path in paths]
        if not self.paths:
            raise RecordError("A ParquetLog needs a file at least: its list of paths is empty.")
        self._files = [open_parquet(path) for path in self.paths]
        self._schema = self._files[0].schema_arrow
        for path, file in zip(self.paths, self._files, strict=True):
            if file.schema_arrow.names != self._schema.names:
                raise RecordError(
                    f"{path} has the columns {listing(file.schema_arrow.names)}, and {self.paths[0]} has "
                    f"{listing(self._schema.names)}. Files of one log must have the same columns."
                )
        self._groups = [(file, i) for file in self._files for i in range(file.metadata.num_row_groups)]
        rows = [file.metadata.row_group(i).num_rows for file, i in self._groups]
        self.edges: NDArray[np.intp] = np.cumsum([0, *rows])
        """First row of each row group, and the number of rows."""
        self._names: list[str] | None = None

    def __len__(self) -> int:
        return int(self.edges[-1])

    def __reduce__(self) -> Any:
        return type(self), (self.paths,), {"_names": self._names}

    @property
    def columns(self) -> list[str]:
        """Names of the columns, the index left out."""
        return self._names or [name for name in self._schema.names if name != self.index_name]

    def with_columns(self, names: Collection[Any]) -> Self:
        """The log with some of its columns."""
        some = copy(self)
        some._names = list(names)
        return some

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes that pandas stored with the frame."""
        attributes = (self._schema.pandas_metadata or {}).get("attributes", {})
        return dict(attributes) if isinstance(attributes, dict) else {}

    @property
    def index_name(self) -> str | None:
        """Column of dates or spans that was the index of the frame written."""
        for name in (self._schema.pandas_metadata or {}).get("index_columns", []):
            if isinstance(name, str) and str(self._schema.field(name).type).startswith(("timestamp", "duration")):
                return name
        return None

    def __getitem__(self, name: str) -> ParquetColumn:
        return ParquetColumn(self, name)

    def field_type(self, name: str) -> Any:
        """Arrow's type of a column; RecordError where there is none of that name."""
        if name not in self._schema.names:
            raise RecordError(
                f"There is no column {quoted(name)} in the file. Its columns are {listing(self.columns)}."
            )
        return self._schema.field(name).type

    def times(self, name: str) -> Times:
        """Times from a column of dates, spans or seconds."""
        column = TimeColumn(self, name)
        ticks: Any = column  # read when it is sliced, like every column of a log
        return Times(len(self), column.time_kind, ticks, column.per_second)

    def read_group(self, group: int, name: str) -> Any:
        """One column of one row group, as Arrow has it."""
        file, i = self._groups[group]
        return file.read_row_group(i, columns=[name], use_threads=False).column(name)


class ParquetColumn:
    """A column of a `ParquetLog` that is read when it is sliced; the last two row groups are kept.

    Numbers and switches come as float64, dates and spans as numpy has them, text as objects.
    """

    ndim = 1

    def __init__(self, log: ParquetLog, name: str, look: Callable[[NDArray[Any], int], None] | None = None):
        self.log, self.name = log, name
        self.type_name = str(log.field_type(name))
        self.kind: ColumnKind = kind_of_arrow(self.type_name)
        self._held: dict[int, NDArray[Any]] = {}
        self._look = look
        self._seen: set[int] = set()
        self.dtype = self._group(0).dtype if len(log) else np.dtype(float)

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes that pandas stored with the frame."""
        return self.log.attrs

    @property
    def shape(self) -> tuple[int]:
        """One column of so many rows."""
        return (len(self.log),)

    def looked_at_by(self, look: Callable[[NDArray[Any], int], None]) -> ParquetColumn:
        """The column, each row group of which is shown to `look` with its first row when it is read for the first time.

        What is wrong with a column is so found without a walk through the file of its own.
        """
        return ParquetColumn(self.log, self.name, look)

    def __len__(self) -> int:
        return len(self.log)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)

    def __getitem__(self, rows: Any) -> Any:
        """Rows of the column: a number, a slice, or row numbers in any order."""
        if isinstance(rows, int | np.integer):
            row = int(rows) + (len(self) if rows < 0 else 0)
            group = int(np.searchsorted(self.log.edges, row, side="right")) - 1
            return self._group(group)[row - self.log.edges[group]]
        if isinstance(rows, slice):
            start, stop, stride = rows.indices(len(self))
            return self._stretch(start, max(stop, start))[::stride]
        rows = np.asarray(rows)
        groups = np.searchsorted(self.log.edges, rows, side="right") - 1
        values = np.empty(len(rows), self.dtype)
        for group in np.unique(groups):
            inside = groups == group
            values[inside] = self._group(int(group))[rows[inside] - self.log.edges[group]]
        return values

    def _stretch(self, start: int, stop: int) -> NDArray[Any]:
        edges = self.log.edges
        first = int(np.searchsorted(edges, start, side="right")) - 1
        parts = []
        while start < stop:
            end = min(stop, int(edges[first + 1]))
            parts.append(self._group(first)[start - edges[first] : end - edges[first]])
            start, first = end, first + 1
        return parts[0] if len(parts) == 1 else np.concatenate(parts) if parts else np.zeros(0, self.dtype)

    def _group(self, group: int) -> NDArray[Any]:
        """The values of a row group; neighbours of the rows at an edge are asked for in turn, so two are kept."""
        if group not in self._held:
            while len(self._held) > 1:
                del self._held[next(iter(self._held))]
            first_row = int(self.log.edges[group])
            values = self._values(self.log.read_group(group, self.name), first_row)
            if self._look is not None and group not in self._seen:
                self._look(values, first_row)
                self._seen.add(group)
            self._held[group] = values
        return self._held[group]

    def _values(self, column: Any, first_row: int) -> NDArray[Any]:
        """A stretch of the column, from row `first_row` on."""
        if self.kind in ("number", "switch"):
            if self.type_name.startswith("decimal"):  # Arrow's cast is not to the nearest number
                return np.array([np.nan if value is None else float(value) for value in column.to_pylist()])
            if self.type_name == "halffloat":  # older versions of Arrow have no cast
                return np.asarray(column.to_numpy(), np.float64)
            return np.asarray(column.cast("float64", safe=False).to_numpy(), np.float64)
        if self.kind in ("date", "span"):
            return np.asarray(column.to_numpy())
        values = np.empty(len(column), object)
        values[:] = column.to_pylist()
        return values


class TimeColumn(ParquetColumn):
    """The times of a `ParquetLog`: integer ticks of dates and spans, or seconds."""

    def __init__(self, log: ParquetLog, name: str):
        self.type_name = str(log.field_type(name))
        self.time_kind, self.per_second = time_kind(self.type_name, name)
        super().__init__(log, name)

    def _values(self, column: Any, first_row: int) -> NDArray[Any]:
        values = super()._values(column, first_row)
        missing = ~np.isfinite(values) if values.dtype.kind == "f" else np.isnat(values)
        if missing.any():
            row = first_row + int(missing.argmax())
            raise RecordError(f"The column {quoted(self.name)} has no time in row {row}. Every row needs its time.")
        if values.dtype.kind == "f":
            return seconds_within_range(values, f"The time column {quoted(self.name)}", first_row)
        ticks = values.astype(f"{values.dtype.str[1]}8[{_UNIT[self.per_second]}]").view("i8")
        return within_range(ticks, self.per_second, f"The time column {quoted(self.name)}", first_row)


def open_parquet(path: str | PathLike[str]) -> Any:
    """A Parquet file; RecordError for any other, ImportError where pyarrow is not installed."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise ImportError("Reading Parquet needs pyarrow: pip install pyarrow.") from None
    try:
        return parquet.ParquetFile(path, memory_map=False)
    except OSError as error:
        existing_file(path)
        raise RecordError(f"{path} cannot be read: {error.strerror or ' '.join(str(error).split())}.") from None
    except (ArrowException, ValueError) as error:
        raise RecordError(f"{path} cannot be read as a table of Parquet: {' '.join(str(error).split())}.") from None


def time_kind(type_name: str, column: str) -> tuple[Kind, int]:
    """Kind of times and ticks per second of an Arrow type such as ``timestamp[us, tz=UTC]``."""
    what, kind = f"The time column {quoted(column)}", kind_of_arrow(type_name)
    require_role(kind, "time", what, type_name)
    if kind == "number":
        return "seconds", 1
    if kind == "text":
        raise RecordError(f"{what} holds {type_name}. Write dates, spans or seconds, not text, to a Parquet file.")
    unit = type_name.split("[")[1].split("]")[0].split(",")[0] if "[" in type_name else "s"
    per_second = _PER_SECOND.get(unit, 1)  # dates without a clock count days
    if kind == "span":
        return "timedelta", per_second
    return ("datetime with time zone" if "tz=" in type_name else "datetime"), per_second
