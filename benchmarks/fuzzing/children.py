"""Files that could take much memory or time, each in a process of its own whose peak is looked at."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from thermocorr.files.model_file import signed

from .outcomes import HANG, MEGABYTES, MEMORY, REFUSED, RIGHT, SECONDS, Found, Room
from .subjects import HEADER, text_of

_CHILD = """
import resource, sys, time
from thermocorr.command.cli import main
usage = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
import thermocorr.pages.report, pyarrow.parquet
before, begin = usage(), time.process_time()
sys.stdout = open({out!r}, "w")
status = main(sys.argv[1:])
print(f"THE END {{status}} {{usage() - before:.0f}} {{time.process_time() - begin:.3f}}", file=sys.stderr)
"""


def in_child(room: Room, *arguments: object, limit: float = 100.0) -> tuple[int, float, float, str]:
    """A command in a process of its own: exit status, memory that it took [MB], time [s], standard error.

    Its time is the processor's, so that a busy machine makes no finding; waiting ends at `limit` [s].
    """
    code = _CHILD.format(out=str(room.folder / "stdout"))
    command = [sys.executable, "-c", code, *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, env=environment, check=False)
    except subprocess.TimeoutExpired:
        raise Found(HANG, f"more than {limit:g} s") from None
    *said, last = done.stderr.splitlines() or [""]
    if not last.startswith("THE END"):
        raise Found("traceback", f"the process ended with {done.returncode}: {last[:300]}")
    status, memory, seconds = last.split()[2:]
    return int(status), float(memory), float(seconds), "\n".join(said)


def _nested(n: int) -> bytes:
    return b"[" + b"[]," * n + b"[]]"


def large(subject: Any, node: dict[str, Any], rng: random.Random) -> tuple[str, str, Callable[[], bytes]]:
    """What to call it, which file it is ("model" or "state" or "log"), and its content."""
    rest = {key: value for key, value in node.items() if key not in ("format", "version", "digest")}

    def forged(change: Callable[[dict[str, Any]], None]) -> bytes:
        other = json.loads(json.dumps(rest))
        change(other["model"])
        return signed(other)

    def long_text(model: dict[str, Any]) -> None:
        model["notes"] = ["x" * 10_000] * 3000

    def long_list(model: dict[str, Any]) -> None:
        model["coefficients"] = [1.0] * 5_000_000

    def harmonics(model: dict[str, Any]) -> None:
        periodic = next(effect for effect in model["effects"] if effect["kind"] == "periodic")
        periodic["parameters"]["harmonics"] = 10_000

    def time_constants(model: dict[str, Any]) -> None:
        model["parameters"]["time_constants"] = [1.0 + k for k in range(400_000)]

    keys = b"{" + b",".join(b'"a": 1' for _ in range(2_000_000)) + b"}"
    row = text_of(HEADER, [subject.cells[0]]).splitlines(keepends=True)
    cases: list[tuple[str, str, Callable[[], bytes]]] = [
        ("30 MB of lists", "model", lambda: _nested(10_000_000)),
        ("30 MB of lists", "state", lambda: _nested(10_000_000)),
        ("190 000 lists, 30 MB of numbers", "model", lambda: _nested(150_000)[:-1] + b",0" * 14_000_000 + b"]"),
        ("30 MB of numbers", "state", lambda: b"[" + b"1," * 15_000_000 + b"1]"),
        ("the same key 2 000 000 times", "model", lambda: keys),
        ("20 000 keys, one of them twice", "model", lambda: _keys(20_000)),
        ("600 000 keys, one of them twice", "state", lambda: _keys(600_000)),
        ("a text of 30 MB", "model", lambda: b'{"format": "' + b"x" * 30_000_000 + b'"}'),
        ("a text of 30 MB of escapes", "model", lambda: b'{"format": "' + b"\\u0000" * 5_000_000 + b'"}'),
        ("33 MB", "model", lambda: b" " * 34_000_000),
        ("100 000 brackets deep", "state", lambda: b"[" * 100_000 + b"]" * 100_000),
        ("a number of 30 MB", "model", lambda: b'{"version": ' + b"1" * 30_000_000 + b"}"),
        ("a float of 30 MB", "model", lambda: b'{"version": 1.' + b"1" * 30_000_000 + b"}"),
        ("notes of 30 MB", "model", lambda: forged(long_text)),
        ("5 000 000 coefficients", "model", lambda: forged(long_list)),
        ("10 000 harmonics", "model", lambda: forged(harmonics)),
        ("400 000 time constants", "model", lambda: forged(time_constants)),
        ("a line of 40 MB", "log", lambda: row[0] + b"x" * 40_000_000 + b"\n"),
        ("a header of 40 MB", "log", lambda: b"x," * 20_000_000 + b"\n"),
        ("10 MB of line ends", "log", lambda: row[0] + b"\n" * 10_000_000),
        ("4 MB of bad lines", "log", lambda: row[0] + b"x\n" * 2_000_000),
        ("40 MB of quotes", "log", lambda: row[0] + b'"' * 40_000_000),
    ]
    return rng.choice(cases)


def _keys(n: int) -> bytes:
    return b"{" + b",".join(b'"k%d": 1' % k for k in (*range(n), n - 1)) + b"}"


def memory(rng: random.Random, room: Room) -> str:
    """A large file, refused before it takes much memory."""
    subject, node = room.subjects["victims"]["rich"]
    what, role, content = large(subject, node, rng)
    room.said.append(f"{what} as the {role}")
    path = room.write({"model": "model.json", "state": "state.json", "log": "log.csv"}[role], content())
    log = path if role == "log" else room.write("log.csv", text_of(HEADER, subject.cells[50:80]))
    arguments: list[object] = ["correct", "--model", path if role == "model" else subject.path, log]
    if role == "log" and rng.random() < 0.5:
        arguments = ["analyze", path, "--reading", "reading", "--time-constants", "10min"]
        room.said.append("analyze")
    if role == "state":
        arguments += ["--state", path]
    status, more, seconds, said = in_child(room, *arguments)
    Path(path).unlink()
    if more > MEGABYTES:
        raise Found(MEMORY, f"{'; '.join(room.said)}: {more:.0f} MB more, exit status {status}, {said[-200:]!r}")
    if seconds > (SECONDS if role != "log" else 30.0):  # a log of ten million lines may take its time
        raise Found(HANG, f"{'; '.join(room.said)}: {seconds:.1f} s, exit status {status}")
    if "Traceback" in said or status not in (0, 1, 2):
        raise Found("traceback", said[-400:])
    return REFUSED if status == 2 else RIGHT
