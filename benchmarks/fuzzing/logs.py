"""Spoiled CSV logs through `correct`, against the oracle, and through `analyze`, against `correct`."""

import contextlib
import csv
import io
import math
import os
import random
import re

import numpy as np
import pandas as pd

from thermocorr import OnlineCorrector

from . import oracle
from .mutations import spoiled
from .outcomes import NAMED, OTHER, REFUSED, REFUSED_GOOD, RIGHT, WRONG, Done, Found, Room, run
from .subjects import ROWS, Subject

_LEFT_OUT = re.compile(r"thermocorr: line (\d+) is left out: ")
_COUNTED = re.compile(r"got no result: (\d+) lines left out")
TIMED = ("dates", "zoned", "seconds", "runs", "numbered")
TABLES = ("dates", "zoned", "seconds")
_NAMED = 20  # so many bad lines are named, further ones counted


def _wrong(text: str) -> Found:
    return Found(WRONG, text)


def a_log(rng: random.Random, room: Room, names: tuple[str, ...]) -> tuple[Subject, bytes]:
    """A spoiled log of one of these subjects, kept in the room."""
    subject = room.subjects[rng.choice(names)]
    start = rng.choice([0, 40, 60])
    content = spoiled(subject.cells[start : rng.choice([start + 25, ROWS])], rng)
    room.said.append(f"{subject.name}, {len(content)} bytes")
    return subject, content


def shown_by(done: Done) -> list[list[str]]:
    """Header and rows that a command has printed."""
    return list(csv.reader(io.StringIO(done.out.decode("utf-8"), newline="")))


# ---- correct ---------------------------------------------------------------------------------------------------------
def correct(rng: random.Random, room: Room) -> str:
    """`correct --model m.json log.csv`: every row that the oracle has, with the corrector's own numbers for it."""
    subject, content = a_log(rng, room, (*TIMED, "rows"))
    log = oracle.log(content, subject.roles)
    done = run("correct", "--model", subject.path, room.write("log.csv", content))
    return _same_rows(subject, log, done, exact=True)


def follow(rng: random.Random, room: Room) -> str:
    """The same through a pipe, row by row."""
    subject, content = a_log(rng, room, TIMED)
    content = content[:60_000]
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
    foreign = any(line.startswith("thermocorr: read as: ") for line in done.said)
    if log.header is None or foreign:  # another dialect, perhaps, which the oracle does not know
        return REFUSED if done.status == 2 else OTHER
    if done.status == 2:
        if (
            all(row.verdict in ("row", "skipped") for row in log.rows)
            and not log.torn
            and "has a line of more than" not in done.said[-1]
        ):
            raise Found(REFUSED_GOOD, done.said[-1])
        return REFUSED
    n = len(log.header)
    names, *rows = shown_by(done)
    used = _used(log, done, [row[:n] for row in rows])
    if names[:n] != log.header:
        raise _wrong(f"header {names}")
    if len(rows) != len(used) or not all(_alike(row[:n], one.fields) for row, one in zip(rows, used, strict=True)):
        raise _wrong(f"{len(rows)} rows shown, {len(used)} expected, or other cells in them")
    for row, cells, (corrected, bias, flag) in zip(used, rows, _expected(subject, used), strict=True):
        said = cells[n:]
        if not (_equal(said[0], corrected, exact) and _equal(said[1], bias, exact) and (said[2] == flag or not exact)):
            raise _wrong(f"line {row.number}: {said} instead of {[corrected, bias, flag]}")
    return NAMED if done.status else RIGHT


def _alike(shown: list[str], given: list[str]) -> bool:
    """True for the same cells, or the same numbers in other digits, as a log read as a table has them."""
    return len(shown) == len(given) and all(
        one == other or oracle.number(one) == oracle.number(other) is not None
        for one, other in zip(shown, given, strict=True)
    )


def _used(log: oracle.Log, done: Done, shown: list[list[str]]) -> list[oracle.Row]:
    """Rows that must be in the output; Found where other lines were left out than should be.

    Where not all of these are named, a row that may be left out was used if it stands next in what is `shown`, and
    their count must be the one that is said at the end.
    """
    named = {int(found[1]) for line in done.said if (found := _LEFT_OUT.match(line))}
    out = {row.number for row in log.rows if row.verdict == "out"} | ({len(log.rows) + 2} if log.torn else set())
    may = {row.number for row in log.rows if row.verdict == "may"}
    counted = len(named) >= _NAMED
    missed = out - named if not counted else set() if may else set(sorted(out)[:_NAMED]) - named
    if missed:
        raise _wrong(f"lines {sorted(missed)[:5]} must be left out and named; named are {sorted(named)[:9]}")
    if extra := named - out - may:
        raise Found(REFUSED_GOOD, next(line for line in done.said if f"line {min(extra)} is" in line))
    late = bool(done.said) and "time" in done.said[-1]
    if (done.status == 1) != bool(out or named) and not late:
        raise _wrong(f"exit status {done.status} where {len(out)} lines are left out")
    rows = [row for row in log.rows if row.verdict in ("row", "may") and row.number not in named]
    if not counted:
        return rows
    used: list[oracle.Row] = []
    for row in rows:
        if row.verdict == "row" or shown[len(used) : len(used) + 1] == [row.fields]:
            used.append(row)
    left_out = len(out | may | named) - sum(row.verdict == "may" for row in used)
    if (said := _COUNTED.search(done.said[-1])) is None or int(said[1]) != left_out:
        raise _wrong(f"{left_out} lines are left out, and said is: {done.said[-1]}")
    return used


def _expected(subject: Subject, rows: list[oracle.Row]) -> list[tuple[float, float, str]]:
    """What a live corrector says of these rows; that it says what the whole record says, `live_cases.py` looks at."""
    if not rows:
        return []
    roles = subject.roles
    values = {name: np.array([row.values[name] for row in rows]) for name in rows[0].values}
    stamps = None if roles.time is None else np.array([row.stamp for row in rows])
    runs = None if roles.run is None else pd.Series([row.run for row in rows], dtype=object)
    reading = values.pop(roles.reading)
    got = OnlineCorrector(subject.model).update_stamps(stamps, values, reading, runs)
    return list(zip(got.corrected, got.bias, got.flags, strict=True))


def _equal(cell: str, value: float, exact: bool) -> bool:
    if cell == "" or math.isnan(value):
        return cell == "" and math.isnan(value)
    got = float(cell)
    return got == value or (not exact and math.isclose(got, value, rel_tol=1e-7, abs_tol=1e-7))


def resume(rng: random.Random, room: Room) -> str:
    """A log in two parts, with a saved state between them, against the whole at once."""
    subject, content = a_log(rng, room, TIMED)
    whole = run("correct", "--model", subject.path, room.write("log.csv", content))
    if whole.status == 2 or b"\r" in content:  # a log whose first times have another zone, or no header
        return REFUSED if whole.status == 2 else RIGHT
    lines = content.splitlines(keepends=True)
    grows, cut = rng.random() < 0.5, rng.randrange(1, len(lines) + 1)
    plain = [line.replace(b'"', b"") for line in lines]
    # another file may begin with rows that were there before, bad ones aside: these are left out
    grows = grows or any(line in plain[1:cut] for line in plain[cut:])
    room.said.append(f"cut before line {cut + 1}, {'the same file grows' if grows else 'two files'}")
    state, out = room.folder / "state.json", room.folder / "out.csv"
    second = lines if grows else [*lines[:1], *lines[cut:]]
    for name, part in (("log.csv", lines[:cut]), ("log.csv" if grows else "second.csv", second)):
        path = room.write(name, b"".join(part))
        if run("correct", "--model", subject.path, path, "--state", state, "--out", out).status == 2:
            return REFUSED  # a file whose first times have another zone
    if out.read_bytes() != whole.out:
        raise _wrong(f"two parts, cut before line {cut + 1}, give other rows than the whole")
    return RIGHT


def _is_good(log: oracle.Log) -> bool:
    """True if a whole log has nothing to refuse: 24 rows in even steps, a temperature and a reading in each."""
    if log.header is None or log.torn or {row.verdict for row in log.rows} != {"row"} or len(log.rows) < 24:
        return False
    steps = np.diff([float(row.stamp) for row in log.rows if row.stamp is not None])
    values = np.array([[row.values["temperature"], row.values["reading"]] for row in log.rows])
    even = len(steps) and 0 < steps.max() < 5 * steps.min()
    return bool(even and np.isfinite(values).all() and np.ptp(values, axis=0).all())


def analyze(rng: random.Random, room: Room) -> str:
    """`analyze`, which reads a log as a whole, and `correct` with its model: the same rows and corrected readings."""
    subject, content = a_log(rng, room, TABLES)
    log, out = room.write("log.csv", content), room.folder / "out"
    options = ["--reading", "reading", "--time-constants", "10min,2h", "--blocks", "2", "--quiet", "--out", out]
    done = run("analyze", log, *options)
    if done.status == 2:
        if _is_good(oracle.log(content, subject.roles)):
            raise Found(REFUSED_GOOD, done.said[-1])
        return REFUSED
    if not (out / "model.json").exists():  # no correction is advised
        return RIGHT
    again = run("correct", "--model", out / "model.json", log)
    if again.status == 2:
        if b"\r" in content:  # a line of a plain log holds none
            return REFUSED
        raise _wrong(f"correct does not take the log that analyze took: {again.said[-1:]}")
    if again.status == 1:  # correct names lines that are no rows of plain CSV, such as 1 000 with a blank
        return NAMED
    tables = [(out / "corrected.csv").read_bytes(), again.out]
    whole, lines = (pd.read_csv(io.BytesIO(table), dtype=str, keep_default_na=False) for table in tables)
    readings = [np.array([oracle.number(cell) for cell in table["reading"]], float) for table in (whole, lines)]
    if not np.array_equal(*readings, equal_nan=True):
        raise _wrong(f"analyze took {len(whole)} rows and correct {len(lines)}, or other readings")
    differ = (whole["flag"] == lines["flag"]) & (whole["corrected"] != lines["corrected"])
    if differ.any():
        k = int(differ.argmax())
        raise _wrong(f"row {k}: analyze wrote {whole['corrected'][k]}, correct {lines['corrected'][k]}")
    return RIGHT
