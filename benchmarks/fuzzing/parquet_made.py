"""Parquet files with columns of every Arrow type in every role."""

from __future__ import annotations

import contextlib
import math
import random
from decimal import Decimal
from typing import Any

import numpy as np
import pyarrow as pa

from .mutations import NUMBERS, TIMES

ROWS = 40
UNITS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
INTEGERS = [getattr(pa, f"{sign}int{bits}")() for sign in ("", "u") for bits in (8, 16, 32, 64)]
FLOATS = [pa.float16(), pa.float32(), pa.float64()]
DECIMALS = [pa.decimal128(10, 3), pa.decimal128(38, 10), pa.decimal256(60, 6), pa.decimal128(20, 0)]
STAMPS = [pa.timestamp(unit, zone) for unit in UNITS for zone in (None, "UTC", "Europe/Paris", "+05:30")]
SPANS = [pa.duration(unit) for unit in UNITS]
DAYS = [pa.date32(), pa.date64()]
CLOCKS = [pa.time32("s"), pa.time32("ms"), pa.time64("us"), pa.time64("ns")]
WORDS = [pa.string(), pa.large_string()]
TEXTS = [*WORDS, *(pa.dictionary(index, word) for index, word in zip((pa.int32(), pa.int8()), WORDS, strict=True))]
STRANGE = [
    pa.dictionary(pa.int32(), pa.int64()), pa.dictionary(pa.int32(), pa.float64()), pa.binary(), pa.large_binary(),
    pa.binary(4), pa.list_(pa.float64()), pa.large_list(pa.int64()), pa.list_(pa.float64(), 2),
    pa.struct([("a", pa.float64())]), pa.map_(pa.string(), pa.float64()), pa.null(), pa.bool_(), pa.string_view(),
    pa.dictionary(pa.int32(), pa.binary()),
]  # fmt: skip
TYPES = [*INTEGERS, *FLOATS, *DECIMALS, *STAMPS, *SPANS, *DAYS, *CLOCKS, *TEXTS, *STRANGE]
ROLES = ("temperature", "reading", "humidity", "time", "run")
FAR = [
    191_065_305_600, 3_918_000_000, -9_300_000_000, 9_223_372_036, 9_223_372_037, 253_402_300_799, -62_135_596_800
]  # fmt: skip
"""Years 8024, 2094, 1675, the last of the range, beyond it, 9999 and 1, in seconds since 1970."""
LAST = (1 << 63) - 1


def column(kind: Any, raw: list[int | None], time: bool) -> Any:
    """These whole numbers as a column of a type: eighths of them as numbers, seconds as times."""
    if pa.types.is_integer(kind) or pa.types.is_null(kind):
        return pa.array([None] * len(raw) if pa.types.is_null(kind) else raw, kind)
    if pa.types.is_floating(kind):
        values = np.array([np.nan if r is None else (r if time else r / 8 + 0.1) for r in raw])
        return pa.array(values.astype(kind.to_pandas_dtype()), mask=np.array([r is None for r in raw]))
    if pa.types.is_decimal(kind):
        scale = Decimal(1).scaleb(-kind.scale)
        return pa.array([None if r is None else (Decimal(r) / 8).quantize(scale) for r in raw], kind)
    if pa.types.is_boolean(kind):
        return pa.array([None if r is None else r % 2 == 0 for r in raw], kind)
    if pa.types.is_temporal(kind):
        return _temporal(kind, raw)
    if pa.types.is_dictionary(kind):
        return column(kind.value_type, raw, time).dictionary_encode().cast(kind)
    write = (lambda r: f"2024-03-04T00:{r // 60 % 60:02}:{r % 60:02}") if time else (lambda r: str(r / 8))
    words = [None if r is None else write(r) for r in raw]
    if pa.types.is_fixed_size_binary(kind):
        return pa.array([None if w is None else w.encode()[:4].ljust(4) for w in words], kind)
    if pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        return pa.array([None if w is None else w.encode() for w in words], kind)
    if pa.types.is_struct(kind):
        return pa.array([None if r is None else {"a": float(r)} for r in raw], kind)
    if pa.types.is_map(kind):
        return pa.array([None if r is None else [("a", float(r))] for r in raw], kind)
    if pa.types.is_nested(kind):
        return pa.array([None if r is None else [r, r] for r in raw], kind)
    return pa.array(words, kind)


def _temporal(kind: Any, raw: list[int | None]) -> Any:
    if kind == pa.date32() or kind == pa.date64():
        days = pa.array([None if r is None else 19_786 + r for r in raw], pa.int32())
        return days.view(pa.date32()).cast(kind)
    per_second = UNITS[kind.unit]
    begin = 1_709_510_400 if pa.types.is_timestamp(kind) else 0
    wide = pa.int32() if pa.types.is_time32(kind) else pa.int64()
    return pa.array([None if r is None else (begin + r) * per_second for r in raw], wide).view(kind)


def spoiled(values: Any, rng: random.Random, time: bool) -> tuple[Any, str]:
    """The column with something else in it."""
    kind, n = values.type, len(values)
    what = rng.choice(["", "", "hole", "back", "same", "extreme", "holes", "late", "text", "all missing"])
    at = rng.randrange(1, n)
    order = list(range(n))
    if what == "back":
        order[at - 1], order[at] = order[at], order[at - 1]
        return _taken(values, order), what
    if what == "same":
        order[at] = at - 1
        return _taken(values, order), what
    if what in ("hole", "holes", "all missing"):
        gone = {"hole": {at}, "holes": {at, at // 2, 0}, "all missing": set(order)}[what]
        return _taken(values, [None if k in gone else k for k in order]), what
    choices = extremes(kind, what, rng)
    if not choices:
        return values, ""
    try:
        one = rng.choice(choices)
        one = one if isinstance(one, pa.Array) else pa.array([one], kind)
    except (pa.ArrowException, ValueError, OverflowError, TypeError):
        return values, ""
    at = n - 1 if what == "late" else at
    plain = one.view(pa.int64()) if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) else one
    plain = plain.cast(pa.date32()).view(pa.int32()) if kind in DAYS else plain
    return pa.concat_arrays([values[:at], one, values[at + 1 :]]), f"{what} {plain[0]!s:.40}"


def _taken(values: Any, order: list[int | None]) -> Any:
    plain = values.cast(pa.string()) if values.type == pa.string_view() else values
    return plain.take(pa.array(order, pa.int64())).cast(values.type)


def extremes(kind: Any, what: str, rng: random.Random) -> list[Any]:
    """Values at the ends of a type."""
    if what == "text" and (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
        return [rng.choice(NUMBERS + TIMES).replace("\ud800", "")]
    if what not in ("extreme", "late"):
        return []
    if pa.types.is_integer(kind):
        bits = kind.bit_width
        low, high = 0, (1 << bits) - 1
        if pa.types.is_signed_integer(kind):
            low, high = -(1 << bits - 1), (1 << bits - 1) - 1
        return [low, high, high - 1, min(high, 2**53 + 1), min(high, 2**63)]
    if pa.types.is_floating(kind):
        values = [math.inf, -math.inf, math.nan, 1e300, -1e41, 1e39, 65504.0, 3e38, 2.0**53 + 1, 1e-320]
        with np.errstate(all="ignore"):
            return [pa.array(np.array([value]).astype(kind.to_pandas_dtype())) for value in values]
    if pa.types.is_decimal(kind):
        return [Decimal("0.001"), Decimal("9" * (kind.precision - kind.scale)), Decimal("1234567.123"), Decimal(-1)]
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        ticks = [value * UNITS[kind.unit] for value in FAR] + [LAST, -LAST]
        return [pa.array([tick], pa.int64()).view(kind) for tick in ticks if abs(tick) <= LAST]
    if kind in (pa.date32(), pa.date64()):
        days = (2**31 - 1, 106_752, 2_000_000, -110_000)
        return [pa.array([day], pa.int32()).view(pa.date32()).cast(kind) for day in days]
    return []


def made(rng: random.Random) -> tuple[Any, str, str | None]:
    """A table with one or two columns of chosen types, what was done, and the column of runs."""
    tick = 0
    raw: dict[str, list[int | None]] = {}
    for name in ROLES[:3]:
        walk = [50]
        while len(walk) < ROWS:
            walk.append(min(100, max(0, walk[-1] + rng.choice([-7, -3, 2, 5]))))
        raw[name] = list(walk)
    raw["time"] = [tick := tick + rng.choice([1, 1, 1, 2]) for _ in range(ROWS)]
    odd = rng.randrange(ROWS)
    raw["run"] = [8 * rng.choice([k > 20, k > 20, k == odd, k % 2 == 0]) for k in range(ROWS)]
    if rng.random() < 0.7:
        raw["run"] = [8 * (k > 20 or k == odd) for k in range(ROWS)]
    types = {"temperature": pa.float64(), "reading": pa.float64(), "humidity": pa.float64(), "time": pa.timestamp("us")}
    chosen = rng.choices(ROLES, k=rng.choice([1, 1, 2]))
    types |= {role: rng.choice(TYPES) for role in chosen}
    if "time" in chosen and rng.random() < 0.6:
        types["time"] = rng.choice([*INTEGERS, *FLOATS, *STAMPS, *SPANS, *DAYS])
    if "run" in chosen:
        types.setdefault("run", pa.string())
    said, columns = [], {}
    for name, kind in types.items():
        try:
            columns[name] = column(kind, raw[name], name == "time")
        except (pa.ArrowException, ValueError, TypeError, NotImplementedError):
            columns[name] = pa.array(raw[name], pa.int64())
        note = ""
        if name in chosen:
            columns[name], note = spoiled(columns[name], rng, name == "time")
        if name in chosen:
            said.append(f"{name}: {columns[name].type} {note}".strip())
    table = pa.table(columns)
    if rng.random() < 0.2 and str(columns["time"].type).startswith(("timestamp", "duration")):
        with contextlib.suppress(pa.ArrowException, ValueError, OverflowError):  # an index, as pandas writes it
            table = pa.Table.from_pandas(table.to_pandas().set_index("time"))
            said.append("as an index")
    return table, ", ".join(said), "run" if "run" in types else None
