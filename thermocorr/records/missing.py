"""Rows that lack a needed value, in words: which they are, when, and what they lack."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .errors import listing, times_word
from .record import Record

_CHUNK = 1 << 16  # rows looked at together, so that checks need no memory of the record's size


def missing_text(record: Record, missing: NDArray[np.intp]) -> str:
    """How many rows lack a value, and of the first which columns and its time.

    Parameters
    ----------
    record : Record
    missing : array of shape (n,)
        The rows, in time order; one at least.
    """
    row = record.row(int(missing[0]))
    lacks = listing(name for name, values in record.columns.items() if np.isnan(values[row]))
    at = "" if record.times.kind == "rows" else f" at {record.times.label(row)}"
    have = "has" if len(missing) == 1 else "have"
    return (
        f"{times_word(len(missing), 'row')} of {record.n_rows} {have} a missing value, the first is row {row} "
        f"({lacks}{at})"
    )


def nothing_known_text(record: Record) -> str:
    """What is wrong with a record of which no row has all that is needed: the columns that are empty, if any are."""
    n = record.n_rows
    empty = [name for name in record.columns if _is_empty(record, name)]
    where = f"in {listing(empty)}" if empty else f"in every needed column ({listing(record.columns)})"
    lack = f"all {n} values are missing" if len(empty) == 1 else f"all {n} rows have a missing value"
    check = (
        "the column's name and the file it comes" if len(empty) == 1 else "the columns' names and the file they come"
    )
    return f"No row has a number {where}: {lack}. Check {check} from."


def _is_empty(record: Record, name: object) -> bool:
    values = record.columns[name]
    return all(np.isnan(values[start : start + _CHUNK]).all() for start in range(0, record.n_rows, _CHUNK))
