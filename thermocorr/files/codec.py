"""Python values as JSON and back, bit for bit, without ever running what a file says."""

from __future__ import annotations

import json
import math
import re
import reprlib
import stat
import sys
from collections.abc import Callable, Sequence
from datetime import date, datetime, timedelta
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..effects.signals import DelayState
from ..equations import LagState
from ..records.grammar import LARGEST

LARGEST_FILE = 32 << 20
"""Bytes of a file of a model or state; a longer one is refused before it is read."""
MOST_BRACKETS = 200_000
"""Lists and objects in such a file: each takes some hundred bytes of memory, however short it is in the file."""
MOST_VALUES = 9_000_000
"""Values in such a file: each takes its time, however short it is in the file."""
MOST_STATE = LARGEST**3
"""Bound of the numbers in a state, which hold powers of columns."""
LARGEST_INTEGER = 1 << 63
LONGEST_TEXT = 10_000
_LARGE = re.compile(rb"[0-9]{19}|[eE]\+?[0-9]{3}")
"""What numbers have that may be too large: all others need not be looked at one by one."""
_BRIEF = reprlib.Repr()
_BRIEF.maxlist = _BRIEF.maxdict = _BRIEF.maxtuple = 30
_BRIEF.maxstring = _BRIEF.maxlong = _BRIEF.maxother = 80
_SURROGATE = re.compile("[\ud800-\udfff]")
"""Halves of characters: no text has them alone."""
_STATES: dict[str, type[LagState | DelayState]] = {"LagState": LagState, "DelayState": DelayState}
_DTYPES = ("float64", "float32", "int64", "int32", "bool")


class ModelFileError(ValueError):
    """A model file is damaged, foreign or of another version, or a model cannot be written as one."""

    remedy = "Take an undamaged copy, or fit the model again and save it with thermocorr.save_model."
    """What to do about a file that cannot be loaded."""


def pack(value: Any, where: str, effect: Callable[[Any, str], Any] | None = None) -> Any:
    """A value as JSON: numbers with all their digits, everything that JSON does not know under a ``$`` name.

    `value` (object): None, bool, number, text, list, tuple, dict, numeric array, time span, date, or a state of the
    lags or a delay. `where` (str): What the value is, for the message. `effect` (callable, optional): Packs what is
    none of these. Raises ModelFileError for a value that has no safe form in a file.
    """
    if isinstance(value, np.generic) and not isinstance(value, np.datetime64 | np.timedelta64):
        value = value.item()
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        if abs(value) >= LARGEST_INTEGER:
            raise ModelFileError(f"{where} is the integer {value}, which is too large for a model file.")
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"$float": repr(value)}
    if type(value) is list:
        return [pack(item, f"{where}[{i}]", effect) for i, item in enumerate(value)]
    if type(value) is tuple:
        return {"$tuple": [pack(item, f"{where}[{i}]", effect) for i, item in enumerate(value)]}
    if type(value) is dict:
        if all(isinstance(key, str) and not key.startswith("$") for key in value):
            return {key: pack(item, f"{where}.{key}", effect) for key, item in value.items()}
        return {"$dict": [[pack(k, where, effect), pack(v, f"{where}[{k!r}]", effect)] for k, v in value.items()]}
    for name, state in _STATES.items():
        if isinstance(value, state):
            return {"$state": name, "values": [pack(item, f"{where}.{name}", effect) for item in value]}
    if isinstance(value, np.ndarray) and value.dtype.name in _DTYPES:
        flat = [pack(item, where) for item in value.ravel().tolist()]
        if value.dtype == np.float64 and value.ndim == 1:
            return {"$array": flat}
        return {"$array": flat, "dtype": value.dtype.name, "shape": list(value.shape)}
    if isinstance(value, datetime | np.datetime64) and not pd.isna(value):
        return {"$date": _date_text(pd.Timestamp(value))}
    if type(value) is date:
        return {"$day": value.isoformat()}
    if isinstance(value, timedelta | np.timedelta64) and not pd.isna(value):
        return {"$span": int(pd.Timedelta(value).value)}
    if effect is not None:
        return effect(value, where)
    raise ModelFileError(
        f"{where} is a {type(value).__name__}, which has no place in a model file: numbers, text, dates, lists, dicts "
        "and numeric arrays do."
    )


def _date_text(date: pd.Timestamp) -> str:
    """A date as ISO 8601 has it: in UTC where its zone was off by seconds, as local mean times were."""
    offset = date.utcoffset()
    return (date if offset is None or offset.total_seconds() % 60 == 0 else date.tz_convert("UTC")).isoformat()


def unpack(node: Any, where: str, effect: Callable[[Any, str], Any] | None = None) -> Any:
    """The value that `pack` wrote; raises ModelFileError for anything else."""
    if node is None or isinstance(node, bool | int | float | str):
        return node
    if isinstance(node, list):
        return [unpack(item, f"{where}[{i}]", effect) for i, item in enumerate(node)]
    assert isinstance(node, dict)
    tags = [key for key in node if key.startswith("$")]
    if not tags:
        return {key: unpack(item, f"{where}.{key:.60}", effect) for key, item in node.items()}
    tag = tags[0]
    allowed = {"$array": {"$array", "dtype", "shape"}, "$state": {"$state", "values"}}.get(tag, {tag})
    if set(node) - allowed:
        raise unexpected(where, f"the keys {_shown(sorted(node))}")
    content = node[tag]
    if tag == "$float" and isinstance(content, str) and content in ("nan", "inf", "-inf"):
        return float(content)
    if tag == "$tuple" and isinstance(content, list):
        return tuple(unpack(item, f"{where}[{i}]", effect) for i, item in enumerate(content))
    if tag == "$dict" and isinstance(content, list):
        return _unpack_dict(content, where, effect)
    if tag == "$array":
        return _unpack_array(node, where)
    if tag == "$state" and isinstance(content, str) and content in _STATES:
        return _unpack_state(_STATES[content], node.get("values"), where)
    if tag == "$date" and isinstance(content, str) and len(content) < 60:
        return _unpack_date(content, where)
    if tag == "$day" and isinstance(content, str) and len(content) < 60:
        return _unpack_date(content, where).date()
    if tag == "$span" and type(content) is int and abs(content) < LARGEST_INTEGER:
        return pd.Timedelta(content, unit="ns")
    if tag == "$effect" and effect is not None:
        return effect(content, f"{where}.$effect")
    raise unexpected(where, f"{tag:.60} with {_shown(content)}")


def _unpack_dict(pairs: list[Any], where: str, effect: Callable[[Any, str], Any] | None) -> dict[Any, Any]:
    result: dict[Any, Any] = {}
    for i, pair in enumerate(pairs):
        if not (isinstance(pair, list) and len(pair) == 2 and type(pair[0]) in (str, int)) or pair[0] in result:
            raise unexpected(f"{where}[{i}]", _shown(pair), "a key that stands once and its value")
        result[pair[0]] = unpack(pair[1], f"{where}[{pair[0]!r:.60}]", effect)
    return result


def _unpack_array(node: dict[str, Any], where: str) -> np.ndarray:
    flat, dtype, shape = node["$array"], node.get("dtype", "float64"), node.get("shape")
    if dtype not in _DTYPES:
        raise unexpected(f"{where}.dtype", _shown(dtype), f"one of {', '.join(_DTYPES)}")
    if not isinstance(flat, list):
        raise unexpected(where, _shown(flat), "a list of numbers")
    kind: type = {"f": float, "i": int, "b": bool}[np.dtype(dtype).kind]
    values = [item if type(item) is not dict else unpack(item, f"{where}[{i}]") for i, item in enumerate(flat)]
    for i, item in enumerate(values):
        if type(item) is not kind:
            raise unexpected(f"{where}[{i}]", _shown(item), f"a {kind.__name__}")
    if shape is None:
        shape = [len(flat)]
    sizes = isinstance(shape, list) and all(type(size) is int and 0 <= size < 1 << 40 for size in shape)
    if not sizes or len(shape) > 8 or math.prod(shape) != len(flat):
        raise unexpected(f"{where}.shape", _shown(shape), f"the shape of {len(flat)} numbers")
    if kind is int and values and not np.iinfo(dtype).min <= min(values) <= max(values) <= np.iinfo(dtype).max:
        raise unexpected(where, "numbers", f"numbers within the range of {dtype}")  # old versions of NumPy wrap them
    return np.array(values, dtype=dtype).reshape(shape)


def _unpack_state(state: Any, values: Any, where: str) -> Any:
    if not isinstance(values, list) or len(values) != len(state._fields):
        raise unexpected(where, _shown(values), f"the values of a {state.__name__}")
    parts = [unpack(item, f"{where}.values[{i}]") for i, item in enumerate(values)]
    for part, name in zip(parts, state._fields, strict=True):
        if state is LagState and name == "temperature":
            if type(part) is not float:
                raise unexpected(f"{where}.{name}", _shown(part), "a float")
        elif type(part) is not np.ndarray or part.ndim != 1 or part.dtype != np.float64:
            raise unexpected(f"{where}.{name}", _shown(part), "a ndarray")
    return state(*parts)


def _unpack_date(text: str, where: str) -> pd.Timestamp:
    try:
        date: pd.Timestamp | None = pd.Timestamp(text)
    except (ValueError, TypeError, OverflowError):
        date = None
    if date is None or pd.isna(date):
        raise unexpected(where, _shown(text), "a date such as 2024-05-31T14:00:00")
    return date


def unexpected(where: str, found: str, wanted: str = "") -> ModelFileError:
    """The error for something in a file that does not belong there."""
    return ModelFileError(f"{where} holds {found}{f' where {wanted} belongs' if wanted else ', which is unknown'}")


def _shown(value: Any) -> str:
    text = _BRIEF.repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


# -------------------------------------------------------------------------------------------- checks of what was read


def fields(node: Any, where: str, required: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    """A JSON object with exactly these keys."""
    if not isinstance(node, dict):
        raise unexpected(where, _shown(node), "an object")
    missing = [key for key in required if key not in node]
    if missing:
        raise ModelFileError(f"{where} has no {missing[0]!r}")
    foreign = sorted(set(node) - set(required) - set(optional))
    if foreign:
        raise unexpected(where, f"the key {_shown(foreign[0])}")
    return node


def number(value: Any, where: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite float between `low` and `high`, both allowed."""
    if type(value) not in (float, int) or not (low <= value <= high and abs(value) <= sys.float_info.max):
        limits = "" if low == -math.inf and high == math.inf else f" from {low:g} to {high:g}"
        raise unexpected(where, _shown(value), f"a number{limits}")
    return float(value)


def positive(value: Any, where: str) -> float:
    """A float above zero, as large as a measurement may be."""
    if number(value, where, 0.0, LARGEST) == 0.0:
        raise unexpected(where, _shown(value), "a positive number")
    return float(value)


def integer(value: Any, where: str, low: int = -LARGEST_INTEGER, high: int = LARGEST_INTEGER) -> int:
    """An integer between `low` and `high`, both allowed."""
    if type(value) is not int or not low <= value <= high:
        raise unexpected(where, _shown(value), f"an integer from {low} to {high}")
    return value


def counted(value: Any, where: str, low: int = 0) -> int:
    """A number of rows, lines or bytes, `low` at least: one that can go on counting."""
    # Rows, lines or bytes that are counted: a float counts as far, no log reaches it, and any log may follow
    return integer(value, where, low, 1 << 53)


def text(value: Any, where: str) -> str:
    """Text of a reasonable length."""
    if not isinstance(value, str) or len(value) > LONGEST_TEXT or _SURROGATE.search(value):
        raise unexpected(where, _shown(value), f"text of at most {LONGEST_TEXT} characters")
    return value


def name(value: Any, where: str) -> str | int:
    """Name or number of a column."""
    return integer(value, where, 0) if type(value) is int else text(value, where)


def label(value: Any, where: str) -> Any:
    """Label of a run: None, text, a number, true or false, a date or a span, several of these."""
    if type(value) is tuple:
        return tuple(label(part, where) for part in value)
    if not (value is None or isinstance(value, bool | int | float | str | date | pd.Timedelta)) or value != value:
        raise unexpected(where, _shown(value), "a label (text, a number, a date)")
    return value


def items(value: Any, where: str, length: int | None = None) -> list[Any]:
    """A list, of a given length where one is given."""
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise unexpected(where, _shown(value), "a list" if length is None else f"a list of {length}")
    return value


def numbers(
    value: Any, where: str, length: int | None = None, low: float = -math.inf, high: float = math.inf
) -> np.ndarray:
    """A list of finite numbers between `low` and `high`, as an array; of a given length where one is given."""
    found = enumerate(items(value, where, length))
    return np.array([number(one, f"{where}[{i}]", low, high) for i, one in found], float)


def vector(
    value: Any, where: str, length: int | None = None, most: float = math.inf, missing: Sequence[int] | np.ndarray = ()
) -> np.ndarray:
    """A one-dimensional array of floats up to `most`, of a given length where one is given.

    NaN may stand where a value may be `missing`; elsewhere all are finite.
    """
    right = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype == np.float64
    if right:
        finite = np.isfinite(value) & (abs(value) <= most)
        right = bool((finite | np.isnan(value) & np.isin(np.arange(len(value)), missing)).all())
    if not right or (length is not None and len(value) != length):
        raise unexpected(where, _shown(value), f"an array of {'' if length is None else f'{length} '}finite numbers")
    return np.asarray(value)


# --------------------------------------------------------------------------------------------------- JSON, strictly


def read_bytes(path: str | PathLike[str]) -> bytes:
    """Content of a file of moderate size; pipes and devices, which might never end, are refused.

    Raises ModelFileError for what is no regular file, or too large. Raises OSError for what cannot be read.
    """
    status = Path(path).stat()
    if not stat.S_ISREG(status.st_mode):
        raise ModelFileError("it is no regular file")
    if status.st_size > LARGEST_FILE:
        raise ModelFileError(f"it has {status.st_size} bytes, and at most {LARGEST_FILE} are read (32 MiB)")
    with Path(path).open("rb") as file:
        return file.read(LARGEST_FILE + 1)


def parse(content: bytes) -> dict[str, Any]:
    """JSON as `render` writes it: no duplicate keys, no NaN, no number beyond a float."""
    brackets = content.count(b"[") + content.count(b"{")
    if brackets > MOST_BRACKETS:
        raise ModelFileError(f"it has {brackets} lists and objects, more than any file of thermocorr ({MOST_BRACKETS})")
    values = content.count(b",")
    if values > MOST_VALUES:
        raise ModelFileError(f"it has {values} values, more than any file of thermocorr ({MOST_VALUES})")
    checks: dict[str, Any] = {"parse_float": _finite, "parse_int": _moderate} if _LARGE.search(content) else {}
    try:
        node = json.loads(
            content.decode("utf-8"), object_pairs_hook=_without_duplicates, parse_constant=_refuse_constant, **checks
        )
    except UnicodeDecodeError as error:
        raise ModelFileError(f"byte {error.start} is not text in UTF-8") from None
    except json.JSONDecodeError as error:
        raise ModelFileError(f"line {error.lineno}, column {error.colno}: this is not JSON ({error.msg})") from None
    except RecursionError:
        raise ModelFileError("its lists and objects are nested too deeply") from None
    if not isinstance(node, dict):
        raise unexpected("$", _shown(node), "an object")
    return node


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                raise ModelFileError(f"the key {_shown(key)} stands twice in one object")
            seen.add(key)
    return result


def _finite(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise ModelFileError(f"the number {_shown(digits)} is too large")
    return value


def _moderate(digits: str) -> int:
    if len(digits) > 20 or abs(int(digits)) >= LARGEST_INTEGER:
        raise ModelFileError(f"the integer {_shown(digits)} is too large")
    return int(digits)


def _refuse_constant(constant: str) -> Any:
    raise ModelFileError(f"{constant} is not a number in JSON")


def render(node: Any, depth: int = 0) -> str:
    """JSON for people: one line for each key, lists of plain values in one line."""
    pad = " " * (depth + 1)
    if isinstance(node, dict) and any(isinstance(value, dict | list) for value in node.values()):
        inside = [f"{pad}{json.dumps(key)}: {render(value, depth + 1)}" for key, value in node.items()]
        return "{\n" + ",\n".join(inside) + f"\n{' ' * depth}}}"
    if isinstance(node, list) and any(isinstance(value, dict | list) for value in node):
        return "[\n" + ",\n".join(f"{pad}{render(value, depth + 1)}" for value in node) + f"\n{' ' * depth}]"
    return json.dumps(node, allow_nan=False)
