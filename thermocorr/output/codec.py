"""Values as JSON by their type hints; reading runs nothing."""

from __future__ import annotations

import json
import math
import re
import reprlib
import stat
from collections.abc import Callable, Iterable
from dataclasses import fields as fields_of
from dataclasses import is_dataclass
from datetime import date, datetime, timedelta
from functools import cache
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pandas as pd

from ..effects.signals import DelayState
from ..equations import LagState

LARGEST_FILE = 32 << 20
"""Bytes of a file of a model or state; a longer one is refused before it is read."""
MOST_BRACKETS, MOST_VALUES = 200_000, 9_000_000
"""Lists and objects, and values, in such a file: each takes memory and time, however short it is in the file."""
LARGEST_INTEGER = 1 << 63
LONGEST_TEXT = 10_000
_SURROGATE = re.compile("[\ud800-\udfff]")
"""Halves of characters: no text has them alone."""
_STATES: dict[str, Any] = {"LagState": LagState, "DelayState": DelayState}
_DTYPES = ("float64", "float32", "int64", "int32", "bool")
_LOOSE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_BRIEF = reprlib.Repr()
_BRIEF.maxlist = _BRIEF.maxdict = _BRIEF.maxtuple = 30
_BRIEF.maxstring = _BRIEF.maxlong = _BRIEF.maxother = 80

Codec = Callable[[Any, str], Any] | None
"""Writes or reads an effect that stands among other values."""


class ModelFileError(ValueError):
    """A model file is damaged or foreign, or cannot be written."""

    remedy = "Take an undamaged copy, or fit the model again and save it with thermocorr.save_model."
    """What to do about a file that cannot be loaded."""


def unexpected(where: str, found: str, wanted: str = "") -> ModelFileError:
    """The error for something unexpected in a file."""
    return ModelFileError(f"{where} holds {found}{f' where {wanted} belongs' if wanted else ', which is unknown'}")


def shown(value: Any) -> str:
    """A value in few characters."""
    text = _BRIEF.repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


# ------------------------------------------------------------------------------------------------------- by type hints


@cache
def _hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls, include_extras=True)


@cache
def hints_of(cls: type) -> dict[str, Any]:
    """Fields of a dataclass that a file holds, with hints."""
    return {field.name: _hints(cls)[field.name] for field in fields_of(cls) if field.compare}


def write(hint: Any, value: Any, where: str, effect: Codec = None) -> Any:
    """A value as JSON, as its type hint says."""
    if get_origin(hint) is Annotated:
        return write(get_args(hint)[0], value, where, effect)
    origin, args = get_origin(hint), get_args(hint)
    if value is None:
        return None
    if origin in (Union, UnionType) and NoneType in args:
        return write(next(arg for arg in args if arg is not NoneType), value, where, effect)
    if is_dataclass(hint):
        return {
            name: write(of, getattr(value, name), f"{where}.{name}", effect)
            for name, of in hints_of(hint).items()  # type: ignore[arg-type]
        }
    if hasattr(hint, "_fields"):
        return [write(of, one, where, effect) for of, one in zip(_hints(hint).values(), value, strict=True)]
    if hint is np.ndarray:
        return np.asarray(value, float).tolist()
    if origin in (tuple, list):
        parts = args if origin is tuple and args[1:] != (...,) else args[:1] * len(value)
        return [write(part, one, where, effect) for part, one in zip(parts, value, strict=True)]
    if origin is dict and args[0] is str:
        return {key: write(args[1], one, f"{where}.{key}", effect) for key, one in value.items()}
    if origin is dict:
        return [[write(args[0], key, where), write(args[1], one, where, effect)] for key, one in value.items()]
    if hint is float:
        return float(value) if math.isfinite(value) else repr(float(value))
    if hint in (int, bool):
        return hint(value)
    if effect is not None and hasattr(hint, "get_params"):
        return effect(value, where)
    return pack(value, where, effect)


def read(hint: Any, node: Any, where: str, effect: Codec = None) -> Any:
    """The value that `write` wrote under the same hint."""
    if get_origin(hint) is Annotated:
        hint, *limits = get_args(hint)
        value = _read(hint, node, where, effect)
        for limit in limits:
            if not limit.holds(value):
                raise unexpected(where, shown(node), limit.wanted)
        return value
    return _read(hint, node, where, effect)


def read_fields(cls: Any, node: Any, where: str, effect: Codec = None) -> dict[str, Any]:
    """The fields of a dataclass."""
    hints = hints_of(cls)
    node = fields(node, where, hints)
    return {name: read(hint, node[name], f"{where}.{name}", effect) for name, hint in hints.items()}


def _read(hint: Any, node: Any, where: str, effect: Codec) -> Any:
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        if node is None and NoneType in args:
            return None
        kinds = [arg for arg in args if arg is not NoneType]
        return read(next((kind for kind in kinds if kind is type(node)), kinds[0]), node, where, effect)
    if is_dataclass(hint):
        given = read_fields(hint, node, where, effect)
        try:
            return hint(**given)  # type: ignore[operator]
        except (ValueError, TypeError) as error:
            raise ModelFileError(f"{where}: {error}") from None
    if hasattr(hint, "_fields"):
        named = zip(_hints(hint).items(), items(node, where, len(hint._fields)), strict=True)
        return hint(*(read(of, one, f"{where}.{name}", effect) for (name, of), one in named))
    if hint is np.ndarray:
        return array(node, where)
    if origin in (tuple, list):
        parts = args if origin is tuple and args[1:] != (...,) else args[:1] * len(items(node, where))
        found = zip(parts, items(node, where, len(parts)), strict=True)
        return origin(read(part, one, f"{where}[{i}]", effect) for i, (part, one) in enumerate(found))
    if origin is dict and args[0] is str:
        return {key: read(args[1], one, f"{where}.{key:.60}", effect) for key, one in fields(node, where).items()}
    if origin is dict:
        pairs = [items(pair, f"{where}[{i}]", 2) for i, pair in enumerate(items(node, where))]
        result = {
            read(args[0], key, f"{where}[{i}]"): read(args[1], one, f"{where}[{i}]", effect)
            for i, (key, one) in enumerate(pairs)
        }
        if len(result) < len(pairs):
            raise unexpected(where, "a key twice", "keys that stand once")
        return result
    if origin is Literal:
        if type(node) is not type(args[0]) or node not in args:
            raise unexpected(where, shown(node), f"one of {', '.join(map(str, args))}")
        return node
    if hint is float and isinstance(node, str) and node in _LOOSE:
        return _LOOSE[node]
    if hint in (float, int, bool):
        if type(node) is not hint:
            raise unexpected(where, shown(node), {float: "a number", int: "an integer", bool: "true or false"}[hint])
        return node
    if hint is str:
        return text(node, where)
    if effect is not None and hasattr(hint, "get_params"):
        return effect(node, where)
    return unpack(node, where, effect)


def array(node: Any, where: str) -> np.ndarray:
    """A list of floats, or of equally long lists, as an array."""
    rows = items(node, where)
    if rows and isinstance(rows[0], list):
        width = len(rows[0])
        return np.array([array(items(row, f"{where}[{i}]", width), where) for i, row in enumerate(rows)])
    for i, one in enumerate(rows):
        if type(one) is not float:
            raise unexpected(f"{where}[{i}]", shown(one), "a number")
    return np.array(rows, float)


# --------------------------------------------------------------------------------------------------- values of any kind


def pack(value: Any, where: str, effect: Codec = None) -> Any:
    """A value as JSON, special ones under a ``$`` name.

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
    for name, state in _STATES.items():
        if isinstance(value, state):
            return {f"${name}": [pack(item, f"{where}.{name}", effect) for item in value]}
    if type(value) is tuple:
        return {"$tuple": [pack(item, f"{where}[{i}]", effect) for i, item in enumerate(value)]}
    if type(value) is dict:
        return {"$dict": [[pack(k, where, effect), pack(v, f"{where}[{k!r}]", effect)] for k, v in value.items()]}
    if isinstance(value, np.ndarray) and value.dtype.name in _DTYPES:
        return {"$array": [value.dtype.name, pack(value.tolist(), where)]}
    if isinstance(value, datetime | np.datetime64) and not pd.isna(value):
        return {"$date": _date_text(pd.Timestamp(value))}
    if type(value) is date:
        return {"$day": value.isoformat()}
    if isinstance(value, timedelta | np.timedelta64) and not pd.isna(value):
        return {"$span": int(pd.Timedelta(value).value)}
    if effect is not None:
        return {"$effect": effect(value, where)}
    raise ModelFileError(
        f"{where} is a {type(value).__name__}, which has no place in a model file: numbers, text, dates, lists, dicts "
        "and arrays of floats do."
    )


def _date_text(date: pd.Timestamp) -> str:
    """A date in ISO 8601, odd zones in UTC."""
    offset = date.utcoffset()
    return (date if offset is None or offset.total_seconds() % 60 == 0 else date.tz_convert("UTC")).isoformat()


def unpack(node: Any, where: str, effect: Codec = None) -> Any:
    """The value that `pack` wrote; raises ModelFileError for anything else."""
    if isinstance(node, str):
        return text(node, where)
    if node is None or isinstance(node, bool | int | float):
        return node
    if isinstance(node, list):
        return [unpack(item, f"{where}[{i}]", effect) for i, item in enumerate(node)]
    tag, content = next(iter(node.items()), ("", None))
    if len(node) == 1:
        if tag == "$float" and isinstance(content, str) and content in _LOOSE:
            return _LOOSE[content]
        if tag == "$tuple":
            return tuple(unpack(item, f"{where}[{i}]", effect) for i, item in enumerate(items(content, where)))
        if tag == "$dict":
            pairs = [items(pair, f"{where}[{i}]", 2) for i, pair in enumerate(items(content, where))]
            if all(type(key) in (str, int) for key, _ in pairs):
                return {key: unpack(item, f"{where}[{shown(key)}]", effect) for key, item in pairs}
        if tag == "$array":
            dtype, values = items(content, where, 2)
            return np.array(unpack(values, where), read(Literal[_DTYPES], dtype, where))
        if tag[1:] in _STATES:
            state = _STATES[tag[1:]]
            return state(*(unpack(one, where) for one in items(content, where, len(state._fields))))
        if tag in ("$date", "$day") and isinstance(content, str) and len(content) < 60:
            moment = _date(content, where)
            return moment if tag == "$date" else moment.date()
        if tag == "$span" and type(content) is int and abs(content) < LARGEST_INTEGER:
            return pd.Timedelta(content, unit="ns")
        if tag == "$effect" and effect is not None:
            return effect(content, f"{where}.$effect")
    raise unexpected(where, shown(node))


def _date(text: str, where: str) -> pd.Timestamp:
    try:
        moment: pd.Timestamp | None = pd.Timestamp(text)
    except (ValueError, TypeError, OverflowError):
        moment = None
    if moment is None or pd.isna(moment):
        raise unexpected(where, shown(text), "a date such as 2024-05-31T14:00:00")
    return moment


# -------------------------------------------------------------------------------------------- checks of what was read


def fields(
    node: Any, where: str, required: Iterable[str] | None = None, optional: Iterable[str] = ()
) -> dict[str, Any]:
    """A JSON object; with exactly these keys, where they are given."""
    if not isinstance(node, dict):
        raise unexpected(where, shown(node), "an object")
    for key in required or ():
        if key not in node:
            raise ModelFileError(f"{where} has no {key!r}")
    foreign = [] if required is None else sorted({*node} - {*required} - {*optional})
    if foreign:
        raise unexpected(where, f"the key {shown(foreign[0])}")
    return node


def number(value: Any, where: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number between `low` and `high`, both allowed."""
    if type(value) not in (float, int) or not (low <= value <= high and abs(value) <= 1e308):
        limits = "" if low == -math.inf and high == math.inf else f" from {low:g} to {high:g}"
        raise unexpected(where, shown(value), f"a number{limits}")
    return float(value)


def integer(value: Any, where: str, low: int = -LARGEST_INTEGER, high: int = LARGEST_INTEGER) -> int:
    """An integer between `low` and `high`, both allowed."""
    if type(value) is not int or not low <= value <= high:
        raise unexpected(where, shown(value), f"an integer from {low} to {high}")
    return value


def text(value: Any, where: str) -> str:
    """Text of a reasonable length."""
    if not isinstance(value, str) or len(value) > LONGEST_TEXT or _SURROGATE.search(value):
        raise unexpected(where, shown(value), f"text of at most {LONGEST_TEXT} characters")
    return value


def items(value: Any, where: str, length: int | None = None) -> list[Any]:
    """A list, of a given length where one is given."""
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise unexpected(where, shown(value), "a list" if length is None else f"a list of {length}")
    return value


# --------------------------------------------------------------------------------------------------- JSON, strictly


def read_bytes(path: str | PathLike[str]) -> bytes:
    """Content of a file of moderate size.

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
    """A JSON object of known size."""
    for count, most, what in (
        (content.count(b"[") + content.count(b"{"), MOST_BRACKETS, "lists and objects"),
        (content.count(b","), MOST_VALUES, "values"),
    ):
        if count > most:
            raise ModelFileError(f"it has {count} {what}, more than any file of thermocorr ({most})")
    try:
        node = json.loads(content)
    except (ValueError, RecursionError) as error:  # no text, no JSON, an integer of thousands of digits
        raise ModelFileError(f"it is not JSON: {error}") from None
    return fields(node, "$")


def render(node: Any, depth: int = 0) -> str:
    """JSON with one line per key."""
    pad = " " * (depth + 1)
    if isinstance(node, dict) and any(isinstance(value, dict | list) for value in node.values()):
        inside = [f"{pad}{json.dumps(key)}: {render(value, depth + 1)}" for key, value in node.items()]
        return "{\n" + ",\n".join(inside) + f"\n{' ' * depth}}}"
    if isinstance(node, list) and any(isinstance(value, dict) for value in node):
        return "[\n" + ",\n".join(f"{pad}{render(value, depth + 1)}" for value in node) + f"\n{' ' * depth}]"
    return json.dumps(node, allow_nan=False)
