"""What a fitted model does with missing cells, as JSON and back."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from ..estimators.filling import Filling
from ..estimators.stand_in import RULES, StandIn
from ..records.grammar import LARGEST
from .codec import ModelFileError, fields, items, name, number, pack, positive, unexpected, unpack, vector
from .screen_nodes import pack_limits, unpack_limits

_FIELDS = tuple(StandIn.__dataclass_fields__)


def pack_filling(filling: Filling) -> list[dict[str, Any]]:
    """Every stand-in, with what it remembers; null for a hole of any length, and for what is not known."""
    ends = filling.end or [np.zeros(0)] * len(filling.stand_ins)
    return [
        {
            "column": pack(one.column, "a column's name"),
            "others": [pack(other, "a column's name") for other in one.others],
            "means": one.means.tolist(),
            "slopes": one.slopes.ravel().tolist(),
            "time_constants": one.time_constants.tolist(),
            "spread": one.spread,
            "memory": one.memory,
            "limits": pack_limits(one.limits),
            "range": [None if np.isinf(end) else end for end in one.range],
            "rule": one.rule,
            "longest": None if np.isinf(one.longest) else one.longest,
            "end": [None if np.isnan(value) else float(value) for value in end],
        }
        for one, end in zip(filling.stand_ins, ends, strict=True)
    ]


def unpack_filling(node: Any, where: str, columns: Collection[Any]) -> Filling:
    """The stand-ins, every number checked; they read no other columns than these."""
    found = [_stand_in(item, f"{where}[{i}]", columns) for i, item in enumerate(items(node, where))]
    return Filling(tuple(one for one, _ in found), tuple(end for _, end in found if len(end)))


def _stand_in(node: Any, where: str, columns: Collection[Any]) -> tuple[StandIn, np.ndarray]:
    node = fields(node, where, (*_FIELDS, "end"))
    column = name(unpack(node["column"], f"{where}.column"), f"{where}.column")
    others = tuple(
        name(unpack(other, f"{where}.others[{i}]"), f"{where}.others[{i}]")
        for i, other in enumerate(items(node["others"], f"{where}.others"))
    )
    for each in (column, *others):
        if each not in columns:
            raise ModelFileError(f"{where} names {each!r}, which the model does not read")
    if column in others or len(set(others)) < len(others):
        raise unexpected(f"{where}.others", repr(others)[:60], "other columns, each once")
    numbers = {
        key: vector(_floats(node[key], f"{where}.{key}"), f"{where}.{key}", length, LARGEST)
        for key, length in (("means", 1 + len(others)), ("slopes", 2 * len(others)), ("time_constants", len(others)))
    }
    if (numbers["time_constants"] <= 0).any():
        raise unexpected(f"{where}.time_constants", "times", "times above zero")
    if node["rule"] not in RULES or (node["rule"] == "estimate") != bool(others):
        raise unexpected(f"{where}.rule", repr(node["rule"])[:60], f"one of {RULES}, 'estimate' with other columns")
    low, high = numbers_or_nan(node["range"], f"{where}.range", 2)
    stand_in = StandIn(
        limits=unpack_limits(node["limits"], f"{where}.limits"),
        range=(-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high),
        column=column,
        others=others,
        means=numbers["means"],
        slopes=numbers["slopes"].reshape(-1, 2),
        time_constants=numbers["time_constants"],
        spread=number(node["spread"], f"{where}.spread", 0.0, LARGEST),
        memory=positive(node["memory"], f"{where}.memory"),
        rule=node["rule"],
        longest=np.inf if node["longest"] is None else number(node["longest"], f"{where}.longest", 0.0, LARGEST),
    )
    return stand_in, np.array(numbers_or_nan(node["end"], f"{where}.end", stand_in.width if node["end"] != [] else 0))


def numbers_or_nan(node: Any, where: str, length: int) -> list[float]:
    """So many numbers, NaN for null."""
    values = items(node, where, length)
    return [
        np.nan if value is None else number(value, f"{where}[{k}]", -LARGEST, LARGEST) for k, value in enumerate(values)
    ]


def _floats(node: Any, where: str) -> np.ndarray:
    return np.array([number(value, f"{where}[{i}]") for i, value in enumerate(items(node, where))], float)
