"""What a fitted record tells of gaps, as JSON and back."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from ..records.gaps import Gaps
from .codec import ModelFileError, fields, items, name, number, pack, positive, unexpected, unpack


def pack_gaps(gaps: Gaps) -> dict[str, Any]:
    """What happens in gaps, as plain values: the least step of one, and how far each column wanders."""
    return {
        "least": gaps.least,
        "lags": gaps.lags.tolist(),
        "columns": [
            {"name": pack(column, "a column's name"), "squares": squares.tolist()}
            for column, squares in gaps.squares.items()
        ],
    }


def unpack_gaps(node: Any, where: str, columns: Collection[Any]) -> Gaps | None:
    """What `pack_gaps` made, every number checked, for these columns; None for a file of an earlier version."""
    if node is None:
        return None
    node = fields(node, where, ("least", "lags", "columns"))
    lags = _numbers(node["lags"], f"{where}.lags")
    if not len(lags) or lags[0] != 0 or (np.diff(lags) <= 0).any():
        raise unexpected(f"{where}.lags", "other times", "0 first, and then increasing times")
    squares: dict[Any, np.ndarray] = {}
    for i, item in enumerate(items(node["columns"], f"{where}.columns", len(columns))):
        place = f"{where}.columns[{i}]"
        item = fields(item, place, ("name", "squares"))
        column = name(unpack(item["name"], f"{place}.name"), f"{place}.name")
        if column not in columns or column in squares:
            raise ModelFileError(f"{place}.name is {column!r}, which the model does not keep, or twice")
        squares[column] = _numbers(item["squares"], f"{place}.squares", len(lags))
    return Gaps(positive(node["least"], f"{where}.least"), lags, squares)


def _numbers(node: Any, where: str, count: int | None = None) -> np.ndarray:
    return np.array([number(value, f"{where}[{i}]", 0.0) for i, value in enumerate(items(node, where, count))], float)
