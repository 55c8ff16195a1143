"""Dates, and CSV that is written, by pyarrow where it is installed: faster than by pandas, and nothing differs.

What pyarrow does not do, or would do in another way, is left to pandas.
"""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
import pandas as pd

_TEXT: Any = pd.Series(["text"]).dtype
"""How pandas keeps text; older ones keep Python's own, which pyarrow would have to make one by one."""


ROWS_WRITTEN = 250_000
"""Rows that are made to text at a time."""
MANY = 10_000
"""Dates, or rows to be written, from which it is worth loading pyarrow."""


def dates_by_arrow(text: pd.Series[Any]) -> pd.Series[Any] | None:
    """Dates of texts as ISO 8601 has them, in UTC where they have zones; None where pandas has to read them."""
    if len(text) < MANY or not isinstance(_TEXT, pd.StringDtype):
        return None
    try:
        import pyarrow as pa
    except ImportError:
        return None
    cells = pa.array(text)
    for zone in (None, "UTC"):
        try:
            parsed = cells.cast(pa.timestamp("us", zone))
        except pa.ArrowException:  # a zone more or less, or another form
            continue
        return pd.Series(parsed.to_pandas().array, index=text.index, name=text.name)
    return None


def written_by_arrow(frame: pd.DataFrame, file: BinaryIO) -> bool:
    """Write numbers, switches and plain text as CSV; False, and nothing written, where pandas has to do it.

    Every number reads back to the last bit. A whole one is written without a point where others of its column are none.
    """
    kinds = (np.dtype(np.float64), np.dtype(np.int64), np.dtype(bool), _TEXT)
    if len(frame) < MANY or not all(dtype in kinds for dtype in frame.dtypes):
        return False
    try:
        import pyarrow as pa
        from pyarrow import csv
    except ImportError:
        return False
    columns = [pa.array(frame.iloc[:, k], from_pandas=True) for k in range(frame.shape[1])]
    if any(column.type not in (pa.float64(), pa.int64(), pa.bool_()) and _needs_quotes(column) for column in columns):
        return False
    whole = [dtype == np.float64 and bool(_is_whole(frame.iloc[:, k])) for k, dtype in enumerate(frame.dtypes)]
    file.write(frame.iloc[:0].to_csv(index=False, lineterminator="\n").encode())
    options = csv.WriteOptions(include_header=False, quoting_style="none")
    for start in range(0, len(frame), ROWS_WRITTEN):
        cells = [
            _as_pandas_shows(column.slice(start, ROWS_WRITTEN), bare)
            for column, bare in zip(columns, whole, strict=True)
        ]
        text = pa.BufferOutputStream()
        csv.write_csv(pa.Table.from_arrays(cells, [str(k) for k in range(len(cells))]), text, options)
        file.write(memoryview(text.getvalue()))
    return True


def _is_whole(values: pd.Series[Any]) -> bool:
    """Whether all numbers of a column are whole, or missing."""
    numbers = values.to_numpy()
    with np.errstate(invalid="ignore"):  # infinities
        return all(
            (np.isnan(part) | (part % 1 == 0)).all()
            for part in (numbers[start : start + ROWS_WRITTEN] for start in range(0, len(numbers), ROWS_WRITTEN))
        )


def _needs_quotes(column: Any) -> bool:
    """Whether a text has a comma, a quote or an end of line."""
    from pyarrow import compute

    return bool(compute.any(compute.match_substring_regex(column, '[,"\r\n]')).as_py())


def _as_pandas_shows(column: Any, whole: bool) -> Any:
    """Numbers of a column of whole ones as 23.0, switches as True."""
    import pyarrow as pa
    from pyarrow import compute

    if whole:
        shown = compute.cast(column, pa.string())
        bare = compute.match_substring_regex(shown, "^-?[0-9]+$")
        return compute.if_else(bare, compute.binary_join_element_wise(shown, "0", "."), shown)
    if column.type == pa.bool_():
        return compute.utf8_capitalize(compute.cast(column, pa.string()))
    return column
