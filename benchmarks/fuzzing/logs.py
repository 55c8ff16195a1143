"""Spoiled CSV logs through `correct`, `analyze` and the reader below them, against the oracle."""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
import random
import re
import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from thermocorr import OnlineCorrector, RecordError, load_model
from thermocorr.files.model_file import data_digest
from thermocorr.records.files import read_table
from thermocorr.records.read import Layout, read_record

from . import oracle
from .mutations import spoiled
from .outcomes import NAMED, REFUSED, REFUSED_GOOD, RIGHT, WRONG, Done, Found, Room, refused, run
from .subjects import ROWS, Subject, times_of

_LEFT_OUT = re.compile(r"thermocorr: line (\d+) is left out: ")
_COUNTED = re.compile(r"got no result: (\d+) lines left out")
KINDS = ("dates", "zoned", "seconds", "runs", "numbered", "rows")
KINDS_WITH_TIMES = KINDS[:-1]
_NAMED = 20
"""So many bad lines are named, further ones counted."""


def _wrong(text: str) -> Found:
    return Found(WRONG, text)


def a_log(rng: random.Random, room: Room, names: tuple[str, ...]) -> tuple[Subject, bytes]:
    """A spoiled log of one of these subjects, kept in the room."""
    subject = room.subjects[rng.choice(names)]
    start = rng.choice([0, 40, 60])
    content = spoiled(subject.cells[start : rng.choice([start + 25, ROWS])], rng)
    room.said.append(f"{subject.name}, {len(content)} bytes")
    return subject, content


# ------------------------------------------------------------------------------------------------------- correct


def correct(rng: random.Random, room: Room) -> str:
    """`correct --model m.json log.csv`: every row that the oracle has, with the corrector's own numbers for it."""
    subject, content = a_log(rng, room, KINDS)
    return check_correct(subject, content, room)


def check_correct(subject: Subject, content: bytes, room: Room) -> str:
    log = oracle.log(content, subject.roles)
    done = run("correct", "--model", subject.path, room.write("log.csv", content))
    if subject.name == "rows" and done.status == 2 and any(row.verdict == "out" for row in log.rows):
        return REFUSED  # its rows are placed in the fitted record, which takes a log without holes
    return _same_rows(subject, log, done, exact=True)


def follow(rng: random.Random, room: Room) -> str:
    """The same through a pipe, row by row."""
    subject, content = a_log(rng, room, KINDS_WITH_TIMES)
    return check_follow(subject, content[:60_000])


def check_follow(subject: Subject, content: bytes) -> str:
    reading, writing = os.pipe()
    before = {*os.listdir("/dev/fd"), str(writing)}
    try:
        os.write(writing, content)
        os.close(writing)
        done = run("correct", "--follow", "--model", subject.path, f"/dev/fd/{reading}")
    finally:
        os.close(reading)
        for left in set(os.listdir("/dev/fd")) - before | {str(writing)}:  # what the command leaves open
            with contextlib.suppress(OSError):
                os.close(int(left))
    return _same_rows(subject, oracle.log(content, subject.roles), done, exact=False)


def _same_rows(subject: Subject, log: oracle.Log, done: Done, exact: bool) -> str:
    if log.header is None or done.status == 2:
        if log.header is None and done.status != 2:
            raise _wrong("the header must be refused")
        if log.header is not None and "has a line of more than" not in done.said[-1]:
            raise Found(REFUSED_GOOD, done.said[-1])
        return REFUSED
    shown = list(csv.reader(io.StringIO(done.out.decode("utf-8"), newline="")))
    used = _used(log, done, [row[: len(log.header)] for row in shown[1:]])
    if shown[0][: len(log.header)] != log.header:
        raise _wrong(f"header {shown[0]}")
    if [row[: len(log.header)] for row in shown[1:]] != [row.fields for row in used]:
        raise _wrong(f"{len(shown) - 1} rows shown, {len(used)} expected, or other cells in them")
    expected = _expected(subject, used)
    for row, cells, (corrected, bias, flag) in zip(used, shown[1:], expected, strict=True):
        said = cells[len(log.header) :]
        if not (_equal(said[0], corrected, exact) and _equal(said[1], bias, exact) and (said[2] == flag or not exact)):
            raise _wrong(f"line {row.number}: {said} instead of {[corrected, bias, flag]}")
    return NAMED if done.status else RIGHT


def _used(log: oracle.Log, done: Done, shown: list[list[str]]) -> list[oracle.Row]:
    """Rows that must be in the output; Found where other lines were left out than should be.

    Where not all of these are named, a row that may be left out was used if it stands next in what is `shown`, and
    their count must be the one that is said at the end.
    """
    named = {int(found[1]) for line in done.said if (found := _LEFT_OUT.match(line))}
    torn = len(log.rows) + 2
    out = {row.number for row in log.rows if row.verdict == "out"} | ({torn} if log.torn else set())
    may = {row.number for row in log.rows if row.verdict == "may"}
    if len(named) >= _NAMED:
        out |= may  # cannot be told apart any more
        missed, extra = sorted(out)[:_NAMED] if not may else [], named - out
    else:
        missed, extra = out - named, named - out - may
    if missed and not set(missed) <= named:
        raise _wrong(f"lines {sorted(missed)[:5]} must be left out and named; named are {sorted(named)[:9]}")
    if extra:
        at = sorted(extra)[0]
        why = next(line for line in done.said if f"line {at} is" in line)
        raise Found(REFUSED_GOOD, why)
    if (done.status == 1) != bool(out or named) and not _late(done):
        raise _wrong(f"exit status {done.status} where {len(out)} lines are left out")
    rows = [row for row in log.rows if row.verdict in ("row", "may") and row.number not in named]
    if len(named) < _NAMED:
        return rows
    used: list[oracle.Row] = []
    for row in rows:
        if row.verdict == "row" or shown[len(used) : len(used) + 1] == [row.fields]:
            used.append(row)
    left_out = len(out | named) - sum(row.number in out for row in used)
    if (said := _COUNTED.search(done.said[-1])) is None or int(said[1]) != left_out:
        raise _wrong(f"{left_out} lines are left out, and said is: {done.said[-1]}")
    return used


def _late(done: Done) -> bool:
    return bool(done.said) and "time" in done.said[-1]


def _expected(subject: Subject, rows: list[oracle.Row]) -> list[tuple[float, float, str]]:
    if not rows:
        return []
    live = OnlineCorrector(subject.model)
    names = rows[0].values
    values = {n: np.array([row.values[n] for row in rows]) for n in names if n != subject.roles.reading}
    reading = np.array([row.values[subject.roles.reading] for row in rows])
    stamps = None if subject.roles.time is None else np.array([row.stamp for row in rows])
    runs = None if subject.roles.run is None else pd.Series([row.run for row in rows], dtype=object)
    got = live.update_stamps(stamps, values, reading, runs)
    if stamps is not None and _orderly(subject, rows):
        _check_whole(subject, rows, got.corrected)
    return list(zip(got.corrected, got.bias, got.flags, strict=True))


def _orderly(subject: Subject, rows: list[oracle.Row]) -> bool:
    """Whether the rows are in order, and of a size that no reading of the temperature loses to rounding."""
    T = [row.values[subject.roles.temperature] for row in rows]
    forward = all(b.stamp > a.stamp for a, b in pairwise(rows))
    changes = sum(a.run != b.run for a, b in pairwise(rows))
    if changes >= len({row.run for row in rows}):
        return False  # runs take turns: the whole record puts each together, a stream cannot
    return forward and all(not abs(value) > 1e3 for row in rows for value in row.values.values()) and any(
        not math.isnan(value) for value in T
    )  # fmt: skip


def _check_whole(subject: Subject, rows: list[oracle.Row], corrected: np.ndarray) -> None:
    """The whole record at once, as `DynamicBiasRegressor.correct` has it."""
    frame = pd.DataFrame([row.values for row in rows])
    frame["time"] = times_of([row.stamp for row in rows], subject.roles.kind)
    if subject.roles.run is not None:
        frame["run"] = [row.run for row in rows]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            whole = subject.model.correct(frame.drop(columns="reading"), frame["reading"]).to_numpy()
    except RecordError:
        return  # not a row with all its numbers
    if not np.allclose(whole, corrected, rtol=1e-9, atol=1e-9, equal_nan=True):
        raise _wrong(f"live and whole differ by {np.nanmax(abs(whole - corrected)):.2e}")


def _equal(cell: str, value: float, exact: bool) -> bool:
    if cell == "" or math.isnan(value):
        return cell == "" and math.isnan(value)
    got = float(cell)
    return got == value or (not exact and math.isclose(got, value, rel_tol=1e-7, abs_tol=1e-7))


# ------------------------------------------------------------------------------------------------- analyze and below

_TABLES = ("dates", "zoned", "seconds")


def read(rng: random.Random, room: Room) -> str:
    """`read_table` and `read_record`, what `analyze` begins with."""
    subject, content = a_log(rng, room, _TABLES)
    return check_read(subject, content, room)


def check_read(subject: Subject, content: bytes, room: Room) -> str:
    expected = oracle.table(content, subject.roles)
    path = room.write("log.csv", content)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            frame = read_table(path)
            time = next((name for name in oracle.TIME_NAMES if name in frame.columns), None)
            if time is None:
                return REFUSED
            record = read_record(frame.drop(columns="reading"), Layout("temperature", time), y=frame["reading"])
    except Exception as error:
        return _refusal(error, expected)
    if expected is None:
        raise _wrong("accepted what the oracle refuses")
    torn = not content.endswith(b"\n")
    if torn != any("is left out" in str(warning.message) for warning in caught):
        raise _wrong("the last line is torn, and that is not said")
    _same_record(expected, record)
    return NAMED if torn else RIGHT


def _refusal(error: Exception, expected: oracle.Table | None) -> str:
    if isinstance(error, KeyError) and "reading" in str(error):
        return REFUSED  # the command looks for the column first
    outcome = refused(error)
    if expected is not None and expected.sure and any(not math.isnan(value) for value in expected.temperature):
        raise Found(REFUSED_GOOD, str(error)[:300])
    return outcome


def _same_record(expected: oracle.Table, record: Any) -> None:
    T = np.asarray(record.columns[record.temperature_name], float)
    for what, got, wanted in (
        ("temperature", T, expected.temperature), ("reading", np.asarray(record.reading, float), expected.reading),
    ):  # fmt: skip
        if not np.array_equal(got, wanted, equal_nan=True):
            raise _wrong(f"other numbers in {what}")
    if record.times.kind != expected.kind or [record.times.stamp(k) for k in range(len(T))] != expected.stamps:
        raise _wrong("other times")
    used = {k for segment in record.segments for k in range(segment.start, segment.stop)} - set(record.skipped.tolist())
    if used != {k for k, value in enumerate(expected.temperature) if not math.isnan(value)}:
        raise _wrong("a row without a temperature is not passed over")


def analyze(rng: random.Random, room: Room) -> str:
    """The whole command, its files, and `correct` on the same log with the model that it wrote."""
    subject, content = a_log(rng, room, _TABLES)
    return check_analyze(subject, content, room)


def check_analyze(subject: Subject, content: bytes, room: Room) -> str:
    expected = oracle.table(content, subject.roles)
    log, out = room.write("log.csv", content), room.folder / "out"
    options = ["--reading", "reading", "--time-constants", "10min,2h", "--blocks", "2", "--quiet", "--out", out]
    done = run("analyze", log, *options)
    if done.status == 2:
        return REFUSED
    if expected is None:
        raise _wrong("accepted what the oracle refuses")
    if (not content.endswith(b"\n")) != (b"is left out" in done.out):
        raise _wrong("the last line is torn, and that is not said")
    names, *rows = csv.reader(io.StringIO((out / "corrected.csv").read_text("utf-8"), newline=""))
    if len(rows) != len(expected.cells) or names[: len(expected.names)] != [
        name or f"Unnamed: {i}" for i, name in enumerate(expected.names)
    ]:
        raise _wrong(f"corrected.csv has {len(rows)} rows of {names}")
    for row, cells in zip(rows, expected.cells, strict=True):
        if not all(map(_same_cell, row[: len(cells)], cells)):
            raise _wrong(f"corrected.csv has the row {row} for {cells}")
    return _same_results(expected, names, rows, room, done)


def _same_cell(shown: str, cell: str) -> bool:
    """Whether a cell came through: to the digit where it is a number, as nothing where it says so."""
    if shown == cell:
        return True
    a, b = oracle.switch(shown), oracle.switch(cell)
    if a is None or b is None:  # too large for a measurement, in a column that is not used
        try:
            return math.isfinite(float(cell)) and float(shown) == float(cell)
        except ValueError:
            return False
    return a == b or (math.isnan(a) and math.isnan(b))


def _same_results(expected: oracle.Table, names: list[str], rows: list[list[str]], room: Room, done: Done) -> str:
    out, new = room.folder / "out", len(expected.names)
    model = load_model(out / "model.json")
    X = pd.DataFrame({expected.time: times_of(expected.stamps, expected.kind), "temperature": expected.temperature})
    X = X.reindex(columns=list(model.feature_names_in_))
    y = pd.Series(expected.reading, name="reading")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        evaluated = model.evaluate(X, y)
        digest = data_digest(model, X, y)
    if digest != model.provenance_["data"]["sha256"]:
        raise _wrong("the model was fitted to other data than the log has")
    for k, row in enumerate(rows):
        for name, cell in zip(("corrected", "model", "residual", "flag"), row[new:], strict=True):
            value = evaluated[name].iloc[k]
            if cell != value and not (name != "flag" and _equal(cell, value, True)):
                raise _wrong(f"row {k}: {name} is {cell} and not {value}")
    again = run("correct", "--model", out / "model.json", room.folder / "log.csv")
    shown = list(csv.reader(io.StringIO(again.out.decode("utf-8"), newline="")))[1:]
    if again.status == 2 or len(shown) != len(rows):
        raise _wrong(f"correct does not take the log that analyze took: {again.said[-1:]}")
    for k, (row, other) in enumerate(zip(rows, shown, strict=True)):
        if row[new + 3] == other[new + 2] and row[new] != other[new]:
            raise _wrong(f"row {k}: analyze wrote {row[new]}, correct {other[new]}")
    return NAMED if b"is left out" in done.out else RIGHT


# --------------------------------------------------------------------------------------------------------- states


def resume(rng: random.Random, room: Room) -> str:
    """A log in two parts, with a saved state between them, against the whole at once."""
    subject, content = a_log(rng, room, KINDS_WITH_TIMES)
    lines = content.splitlines(keepends=True)
    log = oracle.log(content, subject.roles)
    if log.header is None or b"\r" in content:
        return REFUSED if run("correct", "--model", subject.path, room.write("log.csv", content)).status == 2 else RIGHT
    grows, cut = rng.random() < 0.5, rng.randrange(1, len(lines) + 1)
    plain = [line.replace(b'"', b"") for line in lines]
    if not grows and any(line in plain[1:cut] for line in plain[cut:]):
        grows = True  # another file may begin with rows that were there before, bad ones aside: these are left out
    room.said.append(f"cut before line {cut + 1}, {'the same file grows' if grows else 'two files'}")
    return check_resume(subject, lines, cut, grows, room)


def check_resume(subject: Subject, lines: list[bytes], cut: int, grows: bool, room: Room) -> str:
    state, out = room.folder / "state.json", room.folder / "out.csv"
    second = lines if grows else [*lines[:1], *lines[cut:]]
    for name, part in (("log.csv", lines[:cut]), ("log.csv" if grows else "second.csv", second)):
        path = room.write(name, b"".join(part))
        run("correct", "--model", subject.path, path, "--state", state, "--out", out)
    whole = run("correct", "--model", subject.path, room.write("log.csv", b"".join(lines)))
    if out.read_bytes() != whole.out:
        raise _wrong(f"two parts, cut before line {cut + 1}, give other rows than the whole")
    return RIGHT
