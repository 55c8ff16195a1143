"""Which rows a user means: a number, a label, a slice, or several of these."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd


def asked_rows(rows: Any, n: int, index: pd.Index | None) -> np.ndarray:
    """Numbers of the rows meant, increasing, each once.

    Integers are places, counted from 0, in slices too; anything else is a label of the index.

    Parameters
    ----------
    rows : None, int, slice, label, or sequence of int, bool or labels
        None: all.
    n : int
        Rows there are.
    index : Index or None
        Their labels.

    Raises
    ------
    ValueError
        For what names no row; the message says what was given, and what there is.
    """
    try:
        found = _found(rows, n, index)
    except (IndexError, KeyError, TypeError, ValueError) as error:
        labels = "" if index is None else f", or labels from {index[0]} to {index[-1]}"
        raise ValueError(
            f"There are no such rows: {rows!r:.80}. Give places from 0 to {n - 1}{labels}: one, a slice or a list."
        ) from error
    return np.unique(found)


def _found(rows: Any, n: int, index: pd.Index | None) -> np.ndarray:
    every = np.arange(n)
    if rows is None:
        return every
    if isinstance(rows, bool):
        raise TypeError("true or false is no row")
    if isinstance(rows, int | np.integer):
        return every[[int(rows)]]
    if isinstance(rows, slice):
        ends = [end for end in (rows.start, rows.stop) if end is not None]
        if index is None or all(isinstance(end, int | np.integer) for end in ends):
            return every[rows]
        return np.asarray(every[index.slice_indexer(rows.start, rows.stop, rows.step)])
    if isinstance(rows, str) or np.ndim(rows) == 0:
        if index is None:
            raise KeyError(rows)
        return np.atleast_1d(every[index.get_loc(rows)])
    given = np.asarray(rows)
    if given.dtype == bool or np.issubdtype(given.dtype, np.integer):
        return np.asarray(every[given])
    if index is None:
        raise KeyError(rows)
    places = index.get_indexer(pd.Index(rows))
    if (places < 0).any():
        raise KeyError(rows)
    return np.asarray(every[places])
