"""Parquet files with columns of every Arrow type in every role, through both readers and `correct`."""

import contextlib
import math
import random
import re
import warnings
from collections.abc import Callable
from decimal import Decimal
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from thermocorr import DynamicBiasRegressor, OnlineCorrector, ParquetLog, save_model
from thermocorr.effects import Covariate
from thermocorr.records.files import read_table

from . import oracle
from .logs import shown_by
from .mutations import NUMBERS, TIMES
from .outcomes import REFUSED, REFUSED_GOOD, RIGHT, WRONG, Found, Room, refused, run
from .subjects import times_of

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
ROLES = ("temperature", "reading", "humidity", "time")
FAR = [
    191_065_305_600, 3_918_000_000, -9_300_000_000, 9_223_372_036, 9_223_372_037, 253_402_300_799, -62_135_596_800
]  # fmt: skip
"""Years 8024, 2094, 1675, the last of the range, beyond it, 9999 and 1, in seconds since 1970."""
LAST = (1 << 63) - 1


def column(kind: Any, raw: list[int], time: bool) -> Any:
    """These whole numbers as a column of a type: eighths of them as numbers, seconds as times."""
    if pa.types.is_null(kind):
        return pa.nulls(len(raw))
    if pa.types.is_integer(kind):
        return pa.array(raw, kind)
    if pa.types.is_floating(kind):
        return pa.array(np.array([r if time else r / 8 + 0.1 for r in raw]).astype(kind.to_pandas_dtype()))
    if pa.types.is_decimal(kind):
        return pa.array([(Decimal(r) / 8).quantize(Decimal(1).scaleb(-kind.scale)) for r in raw], kind)
    if pa.types.is_temporal(kind):
        return _temporal(kind, raw)
    if pa.types.is_dictionary(kind):
        return column(kind.value_type, raw, time).dictionary_encode().cast(kind)
    write = (lambda r: f"2024-03-04T00:{r // 60 % 60:02}:{r % 60:02}") if time else (lambda r: str(r / 8))
    items: dict[str, Callable[[int], Any]] = {
        "boolean": lambda r: r % 2 == 0,
        "fixed_size_binary": lambda r: write(r).encode()[:4].ljust(4),
        "binary": lambda r: write(r).encode(),
        "large_binary": lambda r: write(r).encode(),
        "struct": lambda r: {"a": float(r)},
        "map": lambda r: [("a", float(r))],
        "nested": lambda r: [r, r],
    }
    family = next((name for name in items if getattr(pa.types, f"is_{name}")(kind)), None)
    return pa.array(list(map(items[family] if family else write, raw)), kind)


def _temporal(kind: Any, raw: list[int]) -> Any:
    if kind in DAYS:
        return pa.array([19_786 + r for r in raw], pa.int32()).view(pa.date32()).cast(kind)
    begin = 1_709_510_400 if pa.types.is_timestamp(kind) else 0
    wide = pa.int32() if pa.types.is_time32(kind) else pa.int64()
    return pa.array([(begin + r) * UNITS[kind.unit] for r in raw], wide).view(kind)


def spoiled(values: Any, rng: random.Random, time: bool) -> tuple[Any, str]:
    """The column with something else in it."""
    kind, n = values.type, len(values)
    what = rng.choice(["", "", "hole", "back", "same", "extreme", "holes", "late", "text", "all missing"])
    at = rng.randrange(1, n)
    order: list[int | None] = list(range(n))
    if what in ("back", "same"):
        order[at - 1 : at + 1] = [at, at - 1] if what == "back" else [at - 1, at - 1]
    elif what in ("hole", "holes", "all missing"):
        gone = {"hole": {at}, "holes": {at, at // 2, 0}, "all missing": set(order)}[what]
        order = [None if k in gone else k for k in order]
    else:
        choices = extremes(kind, what, rng)
        try:
            one = rng.choice(choices) if choices else None
            one = one if isinstance(one, pa.Array) else pa.array([one], kind)
        except (pa.ArrowException, ValueError, OverflowError, TypeError):
            return values, ""
        at = n - 1 if what == "late" else at
        return (pa.concat_arrays([values[:at], one, values[at + 1 :]]), what) if choices else (values, "")
    plain = values.cast(pa.string()) if kind == pa.string_view() else values
    return plain.take(pa.array(order, pa.int64())).cast(kind), what


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


def made(rng: random.Random) -> tuple[Any, str]:
    """A table with one or two columns of chosen types, and what was done (of runs, the tests have every type)."""
    raw: dict[str, list[int]] = {}
    for name in ROLES[:3]:
        walk = [50]
        while len(walk) < ROWS:
            walk.append(min(100, max(0, walk[-1] + rng.choice([-7, -3, 2, 5]))))
        raw[name] = walk
    raw["time"] = list(accumulate(rng.choice([1, 1, 1, 2]) for _ in range(ROWS)))
    types = {"temperature": pa.float64(), "reading": pa.float64(), "humidity": pa.float64(), "time": pa.timestamp("us")}
    chosen = rng.choices(ROLES, k=rng.choice([1, 1, 2]))
    types |= {role: rng.choice(TYPES) for role in chosen}
    if "time" in chosen and rng.random() < 0.6:
        types["time"] = rng.choice([*INTEGERS, *FLOATS, *STAMPS, *SPANS, *DAYS])
    said, columns = [], {}
    for name, kind in types.items():
        try:
            columns[name] = column(kind, raw[name], name == "time")
        except (pa.ArrowException, ValueError, TypeError, NotImplementedError):
            columns[name] = pa.array(raw[name], pa.int64())
        if name in chosen:
            columns[name], note = spoiled(columns[name], rng, name == "time")
            said.append(f"{name}: {columns[name].type} {note}".strip())
    table = pa.table(columns)
    if rng.random() < 0.2 and str(columns["time"].type).startswith(("timestamp", "duration")):
        with contextlib.suppress(pa.ArrowException, ValueError, OverflowError):  # an index, as pandas writes it
            table = pa.Table.from_pandas(table.to_pandas().set_index("time"))
            said.append("as an index")
    return table, ", ".join(said)


Expected = tuple[pd.DataFrame, list[Any]]  # columns as floats with their times, and the stamps of these


# ---- oracle ----------------------------------------------------------------------------------------------------------
def _is(kind: Any, *names: str) -> bool:
    """Whether a type is of one of these families of Arrow."""
    return any(getattr(pa.types, f"is_{name}")(kind) for name in names)


def numbers(values: Any, role: str) -> list[float] | None:
    """A column as floats, NaN where there is none; None where it must be refused."""
    kind = values.type
    text = kind.value_type if pa.types.is_dictionary(kind) else kind
    items = [] if pa.types.is_temporal(text) else values.to_pylist()
    if _is(text, "string", "large_string") or text == pa.string_view():
        found = [math.nan if item is None else oracle.number(item) for item in items]
    elif _is(kind, "integer", "floating", "decimal", "null") or (pa.types.is_boolean(kind) and role == "humidity"):
        found = [math.nan if item is None else float(item) for item in items]
    else:
        return None
    if any(value is None or abs(value) > oracle.MOST for value in found):
        return None
    return found if any(not math.isnan(value) for value in found) else None


def times(values: Any) -> tuple[str, list[Any]] | None:
    """Kind and stamps of a column of times; None where it must be refused."""
    kind = values.type
    if values.null_count or pa.types.is_null(kind):
        return None
    if _is(kind, "integer", "floating", "decimal"):
        seconds = [float(value) for value in values.to_pylist()]
        return ("seconds", seconds) if all(map(math.isfinite, seconds)) else None
    if kind in DAYS:
        stamps = [day * 86_400 * 10**9 for day in values.cast(pa.date32()).view(pa.int32()).to_pylist()]
        return ("datetime", stamps) if all(abs(stamp) <= LAST for stamp in stamps) else None
    if _is(kind, "timestamp", "duration"):
        stamps = [tick * (10**9 // UNITS[kind.unit]) for tick in values.view(pa.int64()).to_pylist()]
        local = pa.types.is_timestamp(kind) and kind.tz not in (None, "UTC")  # a date in its zone too
        if any(abs(stamp) > LAST - 86_400 * 10**9 * local for stamp in stamps):
            return None
        if pa.types.is_duration(kind):
            return "timedelta", stamps
        return ("datetime" if kind.tz is None else "datetime with time zone"), stamps
    return None


def expected(path: Any) -> Expected | None:
    """The log as a frame of floats and times; None where it must be refused."""
    table = parquet.read_table(path)
    whole = {name: table.column(name).combine_chunks() for name in table.column_names}
    found = {name: numbers(whole[name], name) for name in ROLES[:3]}
    when = times(whole["time"])
    if None in found.values() or when is None or any(after <= before for before, after in pairwise(when[1])):
        return None
    stamps = pd.to_timedelta(when[1], unit="ns") if when[0] == "timedelta" else times_of(when[1], when[0])
    return pd.DataFrame(found).assign(time=stamps), when[1]


# ---- checks ----------------------------------------------------------------------------------------------------------
def _fitted(log: Any) -> tuple[DynamicBiasRegressor, Any, Any]:
    """A model of a frame or a `ParquetLog`, with what it was fitted to."""
    index = log.index if isinstance(log, pd.DataFrame) else None
    stamped = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex) or getattr(log, "index_name", None) is not None
    X, y = log.drop(columns="reading") if isinstance(log, pd.DataFrame) else log, log["reading"]
    time = None if stamped else "time"
    model = DynamicBiasRegressor("temperature", [6.0, 20.0], 1, time=time, effects=[Covariate("humidity")])
    return model.fit(X, y), X, y


def _outcome(opened: Callable[[], Any]) -> tuple[np.ndarray | None, str]:
    """Corrected readings of all rows that have a temperature, or the sentence that refuses the log."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            model, X, y = _fitted(opened())
            if isinstance(X, ParquetLog):  # it leaves out rows without a temperature
                return pd.concat(list(model.evaluate_blocks(X, y)))["corrected"].reindex(range(ROWS)).to_numpy(), ""
            return model.evaluate(X, y)["corrected"].to_numpy(), ""
    except Exception as error:
        refused(error)
        return None, str(error)[:300]


def a_table(rng: random.Random, room: Room, size: int) -> tuple[Any, Any]:
    """A table, and its file; None where Parquet does not know a type."""
    table, said = made(rng)
    room.said.append(said)
    path = room.folder / "log.parquet"
    try:
        parquet.write_table(table, path, row_group_size=size)
    except (pa.ArrowException, ValueError):
        return table, None
    return table, path


def readers(rng: random.Random, room: Room) -> str:
    """`ParquetLog` against `read_table`, and both against the oracle."""
    table, path = a_table(rng, room, rng.choice([7, 1000]))
    if path is None:
        return REFUSED
    log, words = _outcome(lambda: ParquetLog(path))
    frame, other_words = _outcome(lambda: read_table(path))
    text = re.search("holds (dictionary<values=)?(large_)?string", words)  # numbers and dates as text: frames only
    if (log is None) != (frame is None) and not (log is None and text):
        raise Found(WRONG, f"the readers disagree: {words or 'accepted'!r} and {other_words or 'accepted'!r}")
    wanted = expected(path)
    if wanted is None or frame is None:
        if frame is not None and "string" not in str(table.schema.field("time").type):
            raise Found(WRONG, "accepted what the oracle refuses")
        return REFUSED
    right = _outcome(lambda: wanted[0])[0]
    close = 1e-9 * np.nanmax(abs(wanted[0][["temperature", "reading"]].to_numpy()))
    for reader, got in (("ParquetLog", log), ("read_table", frame)):
        if got is not None and (right is None or not np.allclose(got, right, rtol=1e-9, atol=close, equal_nan=True)):
            raise Found(WRONG, f"{reader} gives other corrected readings")
    return RIGHT


def correct(rng: random.Random, room: Room) -> str:
    """`correct log.parquet` with a model that was fitted to what the oracle makes of the log."""
    _, path = a_table(rng, room, 1000)
    if path is None:
        return REFUSED
    wanted = expected(path)
    if wanted is None:  # the model of another log: a sentence, or rows that are named
        run("correct", "--model", room.subjects["dates"].path, path)
        return REFUSED
    frame, stamps = wanted
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            model = _fitted(frame)[0]
        except ValueError:
            return REFUSED
        save_model(model, room.folder / "model.json")
    done = run("correct", "--model", room.folder / "model.json", path)
    if done.status == 2:
        raise Found(REFUSED_GOOD, done.said[-1])
    values = {name: frame[name].to_numpy() for name in ("temperature", "humidity")}
    live = OnlineCorrector(model).update_stamps(np.array(stamps), values, frame["reading"].to_numpy())
    names, *rows = shown_by(done)
    at = names.index("corrected")
    for k, (row, *pair) in enumerate(zip(rows, live.corrected, live.bias, strict=True)):
        got = [math.nan if cell == "" else float(cell) for cell in row[at : at + 2]]
        if not np.allclose(got, pair, rtol=1e-12, atol=1e-12, equal_nan=True):
            raise Found(WRONG, f"row {k}: corrected and bias are {got} and not {pair}")
    return RIGHT
