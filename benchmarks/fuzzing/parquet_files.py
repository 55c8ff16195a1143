"""Parquet files through both readers and the commands, against what Arrow itself says of their values."""

from __future__ import annotations

import csv
import io
import math
import random
import re
import warnings
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from thermocorr import DynamicBiasRegressor, OnlineCorrector, ParquetLog, save_model
from thermocorr.effects import Covariate
from thermocorr.records.files import read_table
from thermocorr.records.numbers import numeric_column

from . import oracle
from .outcomes import REFUSED, REFUSED_GOOD, RIGHT, WRONG, Found, Room, refused, run
from .parquet_made import DAYS, LAST, ROLES, ROWS, UNITS, made
from .subjects import times_of

Expected = tuple[pd.DataFrame, str, list[Any]]
"""Columns as floats, kind of the times, their stamps."""
# ------------------------------------------------------------------------------------------------------------- oracle


def _numeric(kind: Any) -> bool:
    return any(
        test(kind) for test in (pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal, pa.types.is_null)
    )


def numbers(values: Any, role: str) -> list[float] | None:
    """A column as floats, NaN where there is none; None where it must be refused."""
    kind = values.type
    text = kind.value_type if pa.types.is_dictionary(kind) else kind
    items = [] if pa.types.is_temporal(text) else values.to_pylist()
    if pa.types.is_string(text) or pa.types.is_large_string(text) or text == pa.string_view():
        found = [math.nan if item is None else oracle.number(item) for item in items]
    elif _numeric(kind) or (pa.types.is_boolean(kind) and role == "humidity"):
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
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        seconds = [float(value) for value in values.to_pylist()]
        return ("seconds", seconds) if all(map(math.isfinite, seconds)) else None
    if kind in DAYS:
        days = values.cast(pa.date32()).view(pa.int32()) if isinstance(values, pa.Array) else None
        stamps = [day * 86_400 * 10**9 for day in days.to_pylist()]
        return ("datetime", stamps) if all(abs(stamp) <= LAST for stamp in stamps) else None
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        stamps = [tick * (10**9 // UNITS[kind.unit]) for tick in values.view(pa.int64()).to_pylist()]
        local = pa.types.is_timestamp(kind) and kind.tz not in (None, "UTC")  # a date in its zone too
        if any(abs(stamp) > LAST - 86_400 * 10**9 * local for stamp in stamps):
            return None
        if pa.types.is_duration(kind):
            return "timedelta", stamps
        return ("datetime" if kind.tz is None else "datetime with time zone"), stamps
    return None


def _labels(values: Any) -> list[Any] | None:
    """Labels of runs; None where a column cannot be one, or a row has none."""
    kind = values.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        values = values.view(pa.int64())
    elif kind in DAYS:
        values = values.cast(pa.date32()).view(pa.int32())
    elif pa.types.is_nested(kind) or pa.types.is_time(kind) or "binary" in str(kind):
        return None
    if pa.types.is_dictionary(kind) and "string" not in str(kind.value_type):
        return None
    labels = values.to_pylist()
    return None if any(label is None or label != label for label in labels) else labels


def expected(table: Any, run_column: str | None, used: tuple[str, ...] = ROLES[:3]) -> Expected | None:
    """The log as a frame of floats and times; None where it must be refused, or where the oracle does not say."""
    whole = {name: table.column(name).combine_chunks() for name in table.column_names}
    found = {name: numbers(whole[name], name) for name in used}
    when = times(whole["time"])
    if None in found.values() or when is None:
        return None
    frame = pd.DataFrame(found)
    labels: list[Any] = [None] * ROWS
    if run_column is not None:
        given = _labels(whole[run_column])
        if given is None:
            return None
        labels = frame[run_column] = pd.factorize(pd.Series(given, dtype=object))[0].tolist()
    last: dict[Any, Any] = {}
    for label, stamp in zip(labels, when[1], strict=True):
        if label in last and stamp <= last[label]:
            return None
        last[label] = stamp
    if when[0] == "timedelta":
        frame["time"] = pd.to_timedelta(when[1], unit="ns")
    else:
        frame["time"] = times_of(when[1], when[0])
    return frame, when[0], when[1]


# ------------------------------------------------------------------------------------------------------------- checks


def _model(frame: Any, run_column: str | None) -> DynamicBiasRegressor:
    stamped = isinstance(frame, pd.DataFrame) and isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex)
    stamped = stamped or getattr(frame, "index_name", None) is not None
    return DynamicBiasRegressor(
        "temperature", [6.0, 20.0], 1, time=None if stamped else "time", run=run_column, effects=[Covariate("humidity")]
    )


def _outcome(fit: Any) -> tuple[np.ndarray | None, np.ndarray | None, str]:
    """Coefficients and corrected readings, or the sentence that refuses the log."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return (*fit(), "")
    except Exception as error:
        refused(error)
        return None, None, str(error)[:300]


def readers(rng: random.Random, room: Room) -> str:
    """`ParquetLog` against `read_table`, and both against the oracle."""
    table, said, run_column = made(rng)
    room.said.append(said)
    return check_readers(table, run_column, room, rng.choice([7, 1000]))


def _write(table: Any, room: Room, size: int) -> Any:
    path = room.folder / "log.parquet"
    try:
        parquet.write_table(table, path, row_group_size=size)
    except (pa.ArrowException, ValueError):  # a type that Parquet does not know
        return None
    return path


def check_readers(table: Any, run_column: str | None, room: Room, size: int) -> str:
    path = _write(table, room, size)
    if path is None:
        return REFUSED

    def of_log() -> tuple[Any, Any]:
        log = ParquetLog(path)
        model = _model(log, run_column).fit(log, log["reading"])
        blocks = pd.concat(list(model.evaluate_blocks(log, log["reading"])))  # rows without a temperature left out
        return model.coef_, blocks["corrected"].reindex(range(ROWS)).to_numpy()

    def of_frame() -> tuple[Any, Any]:
        frame = read_table(path)
        model = _model(frame, run_column).fit(frame.drop(columns="reading"), frame["reading"])
        return model.coef_, model.evaluate(frame.drop(columns="reading"), frame["reading"])["corrected"].to_numpy()

    log, frame, wanted = _outcome(of_log), _outcome(of_frame), expected(parquet.read_table(path), run_column)
    text = re.search("holds (dictionary<values=)?(large_)?string", log[2])  # numbers and dates as text: frames only
    if (log[0] is None) != (frame[0] is None) and not (log[0] is None and text):
        raise Found(WRONG, f"the readers disagree: {log[2] or 'accepted'!r} and {frame[2] or 'accepted'!r}")
    reached = frame if log[0] is None else log
    if wanted is None or reached[0] is None:
        if reached[0] is not None and not _text_times(table):
            raise Found(WRONG, "accepted what the oracle refuses")
        return REFUSED
    for name in ROLES[:3]:
        exact = wanted[0][name].to_numpy()
        if log[0] is not None and not np.array_equal(ParquetLog(path)[name][:], exact, equal_nan=True):
            raise Found(WRONG, f"ParquetLog has other numbers in {name}")
        if not np.array_equal(np.asarray(numeric_column(read_table(path), name), float), exact, equal_nan=True):
            raise Found(WRONG, f"read_table has other numbers in {name}")
    for coef, corrected, words in (log, frame):
        if not words and not _agree(wanted[0], run_column, coef, corrected):
            raise Found(WRONG, f"{'ParquetLog' if coef is log[0] else 'read_table'} gives other corrected readings")
    return RIGHT


def _text_times(table: Any) -> bool:
    return "string" in str(table.schema.field("time").type)


def _agree(frame: pd.DataFrame, run_column: str | None, coef: Any, corrected: Any) -> bool:
    wanted = _outcome(lambda: _fit(frame, run_column))
    if wanted[0] is None:
        return False
    size = np.nanmax(abs(frame[["temperature", "reading"]].to_numpy()))
    return np.allclose(coef, wanted[0], rtol=1e-6) and np.allclose(
        corrected, wanted[1], rtol=1e-9, atol=1e-9 * size, equal_nan=True
    )


def _fit(frame: pd.DataFrame, run_column: str | None) -> tuple[Any, Any]:
    model = _model(frame, run_column).fit(frame.drop(columns="reading"), frame["reading"])
    return model.coef_, model.evaluate(frame.drop(columns="reading"), frame["reading"])["corrected"].to_numpy()


def correct(rng: random.Random, room: Room) -> str:
    """`correct log.parquet` with a model that was fitted to what the oracle makes of the log."""
    table, said, run_column = made(rng)
    room.said.append(said)
    return check_correct(table, None if run_column is None else "run", room)


def check_correct(table: Any, run_column: str | None, room: Room) -> str:
    path = _write(table, room, 1000)
    if path is None:
        return REFUSED
    back = parquet.read_table(path)
    wanted = None if run_column is not None else expected(back, None)
    if wanted is None:  # the model of another log: a sentence, or rows that are named
        run("correct", "--model", room.subjects["dates"].path, path)
        return REFUSED
    frame, _, stamps = wanted
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            model = _model(frame, None).fit(frame.drop(columns="reading"), frame["reading"])
        except ValueError:
            return REFUSED
        save_model(model, room.folder / "model.json")
    done = run("correct", "--model", room.folder / "model.json", path)
    if done.status == 2:
        raise Found(REFUSED_GOOD, done.said[-1])
    values = {name: frame[name].to_numpy() for name in ("temperature", "humidity")}
    live = OnlineCorrector(model).update_stamps(np.array(stamps), values, frame["reading"].to_numpy())
    names, *rows = csv.reader(io.StringIO(done.out.decode("utf-8"), newline=""))
    if len(rows) != len(frame):
        raise Found(WRONG, f"{len(rows)} rows of {len(frame)} are corrected: {done.said[:1]}")
    at = names.index("corrected")
    for k, (row, value, bias) in enumerate(zip(rows, live.corrected, live.bias, strict=True)):
        got = [math.nan if cell == "" else float(cell) for cell in row[at : at + 2]]
        if not np.allclose(got, [value, bias], rtol=1e-12, atol=1e-12, equal_nan=True):
            raise Found(WRONG, f"row {k}: corrected and bias are {got} and not {[value, bias]}")
    return RIGHT


def analyze(rng: random.Random, room: Room) -> str:
    """`analyze log.parquet`, and `correct` with the model that it wrote."""
    table, said, run_column = made(rng)
    room.said.append(said)
    return check_analyze(table, run_column, room)


def check_analyze(table: Any, run_column: str | None, room: Room) -> str:
    path, out = _write(table, room, 1000), room.folder / "out"
    if path is None:
        return REFUSED
    options = ["--reading", "reading", "--time-constants", "6,20", "--blocks", "2", "--quiet", "--out", out]
    options += [] if run_column is None else ["--run", run_column]
    done = run("analyze", path, *options)
    wanted = expected(parquet.read_table(path), run_column, ("temperature", "reading"))
    if done.status == 2:
        return REFUSED
    if wanted is None and not _text_times(table):
        raise Found(WRONG, "accepted what the oracle refuses")
    again = run("correct", "--model", out / "model.json", path)
    names, *rows = csv.reader(io.StringIO((out / "corrected.csv").read_text("utf-8"), newline=""))
    shown = list(csv.reader(io.StringIO(again.out.decode("utf-8"), newline="")))
    if again.status == 2 or len(shown) - 1 != len(rows):
        raise Found(WRONG, f"correct does not take the log that analyze took: {again.said[:1]}")
    for k, (row, other) in enumerate(zip(rows, shown[1:], strict=True)):
        flags = row[names.index("flag")], other[shown[0].index("flag")]
        values = row[names.index("corrected")], other[shown[0].index("corrected")]
        if flags[0] == flags[1] and values[0] != values[1]:
            raise Found(WRONG, f"row {k}: analyze wrote {values[0]}, correct {values[1]}")
    return RIGHT
