"""Power cuts, interrupts and full disks: does a command ever lose a row, harm a file, or leave something behind?

    python benchmarks/crash.py                       # 300 moments for each way of running and each signal
    python benchmarks/crash.py --moments 40 --only pipe

SIGTERM, SIGINT and SIGKILL come at random moments (a third in the start, the middle and the end each, as an undisturbed
run has them) and at calls that open, write, rename or remove a file: before it, after it, or with half of the bytes
written. SIGKILL is a power cut at times, which takes rows that were not brought to the disk. Then the command is run
again to its end, and its results are compared with those of an undisturbed run.

Then the disk is full: at each such call once, from it on, for files above a given size, and (as root, or under
`unshare -rm`) on a real file system of a few pages. The command must end with status 2 and one sentence, leave what was
there, and do its work when it is run again.

A new process spends most of its time with imports. Here one process imports the package and forks a child for each
moment, which takes the signal handlers of a new process and calls `thermocorr.command.cli.main`; constants of the
package are made small, so that the state is saved every 10 ms. Rows named "new processes" are without all this: what
the interpreter shows of an interrupt before the package is there is not counted.

Prints what was found, one line for each way of running and each signal, and ends with status 1 if anything is wrong.
The same seed makes the same choices; what a process does at a time is for the system to say.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported: a process with threads must not fork

from crashing.calls import Disturbance
from crashing.episodes import (
    Analyze,
    Episode,
    Export,
    Growing,
    NewProcesses,
    PipeAgain,
    PipeAgainDamaged,
    PipeRest,
    PipeRestDamaged,
    Whole,
    WithState,
    known,
)
from crashing.full import FULL, disk_full
from crashing.judging import APART, FAULTS, disturbed
from crashing.lab import Lab, make_lab

KINDS = (
    Whole, WithState, PipeRest, PipeRestDamaged, PipeAgain, PipeAgainDamaged, Growing, Analyze, Export, NewProcesses
)  # fmt: skip
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)
AGAIN = 0.25
"""How often a process that goes on is ended too."""
MEMORY = Path("/dev/shm")
"""A file system that no disk slows down."""
NAMED = 4
"""Kinds of findings in words, for each line of the table."""


def moments(
    kind: type[Episode], lab: Lab, rng: random.Random, number: int, n: int, calls_only: bool
) -> list[list[Disturbance]]:
    """When the signal comes: two thirds of them at random times, the others at calls."""
    usual = known(kind, lab)[1]
    calls = range(1, usual.calls + 1)
    at_calls = rng.sample(calls, min(len(calls), n if calls_only else n // 3))
    n = len(at_calls) if calls_only else n
    chosen = [Disturbance(number, None, call, rng.choice(["before", "half", "after"])) for call in at_calls]
    chosen += [Disturbance(number, _time(rng, usual.seconds, k)) for k in range(n - len(chosen))]
    again = kind.appends and not issubclass(kind, PipeRest | NewProcesses)
    return [
        [one, Disturbance(number, _time(rng, usual.seconds, rng.randrange(3)))]
        if again and rng.random() < AGAIN
        else [one]
        for one in chosen
    ]


def _time(rng: random.Random, seconds: float, k: int) -> float:
    """A moment in the start, the middle or the end of a run [s]."""
    return seconds * rng.uniform(*[(0.0, 0.2), (0.2, 0.8), (0.8, 1.05)][k % 3])


def line(name: str, what: str, n: int, found: Counter[str], seconds: float) -> str:
    """A line of the table."""
    return f"{name:30} {what:16}{n:8}" + "".join(f"{found[key]:11}" for key in (*FAULTS, *APART)) + f"{seconds:8.0f}"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=300, help="for each way of running and each signal")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=[""], metavar="NAME", help="lines whose name holds one of these")
    parser.add_argument("--calls", action="store_true", help="signals at calls only, not at random times")
    options = parser.parse_args()
    wrong, only = 0, options.only
    heads = "".join(f"{head:>11}" for head in (*FAULTS, *APART))
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as work:
        lab = make_lab(Path(work))
        print(f"{'command':30} {'ended by':16}{'moments':>8}{heads}{'s':>8}", flush=True)
        for kind in KINDS:
            for number in SIGNALS:
                if any(name in f"{kind.name}, {number.name}" for name in only):
                    wrong += _ended_by(kind, lab, number, options)
        for kind in FULL:
            if any(name in f"{kind.name}, disk full" for name in only):
                for what, n, found, notes, seconds in disk_full(kind, lab, options.moments):
                    wrong += _shown(kind.name, what, n, found, notes, seconds)
    print(f"{wrong} findings" if wrong else "nothing is wrong")
    return 1 if wrong else 0


def _ended_by(kind: type[Episode], lab: Lab, number: signal.Signals, options: argparse.Namespace) -> int:
    rng = random.Random(f"{options.seed} {kind.name} {number}")
    n = options.moments if kind is not NewProcesses else max(3, options.moments // 40)
    found, notes, began = Counter[str](), list[str](), time.monotonic()
    chosen = moments(kind, lab, rng, number, n, options.calls)
    for disturbances in chosen:
        found += disturbed(kind, lab, rng, disturbances, notes)
    return _shown(kind.name, number.name, len(chosen), found, notes, time.monotonic() - began)


def _shown(name: str, what: str, n: int, found: Counter[str], notes: list[str], seconds: float) -> int:
    print(line(name, what, n, found, seconds), flush=True)
    alike = Counter(map(_kind_of, notes))
    first = {_kind_of(note): note for note in reversed(notes)}
    for key, count in alike.most_common(NAMED):
        print(f"    {count} times such as {first[key]}", flush=True)
    return sum(found[key] for key in FAULTS)


def _kind_of(note: str) -> str:
    """What notes of one kind have in common: the faults, and the end of what was said."""
    faults = re.search(r"{.*?}", note)
    said = note.rstrip("\\n'").rpartition("\\n")[2]
    return re.sub(r"\d+", "", (faults[0] if faults else "") + said[-60:])


if __name__ == "__main__":
    sys.exit(main())
